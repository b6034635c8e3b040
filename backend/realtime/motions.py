"""Motions of the modes, and their construction from programs."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from backend.control import (
    NO_REFERENCE,
    PRETENSION_N,
    Bounds,
    CascadeTuning,
    ControlOutput,
    MotorLoopState,
    Moving,
    Resting,
    Setpoint,
    VoltageMargin,
    baselines,
    build_decoupler,
    cascade,
    compute_bounds,
    motion_primitives,
    motor_positions,
    pid,
    setpoint_player,
    track_motors,
    tracking,
)
from backend.errors import check_range
from backend.realtime import messages
from backend.realtime.modes import Cause, CommandRejectedError, ModeCause
from backend.realtime.program import Excitation, Law, Program, Segment, Shape, require_few, require_plant_ability
from backend.tuning import TuningParameters, make_feedback_linearization_tuning, make_single_loop_tuning
from plant import Measurement, Plant, PlantParameters, StateBlock, T_s, spring_elongation

# Program arrays ------------------------------------------------------------------------------------
# Programs in the form that the compiled step reads.


_SHAPES = {
    Shape.STEP: setpoint_player.STEP,
    Shape.RAMP: setpoint_player.RAMP,
    Shape.SINE: setpoint_player.SINE,
    Shape.SWEEP: setpoint_player.SWEEP,
    Shape.PRBS: setpoint_player.PRBS,
    Shape.MULTISINE: setpoint_player.MULTISINE,
}


def make_segment_player(segments: Sequence[Segment], first: Setpoint) -> setpoint_player.SetpointPlayer:
    """Return a player of segments that starts from a setpoint."""
    rows = [
        (
            _SHAPES[segment.shape],
            round(segment.duration_s / T_s),
            segment.duration_s,
            segment.q_ref,
            segment.S_ref,
            segment.F_push,
            segment.period_s,
            segment.load_A,
            segment.load_B,
            segment.period_end_s,
            segment.count,
            segment.peak,
            segment.tuning,
            segment.wall,
            segment.contact_detection,
        )
        for segment in segments
    ]
    return setpoint_player.SetpointPlayer(
        np.array(rows, dtype=np.float64).reshape(-1, setpoint_player.COLUMNS),
        0,
        0,
        setpoint_player.INITIAL_REGISTER,
        first,
    )


def make_tension_hold_state(
    program: Program, excitation: Excitation, motor_loops: MotorLoopState, theta_A: float
) -> motion_primitives.TensionHoldState:
    """Return a state that holds the program's tension, settles and excites.

    ``theta_A`` [rad] of motor A gives approximately this tension.
    """
    amplitude = excitation.amplitude_rad
    levels = np.array([amplitude if level == "+" else -amplitude for level in excitation.levels])
    chip_ticks = max(round(excitation.chip_s / T_s), 1)
    chips = motion_primitives.ExcitationChips(levels, chip_ticks, excitation.periods * len(levels) * chip_ticks)
    base = motor_loops.theta_A_ref, motor_loops.theta_B_ref
    settle_ticks = round(program.settle_s / T_s)
    return motion_primitives.TensionHoldState(
        program.tension_N, theta_A, *base, settle_ticks, chips, 0, pid.ForceHoldState(0.0)
    )


def make_tension_sweep_state(
    program: Program, goals: Sequence[tuple[float, float]]
) -> motion_primitives.TensionSweepState:
    """Return a state that sweeps along ``goals``.

    These are theta_A and theta_B [rad] at the start and at the end of each leg.
    """
    ticks = np.array([max(round(leg.duration_s / T_s), 1) for leg in program.legs], dtype=np.int64)
    return motion_primitives.TensionSweepState(np.array(goals), ticks, round(program.settle_s / T_s), -1, 0)


def make_voltage_steps_state(
    program: Program, margin: motion_primitives.VoltageMargin
) -> motion_primitives.VoltageStepsState:
    """Return a state that executes the program's steps within ``margin``."""
    rows = [(step.theta_start, step.u, round(step.duration_s / T_s), step.travel_rad) for step in program.steps]
    steps = np.array(rows, dtype=np.float64).reshape(-1, 4)
    brake = motion_primitives.BrakeState(0.0, 0.0, 0.0, 0.0)
    first = motion_primitives.CENTRED
    return motion_primitives.VoltageStepsState(
        margin=margin,
        steps=steps,
        settle_ticks=round(program.settle_s / T_s),
        step=0,
        stage=first,
        ticks=0,
        began_A=0.0,
        began_B=0.0,
        brake=brake,
    )


