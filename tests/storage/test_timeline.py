"""The event log: no duplicate, no omission at the edge of a page, each event at its time."""

from contextlib import AbstractContextManager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import pytest
from sqlalchemy import update

from backend.errors import RequestRejectedError
from backend.schemas.state import MarkKind
from backend.storage import events, recordings, runs, timeline
from backend.storage.database import Database, Session
from backend.storage.events import EventKind
from backend.storage.orm import RunRow, UnknownRecordError
from backend.storage.recordings import Chunk
from backend.storage.tags import TagError
from backend.storage.timeline import LogEntry, LogQuery
from backend.units import AngleUnit
from tests.refusals import refused
from tests.storage.test_search import NEW

NOON = datetime(2026, 3, 31, 12, tzinfo=UTC)


def after(seconds: float) -> datetime:
    return NOON + timedelta(seconds=seconds)


def record(session: Session, began: float, first_tick: int, count: int) -> int:
    """Store a run of ``count`` ticks that began ``began`` seconds after noon."""
    number = runs.create(session, NEW).id
    recordings.begin(session, number, ["q"], 0.001)
    recordings.add_chunks(session, number, [Chunk(first_tick, count, b"", b"")])
    runs.end(session, number, runs.EndState.COMPLETED)
    ended = after(began + count / 1000)
    session.execute(update(RunRow).where(RunRow.id == number).values(started_at=after(began), ended_at=ended))
    return number


def all_of(database: Database, asked: LogQuery | None = None) -> list[LogEntry]:
    with database.reading() as session:
        found, more = timeline.find(session, asked or LogQuery(), 500)
    assert more is None
    return found


def test_every_mark_on_the_time_axis_has_its_kind_in_the_log() -> None:
    assert {str(kind) for kind in MarkKind} <= {str(kind) for kind in EventKind}


def test_an_event_has_its_time_in_the_run_recorded_at_that_time(database: Database) -> None:
    with database.session() as session:
        first = record(session, 0.0, 5000, 4000)
        second = record(session, 60.0, 5000, 4000)  # the same ticks, of another loop process
        events.add(session, EventKind.MODE, "run → off", tick=7500, at=after(2.5))
        events.add(session, EventKind.MODE, "off → run", tick=5250, at=after(60.25))
        events.add(session, EventKind.NOTE, "between", tick=7500, at=after(30.0))
        events.add(session, EventKind.ACCESS, "signed in as operator", who="Ana", at=after(61.0))
    placed = {one.text: (one.run, one.t) for one in all_of(database) if one.kind is not EventKind.RUN}
    assert placed == {
        "run → off": (first, pytest.approx(2.5)),
        "off → run": (second, pytest.approx(0.25)),
        "between": (None, None),
        "signed in as operator": (None, None),
    }
    told = [(one.at, one.run) for one in all_of(database, LogQuery(kinds=[EventKind.RUN]))]
    assert told == [(after(64.0), second), (after(60.0), second), (after(4.0), first), (after(0.0), first)]


