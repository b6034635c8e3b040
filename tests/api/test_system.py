"""The System page and the log, through the interface."""

import json
import logging
import os
import re
import signal
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from backend.api import messages
from backend.api.middleware import describe_values
from backend.data_folder import AlreadyRunningError, lock_for_service
from backend.event_bus import EventBus
from backend.logs import EVENT, LINES_PER_WINDOW, Level, RateLimit, configure_logging
from backend.services.event_log import LONGEST_WINDOW_S, MOST, TEXT_MAX, WINDOW_S, EventLog, RejectionLog
from backend.services.messages import command_refused, fault_is_latched, refusal_repeated
from backend.storage import events, runs
from backend.storage.database import BackupError, Database, open_database, restore_database
from backend.storage.events import EventKind
from plant.quantity import Angle
from tests.api.conftest import client_with, problem, until, wait_for
from tests.api.test_endings import wait_for_end
from tests.e2e.service import Service, running_service
from tests.storage.test_lineage import NEW_RUN

# The view of the System page, a backup during operation, and its restore.


def test_the_state_of_computer_timing_and_database_is_reported(viewer: httpx.Client) -> None:
    system = viewer.get("/api/system").json()
    assert system["granted"]["timer_slack_ns"] >= 0  # a FIFO process has none
    assert (system["granted"]["priority"] > 0) or system["granted"]["refusals"]
    classes = system["lateness"]
    assert all(before["to_us"] == after["from_us"] for before, after in pairwise(classes))
    assert classes[-1]["to_us"] is None
    assert sum(entry["ticks"] for entry in classes) > 0
    assert {"Sinew", "Python", "numpy"} <= set(system["versions"])
    assert system["database"]["schema_revision"]
    assert system["database"]["disk_free_bytes"] > 0


def test_a_backup_is_made_and_checked_while_the_service_runs(
    operator: httpx.Client, viewer: httpx.Client, data: Path
) -> None:
    assert viewer.post("/api/system/backups").status_code == 403
    made = operator.post("/api/system/backups").raise_for_status().json()
    assert (data / "backups" / made["name"]).stat().st_size == made["size_bytes"]
    assert made["name"] in [copy["name"] for copy in viewer.get("/api/system").json()["backups"]]
    assert operator.post("/api/system/check").json() == {"problems": []}


def test_recordings_are_listed_and_deleted_only_by_number(operator: httpx.Client, viewer: httpx.Client) -> None:
    """The recordings are within the limit, so none may be deleted: the number of a run is rejected."""
    listed = viewer.get("/api/system/recordings").raise_for_status().json()
    assert listed["limit_bytes"] == 20_000_000_000
    assert (listed["may_go"], listed["says"]) == ([], "")
    assert viewer.post("/api/system/recordings/removal", json={"runs": [1]}).status_code == 403
    assert operator.post("/api/system/recordings/removal", json={"runs": []}).status_code == 422
    refused = operator.post("/api/system/recordings/removal", json={"runs": [1]})
    assert refused.status_code == 409
    assert "nothing was deleted" in str(problem(refused)["message"])


def test_a_database_cannot_be_restored_while_its_service_runs(data: Path) -> None:
    with pytest.raises(AlreadyRunningError), lock_for_service(data):
        pass