# Motion --------------------------------------------------------------------------------------------
# Motions of the motors in each mode: constructed here and stepped by the compiled step.
#
# Each motion passes the state of the motor loops to the next, so the voltages do not jump when the mode changes.


class Motion:
    """A motion. ``done``: it has reached its end, where it holds.

    Its state is ``initial`` until it is bound to a block, then the content of the block.
    """

    def __init__(self, motor_loops: MotorLoopState, state: Any, setpoint: Setpoint = NO_REFERENCE) -> None:
        self.done = False
        self.initial = Moving(motor_loops, setpoint, state)
        self._block: StateBlock[Moving] | None = None

    def bind(self, block: StateBlock[Moving]) -> None:
        """Continue in a block of the motion's kind, which no other motion uses now."""
        block.set(self.initial)
        self._block = block

    @property
    def current(self) -> Moving:
        """Current state of the motion."""
        return self.initial if self._block is None else self._block.get()

    def get_motor_loops(self) -> MotorLoopState:
        """Return the motor loops for the next motion."""
        return self.current.motor_loops

    def set_setpoint(self, setpoint: Setpoint) -> None:
        """Set another setpoint from the next tick on."""
        if self._block is not None:
            self._block.field("setpoint").set(setpoint)


def _compute_holding_voltages(motor_loops: MotorLoopState, m: Measurement, u_max: float) -> tuple[float, float]:
    """Return the voltages [V] with which the motor loops would continue."""
    references = motor_loops.theta_A_ref, motor_loops.theta_B_ref
    voltages, _ = pid.step_motor_pair(motor_loops.gains, motor_loops.state, *references, m.theta_A, m.theta_B, u_max)
    return voltages.u_A, voltages.u_B


class IdleMotion(Motion):
    """No motion: zero volts."""

    def __init__(self, gains: pid.MotorPairGains) -> None:
        super().__init__(
            MotorLoopState(pid.at_rest_motor_pair(gains, 0.0, 0.0, 0.0, 0.0), gains, 0.0, 0.0), Resting(0.0)
        )


class PretensionMotion(Motion):
    """Pretension from slack: both motors wind until the load cells read its tension."""

    def __init__(self, motor_loops: MotorLoopState) -> None:
        super().__init__(motor_loops, motion_primitives.begin_winding(motor_loops))

    @property
    def tensions(self) -> tuple[float, float]:
        """Filtered load cell readings [N]."""
        winding = self.current.state.winding
        return winding.F_A, winding.F_B


class PointToPointMotion(Motion):
    """Move the motor references straight to (theta_A, theta_B) [rad] and hold there."""

    def __init__(self, motor_loops: MotorLoopState, theta_A: float, theta_B: float) -> None:
        super().__init__(motor_loops, motion_primitives.TravelState(theta_A, theta_B, 0.0))


class Braking(Motion):
    """Soft stop: brake both motors until the joint is at rest under tension."""

    def __init__(self, motor_loops: MotorLoopState, m: Measurement, u_max: float) -> None:
        super().__init__(
            motor_loops, motion_primitives.begin_soft_stop(*_compute_holding_voltages(motor_loops, m, u_max), m)
        )


class ForceHold(Motion):
    """Actuator identification: tension held by motor A, excitation added (figure 5)."""


class TensionSweep(Motion):
    """Spring identification: both tensions wound evenly up and down."""


class MotorSteps(Motion):
    """Motor identification: voltage steps with slack tendons."""


class Tracking(Motion):
    """The cascade, following the operator's references or a program's segments."""

    def __init__(
        self,
        tuning: cascade.CascadeTuning,
        motor_loops: MotorLoopState,
        m: Measurement,
        bounds: Bounds,
        position_loop: bool,
        program: Program | None = None,
        *,
        yields: bool = False,
    ) -> None:
        """Start without motion; with ``yields`` the reference is the joint's position."""
        start = tracking.find_resting_setpoint(tuning, m, bounds, position_loop=position_loop or yields)
        player = make_segment_player(() if program is None else program.segments, start)
        references = motor_loops.theta_A_ref, motor_loops.theta_B_ref
        law = cascade.initialize_bumpless(tuning, motor_loops.state, motor_loops.gains, *references, m, start.q_ref)
        super().__init__(motor_loops, tracking.TrackingState(law, position_loop, program is not None, player), start)


