"""Columns to compute with and columns to draw, from the same recording."""

import numpy as np

from backend.recording.reader import read_drawn_columns, read_recorded_columns
from backend.sample import INDEX, STORED_NAMES
from backend.storage.database import Database
from tests.recording.stand_in import Writer, new_run, recorder_of


def test_columns_hold_every_sample_and_drawings_their_extremes(database: Database, writer: Writer) -> None:
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
