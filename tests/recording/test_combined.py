"""Signals that are not stored: their envelopes are those of the sums themselves, and nan where there is none."""

from pathlib import Path

import numpy as np
import pytest

from backend.realtime.ring_buffer import Ring
from backend.recording.reader import UnknownSignalError, read_envelope, read_samples
from backend.sample import COMBINED_SIGNAL_BY_NAME, COMBINED_SIGNALS, INDEX
from backend.storage import runs
from backend.storage.database import Database, open_database
from backend.storage.runs import NewRun, RunKind
from tests.recording.stand_in import Rows, Writer, recorder_of

TICKS = 9_000
R_M, R_J = 0.0075, 0.075
NAMES = [one.name for one in COMBINED_SIGNALS if "S_true" not in one.name]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Database, int, Rows]:
    database = open_database(Path(tmp_path_factory.mktemp("combined")))
    geometry = {"r_m": {"value": R_M}, "r_j": {"value": R_J}}
    with database.session() as session:
        plant = {"plant": "simulator", "parameters_name": "ideal", "parameters": {"geometry": geometry}}
        run = runs.create(session, NewRun(kind=RunKind.SESSION, who="Ana", software="0.1.0", **plant))  # type: ignore[arg-type]  # a dict of these keys
    writer = Writer(Ring.create(TICKS + 100))
    recorder = recorder_of(writer, database)
    writer.write(50)
    head = writer.write(4000, run.id)
    recorder.drain()
    recorder._position += 1000
    writer.write(1000, run.id)
    tail = writer.write(TICKS - 5000, run.id)
    writer.write(1)
    recorder.close()
    writer.ring.close()
    return database, run.id, np.concatenate((head, tail))


def plainly(rows: Rows, name: str) -> Rows:
    """The sum, written out by hand."""
    column = {one: rows[:, at].astype(np.float32).astype(np.float64) for one, at in INDEX.items()}
    if name == "x_A":
        return R_M * column["theta_A"] - R_J * column["q"]
    if name == "x_B":
        return R_M * column["theta_B"] + R_J * column["q"]
    of, _, taken = name.partition(" - ")
    return column[of] - column[taken]


@pytest.mark.parametrize("points", [20_000, 3000, 100, 17])
@pytest.mark.parametrize(("from_s", "to_s"), [(0.0, np.inf), (1.2345, 6.789), (3.9, 5.1)])
def test_an_envelope_has_the_extremes_of_the_sums(
    recorded: tuple[Database, int, Rows], points: int, from_s: float, to_s: float
) -> None:
    database, run, rows = recorded
    with database.reading() as session:
        found = read_envelope(session, run, points, ["q", *NAMES, "F_A"], from_s, to_s)
    t = (rows[:, INDEX["tick"]] - 50) * 1e-3
    inside = (t >= from_s - 5e-4) & (t < to_s - 5e-4)
    assert list(found.minimum) == ["q", *NAMES, "F_A"]
    for name in NAMES:
        values = plainly(rows, name)
        assert len(found.minimum[name]) == len(found.t)
        for bucket, begin in enumerate(found.t):
            here = values[inside & (t >= begin - 5e-4) & (t < begin + found.width_s - 5e-4)]
            low, high = (here.min(), here.max()) if here.size else (np.nan, np.nan)
            assert found.minimum[name][bucket] == pytest.approx(low, rel=1e-6, abs=1e-7, nan_ok=True)
            assert found.maximum[name][bucket] == pytest.approx(high, rel=1e-6, abs=1e-7, nan_ok=True)


def test_alone_they_bring_no_column(recorded: tuple[Database, int, Rows]) -> None:
    database, run, _ = recorded
    with database.reading() as session:
        assert list(read_envelope(session, run, 100, ["q - q_ref"]).minimum) == ["q - q_ref"]


def test_what_cannot_be_had_is_nan(recorded: tuple[Database, int, Rows]) -> None:
    database, run, _ = recorded
    with database.reading() as session:
        assert np.isnan(read_envelope(session, run, 100, ["S - S_true"]).minimum["S - S_true"]).all()  # as on a rig


def test_exports_know_columns_only(recorded: tuple[Database, int, Rows]) -> None:
    database, run, _ = recorded
    with database.reading() as session, pytest.raises(UnknownSignalError, match="no signal q - q_ref"):
        read_samples(session, run, ["q - q_ref"])


def test_each_has_the_unit_of_its_terms() -> None:
    metres = {"x_A", "x_B"}
    assert {one.name for one in COMBINED_SIGNALS if one.unit == "m"} == metres
    assert len(COMBINED_SIGNAL_BY_NAME) == len(COMBINED_SIGNALS)
    assert not set(COMBINED_SIGNAL_BY_NAME) & set(INDEX)