def _make_single_loop(
    parameters: PlantParameters, lambdas: TuningParameters, u: tuple[float, float], m: Measurement
) -> Any:
    tuning = make_single_loop_tuning(parameters, lambdas)
    return tracking.SingleLoop, tuning, baselines.initialize_single_loop(tuning, *u, m)


def _make_feedback_linearization(
    parameters: PlantParameters, lambdas: TuningParameters, u: tuple[float, float], m: Measurement
) -> Any:
    tuning = make_feedback_linearization_tuning(parameters, lambdas)
    return (
        tracking.FeedbackLinearization,
        tuning,
        baselines.initialize_feedback_linearization(tuning, *u, m),
    )


BASELINES: dict[Law, Callable[[PlantParameters, TuningParameters, tuple[float, float], Measurement], Any]] = {
    Law.SINGLE_LOOP: _make_single_loop,
    Law.FEEDBACK_LINEARIZATION: _make_feedback_linearization,
}
"""Laws without cascade: kind of motion, tuning from parameters and λ, and the state that continues from voltages
[V]."""


class Baseline(Motion):
    """Law without cascade that plays a program; its gains do not change during it."""

    def __init__(
        self,
        program: Program,
        parameters: PlantParameters,
        lambdas: TuningParameters,
        tuning: cascade.CascadeTuning,
        motor_loops: MotorLoopState,
        m: Measurement,
        bounds: Bounds,
    ) -> None:
        """Raise TuningError if the law has no gains for these λ."""
        start = tracking.find_resting_setpoint(tuning, m, bounds)
        kind, law_tuning, law = BASELINES[program.law](
            parameters, lambdas, _compute_holding_voltages(motor_loops, m, tuning.u_max), m
        )
        super().__init__(motor_loops, kind(law_tuning, law, make_segment_player(program.segments, start)), start)


class PythonMotion(Motion):
    """Motion of commissioning: rare and short, stepped in Python."""

    def __init__(self, motor_loops: MotorLoopState, setpoint: Setpoint) -> None:
        self.done = False
        self.setpoint = setpoint
        self._motor_loops = motor_loops

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> ControlOutput:
        """Execute a step: measurement to voltages."""
        raise NotImplementedError

    def get_motor_loops(self) -> MotorLoopState:
        """Return the motor loops for the next motion."""
        return self._motor_loops

    def follow(
        self, tuning: cascade.CascadeTuning, m: Measurement, theta_A_ref: float, theta_B_ref: float
    ) -> ControlOutput:
        """Step both motor loops towards motor references [rad]."""
        output, self._motor_loops = track_motors(
            tuning=tuning,
            motor_loops=self._motor_loops,
            setpoint=self.setpoint,
            theta_A_ref=theta_A_ref,
            theta_B_ref=theta_B_ref,
            m=m,
            done=False,
        )
        return output


class CommissioningMotion(PythonMotion):
    """Motion of commissioning, from OFF to OFF.

    Never braked, as directions are not proven yet, but ended at zero volts. ``cause`` says how it ended.
    """

    cause: ModeCause = Cause.ASKED_FOR


# Program motions -----------------------------------------------------------------------------------
# Motions of programs: a program is checked completely before any motion.


