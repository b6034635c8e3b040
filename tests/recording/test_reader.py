"""Recordings read back: slices, envelopes and columns."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.realtime.ring_buffer import Ring
from backend.recording.reader import (
    SampleEnvelope,
    UnknownSignalError,
    read_drawn_columns,
    read_envelope,
    read_recorded_columns,
    read_samples,
)
from backend.sample import ADDED_LATER, INDEX, STORED_NAMES
from backend.storage.database import Database, open_database
from backend.storage.orm import UnknownRecordError
from tests.recording.stand_in import Rows, Writer, new_run, recorder_of
from tests.refusals import refused

# Slices and envelopes agree with the written samples, reduced by a plain loop.

TICKS = 12_000


class Recorded:
    """A run whose samples 3000 to 4699 were lost."""

    def __init__(self, database: Database) -> None:
        self.database = database
        self.run_id = new_run(database).id
        writer = Writer(Ring.create(TICKS + 100))
        recorder = recorder_of(writer, database)
        writer.write(50)
        head = writer.write(3000, self.run_id)
        recorder.drain()
        recorder._position += 1700
        writer.write(1700, self.run_id)
        tail = writer.write(TICKS - 4700, self.run_id)
        writer.write(1)
        recorder.close()
        writer.ring.close()
        self.rows: Rows = np.concatenate((head, tail))
        self.ticks = self.rows[:, INDEX["tick"]].astype(int) - 50

    def column(self, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return self.rows[:, INDEX[name]].astype(np.float32)

    def envelope(self, points: int, from_s: float = 0.0, to_s: float = np.inf) -> SampleEnvelope:
        with self.database.reading() as session:
            return read_envelope(session, self.run_id, points, ["q", "S_true"], from_s, to_s)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return Recorded(open_database(Path(tmp_path_factory.mktemp("reader"))))


@given(a=st.integers(-500, TICKS + 500), b=st.integers(-500, TICKS + 500))
@settings(max_examples=40, deadline=None)
def test_a_slice_holds_exactly_the_samples_within(recorded: Recorded, a: int, b: int) -> None:
    with recorded.database.reading() as session:
        samples = read_samples(session, recorded.run_id, ["F_A"], a * 1e-3, b * 1e-3)
    inside = (recorded.ticks >= a) & (recorded.ticks < b)
    assert samples.first_tick == 50
    np.testing.assert_allclose(samples.t, recorded.ticks[inside] * 1e-3, atol=1e-9)
    np.testing.assert_array_equal(samples.columns["F_A"], recorded.column("F_A")[inside])


@given(a=st.integers(0, TICKS), length=st.integers(1, TICKS), points=st.integers(1, 3000))
@settings(max_examples=60, deadline=None)
def test_an_envelope_bounds_the_samples_at_fixed_positions(
    recorded: Recorded, a: int, length: int, points: int
) -> None:
    b = min(a + length, TICKS)
    envelope = recorded.envelope(points, a * 1e-3, b * 1e-3)
    width = round(envelope.width_s / 1e-3)
    assert len(envelope.t) <= points + 2
    begins = np.rint(envelope.t / 1e-3).astype(int)
    assert np.all(begins % width == 0)
    q = recorded.column("q")
    for begin, low, high in zip(begins, envelope.minimum["q"], envelope.maximum["q"], strict=True):
        within = q[(recorded.ticks >= max(a, begin)) & (recorded.ticks < min(b, begin + width))]
        around = q[(recorded.ticks >= begin) & (recorded.ticks < begin + width)]
        if len(within):
            assert around.min() <= low <= within.min()
            assert around.max() >= high >= within.max()
        else:
            assert np.isnan(low) or low in around
    assert np.all(np.isnan(envelope.minimum["S_true"]))


@pytest.mark.parametrize("points", [1, 7, 240, 300, 5000, 100_000])
def test_the_whole_envelope_is_the_minimum_and_maximum(recorded: Recorded, points: int) -> None:
    envelope = recorded.envelope(points)
    width = round(envelope.width_s / 1e-3)
    buckets = recorded.ticks // width
    q = recorded.column("q")
    for bucket, (low, high) in enumerate(zip(envelope.minimum["q"], envelope.maximum["q"], strict=True)):
        values = q[buckets == bucket]
        if len(values):
            assert (low, high) == (values.min(), values.max())
        else:
            assert np.isnan(low)
            assert np.isnan(high)


def test_lost_samples_are_a_gap(recorded: Recorded) -> None:
    envelope = recorded.envelope(240)
    hole = (envelope.t > 3.0) & (envelope.t < 4.65)
    assert np.all(np.isnan(envelope.minimum["q"][hole]))
    assert not np.any(np.isnan(envelope.minimum["q"][(envelope.t < 2.9) | (envelope.t > 4.8)]))


def test_a_query_without_names_returns_all_signals(recorded: Recorded) -> None:
    with recorded.database.reading() as session:
        assert tuple(read_samples(session, recorded.run_id, to_s=0.01).columns) == STORED_NAMES


def test_unreadable_recordings_are_rejected(recorded: Recorded) -> None:
    with recorded.database.reading() as session:
        with refused(UnknownSignalError, "signals_not_recorded", signals=["Q"], recorded=list(STORED_NAMES)):
            read_samples(session, recorded.run_id, ["Q"])
        with refused(UnknownRecordError, "record_not_found", record="recording of run", number=99):
            read_samples(session, 99)
        with pytest.raises(ValueError, match="points = 0"):
            read_envelope(session, recorded.run_id, 0)


def test_a_run_without_samples_yet_has_no_recording(recorded: Recorded) -> None:
    run = new_run(recorded.database)
    refusal = refused(UnknownRecordError, "record_not_found", record="recording of run", number=run.id)
    with recorded.database.reading() as session, refusal:
        read_samples(session, run.id)


def test_a_signal_that_only_later_versions_record_is_nan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    earlier = [name for name in STORED_NAMES if name not in ADDED_LATER]
    monkeypatch.setattr("backend.recording.recorder.STORED_NAMES", tuple(earlier))
    monkeypatch.setattr("backend.recording.recorder.STORED_COLUMNS", [INDEX[name] for name in earlier])
    recorded = Recorded(open_database(tmp_path))
    for name in ADDED_LATER:
        with recorded.database.reading() as session:
            some = read_samples(session, recorded.run_id, ["q", name, "S"], 0.0, 0.5)
            none = read_envelope(session, recorded.run_id, 7, [name])
            known = read_samples(session, recorded.run_id)
        assert list(some.columns) == ["q", name, "S"]
        np.testing.assert_array_equal(some.columns["q"], recorded.column("q")[:500])
        assert np.isnan(some.columns[name]).all()
        assert np.isnan(none.minimum[name]).all()
        assert none.t.size == none.maximum[name].size > 0
        assert name not in known.columns
    recorded.database.close()


# Columns for computation and columns for charts, from the same recording.


def test_columns_hold_every_sample_and_charts_their_extremes(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    written = writer.write(6_000, run.id)
    writer.write(1)
    recorder.drain()

    columns, missed = read_recorded_columns(database, run.id)
    assert missed == 0
    assert set(columns) == {"t", *STORED_NAMES}
    np.testing.assert_allclose(columns["t"], np.arange(6_000) * 1e-3)
    np.testing.assert_allclose(columns["q"], written[:, INDEX["q"]], atol=1e-6)

    drawn = read_drawn_columns(database, run.id, points=50)
    assert drawn["t"].size <= 120
    assert np.all(np.diff(drawn["t"]) > 0)
    for name in ("q", "S", "u_A"):
        assert (drawn[name].min(), drawn[name].max()) == (columns[name].min(), columns[name].max())
    recorder.close()


def test_a_run_without_samples_has_empty_columns(database: Database) -> None:
    run = new_run(database)
    assert read_recorded_columns(database, run.id)[0]["q"].size == 0
    assert read_drawn_columns(database, run.id)["t"].size == 0
