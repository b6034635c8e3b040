"""Programs of the loop: identification, tunings, baseline laws."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.control import motion_primitives, pid
from backend.control.motion_primitives import STEP_BRAKING_S, ZERO_VOLTS_S
from backend.control.motion_types import NO_REFERENCE, ControlOutput, MotorLoopState
from backend.faults import Fault
from backend.realtime.commands import (
    Accepted,
    Command,
    Inject,
    Refused,
    Reset,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    TuningChanged,
)
from backend.realtime.control_loop import Loop
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.motions import BASELINES, make_voltage_steps_state
from backend.realtime.program import Law, Program, Segment, TensionLeg, VoltageStep
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from backend.tuning.gains import (
    TuningParameters,
    make_cascade_tuning,
    make_feedback_linearization_tuning,
    make_single_loop_tuning,
)
from backend.tuning.simulation import Trajectory
from plant.interface import InjectedFault, InjectedFaultKind, Measurement, Sensor
from plant.parameters import PlantParameters, load_parameters
from plant.quantity import Angle
from plant.simulator import Simulator
from tests.closed_loop.baseline_loops import run_feedback_linearization, run_single_loop
from tests.realtime.bench_top import BenchTop
from tests.reasons import assert_reason

# What a program begins with, as arrays and numbers for the compiled tick: held against a count by hand.


def test_voltage_steps_start_with_the_motion_to_the_centre_or_at_rest_with_the_first() -> None:
    room = motion_primitives.VoltageMargin(3.0, 3.5, 2.0, 12.0)
    up = VoltageStep(theta_start=-0.5, u=2.5, duration_s=0.25, travel_rad=1.5)
    down = VoltageStep(theta_start=0.75, u=-2.5, duration_s=0.1, travel_rad=2.0)
    begun = make_voltage_steps_state(Program(Law.MOTOR_STEPS, steps=(up, down), settle_s=0.3), room)
    np.testing.assert_array_equal(begun.steps, [[-0.5, 2.5, 250.0, 1.5], [0.75, -2.5, 100.0, 2.0]])
    assert begun._replace(steps=np.empty(0))[2:] == (
        300,
        0,
        motion_primitives.CENTRED,
        0,
        0.0,
        0.0,
        motion_primitives.BrakeState(0, 0, 0, 0),
    )
    assert begun.margin == room


# The programs that identify motors and springs: what the motors do, and what the loop lets them.

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


def test_the_joint_is_centred_before_the_tendons_are_slackened(ideal: PlantParameters) -> None:
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
def test_aborting_a_voltage_step_is_safe(ideal: PlantParameters, leave: SetMode | Stop) -> None:
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


def test_a_sweep_moves_both_tensions_evenly_and_not_the_joint(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    identified = identify(bench, SWEEP)
    F_A, F_B, q = (bench.column(column)[identified][-6000:] for column in ("F_A", "F_B", "q"))
    assert F_A[0] == pytest.approx(4.0, abs=0.3)
    assert F_A.max() == pytest.approx(40.0, abs=3.0)
    assert np.abs(F_A - F_B).max() < 0.1
    assert np.abs(q).max() < 0.01
    assert np.all(np.diff(bench.column("theta_A_ref")[identified][-6000:-3001]) > 0.0)


def test_programs_beyond_their_bounds_are_rejected(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    for program, said in (
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


def test_programs_without_segments_are_rejected(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    for law, code in (
        (Law.MOTOR_STEPS, "no_voltage_steps"),
        (Law.TENSION_SWEEP, "no_tension_legs"),
        (Law.FORCE_HOLD, "no_excitation"),
    ):
        answer = bench.send(RunProgram(Program(law)))
        assert isinstance(answer, Refused)
        assert_reason(answer.reason, code)
        assert bench.loop.mode is Mode.PRETENSION


def test_the_duration_of_a_program_is_the_sum_of_its_segments() -> None:
    assert SWEEP.duration_s == pytest.approx(1.0 + 3.0 + 3.0)
    around_each = 1.2 + ZERO_VOLTS_S + STEP_BRAKING_S
    assert STEPS.duration_s == pytest.approx(2.0 * around_each + 2.0 + 0.4)


def test_motors_already_in_position_rest_for_the_whole_settling_time() -> None:
    """Twice, at the joint's centre and at the start of the step: here the same position, so neither requires motion."""
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