class ProgramMotions:
    """Makes the motions of one plant's programs."""

    def __init__(self, plant: Plant, parameters: PlantParameters) -> None:
        self._plant = plant
        self._parameters = parameters
        self._bounds = compute_bounds(parameters)
        self._spring_A, self._spring_B = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
        self._geometry = build_decoupler(parameters)

    def make_motion(
        self,
        program: Program,
        motor_loops: MotorLoopState,
        m: Measurement,
        tuning: CascadeTuning,
        lambdas: TuningParameters,
    ) -> Motion:
        """Return the motion of a program. Raises CommandRejectedError or OutOfRangeError."""
        if program.law is Law.FORCE_HOLD:
            if program.excitation is None:
                raise ValueError(messages.no_excitation())
            # Motor B stays at zero: the rotation of motor A stretches both springs.
            theta_A = sum(self.compute_motor_angles(program.tension_N))
            return ForceHold(motor_loops, make_tension_hold_state(program, program.excitation, motor_loops, theta_A))
        if program.law is Law.MOTOR_STEPS:
            return self._make_motor_steps(program, motor_loops)
        if program.law is Law.TENSION_SWEEP:
            return self._make_tension_sweep(program, motor_loops)
        self._require_segments(program)
        bounds = self._bounds
        if program.law in BASELINES:
            return Baseline(
                program=program,
                parameters=self._parameters,
                lambdas=lambdas,
                tuning=tuning,
                motor_loops=motor_loops,
                m=m,
                bounds=bounds,
            )
        return Tracking(
            tuning=tuning,
            motor_loops=motor_loops,
            m=m,
            bounds=bounds,
            position_loop=program.law is Law.CASCADE,
            program=program,
        )

    def compute_encoder_errors(self, tensions: tuple[float, float], m: Measurement) -> tuple[float, float]:
        """Return the errors [rad] of the motors' encoders, from the tensions [N]."""
        (F_A, F_B), r_m, joint_travel = tensions, self._geometry.r_m, self._geometry.r_j * m.q
        A, B = (
            spring_elongation(self._spring_A, F_A) + joint_travel,
            spring_elongation(self._spring_B, F_B) - joint_travel,
        )
        return A / r_m - m.theta_A, B / r_m - m.theta_B

    def compute_motor_angles(self, F: float) -> tuple[float, float]:
        """Return theta_A, theta_B [rad] that hold F [N] in both tendons at q = 0."""
        r_m = self._geometry.r_m
        return spring_elongation(self._spring_A, F) / r_m, spring_elongation(self._spring_B, F) / r_m

    def compute_pretension_angles(self) -> tuple[float, float]:
        """Return theta_A, theta_B [rad] of mode pretension, with the joint at q = 0.

        Tendons have PRETENSION_N, another mechanism its least stiffness for references.
        """
        if self._geometry.mechanism is not None:
            return motor_positions(self._geometry, 0.0, self._bounds.S_min)
        return self.compute_motor_angles(PRETENSION_N)

    def require_references(self, q_ref: float, S_ref: float) -> None:
        """Raise OutOfRangeError unless q_ref [rad] and S_ref [N·m/rad] are in range."""
        check_range("q_ref", q_ref, self._bounds.q_min, self._bounds.q_max, "rad")
        check_range("S_ref", S_ref, self._bounds.S_min, self._bounds.S_max, "N·m/rad")

    def _require_segments(self, program: Program) -> None:
        require_few(program.segments)
        q_min, q_max, S_min, S_max = self._bounds.q_min, self._bounds.q_max, self._bounds.S_min, self._bounds.S_max
        for segment in program.segments:
            # Most segments pass this check; a thousand calls would take half a period.
            is_valid = q_min <= segment.q_ref <= q_max and S_min <= segment.S_ref <= S_max
            if not is_valid or segment.F_push or segment.load_A or segment.load_B:
                self._require_segment(segment)

    def _require_segment(self, segment: Segment) -> None:
        self.require_references(segment.q_ref, segment.S_ref)
        require_plant_ability(segment, pushes=self._plant.pushes, loads_shafts=self._plant.loads_shafts)

    def _make_motor_steps(self, program: Program, motor_loops: MotorLoopState) -> MotorSteps:
        if not program.steps:
            raise CommandRejectedError(messages.no_voltage_steps())
        # winding over the whole range of the joint
        theta_max = self._geometry.r_j / self._geometry.r_m * self._bounds.q_trip
        for step in program.steps:
            check_range(
                "theta_start",
                step.theta_start,
                minimum=-theta_max,
                maximum=0.0,
                unit="rad",
                remedy=messages.tendons_slack_at_zero(),
            )
            check_range("u", step.u, -self._bounds.u_max, self._bounds.u_max, "V")
        margin = VoltageMargin(*self.compute_motor_angles(PRETENSION_N), self._bounds.F_slack, theta_max)
        return MotorSteps(motor_loops, make_voltage_steps_state(program, margin))

    def _make_tension_sweep(self, program: Program, motor_loops: MotorLoopState) -> TensionSweep:
        if not program.legs:
            raise CommandRejectedError(messages.no_tension_legs())
        tensions = (program.tension_N, *(leg.tension_N for leg in program.legs))
        for tension_N in tensions:
            check_range("tension_N", tension_N, self._bounds.F_slack, self._bounds.F_max, "N")
        return TensionSweep(
            motor_loops,
            make_tension_sweep_state(program, [self.compute_motor_angles(tension_N) for tension_N in tensions]),
        )
