"""Triggers: their conditions and captures."""

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from backend.event_bus import EventBus
from backend.experiments.parser import parse_derived_signal
from backend.realtime.ring_buffer import Ring
from backend.recording import messages
from backend.recording.flight import FlightRecorder, Quota, read_flight_columns
from backend.recording.trigger import Armed, Condition, ConditionKind, Trigger, Triggered, load_armed_trigger
from backend.sample import INDEX, NAMES
from backend.storage import events, flights
from backend.storage.database import Database
from backend.storage.orm import StorageError
from tests.recording.stand_in import Writer, new_run, read_problem
from tests.recording.test_flight import stored, trip

# The tick at which a condition is met, against signals whose crossings follow from a formula.

T_s = 1e-3
TIMES = np.arange(4000) * T_s
SINE = np.sin(2 * math.pi * 0.5 * TIMES)


def condition(kind: ConditionKind, level: float, upper: float | None = None) -> Condition:
    return Condition("F_A", kind, level, upper)


def test_a_ramp_is_above_a_level_at_the_first_tick_past_it() -> None:
    ramp = np.arange(0.0, 500.0, 0.5)
    assert condition(ConditionKind.ABOVE, 100.0).first(ramp, -1.0) == 201
    assert condition(ConditionKind.ABOVE, 99.9).first(ramp, -1.0) == 200
    assert condition(ConditionKind.BELOW, 100.0).first(-ramp, 1.0) == 0
    assert condition(ConditionKind.BELOW, -100.0).first(-ramp, 1.0) == 201


def test_a_sine_crosses_a_level_at_the_times_of_its_arc_sine() -> None:
    level = 0.5
    rises, falls = math.asin(level) / math.pi, 1.0 - math.asin(level) / math.pi
    assert condition(ConditionKind.RISING, level).first(SINE, 0.0) == math.floor(rises / T_s) + 1
    assert condition(ConditionKind.FALLING, level).first(SINE, 0.0) == math.floor(falls / T_s) + 1
    second = math.floor((2.0 + rises) / T_s) + 1
    met = np.flatnonzero(condition(ConditionKind.RISING, level).met(SINE, 0.0))
    assert met.tolist() == [math.floor(rises / T_s) + 1, second]


def test_a_level_is_met_at_once_and_an_edge_only_by_a_crossing() -> None:
    high = np.full(100, 2.0)
    assert condition(ConditionKind.ABOVE, 1.0).first(high, 2.0) == 0
    assert condition(ConditionKind.RISING, 1.0).first(high, 2.0) is None
    assert condition(ConditionKind.RISING, 1.0).first(high, 0.5) == 0, "across the border of two blocks"
    assert condition(ConditionKind.FALLING, 1.0).first(np.array([2.0, 1.0, 0.5]), 2.0) == 2, "at the level is not past"


def test_a_window_includes_its_ends() -> None:
    inside, outside = condition(ConditionKind.INSIDE, 1.0, 2.0), condition(ConditionKind.OUTSIDE, 1.0, 2.0)
    values = np.array([0.9, 1.0, 1.5, 2.0, 2.1])
    assert inside.met(values, 0.0).tolist() == [False, True, True, True, False]
    assert outside.met(values, 0.0).tolist() == [True, False, False, False, True]


@pytest.mark.parametrize("kind", list(ConditionKind))
def test_nan_never_triggers_and_the_next_sample_is_no_edge(kind: ConditionKind) -> None:
    asked = condition(kind, 1.0, 2.0)
    assert asked.first(np.full(50, np.nan), np.nan) is None
    if kind in (ConditionKind.RISING, ConditionKind.FALLING):
        assert asked.first(np.array([0.0, np.nan, 3.0]), 0.0) is None
        assert asked.first(np.array([3.0, np.nan, 0.0]), 3.0) is None


