"""Jumps are found where a plain look at every sample finds them, whatever the summaries leave out."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.recording import reader
from backend.recording.reader import find_jump, jumps
from backend.storage.database import Database, open_database
from tests.recording.compared_runs import recorded_run

LEVELS = st.sampled_from([0.0, 0.25, -1.5])
PARTS = st.lists(st.tuples(st.sampled_from(["hold", "ramp", "sine", "none"]), st.integers(1, 900), LEVELS), min_size=1)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Database:
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


def looked_at(values: list[float], lost: range) -> list[float]:
    """Every sample that differs from the one before, beside which the signal stands still, in milliseconds."""
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
def test_every_jump_is_found_and_nothing_else(
    database: Database, parts: list[tuple[str, int, float]], lost_at: int, lost_for: int, at_once: int
) -> None:
    values, lost = drawn(parts), range(lost_at, lost_at + lost_for)
    if all(k in lost for k in range(len(values))):
        return
    run = recorded_run(database, {"q_ref": values}, lost)
    expected = looked_at(values, lost)
    with pytest.MonkeyPatch.context() as patched, database.reading() as session:
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


def test_a_jump_after_minutes_of_motion_is_found(database: Database) -> None:
    moving = np.sin(np.arange(130_000) * 0.01)
    values = np.concatenate((moving, np.full(50, 0.2), np.full(50, 0.4)))
    run = recorded_run(database, {"q_ref": values})
    with database.reading() as session:
        at_s, count = find_jump(session, run, "q_ref", 1)
    assert at_s == pytest.approx(130.05)
    assert count == 1
