"""A recording as a plant."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Accepted, PlantFailing, Reset, Stopped
from backend.realtime.modes import Mode
from plant import messages, replay
from plant.interface import NO_LOAD, Measurement, MotorCommand, PlantError
from plant.parameters import PlantParameters
from plant.replay import Replay, load_replay, preload_replay
from tests.exports.written import to_csv, to_mat, to_parquet
from tests.plant.recorded import columns_of, session, trip_recorded
from tests.realtime.bench_top import BenchTop
from tests.refusals import refused

# Replay of a recording by Sinew: the same readings, the same trip, and the deviation of the voltages.

Columns = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def recorded(lab: PlantParameters, tmp_path_factory: pytest.TempPathFactory) -> tuple[BenchTop, Path]:
    file = tmp_path_factory.mktemp("replay") / "run-7.csv"
    return trip_recorded(lab, file, seed=3), file


@pytest.fixture
def columns() -> Columns:
    """Two hundred samples of a joint at rest under tension."""
    ticks = np.arange(200.0)
    still = {"q": 0.1, "theta_A": 4.0, "theta_B": 3.0, "F_A": 12.0, "F_B": 11.0, "u_A": 0.5, "u_B": 0.4}
    return {
        "t": ticks / 1000.0,
        **{name: np.full(200, value) for name, value in still.items()},
        "S_true": np.full(200, np.nan),
        "F_push": np.zeros(200),
        "fault": np.zeros(200),
    }


def played(columns: Columns, folder: Path, write: Callable[[Columns], bytes] = to_csv, ending: str = "csv") -> Replay:
    file = folder / f"run-7.{ending}"
    file.write_bytes(write(columns))
    plant = Replay(load_replay(file))
    plant.open()
    return plant


def test_a_recorded_trip_is_repeated_in_the_same_tick(recorded: tuple[BenchTop, Path], lab: PlantParameters) -> None:
    bench, file = recorded
    plant = Replay(load_replay(file))
    again = session(lab, plant)
    assert again.loop.fault is bench.loop.fault is Fault.SENSOR_JUMP
    for name in ("fault", "mode"):
        np.testing.assert_array_equal(again.column(name), bench.column(name))
    stops = [[event for event in which.events if isinstance(event, Stopped)] for which in (bench, again)]
    assert [(stop.fault, stop.detail) for stop in stops[1]] == [(stop.fault, stop.detail) for stop in stops[0]]
    assert plant.difference.volts == pytest.approx(
        max(np.abs(again.column(u) - bench.column(u)).max() for u in ("u_A", "u_B")), abs=1e-5
    )


def test_another_controller_is_detected_by_its_voltages(recorded: tuple[BenchTop, Path], lab: PlantParameters) -> None:
    bench, file = recorded
    plant = Replay(load_replay(file))
    plant.open()
    u_A, u_B = (bench.column(name).astype(np.float32).astype(float) for name in ("u_A", "u_B"))
    u_B[4321] += 0.25
    for tick in range(u_A.size):
        plant.read()
        plant.write(MotorCommand(u_A[tick], u_B[tick]))
    assert plant.difference == pytest.approx((0.25, "u_B", 4.321))
    difference_V, t = pytest.approx(0.25), pytest.approx(4.321)
    with refused(PlantError, "recording_ended", difference_V=difference_V, output="u_B", t=t):
        plant.read()


def test_replay_returns_the_recorded_readings_for_any_voltages(columns: Columns, tmp_path: Path) -> None:
    columns["F_A"] += np.arange(200.0) / 100.0
    columns["S_true"][:] = 9.5
    columns["F_push"][50:] = 3.0
    columns["F_wall"] = np.linspace(0.0, -9.0, 200)
    plant = played(columns, tmp_path)
    for tick in range(199):
        m = plant.read()
        assert m[:5] == plant.read()[:5]
        assert m == pytest.approx(
            (0.1, 4.0, 3.0, columns["F_A"][tick], 11.0, 9.5, columns["F_push"][tick], 0.0, columns["F_wall"][tick]),
            rel=1e-6,
        )
        plant.write(MotorCommand(10.0, -10.0))


def test_a_recording_from_before_obstacles_has_no_obstacle_force(columns: Columns, tmp_path: Path) -> None:
    assert "F_wall" not in columns
    m = played(columns, tmp_path).read()
    assert np.isnan(m.F_wall)
    assert (m.q, m.F_push, m.safety_trip) == pytest.approx((0.1, 0.0, 0.0))


@pytest.mark.parametrize(("write", "ending"), [(to_csv, "csv"), (to_parquet, "parquet")])
def test_both_export_formats_give_the_same_replay(
    recorded: tuple[BenchTop, Path], tmp_path: Path, write: Callable[[Columns], bytes], ending: str
) -> None:
    bench, file = recorded
    other = tmp_path / f"other.{ending}"
    other.write_bytes(write(dict(columns_of(bench))))
    first, second = load_replay(file), load_replay(other)
    for name, values in first.columns.items():
        np.testing.assert_array_equal(values.astype(np.float32), second.columns[name].astype(np.float32))


def test_a_byte_order_mark_is_ignored(columns: Columns, tmp_path: Path) -> None:
    plain, marked = played(columns, tmp_path), played(columns, tmp_path, lambda them: b"\xef\xbb\xbf" + to_csv(them))
    assert marked.read()[:5] == plain.read()[:5]


def test_a_flight_record_begins_before_its_trip(columns: Columns, tmp_path: Path) -> None:
    columns["t"] = columns["t"] - 0.15
    columns["fault"][150:] = FAULT_CODE[Fault.SENSOR_INVALID]
    columns["q"][150:] = np.nan
    plant = played(columns, tmp_path)
    for _ in range(150):
        assert np.isfinite(plant.read().q)
        plant.write(MotorCommand(0.0, 0.0))
    assert np.isnan(plant.read().q)
    assert plant.difference.t == pytest.approx(-0.15)


def test_the_safety_module_trips_in_the_recorded_tick(columns: Columns, tmp_path: Path) -> None:
    assert FAULT_CODE[Fault.SAFETY_MODULE] == replay.SAFETY_MODULE
    columns["fault"][100:150] = replay.SAFETY_MODULE
    plant = played(columns, tmp_path)
    trips = []
    for _ in range(200):
        trips.append(plant.read().safety_trip)
        plant.write(MotorCommand(0.0, 0.0))
    assert trips == [0.0] * 100 + [1.0] * 50 + [0.0] * 50


def test_the_end_of_a_replay_trips_once_and_a_reset_restarts_it(
    columns: Columns, tmp_path: Path, lab: PlantParameters
) -> None:
    plant = played(columns, tmp_path)
    bench = BenchTop(lab, plant=plant)
    bench.advance(0.3)
    assert (bench.loop.mode, bench.loop.fault) == (Mode.TRIPPED, Fault.PLANT_ERROR)
    (failing,) = (event for event in bench.events if isinstance(event, PlantFailing))
    assert failing.tick == 200
    difference_V, output, t = plant.difference
    assert difference_V == pytest.approx(0.5)
    assert messages.recording_ended(samples=200, difference_V=difference_V, output=output, t=t) in failing.reason
    bench.advance(1.0)
    assert plant.sample == 0
    assert isinstance(bench.send(Reset()), Accepted)
    bench.advance(0.05)
    assert plant.sample == 50


def test_operations_that_a_replay_lacks_are_rejected(columns: Columns, tmp_path: Path) -> None:
    plant = played(columns, tmp_path)
    before: Measurement = plant.read()
    attempts: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: plant.push(1.0), "replay_cannot_be_pushed"),
        (lambda: plant.load(NO_LOAD), "replay_cannot_be_loaded"),
        (lambda: plant.inject(None), "replay_without_fault_injection"),
        (lambda: plant.zero(0.0, 0.0, 0.0), "replay_has_its_zeros"),
    )
    for attempt, code in attempts:
        with refused(PlantError, code):
            attempt()
    assert plant.read()[:5] == before[:5]


def without(name: str) -> Callable[[Columns], None]:
    return lambda columns: columns.__delitem__(name)


def at(name: str, index: int, value: float) -> Callable[[Columns], None]:
    return lambda columns: columns[name].__setitem__(index, value)


def each(change: Callable[[np.ndarray], np.ndarray], *names: str) -> Callable[[Columns], None]:
    return lambda columns: columns.update({name: change(columns[name]) for name in names or tuple(columns)})


@pytest.mark.parametrize(
    ("spoil", "code", "values"),
    [
        (
            without("theta_B"),
            "column_missing",
            {
                "column": "theta_B",
                "unit": "rad",
                "columns": ["t", "q", "theta_A", "F_A", "F_B", "u_A", "u_B", "S_true", "F_push", "fault"],
            },
        ),
        (without("u_A"), "column_missing", {"column": "u_A", "unit": "V"}),
        (at("F_A", 40, np.nan), "sample_not_a_number", {"column": "F_A", "t": pytest.approx(0.040)}),
        (at("u_B", 41, np.nan), "sample_not_a_number", {"column": "u_B", "t": pytest.approx(0.041)}),
        (at("t", 3, np.nan), "sample_without_time", {"sample": 4}),
        (
            at("u_A", 7, 10.1),
            "sample_out_of_range",
            {
                "column": "u_A",
                "value": pytest.approx(10.1),
                "t": pytest.approx(0.007),
                "maximum": pytest.approx(10.0),
                "unit": "V",
            },
        ),
        (
            at("u_B", 8, -10.1),
            "sample_out_of_range",
            {
                "column": "u_B",
                "value": pytest.approx(-10.1),
                "t": pytest.approx(0.008),
                "maximum": pytest.approx(10.0),
                "unit": "V",
            },
        ),
        (
            each(np.degrees, "q"),
            "sample_out_of_range",
            {
                "column": "q",
                "value": pytest.approx(np.degrees(0.1)),
                "t": pytest.approx(0.0),
                "maximum": pytest.approx(np.pi),
                "unit": "rad",
            },
        ),
        (
            each(lambda values: 10.0 * values, "t"),
            "recording_of_other_period",
            {"period_s": pytest.approx(0.010), "expected_s": pytest.approx(0.001)},
        ),
        (
            each(lambda values: np.delete(values, slice(60, 72))),
            "samples_missing",
            {"t": pytest.approx(0.059), "step_s": pytest.approx(0.013)},
        ),
        (each(lambda values: values[:1]), "recording_too_short", {"samples": 1}),
    ],
)
def test_a_malformed_recording_is_rejected_with_the_position(
    columns: Columns, tmp_path: Path, spoil: Callable[[Columns], None], code: str, values: dict[str, object]
) -> None:
    spoil(columns)
    file = tmp_path / "run-7.csv"
    file.write_bytes(to_csv(columns))
    with refused(PlantError, code, recording="run-7.csv", **values):
        load_replay(file)


def test_files_of_other_types_are_rejected(columns: Columns, tmp_path: Path) -> None:
    for name, content, code, column in (
        ("run.mat", to_mat(columns), "recording_of_other_format", None),
        ("run.parquet", b"PAR1 junk", "recording_unreadable", None),
        ("run.csv", b"t,q\n1,2\n3\n", "recording_unreadable", None),
        ("text.csv", to_csv(columns).replace(b",0.1,", b",far,"), "column_without_numbers", "q"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PlantError) as error:
            load_replay(tmp_path / name)
        message = error.value.message
        assert (message.code, message.values["recording"], message.values.get("column")) == (code, name, column)
        assert len(message.splitlines()) == 1
    with refused(PlantError, "recording_unreadable", recording="gone.csv", reason=os.strerror(errno.ENOENT)):
        load_replay(tmp_path / "gone.csv")


def test_a_wrong_unit_in_the_file_is_rejected(columns: Columns, tmp_path: Path) -> None:
    table = pa.parquet.read_table(pa.BufferReader(to_parquet(columns)))
    fields = [field.with_metadata({"unit": "deg"}) if field.name == "q" else field for field in table.schema]
    pa.parquet.write_table(pa.table(table.columns, schema=pa.schema(fields)), tmp_path / "run.parquet")
    with refused(PlantError, "column_in_other_unit", column="q", unit="deg", expected="rad"):
        load_replay(tmp_path / "run.parquet")


# A recording that was looked over is not read a second time in the same process, unless the file has changed.

COLUMNS = {name: np.zeros(20) for name in ("q", "theta_A", "theta_B", "F_A", "F_B", "u_A", "u_B")}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    found = tmp_path / "run.csv"
    found.write_bytes(to_csv({"t": np.arange(20.0) / 1000.0, **COLUMNS}))
    return found


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    found: list[Path] = []
    read = replay._read_table

    def counted(path: Path) -> Any:
        found.append(path)
        return read(path)

    monkeypatch.setattr(replay, "_read_table", counted)
    return found


def test_a_preloaded_replay_is_used_once(file: Path, reads: list[Path]) -> None:
    preload_replay(file)
    assert len(load_replay(str(file))) == 20
    assert len(reads) == 1
    load_replay(file)
    assert len(reads) == 2


def test_a_file_changed_after_preloading_is_read_again(file: Path, reads: list[Path]) -> None:
    preload_replay(file)
    os.utime(file, ns=(1, 1))
    load_replay(file)
    assert len(reads) == 2