@given(
    values=st.lists(st.one_of(st.just(math.nan), st.integers(-3, 3).map(float)), min_size=1, max_size=40),
    cut=st.integers(0, 40),
    kind=st.sampled_from(list(ConditionKind)),
)
def test_blocks_meet_a_condition_at_the_same_tick_as_the_whole(
    values: list[float], cut: int, kind: ConditionKind
) -> None:
    asked, array = condition(kind, 0.0, 1.0), np.array(values)
    first, rest = array[:cut], array[cut:]
    met = [asked.met(first, math.nan), asked.met(rest, first[-1] if len(first) else math.nan)]
    assert np.concatenate(met).tolist() == asked.met(array, math.nan).tolist()
    for n, value in enumerate(values):
        before = values[n - 1] if n else math.nan
        expected = {
            ConditionKind.ABOVE: value > 0,
            ConditionKind.BELOW: value < 0,
            ConditionKind.RISING: before <= 0 < value,
            ConditionKind.FALLING: before >= 0 > value,
            ConditionKind.INSIDE: 0 <= value <= 1,
            ConditionKind.OUTSIDE: value < 0 or value > 1,
        }
        assert asked.met(array, math.nan)[n] == expected[kind]


def test_combined_signals_are_sums_of_columns_with_the_lengths_of_the_joint() -> None:
    rows = np.arange(2.0 * len(NAMES)).reshape(2, -1)
    lengths = {"r_m": 0.01, "r_j": 0.1}

    def values(signal: str) -> NDArray[np.float64]:
        return Condition(signal, ConditionKind.ABOVE, 0.0).values(rows, lengths)

    np.testing.assert_array_equal(values("F_A - F_B"), rows[:, INDEX["F_A"]] - rows[:, INDEX["F_B"]])
    np.testing.assert_allclose(values("x_B"), 0.01 * rows[:, INDEX["theta_B"]] + 0.1 * rows[:, INDEX["q"]])


def test_a_formula_is_computed_per_sample_and_described_in_its_unit() -> None:
    rows = np.arange(2.0 * len(NAMES)).reshape(2, -1)
    derived = parse_derived_signal("F_sum", "N", "F_A + 2 * F_B")
    asked = Condition("F_sum", ConditionKind.RISING, 3.0, derived=derived)
    expected = rows[:, INDEX["F_A"]] + 2.0 * rows[:, INDEX["F_B"]]
    np.testing.assert_array_equal(asked.values(rows, {"r_m": 0.01, "r_j": 0.1}), expected)
    assert asked.describe() == messages.edge_condition(signal="F_sum", kind="rising", level=3.0, unit="N")
    rows[0, INDEX["F_A"]] = np.nan
    assert np.isnan(asked.values(rows, {})[0])  # a gap meets nothing


def test_a_condition_is_described_with_its_unit() -> None:
    assert condition(ConditionKind.RISING, 20.0).describe() == messages.edge_condition(
        signal="F_A", kind="rising", level=20.0, unit="N"
    )
    assert Condition("q", ConditionKind.INSIDE, -0.1, 0.2).describe() == messages.window_condition(
        signal="q", kind="inside", lower=-0.1, upper=0.2, unit="rad"
    )
    assert Condition("mode", ConditionKind.ABOVE, 1.5).describe() == messages.level_condition(
        signal="mode", kind="above", level=1.5, unit="1"
    )


# Captures of a trigger: exactly the requested samples around the exact tick, or the number of missing ones.

QUOTA = Quota(100, 10**9)
LENGTHS = {"r_m": 0.0075, "r_j": 0.075}
ABOVE_1_N = messages.triggered(condition=messages.level_condition(signal="F_A", kind="above", level=1.0, unit="N"))


def append(ring: Ring, F_A: NDArray[np.float64], run: int = 0) -> None:
    """Append samples whose F_A is given, and whose q is their tick."""
    row = np.zeros(ring.rows.shape[1])
    for value in F_A:
        row[[INDEX["tick"], INDEX["q"], INDEX["F_A"], INDEX["run"]]] = ring.count, ring.count, value, run
        ring.append(row)