# A program that changes the tuning: which gains are in force when, and that the operator's come back after it.

LAB = load_parameters("lab")
OPERATORS = make_tuning_command(LAB, TuningParameters(0.5, 0.5))
SLOWER = make_tuning_command(LAB, TuningParameters(0.9, 0.7))
SEGMENTS = (Segment(0.3, 0.0, 10.0), Segment(0.4, 0.1, 10.0, tuning=1), Segment(0.3, 0.0, 10.0))
WOUND_UP = 5900


class BenchRunner:
    def __init__(self) -> None:
        self.ring = Ring.create(1 << 14)
        self.loop = Loop(Simulator(LAB, seed=1), LAB, self.ring, OPERATORS)
        self.send(SetMode(Mode.PRETENSION))
        self.tick(WOUND_UP)

    def send(self, command: Command) -> Accepted | Refused:
        self.loop.handle(1, command)
        return next(event for event in self.loop.drain_events()[::-1] if isinstance(event, Accepted | Refused))

    def tick(self, ticks: int) -> list[TuningChanged]:
        for _ in range(ticks):
            self.loop.tick()
        return [event for event in self.loop.drain_events() if isinstance(event, TuningChanged)]

    def lam_q(self) -> float:
        newest = self.ring.newest()
        assert newest is not None
        return float(newest[INDEX["lam_q"]])

    def play(self, law: Law = Law.CASCADE) -> Accepted | Refused:
        return self.send(RunProgram(Program(law, SEGMENTS, tunings=(SLOWER,)), run=3))


def test_samples_show_each_tuning_while_it_is_active() -> None:
    bench = BenchRunner()
    assert isinstance(bench.play(), Accepted)
    changes = bench.tick(1100)
    _, rows, _ = bench.ring.read(WOUND_UP, 2000)
    played = rows[rows[:, INDEX["run"]] == 3.0]
    slower = played[:, INDEX["lam_q"]] == 0.9
    assert slower.argmax() == pytest.approx(300, abs=1)  # from the first tick of the second segment on
    assert slower[slower.argmax() :].all()
    assert [change.number for change in changes] == [1, 0]
    assert bench.lam_q() == 0.5


@pytest.mark.parametrize(
    "ending", [SetMode(Mode.STOPPING), SetMode(Mode.PRETENSION), Stop(), Stop(hard=False)], ids=repr
)
def test_the_operators_tuning_is_restored_after_every_end_of_the_program(ending: Command) -> None:
    bench = BenchRunner()
    bench.play()
    assert [change.number for change in bench.tick(400)] == [1]
    assert bench.lam_q() == 0.9
    bench.loop.handle(2, ending)
    assert [change.number for change in bench.tick(400)] == [0]
    assert bench.lam_q() == 0.5


def test_temporary_tunings_have_no_effect_after_the_program() -> None:
    """Includes a new pretension after a reset: no gain of the program remains."""

    def after(tunings: bool) -> NDArray[np.float64]:
        bench = BenchRunner()
        if tunings:
            bench.play()
            bench.tick(400)
        bench.send(Stop())
        bench.tick(3000)
        bench.send(Reset())
        gains = bench.loop._mode_manager.tunings.gains
        return np.concatenate([np.ravel(gains.schedule.entries), np.array(gains.motors).ravel()])

    np.testing.assert_array_equal(after(True), after(False))


def test_an_operator_cannot_change_a_tuning_that_the_program_overrides() -> None:
    bench = BenchRunner()
    bench.play()
    bench.tick(100)
    answer = bench.send(SLOWER)
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "program_sets_tuning")
    bench.tick(1000)
    assert isinstance(bench.send(SLOWER), Accepted)


