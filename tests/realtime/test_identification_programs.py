"""The programs that identify motors and springs: what the motors do, and what the loop lets them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.control import motion_primitives, pid
from backend.control.motion_primitives import STEP_BRAKING_S, ZERO_VOLTS_S
from backend.control.motion_types import NO_REFERENCE, ControlOutput, MotorLoopState
from backend.realtime.commands import Inject, Refused, RunEnded, RunProgram, SetMode, SetReferences, Stop
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.motions import make_voltage_steps_state
from backend.realtime.program import Law, Program, TensionLeg, VoltageStep
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from plant.interface import InjectedFault, InjectedFaultKind, Measurement, Sensor
from plant.parameters import PlantParameters, load_parameters
from plant.quantity import Angle
from tests.realtime.bench_top import BenchTop

STEPS = Program(
    Law.MOTOR_STEPS,
    settle_s=1.2,
    steps=(VoltageStep(-8.0, 3.0, 2.0, travel_rad=5.0), VoltageStep(-3.0, -3.0, 0.4, travel_rad=9.0)),
)
SWEEP = Program(Law.TENSION_SWEEP, tension_N=4.0, settle_s=1.0, legs=(TensionLeg(40.0, 3.0), TensionLeg(4.0, 3.0)))
STILL = Measurement(*[0.0] * len(Measurement._fields))


def identify(bench: BenchTop, program: Program) -> np.ndarray:
    """Play the program; true where its samples are."""
    assert not isinstance(bench.send(RunProgram(program, run=5)), Refused)
    while bench.loop.mode is Mode.IDENTIFY:
        bench.advance(0.1)
    identified: NDArray[np.bool_] = bench.column("mode") == MODE_CODE[Mode.IDENTIFY]
    assert set(bench.column("run")[identified]) == {5.0}
    return identified


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_voltage_steps_run_free_from_rest_and_stay_within_the_motors_range(name: str) -> None:
    bench = BenchTop(load_parameters(name))
    bench.wind_up()
    identified = identify(bench, STEPS)
    assert [event.completed for event in bench.events if isinstance(event, RunEnded)] == [True]
    u, theta, F = (bench.column(column)[identified] for column in ("u_A", "theta_A", "F_A"))
    up, down = np.flatnonzero(u == 3.0), np.flatnonzero(u == -3.0)
    # The first step ends with the travel of the faster motor, the second with its time.
    travels = [np.ptp(bench.column(column)[identified][up]) for column in ("theta_A", "theta_B")]
    assert max(travels) == pytest.approx(5.0, abs=0.05)
    assert down.size == 400
    for driven, start in ((up, -8.0), (down, -3.0)):
        assert np.all(np.diff(driven) == 1)
        assert theta[driven[0]] == pytest.approx(start, abs=0.1)
        before = slice(driven[0] - 200, driven[0])
        assert not u[before].any()
        assert np.ptp(theta[before]) < 0.02
        assert F[driven].max() < 0.5
    assert np.abs(theta).max() < 10.0 * np.pi / 2
    bench.advance(20.0)
    assert bench.loop.is_pretension_done


def test_steps_centre_the_joint_before_the_tendons_are_let_loose(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.send(SetReferences(1.0, 10.0))
    bench.advance(4.0)
    identified = identify(bench, STEPS)
    driven = np.isnan(bench.column("theta_A_ref")) & identified
    assert np.abs(bench.column("q")[driven]).max() < 0.05
    assert max(bench.column("F_A")[driven].max(), bench.column("F_B")[driven].max()) == 0.0


def test_a_step_ends_when_a_tendon_pulls(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    identified = identify(bench, replace(STEPS, steps=(VoltageStep(-1.0, 5.0, 2.0, travel_rad=14.0),)))
    F = bench.column("F_A")[identified]
    assert 1.0 < F.max() < 20.0
    assert [event.completed for event in bench.events if isinstance(event, RunEnded)] == [True]


def test_slack_is_a_fault_again_after_the_steps(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    identify(bench, STEPS)
    while not bench.loop.is_pretension_done:
        bench.advance(0.1)
    bench.advance(1.0)
    bench.send(Inject(InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.F_A)))
    bench.advance(0.3)
    assert bench.loop.fault == "slack"


@pytest.mark.parametrize("leave", [SetMode(Mode.PRETENSION), Stop(hard=False), Stop()], ids=["back", "soft", "hard"])
def test_leaving_a_step_midway_is_safe(ideal: PlantParameters, leave: SetMode | Stop) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    bench.send(RunProgram(STEPS))
    while bench.column("u_A", last=1)[0] != 3.0:
        bench.advance(0.1)
    assert not isinstance(bench.send(leave), Refused)
    bench.advance(7.0)
    if isinstance(leave, SetMode):
        assert bench.loop.is_pretension_done
    else:
        assert bench.loop.mode is Mode.TRIPPED
        assert not bench.column("u_A", last=100).any()
    assert max(bench.column("F_A").max(), bench.column("F_B").max()) < 14.0


def test_sweep_moves_both_tensions_evenly_and_leaves_the_joint(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    identified = identify(bench, SWEEP)
    F_A, F_B, q = (bench.column(column)[identified][-6000:] for column in ("F_A", "F_B", "q"))
    assert F_A[0] == pytest.approx(4.0, abs=0.3)
    assert F_A.max() == pytest.approx(40.0, abs=3.0)
    assert np.abs(F_A - F_B).max() < 0.1
    assert np.abs(q).max() < 0.01
    assert np.all(np.diff(bench.column("theta_A_ref")[identified][-6000:-3001]) > 0.0)


def test_programs_out_of_bounds_start_nothing(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    for program, said in (
        (Program(Law.MOTOR_STEPS), "at least one step"),
        (Program(Law.TENSION_SWEEP), "at least one leg"),
        (replace(STEPS, steps=(VoltageStep(-20.0, 1.0, 1.0, 1.0),)), f": {Angle(-20.0)} is outside"),
        (replace(STEPS, steps=(VoltageStep(2.0, 1.0, 1.0, 1.0),)), f": {Angle(2.0)} is outside"),
        (replace(STEPS, steps=(VoltageStep(-2.0, 12.0, 1.0, 1.0),)), ": 12 V is outside"),
        (replace(SWEEP, legs=(TensionLeg(60.0, 1.0),)), ": 60 N is outside"),
        (replace(SWEEP, tension_N=0.2), ": 0.2 N is outside"),
    ):
        answer = bench.send(RunProgram(program))
        assert isinstance(answer, Refused)
        assert said in answer.reason
        assert bench.loop.mode is Mode.PRETENSION


def test_a_program_takes_as_long_as_its_parts() -> None:
    assert SWEEP.duration_s == pytest.approx(1.0 + 3.0 + 3.0)
    around_each = 1.2 + ZERO_VOLTS_S + STEP_BRAKING_S
    assert STEPS.duration_s == pytest.approx(2.0 * around_each + 2.0 + 0.4)


def test_motors_that_are_there_already_stand_for_all_of_the_time_of_settling() -> None:
    """Twice, at the joint's centre and where the step starts: here the same place, to which no way leads."""
    program = Program(Law.MOTOR_STEPS, settle_s=0.02, steps=(VoltageStep(0.0, 1.0, 0.1, travel_rad=1.0),))
    tuning = make_cascade_tuning(load_parameters("ideal"), TuningParameters())
    carry = MotorLoopState(pid.at_rest_motor_pair(tuning.motors, 0.0, 0.0, 0.0, 0.0), tuning.motors, 0.0, 0.0)
    state = make_voltage_steps_state(program, motion_primitives.VoltageMargin(0.0, 0.0, F_slack=1.0, theta_max=9.0))
    decided: list[ControlOutput] = []
    for _ in range(60):
        decision, carry, state = motion_primitives.step_voltage_steps(tuning, carry, NO_REFERENCE, state, STILL)
        decided.append(decision)
    assert [decision.theta_A_ref for decision in decided[:40]] == [0.0] * 40
    assert {decision.bank_entry for decision in decided[:40]} == {0.0}  # no bank: its first entry, in no sample another
    assert np.isnan(decided[40].theta_A_ref)
