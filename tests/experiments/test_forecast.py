"""Forecasts of identifications, compared with the control loop that executes them."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.errors import OutOfRangeError
from backend.experiments import messages
from backend.experiments.forecast import (
    CORNERS_MAX,
    TIMETABLE_POINTS,
    Forecast,
    Stage,
    Timetable,
    forecast_identification,
    forecast_identifications,
    read_initial_state,
)
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    IdentificationPlan,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
)
from backend.realtime.commands import Accepted, RunProgram, SetMode, SetReferences
from backend.realtime.modes import MODE_CODE, Mode
from backend.tuning.gains import LAM_MOTOR
from plant.interface import T_s
from plant.message import Message
from plant.parameters import PlantParameters, load_parameters
from tests.realtime.bench_top import BenchTop
from tests.reasons import assert_reason

# Forecasts of identifications, compared with the simulator: range of the joint and duration.

SHORT = ActuatorIdentificationPlan(bits=4, periods=1, settle_s=1.0)
MOTOR = MotorIdentificationPlan(u_low=2.0, u_high=5.0, levels=2)
SPRING = SpringIdentificationPlan(sweep_s=3.0, cycles=1)


def to_centre(bench: BenchTop) -> None:
    bench.send(SetMode(Mode.RUN, 1))
    bench.send(SetReferences(0.0, 10.0))
    bench.advance(2.0)


def to_the_right(bench: BenchTop) -> None:
    bench.send(SetMode(Mode.RUN, 1))
    bench.send(SetReferences(0.9, 14.0))
    bench.advance(3.0)


def in_motion(bench: BenchTop) -> None:
    bench.send(SetMode(Mode.RUN, 1))
    bench.send(SetReferences(-1.2, 9.0))
    bench.advance(0.5)


def held_by_geometry(bench: BenchTop) -> None:
    to_the_right(bench)
    bench.send(SetMode(Mode.COMPLIANCE))
    bench.advance(0.2)


def stay(_bench: BenchTop) -> None:
    """Leave the bench as after the previous run, or slack without a previous run."""


def forecast_from_bench(bench: BenchTop, plans: list[IdentificationPlan], parameters: PlantParameters) -> Forecast:
    return forecast_identifications(plans, parameters, read_initial_state(bench.samples.rows[-1]), LAM_MOTOR)


def play(bench: BenchTop, plans: list[IdentificationPlan]) -> slice:
    """Execute the plans like the service until the mode is pretension again; return the samples."""
    began = len(bench.samples.rows)
    for plan in plans:
        if bench.loop.mode in (Mode.OFF, Mode.COMPLIANCE):
            assert isinstance(bench.send(SetMode(Mode.PRETENSION)), Accepted)
        for _ in range(60_000):
            if bench.loop.mode is Mode.RUN or bench.loop.is_pretension_done:
                break
            bench.loop.tick()
        assert isinstance(bench.send(RunProgram(plan.program(), run=3)), Accepted)
        while bench.loop.mode is Mode.IDENTIFY:
            bench.loop.tick()
    while bench.loop.mode is Mode.PRETENSION and not bench.loop.is_pretension_done:
        bench.loop.tick()
    assert bench.loop.is_pretension_done, bench.loop.fault
    return slice(began, None)


def compare(bench: BenchTop, predicted: Forecast, seen: slice, room_rad: float) -> None:
    """Compare a run with its forecast: path within ``room_rad`` of the forecast range, and equal duration."""
    q = bench.column("q")[seen]
    assert predicted.q_low <= q.min()
    assert q.max() <= predicted.q_high
    assert predicted.q_low == pytest.approx(q.min(), abs=room_rad)
    assert predicted.q_high == pytest.approx(q.max(), abs=room_rad)
    F = np.concatenate([bench.column(name)[seen] for name in ("F_A", "F_B")])
    assert F.max() <= predicted.F_high < F.max() + 2.0
    assert predicted.duration_s == pytest.approx(q.size / 1000.0, abs=0.25)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_the_joint_stays_within_the_forecast_path(name: str) -> None:
    parameters = load_parameters(name)
    bench = BenchTop(parameters)
    bench.advance(0.01)
    for start, tension_N in (
        (stay, 20.0),
        (stay, 40.0),
        (to_centre, 10.0),
        (to_the_right, 20.0),
        (in_motion, 30.0),
        (held_by_geometry, 10.0),
    ):
        start(bench)
        plans: list[IdentificationPlan] = [replace(SHORT, tension_N=tension_N)]
        predicted = forecast_from_bench(bench, plans, parameters)
        compare(bench, predicted, play(bench, plans), room_rad=0.06)


def test_runs_of_all_identification_kinds_take_the_forecast_time() -> None:
    lab = load_parameters("lab")
    bench = BenchTop(lab)
    bench.wind_up()
    plans: list[IdentificationPlan] = [replace(SHORT, tension_N=10.0), MOTOR, SPRING]
    predicted = forecast_from_bench(bench, plans, lab)
    compare(bench, predicted, play(bench, plans), room_rad=0.06)
    assert predicted.let_slack
    assert_reason(predicted.message, "joint_will_move", let_slack=True)


def test_an_identification_beyond_the_spring_or_joint_range_is_rejected_with_its_value() -> None:
    ideal = load_parameters("ideal")
    at_rest = read_initial_state(None)

    def refused(plan: IdentificationPlan, parameters: PlantParameters = ideal) -> OutOfRangeError:
        with pytest.raises(OutOfRangeError) as caught:
            forecast_identifications([plan], parameters, at_rest, LAM_MOTOR).require_within_range(parameters)
        return caught.value

    # 2 rad of motor A stretch each spring by 7.5 mm: from 55.5 mm at 42 N that is beyond 61.4 mm, where they are solid.
    solid = refused(replace(SHORT, tension_N=42.0, amplitude_rad=2.0, chip_s=0.5))
    assert (solid.quantity, solid.maximum, solid.unit) == (messages.tension_during_motion(), 50.0, "N")
    narrow = replace(ideal, geometry=replace(ideal.geometry, q_max=0.5))
    joint = refused(replace(SHORT, tension_N=20.0), narrow)
    assert (joint.quantity, joint.unit) == (messages.joint_position_during_motion(), "rad")
    # q = r_m θ_A / (2 r_j) for equal springs; θ_A: elongation to 20 N, 1 rad of excitation and 1 rad of trim
    assert joint.value == pytest.approx(0.05 * (2.0 * 4.72 + 2.0), abs=0.03)
    predicted = forecast_identifications([replace(SHORT, tension_N=20.0)], ideal, at_rest, LAM_MOTOR)
    predicted.require_within_range(ideal)
    with pytest.raises(OutOfRangeError) as slack:
        replace(predicted, F_low=0.5).require_within_range(ideal)
    assert (slack.value.quantity, slack.value.value, slack.value.minimum) == (
        messages.tension_during_motion(),
        0.5,
        1.0,
    )
    assert isinstance(slack.value.remedy, Message)
    assert slack.value.remedy.code == "higher_tension_or_smaller_amplitude"


# Timetables of identifications, compared with samples of the loop.

ACTUATOR = ActuatorIdentificationPlan(tension_N=20.0, bits=4, periods=2, settle_s=1.5)
MOTOR_TIMETABLE = MotorIdentificationPlan(u_low=3.0, u_high=6.0, levels=3)
SPRING_TIMETABLE = SpringIdentificationPlan(F_low=4.0, F_high=40.0, sweep_s=3.0, cycles=2)


@dataclass(frozen=True)
class Played:
    """The forecast of a run, and its samples."""

    predicted: Timetable
    columns: dict[str, NDArray[np.float64]]

    @property
    def ticks(self) -> int:
        return int(self.columns["mode"].size)

    def at(self, name: str) -> NDArray[np.float64]:
        """Return a column at the times of the profile, which may end slightly before or after the run."""
        ticks = np.minimum(np.rint(self.predicted.t / T_s).astype(int) - 1, self.ticks - 1)
        found: NDArray[np.float64] = self.columns[name][ticks]
        return found


def played(plan: IdentificationPlan, name: str = "lab") -> Played:
    parameters = load_parameters(name)
    bench = BenchTop(parameters)
    bench.wind_up()
    references = bench.column("theta_A_ref", 1)[0], bench.column("theta_B_ref", 1)[0]
    predicted = forecast_identification(plan, parameters, references)
    began = len(bench.samples.rows)
    assert isinstance(bench.send(RunProgram(plan.program(), run=3)), Accepted)
    while bench.loop.mode is Mode.IDENTIFY:
        bench.loop.tick()
    names = ("mode", "theta_A_ref", "theta_B_ref", "u_A", "u_B", "F_A", "F_B", "theta_A")
    columns = {name: bench.column(name)[began:] for name in names}
    identified = columns["mode"] == MODE_CODE[Mode.IDENTIFY]
    return Played(predicted, {name: column[identified] for name, column in columns.items()})


def test_forecast_tension_and_excitation_match_the_samples() -> None:
    run = played(ACTUATOR)
    travel, settle, excite = run.predicted.intervals
    assert [one.stage for one in run.predicted.intervals] == [Stage.TRAVELLING, Stage.SETTLING, Stage.EXCITING]
    assert [run.predicted.title(one) for one in run.predicted.intervals] == ["20 N"] * 3
    assert run.ticks - excite.end in (0, 1, 2)  # the loop detects the end one tick later
    wound = run.columns["theta_B_ref"]
    assert wound[travel.end] == 0.0
    assert wound[travel.end - 3] != 0.0
    trimmed = run.columns["theta_A_ref"]
    sequence = 0.5 * np.diff(trimmed)  # the trim of the force loop changes far less per tick than a chip
    jumps = np.flatnonzero(np.abs(sequence) > 0.2) + 1
    assert jumps[0] == pytest.approx(excite.begin, abs=2)
    assert not np.any((jumps > settle.begin) & (jumps < excite.begin - 2))
    planned = run.predicted.signals["theta_A_ref"]
    where = np.flatnonzero(np.abs(np.diff(planned)) > 0.5)
    predicted_jumps = {round(run.predicted.t[at + 1] / T_s) - 1 for at in where}
    assert {int(at) for at in jumps} <= {at + late for at in predicted_jumps for late in (0, 1)}
    assert len(predicted_jumps) == len(jumps)
    held = slice(settle.end - 200, settle.end)
    assert np.mean(0.5 * (run.columns["F_A"] + run.columns["F_B"])[held]) == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_each_motor_step_has_its_forecast_voltage_at_the_forecast_time(name: str) -> None:
    run = played(MOTOR_TIMETABLE, name)
    whole, tolerance = run.ticks, round(0.02 * run.ticks)
    steps = [one for one in run.predicted.intervals if one.stage is Stage.EXCITING]
    assert [one.set_point for one in steps] == [3.0, -3.0, 4.5, -4.5, 6.0, -6.0]
    assert [(one.number, one.of) for one in steps] == [(number, 6) for number in range(1, 7)]
    assert run.predicted.title(steps[1]) == "−3 V"
    assert run.predicted.intervals[-1].end == pytest.approx(whole, abs=tolerance)
    u, free = run.columns["u_A"], np.isnan(run.columns["theta_A_ref"])
    for step in steps:
        driven = np.flatnonzero((u == step.set_point) & (run.columns["u_B"] == step.set_point) & free)
        assert driven[0] == pytest.approx(step.begin, abs=tolerance)
        assert driven[-1] + 1 == pytest.approx(step.end, abs=tolerance)
        assert np.all(np.diff(driven) == 1)
    begins = [one.begin for one in run.predicted.intervals if one.stage is Stage.TRAVELLING]
    walks = [0, *(np.flatnonzero(np.diff(free.astype(int)) == -1) + 1)]
    assert begins == pytest.approx(walks[: len(begins)], abs=tolerance)
    # the motion to the first step is deterministic: it matches the samples to the tick
    first = np.flatnonzero(free)[0]
    early = run.predicted.t < (first - 2) * T_s
    assert run.predicted.signals["theta_A_ref"][early] == pytest.approx(run.at("theta_A_ref")[early], abs=0.0031)
    assert np.isnan(run.predicted.signals["theta_A_ref"]).any()
    assert np.nanmax(np.abs(run.predicted.signals["u_A"])) == 6.0


def test_the_load_sweep_has_the_forecast_tensions_at_the_forecast_times() -> None:
    run = played(SPRING_TIMETABLE)
    assert [one.set_point for one in run.predicted.intervals] == [4.0, 4.0, 40.0, 4.0, 40.0, 4.0]
    assert [one.number for one in run.predicted.intervals] == [1, 1, 2, 3, 4, 5]
    assert {one.of for one in run.predicted.intervals} == {5}
    assert run.predicted.intervals[-1].end == pytest.approx(run.ticks, abs=2)
    # the references match the samples to one tick of the fastest motion
    assert run.predicted.signals["theta_A_ref"] == pytest.approx(run.at("theta_A_ref"), abs=0.0031)
    for stretch in run.predicted.intervals[1:]:  # closed form: the tension at the end of each leg is its set point
        at = np.searchsorted(run.predicted.t, stretch.end * T_s - 1e-9)
        assert run.predicted.signals["F_A"][at] == pytest.approx(stretch.set_point, abs=1e-6)
    # the readings of the load cells lag by the motors, half a second, and have noise
    sweeping = run.predicted.t > (run.predicted.intervals[1].end + 500) * T_s
    assert np.max(np.abs(run.predicted.signals["F_A"] - run.at("F_A"))[sweeping]) < 8.0
    assert np.ptp(run.at("F_A")) == pytest.approx(36.0, abs=3.0)


@pytest.mark.parametrize("plan", [ACTUATOR, MOTOR_TIMETABLE, SPRING_TIMETABLE], ids=["actuator", "motor", "spring"])
def test_forecast_intervals_are_contiguous_and_drawn_completely(plan: IdentificationPlan) -> None:
    predicted = forecast_identification(plan, load_parameters("lab"))
    begins = [one.begin for one in predicted.intervals]
    assert begins == [0, *(one.end for one in predicted.intervals[:-1])]
    assert all(one.begin < one.end for one in predicted.intervals)
    assert predicted.t[0] == pytest.approx(T_s)
    assert predicted.t[-1] == pytest.approx(predicted.duration_s)
    assert np.all(np.diff(predicted.t) > 0.0)
    assert all(values.size == predicted.t.size for values in predicted.signals.values())


def test_the_number_of_points_of_the_longest_excitation_is_bounded() -> None:
    plan = replace(ACTUATOR, bits=12, periods=10, chip_s=0.0146)
    assert forecast_identification(plan, load_parameters("lab")).t.size <= CORNERS_MAX + 2 * TIMETABLE_POINTS + 2