def test_a_law_rejects_gains_that_it_does_not_have() -> None:
    bench = BenchRunner()
    answer = bench.play(Law.SINGLE_LOOP)
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "law_with_fixed_gains", law=Law.SINGLE_LOOP)
    assert bench.loop.mode is Mode.PRETENSION


def test_a_segment_with_an_unknown_tuning_is_rejected_before_motion() -> None:
    bench = BenchRunner()
    answer = bench.send(RunProgram(Program(Law.CASCADE, SEGMENTS)))
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "unknown_tuning", number=1, count=0)


# The baseline laws in the live loop: they run a program, hold the joint at both ends, and reject invalid programs.

IDEAL = load_parameters("ideal")
SEGMENTS_BASELINES = (Segment(4.0, 0.0, 10.0), Segment(4.0, 0.6, 10.0), Segment(4.0, 0.6, 12.0))
OFFLINE: dict[Law, tuple[Callable[..., Trajectory], Callable[[PlantParameters, TuningParameters], Any]]] = {
    Law.SINGLE_LOOP: (run_single_loop, make_single_loop_tuning),
    Law.FEEDBACK_LINEARIZATION: (run_feedback_linearization, make_feedback_linearization_tuning),
}


def played(law: Law) -> BenchTop:
    bench = BenchTop(IDEAL)
    bench.wind_up()
    assert isinstance(bench.send(RunProgram(Program(law, SEGMENTS_BASELINES), run=7)), Accepted)
    bench.advance(12.0)
    return bench


@pytest.mark.parametrize("law", list(BASELINES))
def test_a_program_moves_the_joint_like_the_offline_loop(law: Law) -> None:
    bench = played(law)
    q, S = bench.column("q", last=8000), bench.column("S", last=8000)
    run, tuning_of = OFFLINE[law]
    q_ref = np.repeat([0.0, 0.6, 0.6], 4000)
    S_ref = np.repeat([10.0, 10.0, 12.0], 4000)
    offline = run(IDEAL, tuning_of(IDEAL, TuningParameters()), q_ref, S_ref)
    assert q == pytest.approx(offline.q[4000:], abs=2e-3)
    assert pytest.approx(offline.S[4000:], abs=2e-2) == S


@pytest.mark.parametrize("law", list(BASELINES))
def test_the_change_to_pretension_has_no_jump(law: Law) -> None:
    bench = played(law)
    bench.advance(1.0)
    assert (bench.loop.mode, bench.loop.fault) == (Mode.PRETENSION, Fault.NONE)
    u_A, u_B = bench.column("u_A", last=1100), bench.column("u_B", last=1100)
    assert max(np.abs(np.diff(u_A[:150])).max(), np.abs(np.diff(u_B[:150])).max()) < 0.05
    assert min(bench.column("F_A", last=1000).min(), bench.column("F_B", last=1000).min()) > 8.0


def test_gains_are_fixed_while_a_baseline_law_runs() -> None:
    bench = BenchTop(IDEAL)
    bench.wind_up()
    bench.send(RunProgram(Program(Law.SINGLE_LOOP, SEGMENTS_BASELINES)))
    bench.advance(0.1)
    answer = bench.send(make_tuning_command(IDEAL, TuningParameters(lam_q=0.8)))
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "baseline_gains_fixed")
    assert bench.column("lam_q", last=1)[0] == TuningParameters().lam_q


def test_a_lambda_without_gains_is_rejected_before_motion() -> None:
    bench = BenchTop(IDEAL, make_tuning_command(IDEAL, TuningParameters(lam_q=2.5)))
    bench.wind_up()
    answer = bench.send(RunProgram(Program(Law.SINGLE_LOOP, SEGMENTS_BASELINES)))
    assert isinstance(answer, Refused)
    assert "λ_q below 8 T_m" in answer.reason
    assert bench.loop.mode is Mode.PRETENSION


def test_motor_references_are_nan_for_laws_without_them() -> None:
    bench = played(Law.SINGLE_LOOP)
    assert all(math.isnan(value) for value in bench.column("theta_A_ref", last=100))