def trigger_on(database: Database, ring: Ring, quota: Quota = QUOTA, events: EventBus | None = None) -> Trigger:
    return Trigger(database, lambda: ring, quota, lambda: LENGTHS, events or EventBus())


def armed(
    kind: ConditionKind, level: float, *, before: int = 100, after: int = 50, captures: int = 1, signal: str = "F_A"
) -> Armed:
    return Armed(Condition(signal, kind, level), before, after, captures, "Ana", datetime.now(UTC))


def kept(database: Database) -> list[flights.Flight]:
    """Return the captures in order."""
    return stored(database)[::-1]


def test_a_capture_has_exactly_the_requested_samples_before_and_after(database: Database) -> None:
    ring, run = Ring.create(8192), new_run(database)
    events = EventBus()
    trigger = trigger_on(database, ring, events=events)
    append(ring, np.zeros(1000), run.id)
    trigger.arm(armed(ConditionKind.ABOVE, 1.0, before=300, after=200))
    told: list[tuple[int, str]] = []
    events.subscribe(Triggered, lambda triggered: told.append((triggered.tick, triggered.text)))
    ramp = np.arange(1000) * 0.01  # above 1 N from its 102nd sample on, whose tick is 1101
    for part in np.array_split(ramp, 37):
        append(ring, part, run.id)
        trigger.step()
        trigger.drain()
    (flight,) = kept(database)
    assert (flight.first_tick, flight.trip_tick, flight.count) == (801, 1101, 500)
    assert (flight.fault, flight.who, flight.run_id, flight.text) == (
        "trigger",
        "Ana",
        run.id,
        ABOVE_1_N,
    )
    columns = read_flight_columns(database, flight.event_id)
    np.testing.assert_array_equal(columns["q"], np.arange(801, 1301))
    np.testing.assert_array_equal(columns["F_A"], np.float32(np.maximum(0.0, (np.arange(801, 1301) - 1000) * 0.01)))
    assert (columns["t"][0], columns["t"][300], columns["t"][-1]) == (-0.3, 0.0, pytest.approx(0.199))
    assert told == [(1101, ABOVE_1_N)]
    assert trigger.status is not None
    assert (trigger.is_armed, trigger.status.captured) == (False, 1)
    assert flight.trigger is not None
    assert (flight.trigger["signal"], flight.trigger["kind"], flight.trigger["level"]) == ("F_A", "above", 1.0)


def test_a_level_triggers_at_once_where_an_edge_waits_for_the_crossing(database: Database) -> None:
    ring = Ring.create(8192)
    level, edge = trigger_on(database, ring), trigger_on(database, ring)
    append(ring, np.full(500, 2.0))
    level.arm(armed(ConditionKind.ABOVE, 1.0))
    edge.arm(armed(ConditionKind.RISING, 1.0))
    append(ring, np.concatenate((np.full(300, 2.0), np.zeros(50), np.full(300, 2.0))))
    for one in (level, edge):
        one.step()
        one.drain()
    assert [flight.trip_tick for flight in kept(database)] == [500, 850]


def test_earlier_samples_do_not_trigger_but_an_edge_at_the_first_one_does(
    database: Database,
) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    append(ring, np.concatenate((np.full(500, 5.0), np.zeros(200))))
    trigger.arm(armed(ConditionKind.RISING, 1.0))
    append(ring, np.full(100, 2.0))
    trigger.step()
    trigger.drain()
    assert [flight.trip_tick for flight in kept(database)] == [700]