def test_pages_of_the_log_have_no_gap_and_no_duplicate(database: Database) -> None:
    with database.session() as session:
        for number in range(40):
            events.add(session, EventKind.NOTE, f"event {number}", at=after(number // 3))
        record(session, 5.0, 0, 3000)
    whole = all_of(database)
    assert len(whole) == 42
    assert all(later.at >= earlier.at for later, earlier in pairwise(whole))
    found: list[LogEntry] = []
    asked = LogQuery()
    with database.reading() as session:
        while True:
            page, more = timeline.find(session, asked, 7)
            found += page
            if more is None:
                break
            asked = LogQuery(before=more)
    assert found == whole


def test_words_kinds_and_times_filter_the_log(database: Database) -> None:
    with database.session() as session:
        events.add(session, EventKind.TUNING, "λ_q 0.5 → 0.7 s", who="Ana", at=after(1))
        events.add(session, EventKind.FAULT, "STOP", who="Bo", at=after(2))
        kept = events.add(session, EventKind.NOTE, "100 % of it", who="Ana", at=after(3))
        timeline.remark(session, kept.id, "tendon changed", ["Worn"], "Cy")
    texts = {
        ("ana",): ["100 % of it", "λ_q 0.5 → 0.7 s"],
        ("ana", "λ_q"): ["λ_q 0.5 → 0.7 s"],
        ("stop",): ["STOP"],
        ("%",): ["100 % of it"],
        ("_",): ["λ_q 0.5 → 0.7 s"],
        ("tendon",): ["100 % of it"],
        ("worn",): ["100 % of it"],
        ("nothing",): [],
    }
    for words, expected in texts.items():
        assert [one.text for one in all_of(database, LogQuery(words=words))] == expected, words
    assert [one.text for one in all_of(database, LogQuery(kinds=[EventKind.FAULT]))] == ["STOP"]
    assert [one.text for one in all_of(database, LogQuery(since=after(2), before=after(3)))] == ["STOP"]


SHOWN = {
    **dict.fromkeys(
        (("60", "deg"), ("60°",), ("60", "°"), ("60deg",)), (["q_ref 1.0472\u202frad, S_ref 10 N·m/rad"], [])
    ),
    ("q_ref", "60"): (["q_ref 1.0472\u202frad, S_ref 10 N·m/rad"], []),
    ("1.0472",): ([], ["q_ref 1.0472\u202frad, S_ref 10 N·m/rad"]),
    ("17.19",): (["wall moved by 0.3\u202frad"], []),
    ("wall", "20"): (["wall above 0.349066\u202frad, 2e+04 N/m"], []),
    ("0.349",): ([], ["wall above 0.349066\u202frad, 2e+04 N/m"]),
    ("−30",): (["q_ref -0.523599\u202frad, S_ref 9 N·m/rad"], []),
    ("-30",): (["q_ref -0.523599\u202frad, S_ref 9 N·m/rad"], []),
    ("n·m/rad", "10"): (["q_ref 1.0472\u202frad, S_ref 10 N·m/rad"],) * 2,
    ("mara",): (["push of 12.5 N for 1.0 s"],) * 2,
    ("12.5",): (["push of 12.5 N for 1.0 s"],) * 2,
}
"""By the words: the texts that somebody finds who reads degrees, and who reads radians."""


@pytest.mark.parametrize("angles", AngleUnit)
def test_displayed_texts_can_be_searched(database: Database, angles: AngleUnit) -> None:
    texts = (
        ("push of 12.5 N for 1.0 s", "Mara Stein"),
        ("q_ref 1.0472\u202frad, S_ref 10 N·m/rad", "Ana"),
        ("q_ref -0.523599\u202frad, S_ref 9 N·m/rad", "Ana"),
        ("wall above 0.349066\u202frad, 2e+04 N/m", "Bo"),
        ("wall moved by 0.3\u202frad", "Bo"),
    )
    with database.session() as session:
        for number, (text, who) in enumerate(texts):
            events.add(session, EventKind.NOTE, text, who=who, at=after(number))
    place = list(AngleUnit).index(angles)
    found = {words: [one.text for one in all_of(database, LogQuery(words=words, angles=angles))] for words in SHOWN}
    assert found == {words: expected[place] for words, expected in SHOWN.items()}
    assert {words: counted(database, LogQuery(words=words, angles=angles)) for words in SHOWN} == {
        words: len(expected[place]) for words, expected in SHOWN.items()
    }


def counted(database: Database, asked: LogQuery) -> int:
    with database.reading() as session:
        return timeline.count(session, asked)


def test_a_search_for_an_angle_has_pages(database: Database) -> None:
    with database.session() as session:
        for number in range(30):
            angle = 1.0472 if number % 3 == 0 else 0.5
            events.add(session, EventKind.REFERENCES, f"q_ref {angle}\u202frad", at=after(number))
    asked = LogQuery(words=["60", "deg"])
    with database.reading() as session:
        first, more = timeline.find(session, asked, 4)
        rest, end = timeline.find(session, replace(asked, before=more), 100)
    assert [one.at for one in first + rest] == [after(27 - 3 * number) for number in range(10)]
    assert (len(first), end, counted(database, asked)) == (4, None, 10)


def test_a_run_is_found_by_its_number_and_by_its_final_angle(database: Database) -> None:
    with database.session() as session:
        record(session, 0.0, 0, 1000)
        second = runs.create(session, NEW).id
        runs.end(session, second, runs.EndState.TRIPPED, "joint_limit: q = 1.0472\u202frad")
    assert {one.run for one in all_of(database, LogQuery(words=["run", str(second)]))} == {second}
    assert {one.run for one in all_of(database, LogQuery(words=["60", "deg"]))} == {second}
    assert all_of(database, LogQuery(words=["1.0472"])) == []
    assert len(all_of(database, LogQuery(words=["1.0472"], angles=AngleUnit.RADIANS))) > 0


def test_notes_and_tags_of_an_event_are_replaced_and_removed(database: Database) -> None:
    with database.session() as session:
        stop = events.add(session, EventKind.FAULT, "STOP", who="Bo", at=NOON)
        timeline.remark(session, stop.id, "a finger", ["near", "Near"], "Ana")
        timeline.remark(session, stop.id, "a hand", ["near", "miss"], "Cy")
    (said,) = all_of(database)
    assert (said.text, said.note, said.tags, said.remark_by) == ("STOP", "a hand", ("near", "miss"), "Cy")
    with database.session() as session:
        timeline.remark(session, stop.id, "", [], "Ana")
    (bare,) = all_of(database)
    assert (bare.text, bare.note, bare.tags, bare.remark_by) == ("STOP", "", (), "")


def test_an_invalid_note_is_rejected_and_the_old_one_remains(database: Database) -> None:
    with database.session() as session:
        stop = events.add(session, EventKind.FAULT, "STOP", at=NOON)
        timeline.remark(session, stop.id, "kept", [], "Ana")
    after, long, many = stop.id + 1, "x" * (timeline.NOTE_MAX + 1), [f"t{n}" for n in range(timeline.TAGS_MAX + 1)]
    refusals: tuple[tuple[int, str, list[str], AbstractContextManager[None]], ...] = (
        (stop.id, long, [], refused(RequestRejectedError, "remark_too_long", length=len(long), tags=0)),
        (stop.id, "", ["two words"], refused(TagError, "invalid_tag", tag="two words")),
        (stop.id, "", many, refused(RequestRejectedError, "remark_too_long", length=0, tags=len(many))),
        (after, "of what", [], refused(UnknownRecordError, "record_not_found", record="event", number=after)),
    )
    for number, note, tags, refusal in refusals:
        with refusal, database.session() as session:
            timeline.remark(session, number, note, tags, "Bo")
    assert [one.note for one in all_of(database)] == ["kept"]


def test_each_station_has_its_own_log(sqlite: Database) -> None:
    with sqlite.session() as session:
        here = events.add(session, EventKind.NOTE, "here", at=NOON)
    elsewhere = Database(sqlite.engine, station="elsewhere")
    assert all_of(elsewhere) == []
    missing = refused(UnknownRecordError, "record_not_found", record="event", number=here.id)
    with missing, elsewhere.session() as session:
        timeline.remark(session, here.id, "theirs", [], "Bo")
