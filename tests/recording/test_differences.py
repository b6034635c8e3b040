"""Differences between runs, and jumps."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.errors import RequestRejectedError
from backend.recording import reader
from backend.recording.reader import UnknownSignalError, find_jump, jumps
from backend.schemas.comparison import AlignBy, ComparisonRequest, DifferencesRequest, StepSignal
from backend.schemas.state import MarkKind
from backend.services import record_messages
from backend.services.comparison import Curve, compare_runs, compute_differences, stream_curves_file, stream_table_file
from backend.storage import events, runs
from backend.storage.database import Database, open_database
from backend.storage.runs import EndState
from tests.recording.compared_runs import recorded_run

# Differences of runs, their positions and times, match a direct comparison of every sample.

LENGTH = 1500
SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Database:
    return open_database(Path(tmp_path_factory.mktemp("differences")))


def signals(seed: int, step_at: int, length: int = LENGTH) -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """A walk in q, and q_ref with one step."""
    random = np.random.default_rng(seed)
    q_ref = np.where(np.arange(length) < step_at, 0.0, 0.3)
    return {"q": np.cumsum(random.normal(0.0, 0.01, length)), "q_ref": q_ref}


@given(seed=SEEDS, steps=st.tuples(*[st.integers(10, 1400)] * 2), gap=st.integers(0, 1400), band=st.floats(0.0, 0.4))
@settings(max_examples=40, deadline=None)
def test_metrics_of_differences_match_a_direct_computation(
    database: Database, seed: int, steps: tuple[int, int], gap: int, band: float
) -> None:
    lost = range(gap, gap + 40)
    one, other = signals(seed, steps[0]), signals(seed + 1, steps[1], LENGTH - 200)
    steps = steps[0], min(steps[1], 1200)
    other["q_ref"] = np.where(np.arange(LENGTH - 200) < steps[1], 0.0, 0.3)
    reference, run = recorded_run(database, one), recorded_run(database, other, lost, first=7)
    begin = 40 if gap == 0 else 0  # its own time counts from its first sample
    asked = DifferencesRequest(run=[reference, run], by=AlignBy.STEP, step=StepSignal.Q_REF, band=band, points=20000)
    if set(lost) & set(range(steps[1] - 2, steps[1] + 2)):
        return
    [found] = compute_differences(database, asked).runs
    shift = steps[0] - steps[1]
    a, b = (np.asarray(values["q"], np.float32).astype(float) for values in (one, other))
    apart = {
        k: float(b[k - shift] - a[k]) for k in range(LENGTH) if begin <= k - shift < len(b) and (k - shift) not in lost
    }
    for k in range(LENGTH):
        assert found.minimum[k] == found.maximum[k] == apart.get(k)
    outside = [k for k, value in apart.items() if abs(value) > band]
    assert found.compared_s == pytest.approx(len(apart) * 1e-3)
    assert found.missing_s == pytest.approx((LENGTH - len(apart)) * 1e-3)
    assert found.outside_s == pytest.approx(len(outside) * 1e-3)
    assert found.left_at_s == (pytest.approx(outside[0] * 1e-3) if outside else None)
    longest = current = 0
    for k in range(LENGTH):
        current = current + 1 if k in set(outside) else 0
        longest = max(longest, current)
    assert found.longest_s == pytest.approx(longest * 1e-3)
    if apart:
        worst = max(apart, key=lambda k: (abs(apart[k]), -k))
        assert found.largest == apart[worst]
        assert found.largest_at_s == pytest.approx(worst * 1e-3)


def test_buckets_hold_the_extremes_of_their_samples_at_fixed_positions(database: Database) -> None:
    one, other = signals(1, 100), signals(2, 100)
    both = [recorded_run(database, one), recorded_run(database, other)]
    apart = [np.asarray(values["q"], np.float32).astype(float) for values in (other, one)]
    exact = apart[0] - apart[1]
    for from_s, to_s in ((0.0, 9.0), (0.1234, 1.0)):
        found = compute_differences(database, DifferencesRequest(run=both, from_s=from_s, to_s=to_s, points=50))
        width = round(found.width_s / 1e-3)
        first, last = round(from_s * 1e3), min(round(to_s * 1e3), LENGTH)
        assert not found.raw
        assert len(found.t) <= 52
        for t, low, high in zip(found.t, found.runs[0].minimum, found.runs[0].maximum, strict=True):
            begin = round(t * 1e3)
            assert begin % width == 0
            inside = exact[max(begin, first) : min(begin + width, last)]
            assert (low, high) == (inside.min(), inside.max())


def test_curves_are_linear_between_samples_and_interrupted_at_gaps() -> None:
    curve = Curve(np.array([0.0, 1.0, 2.0, 5.0, 6.0]), np.array([0.0, 2.0, np.nan, 1.0, 3.0]), 1.0)
    found = curve.interpolate(np.array([-0.5, 0.0, 0.25, 1.0, 1.5, 3.0, 5.0, 5.5, 6.0, 6.5]))
    np.testing.assert_allclose(found, [np.nan, 0.0, 0.5, 2.0, np.nan, np.nan, 1.0, 2.0, 3.0, np.nan])


def test_missing_signals_are_reported_and_the_others_are_compared(database: Database) -> None:
    plain = recorded_run(database, signals(1, 100))
    with_step = recorded_run(database, signals(2, 300))
    without = recorded_run(database, signals(3, 10**6))
    asked = DifferencesRequest(run=[plain, without, with_step], by=AlignBy.STEP)
    with database.reading() as session:
        told = compare_runs(session, asked)
    assert told.runs[1].aligned_at_s is told.runs[1].offset_s is None
    assert [told.runs[n].aligned_at_s for n in (0, 2)] == pytest.approx([0.1, 0.3])
    assert [told.runs[n].offset_s for n in (0, 2)] == pytest.approx([0.0, -0.2])
    assert [bool(run.not_aligned) for run in told.runs] == [False, True, False]
    why = told.runs[1].not_aligned
    assert why == record_messages.too_few_steps(run=without, signal="q_ref", count=0, minimum=1)
    found = compute_differences(database, asked)
    assert [(one.run, one.reason) for one in found.runs] == [(without, why), (with_step, "")]
    assert (found.runs[0].largest, found.runs[0].compared_s) == (None, 0.0)
    assert set(found.runs[0].minimum) == {None}
    by_it = asked.model_copy(update={"reference": without})
    with database.reading() as session:
        told = compare_runs(session, by_it)
    assert [run.offset_s for run in told.runs] == [None, 0.0, None]
    assert told.runs[0].not_aligned == f"the reference cannot be aligned: {why}"
    second = asked.model_copy(update={"number": 2})
    with database.reading() as session:
        not_aligned = compare_runs(session, second).runs[0].not_aligned
        assert not_aligned == record_messages.too_few_steps(run=plain, signal="q_ref", count=1, minimum=2)
    with pytest.raises(UnknownSignalError):
        compute_differences(database, asked.model_copy(update={"signal": "nonsense"}))
    with pytest.raises(RequestRejectedError, match="is not among the compared runs"):
        compute_differences(database, asked.model_copy(update={"reference": 10**6}))


def test_runs_are_aligned_by_an_event_of_each(database: Database) -> None:
    found = []
    for seed, ticks in ((1, (150, 400)), (2, (130, 900))):
        found.append(recorded_run(database, signals(seed, 10), first=100))
        with database.session() as session:
            for tick in ticks:
                events.add(session, MarkKind.TUNING, "λ", run_id=found[-1], tick=tick)
            runs.end(session, found[-1], EndState.COMPLETED)
    with database.reading() as session:
        asked = ComparisonRequest(run=found, by=AlignBy.EVENT, event=MarkKind.TUNING, number=2)
        told = compare_runs(session, asked).runs
        third = compare_runs(session, asked.model_copy(update={"number": 3})).runs
    assert [run.aligned_at_s for run in told] == pytest.approx([0.3, 0.8])
    assert [run.offset_s for run in told] == pytest.approx([0.0, -0.5])
    expected = record_messages.too_few_events(run=found[0], kind="tuning", count=2, minimum=3)
    assert third[0].not_aligned == expected


def test_an_exported_difference_contains_every_sample_and_its_description(database: Database) -> None:
    one, other = signals(4, 100), signals(5, 250, 900)
    reference, run = recorded_run(database, one), recorded_run(database, other)
    asked = DifferencesRequest(run=[reference, run], by=AlignBy.STEP)
    lines = b"".join(stream_curves_file(database, asked)).decode().splitlines()
    head = [line for line in lines if line.startswith("#")]
    assert "aligned by step 1 of q_ref" in head[0]
    assert any(
        line.startswith(f"# q_run_{run} [rad] q: measured joint position") and "-0.15 s" in line for line in head
    )
    rows = list(csv.DictReader(lines[len(head) :]))
    assert list(rows[0]) == ["t", f"q_run_{reference}", f"q_run_{run}", f"d_q_run_{run}"]
    assert len(rows) == LENGTH
    a, b = (np.asarray(values["q"], np.float32).astype(float) for values in (one, other))
    for k, row in enumerate(rows):
        assert float(row["t"]) == pytest.approx(k * 1e-3)
        assert np.float32(row[f"q_run_{reference}"]) == a[k]
        there = 0 <= k + 150 < 900
        value, apart = np.float32(row[f"q_run_{run}"]), float(row[f"d_q_run_{run}"])
        assert (value, apart) == (b[k + 150], b[k + 150] - a[k]) if there else math.isnan(value) and math.isnan(apart)


def test_the_table_lists_the_differences(database: Database) -> None:
    found = [recorded_run(database, signals(seed, 10)) for seed in (1, 2)]
    lines = b"".join(stream_table_file(database, ComparisonRequest(run=found))).decode().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert rows == []  # sessions have no result, and both are set to nothing
    assert f"# run {found[1]}: Session" in "\n".join(lines)


# Jumps are found where a plain look at every sample finds them, whatever the summaries leave out.

LEVELS = st.sampled_from([0.0, 0.25, -1.5])
PARTS = st.lists(st.tuples(st.sampled_from(["hold", "ramp", "sine", "none"]), st.integers(1, 900), LEVELS), min_size=1)


@pytest.fixture(scope="module")
def database_jumps(tmp_path_factory: pytest.TempPathFactory) -> Database:
    return open_database(Path(tmp_path_factory.mktemp("jumps")))


def drawn(parts: list[tuple[str, int, float]]) -> list[float]:
    values = [0.0]
    for shape, length, level in parts[:12]:
        n = np.arange(length)
        own = {
            "hold": np.full(length, level),
            "ramp": values[-1] + (level - values[-1]) * n / length,
            "sine": values[-1] + 0.3 * np.sin(0.05 * n),
            "none": np.full(length, np.nan),
        }[shape]
        values += own.tolist()
    return values


def find_jumps_directly(values: list[float], lost: range) -> list[float]:
    """Every sample that differs from the one before, between constant intervals of the signal, in milliseconds."""
    y = np.asarray(values, np.float32)
    there = [k for k in range(len(y)) if k not in lost]
    begin = there[0] if there else 0
    found = []
    for k in range(2, len(y) - 1):
        around = y[k - 2 : k + 2]
        if any(j in lost for j in range(k - 2, k + 2)) or not np.isfinite(around).all():
            continue
        if around[0] == around[1] != around[2] == around[3]:
            found.append(round((k - begin) * 1e-3, 6))
    return found


@given(
    parts=PARTS,
    lost_at=st.integers(0, 3000),
    lost_for=st.sampled_from([0, 1, 60, 1000]),
    at_once=st.sampled_from([1, 3, 12_000]),
)
@settings(max_examples=40, deadline=None)
def test_exactly_the_jumps_are_found(
    database_jumps: Database, parts: list[tuple[str, int, float]], lost_at: int, lost_for: int, at_once: int
) -> None:
    values, lost = drawn(parts), range(lost_at, lost_at + lost_for)
    if all(k in lost for k in range(len(values))):
        return
    run = recorded_run(database_jumps, {"q_ref": values}, lost)
    expected = find_jumps_directly(values, lost)
    with pytest.MonkeyPatch.context() as patched, database_jumps.reading() as session:
        patched.setattr(reader, "_MOST_SUMMARIES", at_once)
        assert [round(at_s, 6) for at_s in jumps(session, run, "q_ref")] == expected
        for number in (1, len(expected), len(expected) + 1):
            if number == 0:
                continue
            at_s, count = find_jump(session, run, "q_ref", number)
            assert count == min(number, len(expected))
            assert (None if at_s is None else round(at_s, 6)) == (
                expected[number - 1] if number <= len(expected) else None
            )


def test_a_jump_after_minutes_of_motion_is_found(database_jumps: Database) -> None:
    moving = np.sin(np.arange(130_000) * 0.01)
    values = np.concatenate((moving, np.full(50, 0.2), np.full(50, 0.4)))
    run = recorded_run(database_jumps, {"q_ref": values})
    with database_jumps.reading() as session:
        at_s, count = find_jump(session, run, "q_ref", 1)
    assert at_s == pytest.approx(130.05)
    assert count == 1