def test_a_trigger_rearms_until_all_captures_are_made(database: Database) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    trigger.arm(armed(ConditionKind.RISING, 0.5, before=20, after=50, captures=3))
    square = np.tile(np.repeat([0.0, 1.0], 20), 40)  # rises at 20, 60, 100 ...
    for part in np.array_split(square, 11):
        append(ring, part)
        trigger.step()
        trigger.drain()
    # 20 to 69 is the first, so that the rise at 60 falls into it; the next is at 100
    assert [flight.trip_tick for flight in kept(database)] == [20, 100, 180]
    assert [flight.text.rpartition(", ")[2] for flight in kept(database)] == ["1 of 3", "2 of 3", "3 of 3"]
    assert not trigger.is_armed


def test_a_lasting_level_is_captured_without_a_gap(database: Database) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    append(ring, np.zeros(10))
    trigger.arm(armed(ConditionKind.ABOVE, 0.5, before=0, after=50, captures=4))
    append(ring, np.ones(500))
    trigger.step()
    trigger.drain()
    assert [(one.first_tick, one.count) for one in kept(database)] == [(10, 50), (60, 50), (110, 50), (160, 50)]


@pytest.mark.parametrize("kind", list(ConditionKind))
def test_nan_never_triggers(database: Database, kind: ConditionKind) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    trigger.arm(Armed(Condition("F_A", kind, 0.0, 1.0), 10, 10, 1, "Ana", datetime.now(UTC)))
    append(ring, np.full(500, np.nan))
    trigger.step()
    assert (trigger.is_armed, trigger.status and trigger.status.captured) == (True, 0)


def test_samples_not_yet_produced_are_reported_as_missing(database: Database) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    trigger.arm(armed(ConditionKind.ABOVE, 0.5, before=100, after=50))
    append(ring, np.concatenate((np.zeros(30), np.ones(100))))
    trigger.step()
    trigger.drain()
    (flight,) = kept(database)
    assert (flight.first_tick, flight.trip_tick, flight.count) == (0, 30, 80)
    assert messages.lead_too_short(recorded_s=0.03, wanted_s=0.1) in flight.text


def test_samples_that_were_overwritten_are_nan_and_counted(database: Database) -> None:
    ring = Ring.create(1024)
    trigger = trigger_on(database, ring)
    trigger.arm(armed(ConditionKind.ABOVE, 0.5, before=10, after=4000))
    append(ring, np.concatenate((np.zeros(20), np.ones(80))))
    trigger.step()
    append(ring, np.ones(3000))  # the ring holds the last 1023 of them when they are looked at
    trigger.step()
    append(ring, np.ones(950))
    trigger.step()
    trigger.drain()
    (flight,) = kept(database)
    q = read_flight_columns(database, flight.event_id)["q"]
    lost = 3000 - 1023
    assert (len(q), int(np.isnan(q).sum())) == (4010, lost + 10)
    assert messages.samples_missing(count=lost + 10) in flight.text, "those before it were overwritten too"
    np.testing.assert_array_equal(q[-950:], np.arange(3070, 4020))


def test_an_edge_across_samples_that_were_overwritten_does_not_trigger(database: Database) -> None:
    ring = Ring.create(1024)
    trigger = trigger_on(database, ring)
    append(ring, np.zeros(10))
    trigger.arm(armed(ConditionKind.RISING, 0.5))
    append(ring, np.ones(3000))
    trigger.step()
    assert (trigger.is_armed, trigger.status and trigger.status.left) == (True, 0)


def test_a_restarted_loop_ends_a_capture_and_the_trigger_stays_armed(database: Database) -> None:
    first, second = Ring.create(8192), Ring.create(8192)
    present = first
    trigger = Trigger(database, lambda: present, QUOTA, lambda: LENGTHS, EventBus())
    trigger.arm(armed(ConditionKind.RISING, 0.5, before=10, after=100, captures=2))
    append(first, np.concatenate((np.zeros(50), np.ones(10))))
    trigger.step()
    append(first, np.ones(25))
    present = second
    append(second, np.concatenate((np.ones(30), np.zeros(30), np.ones(150))))
    trigger.step()
    trigger.drain()
    cut, whole = kept(database)
    assert (cut.first_tick, cut.trip_tick, cut.count) == (40, 50, 45), "all that the first loop made"
    told = messages.capture_ended_early(recorded_s=0.035, wanted_s=0.1, reason=messages.loop_ended())
    assert told in cut.text
    assert (whole.first_tick, whole.trip_tick, whole.count) == (50, 60, 110), "no edge from one loop to the next"


