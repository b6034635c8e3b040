"""Refused commands in the event log, and floods of them."""

import json
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.api.middleware import describe_values
from backend.event_bus import EventBus
from backend.services.event_log import LONGEST_WINDOW_S, MOST, TEXT_MAX, WINDOW_S, EventLog, RejectionLog
from backend.storage import events
from backend.storage.database import Database, open_database
from backend.storage.events import EventKind
from plant.quantity import Angle
from tests.api.conftest import problem, until


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
        flood.refusals.add("set mode (mode run)", "a fault is latched", "Ana")
    flood.refusals.add("set mode (mode run)", "a fault is latched", "Bo")
    flood.end()
    assert flood.read_refusals() == [
        ("set mode (mode run) refused: a fault is latched", "Ana"),
        ("set mode (mode run) refused: a fault is latched", "Bo"),
        ("set mode (mode run) refused: a fault is latched (499 times more in 10 s)", "Ana"),
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


def test_window_is_short_again_after_a_quiet_one(database: Database) -> None:
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
    ("asked", "said"),
    [
        ({"mode": "run"}, "mode run"),
        ({"q_ref": 1.0472, "S_ref": 9.5}, f"q_ref {Angle(1.0472)}, S_ref 9.5 N·m/rad"),
        ({"learn": True, "bias": None, "parts": [1]}, "learn yes"),
        ({"text": 100 * "x", "name": "a\nb", "not a name": 1}, ""),
        ([1, 2], ""),
        ({f"value_{number}": number for number in range(9)}, ", ".join(f"value_{n} {n}" for n in range(6))),
    ],
)
def test_values_are_told_with_their_units(asked: object, said: str) -> None:
    assert describe_values(json.dumps(asked).encode()) == said


def test_what_is_no_document_has_no_values() -> None:
    assert [describe_values(body) for body in (b"", b"{", b"\xff", 10_000 * b"[")] == ["", "", "", ""]


def test_a_refused_command_stands_in_the_log_with_its_person_and_is_no_alarm(
    off: httpx.Client, viewer: httpx.Client
) -> None:
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
    assert viewers["text"].startswith("set references refused: viewer is signed in as viewer")
    entries = others[: len(reasons)][::-1]
    assert [entry["who"] for entry in entries] == ["operator"] * len(reasons)
    texts = [entry["text"] for entry in entries]
    for text, begin in zip(
        texts, ("set mode (mode run)", "set tuning (lam_q 0.0123", "set references", ""), strict=True
    ):
        assert text.startswith(begin)
        assert " refused: " in text
    assert texts[0].endswith(reasons[0])
    assert f"q_ref {Angle(9.0)}" in texts[2]  # in SI, as all texts of the log: each reads it in their own unit
    alarms = viewer.get("/api/log", params={"kind": ["trip", "fault", "recording"]}).json()["entries"]
    assert not [entry for entry in alarms if "refused" in entry["text"]]


def test_the_log_is_searched_in_the_unit_in_which_somebody_reads(off: httpx.Client) -> None:
    off.put("/api/references", json={"q_ref": 6.6, "S_ref": 9.0})  # 378.2°

    def found(words: str, angles: str) -> int:
        asked: dict[str, str | int] = {"words": words, "angles": angles, "kind": "refusal", "limit": 1}
        return int(off.get("/api/log", params=asked).raise_for_status().json()["total"])

    until(lambda: found("378.2°", "deg"))
    assert (found("378.2", "rad"), found("q_ref 6.6 rad", "rad"), found("6.6", "deg")) == (0, 1, 0)


def test_the_log_tells_how_many_entries_there_are(off: httpx.Client) -> None:
    page = off.get("/api/log", params={"limit": 3}).raise_for_status().json()
    assert len(page["entries"]) == 3
    assert page["total"] > 3
    rest = off.get("/api/log", params={"limit": 1000, "before": page["more_before"]}).json()
    assert page["total"] == len(page["entries"]) + rest["total"]
    assert rest["total"] == len(rest["entries"])
