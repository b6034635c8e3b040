"""Timetables of identifications, compared with samples of the loop."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.experiments.forecast import CORNERS_MAX, TIMETABLE_POINTS, Stage, Timetable, forecast_identification
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    IdentificationPlan,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
)
from backend.realtime.commands import Accepted, RunProgram
from backend.realtime.modes import MODE_CODE, Mode
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop

ACTUATOR = ActuatorIdentificationPlan(tension_N=20.0, bits=4, periods=2, settle_s=1.5)
MOTOR = MotorIdentificationPlan(u_low=3.0, u_high=6.0, levels=3)
SPRING = SpringIdentificationPlan(F_low=4.0, F_high=40.0, sweep_s=3.0, cycles=2)


@dataclass(frozen=True)
class Played:
    """What was told of a run, and its samples."""

    told: Timetable
    columns: dict[str, NDArray[np.float64]]

    @property
    def ticks(self) -> int:
        return int(self.columns["mode"].size)

    def at(self, name: str) -> NDArray[np.float64]:
        """The samples of a column at the times of the profile, which may end a little before or after the run."""
        ticks = np.minimum(np.rint(self.told.t / T_s).astype(int) - 1, self.ticks - 1)
        found: NDArray[np.float64] = self.columns[name][ticks]
        return found


def played(plan: IdentificationPlan, name: str = "lab") -> Played:
    parameters = load_parameters(name)
    bench = BenchTop(parameters)
    bench.wind_up()
    references = bench.column("theta_A_ref", 1)[0], bench.column("theta_B_ref", 1)[0]
    told = forecast_identification(plan, parameters, references)
    began = len(bench.samples.rows)
    assert isinstance(bench.send(RunProgram(plan.program(), run=3)), Accepted)
    while bench.loop.mode is Mode.IDENTIFY:
        bench.loop.tick()
    names = ("mode", "theta_A_ref", "theta_B_ref", "u_A", "u_B", "F_A", "F_B", "theta_A")
    columns = {name: bench.column(name)[began:] for name in names}
    identified = columns["mode"] == MODE_CODE[Mode.IDENTIFY]
    return Played(told, {name: column[identified] for name, column in columns.items()})


def test_the_tension_that_is_held_and_its_excitation_are_those_of_the_samples() -> None:
    run = played(ACTUATOR)
    travel, settle, excite = run.told.intervals
    assert [one.stage for one in run.told.intervals] == [Stage.TRAVELLING, Stage.SETTLING, Stage.EXCITING]
    assert [run.told.title(one) for one in run.told.intervals] == ["20 N"] * 3
    assert run.ticks - excite.end in (0, 1, 2)  # the loop takes a tick to see that it is over
    wound = run.columns["theta_B_ref"]
    assert wound[travel.end] == 0.0
    assert wound[travel.end - 3] != 0.0
    trimmed = run.columns["theta_A_ref"]
    sequence = 0.5 * np.diff(trimmed)  # the trim of the force loop moves by far less in a tick than a chip does
    jumps = np.flatnonzero(np.abs(sequence) > 0.2) + 1
    assert jumps[0] == pytest.approx(excite.begin, abs=2)
    assert not np.any((jumps > settle.begin) & (jumps < excite.begin - 2))
    planned = run.told.signals["theta_A_ref"]
    where = np.flatnonzero(np.abs(np.diff(planned)) > 0.5)
    told_jumps = {round(run.told.t[at + 1] / T_s) - 1 for at in where}
    assert {int(at) for at in jumps} <= {at + late for at in told_jumps for late in (0, 1)}
    assert len(told_jumps) == len(jumps)
    held = slice(settle.end - 200, settle.end)
    assert np.mean(0.5 * (run.columns["F_A"] + run.columns["F_B"])[held]) == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_each_step_has_its_voltage_at_the_forecast_time(name: str) -> None:
    run = played(MOTOR, name)
    whole, tolerance = run.ticks, round(0.02 * run.ticks)
    steps = [one for one in run.told.intervals if one.stage is Stage.EXCITING]
    assert [one.set_point for one in steps] == [3.0, -3.0, 4.5, -4.5, 6.0, -6.0]
    assert [(one.number, one.of) for one in steps] == [(number, 6) for number in range(1, 7)]
    assert run.told.title(steps[1]) == "−3 V"
    assert run.told.intervals[-1].end == pytest.approx(whole, abs=tolerance)
    u, free = run.columns["u_A"], np.isnan(run.columns["theta_A_ref"])
    for step in steps:
        driven = np.flatnonzero((u == step.set_point) & (run.columns["u_B"] == step.set_point) & free)
        assert driven[0] == pytest.approx(step.begin, abs=tolerance)
        assert driven[-1] + 1 == pytest.approx(step.end, abs=tolerance)
        assert np.all(np.diff(driven) == 1)
    begins = [one.begin for one in run.told.intervals if one.stage is Stage.TRAVELLING]
    walks = [0, *(np.flatnonzero(np.diff(free.astype(int)) == -1) + 1)]
    assert begins == pytest.approx(walks[: len(begins)], abs=tolerance)
    # the way to the first step has nothing to guess: it is the samples' own, to the tick
    first = np.flatnonzero(free)[0]
    early = run.told.t < (first - 2) * T_s
    assert run.told.signals["theta_A_ref"][early] == pytest.approx(run.at("theta_A_ref")[early], abs=0.0031)
    assert np.isnan(run.told.signals["theta_A_ref"]).any()
    assert np.nanmax(np.abs(run.told.signals["u_A"])) == 6.0


def test_the_sweep_has_its_tensions_at_the_forecast_times() -> None:
    run = played(SPRING)
    assert [one.set_point for one in run.told.intervals] == [4.0, 4.0, 40.0, 4.0, 40.0, 4.0]
    assert [one.number for one in run.told.intervals] == [1, 1, 2, 3, 4, 5]
    assert {one.of for one in run.told.intervals} == {5}
    assert run.told.intervals[-1].end == pytest.approx(run.ticks, abs=2)
    # references are the samples' own, to a tick of the fastest walk
    assert run.told.signals["theta_A_ref"] == pytest.approx(run.at("theta_A_ref"), abs=0.0031)
    for stretch in run.told.intervals[1:]:  # closed form: the tension at the end of each leg is its set point
        at = np.searchsorted(run.told.t, stretch.end * T_s - 1e-9)
        assert run.told.signals["F_A"][at] == pytest.approx(stretch.set_point, abs=1e-6)
    # what the load cells read is half a second of the motors' lag behind, and their noise beside
    sweeping = run.told.t > (run.told.intervals[1].end + 500) * T_s
    assert np.max(np.abs(run.told.signals["F_A"] - run.at("F_A"))[sweeping]) < 8.0
    assert np.ptp(run.at("F_A")) == pytest.approx(36.0, abs=3.0)


@pytest.mark.parametrize("plan", [ACTUATOR, MOTOR, SPRING], ids=["actuator", "motor", "spring"])
def test_stretches_follow_each_other_without_gaps_and_are_drawn_from_end_to_end(plan: IdentificationPlan) -> None:
    told = forecast_identification(plan, load_parameters("lab"))
    begins = [one.begin for one in told.intervals]
    assert begins == [0, *(one.end for one in told.intervals[:-1])]
    assert all(one.begin < one.end for one in told.intervals)
    assert told.t[0] == pytest.approx(T_s)
    assert told.t[-1] == pytest.approx(told.duration_s)
    assert np.all(np.diff(told.t) > 0.0)
    assert all(values.size == told.t.size for values in told.signals.values())


def test_the_longest_excitation_is_drawn_by_so_many_points() -> None:
    plan = replace(ACTUATOR, bits=12, periods=10, chip_s=0.0146)
    assert forecast_identification(plan, load_parameters("lab")).t.size <= CORNERS_MAX + 2 * TIMETABLE_POINTS + 2