def test_a_restore_installs_the_copy_and_retains_the_previous_database(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    with database.session() as session:
        first = runs.create(session, NEW_RUN).id
    with sqlite3.connect(tmp_path / "sinew.db") as source, sqlite3.connect(tmp_path / "copy.db") as copy:
        source.backup(copy)
    with database.session() as session:
        second = runs.create(session, NEW_RUN).id
    database.close()
    restore_database(tmp_path / "copy.db", tmp_path / "sinew.db")
    database = open_database(tmp_path)
    with database.reading() as session:
        assert [run.id for run in runs.find(session)] == [first]
    database.close()
    (before,) = tmp_path.glob("sinew.before-restore-*.db")
    previous = open_database(tmp_path, f"sqlite:///{before}")
    with previous.reading() as session:
        assert [run.id for run in runs.find(session)] == [second, first]
    previous.close()


@pytest.mark.parametrize("bad", ["missing", "text", "cut", "foreign"])
def test_an_invalid_backup_is_rejected_without_changes(tmp_path: Path, bad: str) -> None:
    database = open_database(tmp_path)
    with database.session() as session:
        for _ in range(200):
            runs.create(session, NEW_RUN)
    database.close()
    target, copy = tmp_path / "sinew.db", tmp_path / "copy.db"
    match bad:
        case "text":
            copy.write_text("not a database at all, but long enough to look like a file" * 100)
        case "cut":
            content = target.read_bytes()
            copy.write_bytes(content[: len(content) // 2])
        case "foreign":
            with sqlite3.connect(copy) as other:
                other.execute("CREATE TABLE recipes (id INTEGER)")
        case _:
            assert bad == "missing"
    content = target.read_bytes()
    with pytest.raises(BackupError):
        restore_database(copy, target)
    assert target.read_bytes() == content
    assert not list(tmp_path.glob("*.restoring"))
    assert not list(tmp_path.glob("*before-restore*"))


# The log through the interface: sign-ins, backups, commands, remarks, and who may write them.


def log(client: httpx.Client, **asked: Any) -> list[dict[str, Any]]:
    return list(client.get("/api/log", params=asked).raise_for_status().json()["entries"])


def test_sign_in_and_sign_out_are_logged(service: Service, viewer: httpx.Client) -> None:
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


def test_a_backup_is_logged_with_its_name(operator: httpx.Client, viewer: httpx.Client) -> None:
    name = operator.post("/api/system/backups").raise_for_status().json()["name"]
    copied = f"database copied to {name}"
    newest = until(lambda: [one for one in log(viewer, kind="backup") if one["text"] == copied])[0]
    assert newest["who"] == "operator"


def test_the_log_has_start_and_end_of_a_run_and_the_time_of_a_command(running: httpx.Client) -> None:
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


def test_the_log_names_the_person_of_a_mode_change(off: httpx.Client, viewer: httpx.Client) -> None:
    last = log(viewer)[0]["event"] or 0

    def modes() -> list[tuple[str, str]]:
        """Return the changes from this test's first command on; the log may get the reset before it late."""
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


def test_a_stop_is_one_entry_with_person_and_flight_record_and_a_reset_is_no_alarm(
    off: httpx.Client, viewer: httpx.Client
) -> None:
    proof = off.post("/api/stop").raise_for_status().json()
    off.post("/api/reset").raise_for_status()

    def read_entries() -> list[dict[str, Any]]:
        return [one for one in log(viewer) if one["kind"] in ("fault", "trip") or one["text"] == "reset"]

    def holds(flight: dict[str, Any]) -> bool:
        return bool(0 <= proof["arrived_tick"] - flight["tick"] <= 1000 * flight["after_s"])

    flight = until(lambda: next(filter(holds, viewer.get("/api/flights").json()["flights"]), None))
    # the commands of the fixture, and those of this test
    assert [(one["kind"], one["who"]) for one in read_entries()[:4]] == 2 * [("note", "operator"), ("trip", "operator")]
    (trip,) = [one for one in log(viewer, kind="trip") if one["event"] == flight["id"]]
    assert trip["flight"]


def test_an_operator_can_add_a_remark_to_an_event_and_a_viewer_can_read_it(
    operator: httpx.Client, viewer: httpx.Client
) -> None:
    operator.post("/api/system/backups").raise_for_status()
    number = until(lambda: log(operator, kind="backup"))[0]["event"]
    remark = {"note": "before the new tendons", "tags": ["Tendons"]}
    assert viewer.put(f"/api/log/{number}/remark", json=remark).status_code == 403
    assert operator.put(f"/api/log/{number}/remark", json=remark).status_code == 204
    (entry,) = log(viewer, words="new tendons")
    assert (entry["event"], entry["tags"], entry["remark_by"]) == (number, ["tendons"], "operator")
    refused = operator.put(f"/api/log/{number}/remark", json={"note": "", "tags": ["two words"]})
    assert refused.status_code == 422
    assert problem(refused)["message_code"] == "invalid_tag"
    assert operator.put("/api/log/999999/remark", json=remark).status_code == 404
    assert log(viewer, words="new tendons") == [entry]


@pytest.mark.parametrize(
    "asked", [{"kind": "everything"}, {"before": "yesterday"}, {"limit": 0}, {"since": "2026-01-01"}]
)
def test_an_invalid_query_of_the_log_is_rejected(viewer: httpx.Client, asked: dict[str, Any]) -> None:
    assert viewer.get("/api/log", params=asked).status_code == 422


# The log at level info has start, stop, processes, connections and modes; by default it has none of them.


def lines_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, level: str | None) -> list[str]:
    """Return the lines of level info of a service that entered pretension and was ended."""
    if level is not None:
        monkeypatch.setenv("SINEW_LOG_LEVEL", level)
    with running_service(tmp_path, params="ideal") as service:
        with client_with(service, "token") as operator:
            operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
            wait_for(operator, "pretension_done", True)
        os.kill(service.pid, signal.SIGTERM)
        wait_for_end(service)
    return [line for line in service.log.read_text().splitlines() if " INFO " in line]


def test_the_info_log_has_events_with_their_identifiers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = lines_of(tmp_path, monkeypatch, "info")
    text = "\n".join(lines)
    started = re.search(r"Control loop process (\d+) started", text)
    assert started is not None
    assert f"Control loop process {started[1]}: ended with status 0" in text
    assert re.search(r"The service started: plant simulator, data folder \S+, address http://127\.0\.0\.1:\d+", text)
    assert re.search(r"mode: off → pretension by operator", text)
    assert "The service stopped: " in text


def test_the_default_log_has_only_warnings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SINEW_LOG_LEVEL", raising=False)
    lines = lines_of(tmp_path, monkeypatch, None)
    assert lines == []


def test_the_log_limits_no_events() -> None:
    def written(extra: dict[str, bool]) -> int:
        limit, log = RateLimit(lambda: 0.0), logging.getLogger("test")
        record = log.makeRecord("test", logging.INFO, "here.py", 1, "a line", (), None, extra=extra)
        return sum(limit.filter(record) for _ in range(100))

    assert (written({}), written(EVENT)) == (LINES_PER_WINDOW, 100)


@pytest.fixture
def loggers() -> Iterator[None]:
    """Restores the loggers after a test that changes them."""
    changed = [logging.getLogger(name) for name in ("", "backend", "plant")]
    before = [(logger.level, logger.handlers[:]) for logger in changed]
    yield
    for logger, (level, handlers) in zip(changed, before, strict=True):
        logger.setLevel(level)
        logger.handlers[:] = handlers


@pytest.mark.usefixtures("loggers")
@pytest.mark.parametrize(
    ("level", "written"),
    [
        ("info", ["backend.x INFO", "backend.x WARNING", "asyncio WARNING"]),
        ("warning", ["backend.x WARNING", "asyncio WARNING"]),
        ("error", []),
    ],
)
def test_the_log_level_applies_to_libraries_too(
    level: Level, written: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    configure_logging(level)
    for name in ("backend.x", "asyncio"):
        logging.getLogger(name).info("%s INFO", name)
        logging.getLogger(name).warning("%s WARNING", name)
    assert [line.rsplit(": ", 1)[1] for line in capsys.readouterr().err.splitlines()] == written


# Refused commands in the event log, and floods of them.


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    with closing(open_database(tmp_path)) as opened:
        yield opened


class Flood:
    """Refusals with windows that the test ends; ``windows_s`` are their lengths."""

    def __init__(self, database: Database) -> None:
        self._database, self._event_log = database, EventLog(database, EventBus())
        self.windows_s: list[float] = []
        self._ends: list[Callable[[], None]] = []
        self.refusals = RejectionLog(self._event_log, self._begin)

    def _begin(self, delay_s: float, end: Callable[[], None]) -> None:
        self.windows_s.append(delay_s)
        self._ends.append(end)

    def end(self) -> None:
        self._ends.pop()()

    def read_refusals(self) -> list[tuple[str, str]]:
        self._event_log.close()
        with self._database.reading() as session:
            found = [event for event in events.find(session) if event.kind == EventKind.REFUSAL]
        return [(event.text, event.who) for event in sorted(found, key=lambda event: event.id)]


def test_repeated_refusals_are_counted_per_user(database: Database) -> None:
    flood = Flood(database)
    for _ in range(500):
        flood.refusals.add("set mode (mode run)", fault_is_latched(), "Ana")
    flood.refusals.add("set mode (mode run)", fault_is_latched(), "Bo")
    flood.end()
    refusal = command_refused(command="set mode (mode run)", reason=fault_is_latched())
    assert flood.read_refusals() == [
        (refusal, "Ana"),
        (refusal, "Bo"),
        (refusal_repeated(refusal=refusal, count=499, window_s=10.0), "Ana"),
    ]


def test_flood_of_refusals_is_bounded_and_its_windows_grow(database: Database) -> None:
    flood = Flood(database)
    for window in range(20):
        for number in range(1000):
            flood.refusals.add("set references", f"{window} {number} is too much", "Ana")
        flood.end()
    assert len(flood.read_refusals()) == 20 * (MOST + 1)
    assert flood.read_refusals()[MOST] == ("990 further commands were refused in 10 s", "")
    assert flood.windows_s[:3] == [WINDOW_S, 2 * WINDOW_S, 4 * WINDOW_S]
    assert flood.windows_s[-1] == LONGEST_WINDOW_S


def test_window_is_short_again_after_one_without_refusals(database: Database) -> None:
    flood = Flood(database)
    for repeats in (2, 1, 1):
        for _ in range(repeats):
            flood.refusals.add("push", "not now", "Ana")
        flood.end()
    assert flood.windows_s == [WINDOW_S, 2 * WINDOW_S, WINDOW_S]
    assert len(flood.read_refusals()) == 4


def test_long_reason_is_cut_and_invisible_characters_are_escaped(database: Database) -> None:
    flood = Flood(database)
    flood.refusals.add("push", "\x00\u202e" + 2000 * "x", "Ana")
    ((text, _),) = flood.read_refusals()
    assert len(text) == TEXT_MAX
    assert text.isprintable()


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ({"mode": "run"}, "mode run"),
        ({"q_ref": 1.0472, "S_ref": 9.5}, f"q_ref {Angle(1.0472)}, S_ref 9.5 N·m/rad"),
        ({"learn": True, "bias": None, "parts": [1]}, "learn yes"),
        ({"text": 100 * "x", "name": "a\nb", "not a name": 1}, ""),
        ([1, 2], ""),
        ({f"value_{number}": number for number in range(9)}, ", ".join(f"value_{n} {n}" for n in range(6))),
    ],
)
def test_values_are_logged_with_their_units(body: object, expected: str) -> None:
    assert describe_values(json.dumps(body).encode()) == expected


def test_an_invalid_body_has_no_logged_values() -> None:
    assert [describe_values(body) for body in (b"", b"{", b"\xff", 10_000 * b"[")] == ["", "", "", ""]


@pytest.fixture(scope="module")
def fresh_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service without earlier refusals: after many refusals the log only counts them for minutes."""
    with running_service(tmp_path_factory.mktemp("unrefused"), params="ideal") as running:
        yield running


def test_a_rejected_command_is_logged_with_its_person_and_is_no_alarm(fresh_service: Service) -> None:
    with client_with(fresh_service, "token") as off, client_with(fresh_service, "viewer-token") as viewer:
        _check_refusals_in_log(off, viewer)


def _check_refusals_in_log(off: httpx.Client, viewer: httpx.Client) -> None:
    reasons = [
        problem(off.post("/api/mode", json={"mode": "run"}))["message"],
        problem(off.put("/api/tuning", json={"lam_q": 0.0123}))["message"],
        problem(off.put("/api/references", json={"q_ref": 9.0, "S_ref": 9.0}))["message"],
        problem(off.put("/api/references", json={"q_ref": "far", "S_ref": 9.0}))["message"],
    ]
    assert viewer.put("/api/references", json={"q_ref": 8.0, "S_ref": 9.0}).status_code == 403
    off.get("/api/runs/999999")

    def refused() -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = viewer.get("/api/log", params={"kind": "refusal"}).json()["entries"]
        return found if len(found) > len(reasons) and found[0]["who"] == "viewer" else []

    viewers, *others = until(refused)
    reason = messages.operator_needed(name="viewer", role="viewer")
    assert viewers["text"].startswith(f"set references refused: {reason}")
    entries = others[: len(reasons)][::-1]
    assert [entry["who"] for entry in entries] == ["operator"] * len(reasons)
    texts = [entry["text"] for entry in entries]
    for text, begin in zip(
        texts, ("set mode (mode run)", "set tuning (lam_q 0.0123", "set references", ""), strict=True
    ):
        assert text.startswith(begin)
        assert " refused: " in text
    assert texts[0].endswith(reasons[0])
    assert f"q_ref {Angle(9.0)}" in texts[2]  # in SI, as all texts of the log: it is shown in the unit of the reader
    alarms = viewer.get("/api/log", params={"kind": ["trip", "fault", "recording"]}).json()["entries"]
    assert not [entry for entry in alarms if "refused" in entry["text"]]


def test_the_log_is_searched_in_the_angle_unit_of_the_reader(fresh_service: Service) -> None:
    with client_with(fresh_service, "token") as off:
        _check_search_of_angles(off)


def _check_search_of_angles(off: httpx.Client) -> None:
    off.put("/api/references", json={"q_ref": 6.6, "S_ref": 9.0})  # 378.2°

    def found(words: str, angles: str) -> int:
        asked: dict[str, str | int] = {"words": words, "angles": angles, "kind": "refusal", "limit": 1}
        return int(off.get("/api/log", params=asked).raise_for_status().json()["total"])

    until(lambda: found("378.2°", "deg"))
    assert (found("378.2", "rad"), found("q_ref 6.6 rad", "rad"), found("6.6", "deg")) == (0, 1, 0)


def test_the_log_returns_the_number_of_entries(off: httpx.Client) -> None:
    page = off.get("/api/log", params={"limit": 3}).raise_for_status().json()
    assert len(page["entries"]) == 3
    assert page["total"] > 3
    rest = off.get("/api/log", params={"limit": 1000, "before": page["more_before"]}).json()
    assert page["total"] == len(page["entries"]) + rest["total"]
    assert rest["total"] == len(rest["entries"])