def test_disarming_stores_the_partial_capture(database: Database) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    trigger.arm(armed(ConditionKind.ABOVE, 0.5, before=10, after=100, captures=5))
    append(ring, np.concatenate((np.zeros(50), np.ones(40))))
    trigger.step()
    assert trigger.status is not None
    assert trigger.status.left == 60
    trigger.disarm("Ana disarmed it")
    trigger.drain()
    append(ring, np.ones(500))
    trigger.step()
    (flight,) = kept(database)
    assert (flight.count, trigger.is_armed) == (50, False)
    told = messages.capture_ended_early(recorded_s=0.04, wanted_s=0.1, reason="Ana disarmed it")
    assert told in flight.text


def test_combined_signals_trigger_and_the_time_is_stored(database: Database) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    trigger.arm(armed(ConditionKind.ABOVE, 30.0, signal="x_B", after=1))  # r_j q, and q is the tick
    append(ring, np.zeros(1000))
    since = datetime.now(UTC)
    trigger.step()
    trigger.drain()
    (flight,) = kept(database)
    assert flight.trip_tick == 401  # 0.075 · 401 > 30
    assert abs(flight.at - (since - timedelta(milliseconds=599))) < timedelta(seconds=1)


def test_flight_records_and_captures_have_separate_quotas(database: Database, writer: Writer) -> None:
    quota = Quota(2, 10**9)
    recorder, trigger = FlightRecorder(database, lambda: writer.ring, quota), trigger_on(database, writer.ring, quota)
    for turn in range(3):
        recorder.on_event(trip(6000 * turn))
        writer.write(6000)
        recorder.drain()
    trigger.arm(armed(ConditionKind.ABOVE, -10.0, before=1, after=10, captures=5))
    writer.write(200)
    trigger.step()
    trigger.drain()
    found = stored(database)
    assert [one.trigger is None for one in found] == [False, False, True, True]
    with database.reading() as session:
        gave_way = [event.text for event in events.find(session) if "were deleted" in event.text]
    assert sum("trigger captures" in text for text in gave_way) == 3
    assert sum("flight records" in text for text in gave_way) == 1


def test_a_failed_capture_is_reported_and_retried(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    trigger.arm(armed(ConditionKind.ABOVE, 0.5))
    append(ring, np.ones(200))
    trigger.step()

    def full(*_: object) -> None:
        raise StorageError("database or disk is full")

    with monkeypatch.context() as patched:
        patched.setattr(flights, "add", full)
        trigger.drain()
        assert read_problem(trigger.problem) == ("capture_not_stored", "database or disk is full")
        assert stored(database) == []
    trigger.drain()
    assert (trigger.problem, len(stored(database))) == ("", 1)


def test_a_trigger_armed_at_the_end_of_the_service_is_reported_once_later(database: Database) -> None:
    ring = Ring.create(8192)
    trigger = trigger_on(database, ring)
    trigger.arm(armed(ConditionKind.ABOVE, 0.5, captures=2))
    trigger.save_armed("Ana")
    append(ring, np.ones(20))
    trigger.close()
    assert [flight.count for flight in stored(database)] == [20]
    left = load_armed_trigger(database)
    assert left is not None
    assert (left["signal"], left["kind"], left["level"], left["who"]) == ("F_A", "above", 0.5, "Ana")
    assert load_armed_trigger(database) is None
    trigger.arm(armed(ConditionKind.ABOVE, 0.5))
    trigger.save_armed("Ana")
    append(ring, np.ones(200))
    trigger.step()
    trigger.drain()
    assert load_armed_trigger(database) is None, "all its captures were made"
