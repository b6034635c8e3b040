"""The log through the interface: who came and went, copies, orders; what people say of it, and who may."""

from datetime import datetime
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from tests.api.conftest import problem, until
from tests.e2e.service import Service


def log(client: httpx.Client, **asked: Any) -> list[dict[str, Any]]:
    return list(client.get("/api/log", params=asked).raise_for_status().json()["entries"])


def test_who_comes_and_goes_is_kept(service: Service, viewer: httpx.Client) -> None:
    token = urlsplit(service.link).query.partition("=")[2]
    with httpx.Client(base_url=service.url) as browser:
        browser.post("/api/session", json={"token": token, "name": "Zoë"}).raise_for_status()
        browser.delete("/api/session").raise_for_status()

    def read_entries() -> list[tuple[str, str]]:
        return [(entry["text"], entry["who"]) for entry in log(viewer, kind="access", words="Zoë")]

    assert until(lambda: read_entries() if len(read_entries()) == 2 else None) == [
        ("signed out", "Zoë"),
        ("signed in as operator", "Zoë"),
    ]
    assert token not in str(log(viewer))


def test_a_copy_of_the_database_is_kept_with_its_name(operator: httpx.Client, viewer: httpx.Client) -> None:
    name = operator.post("/api/system/backups").raise_for_status().json()["name"]
    (newest, *_) = log(viewer, kind="backup")
    assert (newest["text"], newest["who"]) == (f"database copied to {name}", "operator")


def test_a_run_begins_and_ends_in_it_and_an_order_stands_at_its_second(running: httpx.Client) -> None:
    run = running.get("/api/state").json()["recording_run"]
    running.put("/api/references", json={"q_ref": 0.2, "S_ref": 10.5}).raise_for_status()
    tick = running.get("/api/state").json()["tick"]

    def ordered() -> dict[str, Any] | None:
        return next((entry for entry in log(running, kind="references") if entry["run"] == run), None)

    entry = until(ordered)
    assert entry["run"] == run
    assert 0.0 < entry["t"] < tick / 1000
    running.post("/api/mode", json={"mode": "stopping"}).raise_for_status()
    ends = until(lambda: [one for one in log(running, kind="run") if one["run"] == run][1:])
    assert ends[-1]["text"].endswith("began")
    began = datetime.fromisoformat(ends[-1]["at"])
    assert abs((datetime.fromisoformat(entry["at"]) - began).total_seconds() - entry["t"]) < 1.0


def test_a_mode_is_told_with_whoever_ordered_it_and_a_stop_without(off: httpx.Client, viewer: httpx.Client) -> None:
    last = log(viewer)[0]["event"] or 0

    def modes() -> list[tuple[str, str]]:
        """The changes from this test's first order on; the log may get the reset before it late."""
        found = [one for one in log(viewer, kind="mode") if one["event"] > last]
        read_entries = [(one["text"], one["who"]) for one in reversed(found)]
        return read_entries[read_entries.index(ordered) :] if ordered in read_entries else []

    ordered = ("off → pretension", "operator")
    off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    until(lambda: len(modes()) == 2)
    off.post("/api/mode", json={"mode": "off"}).raise_for_status()
    off.post("/api/stop").raise_for_status()
    until(lambda: "tripped" in modes()[-1][0])
    _, reached, ended, *_ = modes()
    assert reached == ("pretension reached", "")
    assert ended == ("pretension → off", "operator")


def test_a_stop_is_one_entry_with_whoever_pressed_it_and_its_flight_record_and_a_reset_is_no_alarm(
    off: httpx.Client, viewer: httpx.Client
) -> None:
    proof = off.post("/api/stop").raise_for_status().json()
    off.post("/api/reset").raise_for_status()

    def read_entries() -> list[dict[str, Any]]:
        return [one for one in log(viewer) if one["kind"] in ("fault", "trip") or one["text"] == "reset"]

    def holds(flight: dict[str, Any]) -> bool:
        return bool(0 <= proof["arrived_tick"] - flight["tick"] <= 1000 * flight["after_s"])

    flight = until(lambda: next(filter(holds, viewer.get("/api/flights").json()["flights"]), None))
    # what the fixture did before, and what was done here
    assert [(one["kind"], one["who"]) for one in read_entries()[:4]] == 2 * [("note", "operator"), ("trip", "operator")]
    (trip,) = [one for one in log(viewer, kind="trip") if one["event"] == flight["id"]]
    assert trip["flight"]


def test_an_operator_says_something_of_an_event_and_a_viewer_reads_it(
    operator: httpx.Client, viewer: httpx.Client
) -> None:
    operator.post("/api/system/backups").raise_for_status()
    number = log(operator, kind="backup")[0]["event"]
    said = {"note": "before the new tendons", "tags": ["Tendons"]}
    assert viewer.put(f"/api/log/{number}/remark", json=said).status_code == 403
    assert operator.put(f"/api/log/{number}/remark", json=said).status_code == 204
    (entry,) = log(viewer, words="new tendons")
    assert (entry["event"], entry["tags"], entry["remark_by"]) == (number, ["tendons"], "operator")
    refused = operator.put(f"/api/log/{number}/remark", json={"note": "", "tags": ["two words"]})
    assert refused.status_code == 422
    assert "is no tag" in str(problem(refused)["message"])
    assert operator.put("/api/log/999999/remark", json=said).status_code == 404
    assert log(viewer, words="new tendons") == [entry]


@pytest.mark.parametrize(
    "asked", [{"kind": "everything"}, {"before": "yesterday"}, {"limit": 0}, {"since": "2026-01-01"}]
)
def test_what_cannot_be_asked_is_refused(viewer: httpx.Client, asked: dict[str, Any]) -> None:
    assert viewer.get("/api/log", params=asked).status_code == 422
