"""Forecasts of identifications, compared with the simulator: range of the joint and duration."""

from dataclasses import replace

import numpy as np
import pytest

from backend.errors import OutOfRangeError
from backend.experiments.forecast import Forecast, forecast_identifications, read_initial_state
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    IdentificationPlan,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
)
from backend.realtime.commands import Accepted, RunProgram, SetMode, SetReferences
from backend.realtime.modes import Mode
from backend.tuning.gains import LAM_MOTOR
from plant.parameters import PlantParameters, load_parameters
from tests.realtime.bench_top import BenchTop

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


def on_its_way(bench: BenchTop) -> None:
    bench.send(SetMode(Mode.RUN, 1))
    bench.send(SetReferences(-1.2, 9.0))
    bench.advance(0.5)


def held_by_geometry(bench: BenchTop) -> None:
    to_the_right(bench)
    bench.send(SetMode(Mode.COMPLIANCE))
    bench.advance(0.2)


def stay(_bench: BenchTop) -> None:
    """Leave the bench as the run before left it, or slack where there was none."""


def announced(bench: BenchTop, plans: list[IdentificationPlan], parameters: PlantParameters) -> Forecast:
    return forecast_identifications(plans, parameters, read_initial_state(bench.samples.rows[-1]), LAM_MOTOR)


def play(bench: BenchTop, plans: list[IdentificationPlan]) -> slice:
    """Play the plans as the service does, tick by tick, until the joint is back in pretension; return its samples."""
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


def compare(bench: BenchTop, told: Forecast, seen: slice, room_rad: float) -> None:
    """Nothing went beyond what was announced, which is not ``room_rad`` more either; and it took as long as told."""
    q = bench.column("q")[seen]
    assert told.q_low <= q.min()
    assert q.max() <= told.q_high
    assert told.q_low == pytest.approx(q.min(), abs=room_rad)
    assert told.q_high == pytest.approx(q.max(), abs=room_rad)
    F = np.concatenate([bench.column(name)[seen] for name in ("F_A", "F_B")])
    assert F.max() <= told.F_high < F.max() + 2.0
    assert told.duration_s == pytest.approx(q.size / 1000.0, abs=0.25)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_the_joint_goes_as_far_as_announced_and_no_further(name: str) -> None:
    parameters = load_parameters(name)
    bench = BenchTop(parameters)
    bench.advance(0.01)
    for start, tension_N in (
        (stay, 20.0),
        (stay, 40.0),
        (to_centre, 10.0),
        (to_the_right, 20.0),
        (on_its_way, 30.0),
        (held_by_geometry, 10.0),
    ):
        start(bench)
        plans: list[IdentificationPlan] = [replace(SHORT, tension_N=tension_N)]
        told = announced(bench, plans, parameters)
        compare(bench, told, play(bench, plans), room_rad=0.06)


def test_several_runs_and_both_other_kinds_take_as_long_as_announced() -> None:
    lab = load_parameters("lab")
    bench = BenchTop(lab)
    bench.wind_up()
    plans: list[IdentificationPlan] = [replace(SHORT, tension_N=10.0), MOTOR, SPRING]
    told = announced(bench, plans, lab)
    compare(bench, told, play(bench, plans), room_rad=0.06)
    assert told.let_slack
    assert "nothing holds it while the tendons are slack" in told.message


def test_what_would_leave_the_range_of_springs_or_joint_is_refused_with_its_figure() -> None:
    ideal = load_parameters("ideal")
    at_rest = read_initial_state(None)

    def refused(plan: IdentificationPlan, parameters: PlantParameters = ideal) -> OutOfRangeError:
        with pytest.raises(OutOfRangeError) as caught:
            forecast_identifications([plan], parameters, at_rest, LAM_MOTOR).require_within_range(parameters)
        return caught.value

    # 2 rad of motor A stretch each spring by 7.5 mm: from 55.5 mm at 42 N that is beyond 61.4 mm, where they are solid.
    solid = refused(replace(SHORT, tension_N=42.0, amplitude_rad=2.0, chip_s=0.5))
    assert (solid.quantity, solid.maximum, solid.unit) == ("tension on the way", 50.0, "N")
    narrow = replace(ideal, geometry=replace(ideal.geometry, q_max=0.5))
    joint = refused(replace(SHORT, tension_N=20.0), narrow)
    assert (joint.quantity, joint.unit) == ("joint position on the way", "rad")
    # q = r_m θ_A / (2 r_j) for like springs, θ_A what stretches both to 20 N, 1 rad of excitation and 1 rad of trim
    assert joint.value == pytest.approx(0.05 * (2.0 * 4.72 + 2.0), abs=0.03)
    told = forecast_identifications([replace(SHORT, tension_N=20.0)], ideal, at_rest, LAM_MOTOR)
    told.require_within_range(ideal)
    with pytest.raises(OutOfRangeError, match=r"tension on the way: 0\.5 N .* 1 N; .* would go slack"):
        replace(told, F_low=0.5).require_within_range(ideal)
