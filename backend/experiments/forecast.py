"""Forecasts an identification before it starts: timetable, motor references, range of the joint."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from backend.control import (
    PRETENSION_N,
    STEP_BRAKING_S,
    TRAVEL_SPEED,
    ZERO_VOLTS_S,
    build_decoupler,
    compute_bounds,
    equilibrium,
    motion_primitives,
    pid,
    stiffness,
)
from backend.errors import OutOfRangeError
from backend.experiments import messages
from backend.experiments.plans import IdentificationPlan, Plan
from backend.realtime import IDENTIFYING, MODES, Law, Mode, Program, VoltageStep, may_start_from
from backend.sample import INDEX
from plant import SIDES, PlantParameters, Side, T_s, spring_elongation, tendon_tension

# Intervals -----------------------------------------------------------------------------------------
# The sequence of setpoints of an identification program, and the stages of each.


class Stage(StrEnum):
    """Stages of a setpoint, in their order."""

    TRAVELLING = "on the way"
    SETTLING = "settling"
    WINDING = "winding"
    EXCITING = "exciting"
    BRAKING = "braking"


@dataclass(frozen=True)
class ProgramInterval:
    """One stage of a setpoint: the ticks ``begin`` to ``end`` of a program, counted from its first tick.

    ``number`` is that of the setpoint, of ``of`` in total. ``set_point`` is a tension [N], or a voltage [V] of a
    voltage step.
    """

    number: int
    of: int
    set_point: float
    stage: Stage
    begin: int
    end: int


def format_set_point(law: Law, set_point: float) -> str:
    """Return a setpoint as text: "20 N", "−3.5 V"."""
    return messages.set_point(value=set_point, unit="V" if law is Law.MOTOR_STEPS else "N")


# Reference trajectory ------------------------------------------------------------------------------
# The references of both motors [rad] at each tick, from the current ones to the end of the program
# and back to pretension. Speeds, pauses and durations are those of the control loop
# (``backend.realtime.motions``).


Array = NDArray[np.float64]
JointAngles = tuple[float, float]

_WINDING_LAG_S = 0.34
"""Delay of the motors behind their references during winding [s]: the sum of the lags of the motor loop."""

_WINDING_MAX_S = 120.0


@dataclass(frozen=True)
class InitialState:
    """State of an actuator: mode, positions of joint and motors [rad], motor references [rad]."""

    mode: Mode
    q: float
    theta: JointAngles
    references: JointAngles


def read_initial_state(row: NDArray[np.float64] | None) -> InitialState:
    """Return the state in a sample; without a sample, mode off with all angles 0.

    A motor without a reference has its position as reference.
    """
    if row is None:
        return InitialState(Mode.OFF, 0.0, (0.0, 0.0), (0.0, 0.0))
    theta = float(row[INDEX["theta_A"]]), float(row[INDEX["theta_B"]])
    commanded = float(row[INDEX["theta_A_ref"]]), float(row[INDEX["theta_B_ref"]])
    references = commanded if math.isfinite(sum(commanded)) else theta
    return InitialState(MODES[int(row[INDEX["mode"]])], float(row[INDEX["q"]]), theta, references)


class ReferenceTrajectory:
    """Builds the references of motors A and B [rad], one pair per tick.

    ``at`` is the current pair. ``intervals`` are those of the last program that was followed.
    """

    def __init__(self, parameters: PlantParameters, start: InitialState) -> None:
        self.at = start.references
        self._mode = start.mode
        self._parameters = parameters
        self._springs = {side: parameters.make_identified_spring(side) for side in SIDES}
        self._reference_arrays: list[Array] = []
        self._trimmed: list[tuple[int, bool]] = []
        self.intervals: list[ProgramInterval] = []
        self._program_start = 0

    @property
    def ticks(self) -> int:
        """Length so far [ticks]."""
        return sum(ticks for ticks, _ in self._trimmed)

    @property
    def duration_s(self) -> float:
        """Length so far [s]."""
        return self.ticks * T_s

    def references(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return θ_A,ref and θ_B,ref [rad] of every tick, and a mask of ticks with trim of motor A."""
        both = np.concatenate(self._reference_arrays)
        return (
            both[:, 0],
            both[:, 1],
            np.repeat([is_trimmed for _, is_trimmed in self._trimmed], [n for n, _ in self._trimmed]),
        )

    def move_to_start(self, law: Law) -> None:
        """Apply pretension, or return to it, if the program cannot start from the current mode."""
        if self._mode in (Mode.OFF, Mode.STOPPING, Mode.TRIPPED):
            self._apply_pretension()
            return
        is_moving = self._mode is Mode.PRETENSION and self.at != self.compute_angles(PRETENSION_N)
        if is_moving or not may_start_from(law, self._mode):
            self.return_to_pretension()

    def return_to_pretension(self) -> None:
        """Move to pretension and wait until the mode is active."""
        self._travel(self.compute_angles(PRETENSION_N))
        self._hold(motion_primitives.STANDSTILL_S)
        self._mode = Mode.PRETENSION

    def follow_program(self, program: Program) -> None:
        """Follow an identification program, from the motion to its start to its end."""
        self.intervals, self._program_start = [], self.ticks
        if program.law is Law.FORCE_HOLD:
            self._follow_force_hold(program)
        elif program.law is Law.MOTOR_STEPS:
            self._follow_motor_steps(program)
        elif program.law is Law.TENSION_SWEEP:
            self._follow_tension_sweep(program)
        else:
            raise ValueError(f"{program.law} follows references of the joint, not of the motors")

    def compute_angles(self, F: float) -> JointAngles:
        """Return the motor angles [rad] at which both tendons have the tension F [N], at q = 0."""
        r_m = self._parameters.geometry.r_m
        return spring_elongation(self._springs["A"], F) / r_m, spring_elongation(self._springs["B"], F) / r_m

    def _follow_force_hold(self, program: Program) -> None:
        if program.excitation is None:
            raise ValueError("a force-hold program needs an excitation")
        at = 1, 1, program.tension_N
        self._travel((sum(self.compute_angles(program.tension_N)), 0.0))
        self._end_interval(*at, Stage.TRAVELLING)
        theta_A, theta_B = self.at
        self._hold(program.settle_s, trimmed=True)
        self._end_interval(*at, Stage.SETTLING)
        excitation = program.excitation
        levels = [1.0 if level == "+" else -1.0 for level in excitation.levels * excitation.periods]
        offsets = excitation.amplitude_rad * np.repeat(levels, max(round(excitation.chip_s / T_s), 1))
        self._add(theta_A + offsets, np.full(offsets.size, theta_B), trimmed=True)
        self._end_interval(*at, Stage.EXCITING)
        self.at = theta_A, theta_B

    def _follow_motor_steps(self, program: Program) -> None:
        settled_s = program.settle_s - T_s  # the tick of arrival counts
        self._travel(self.compute_angles(PRETENSION_N))
        self._hold(settled_s)
        for number, step in enumerate(program.steps, start=1):
            at = number, len(program.steps), step.u
            self._travel((step.theta_start, step.theta_start))
            self._end_interval(*at, Stage.TRAVELLING)
            self._hold(settled_s)
            self._hold(ZERO_VOLTS_S)
            self._end_interval(*at, Stage.SETTLING)
            braked = self._apply_step(step)
            self._end_interval(*at, Stage.EXCITING)
            self._add(*braked)
            self._end_interval(*at, Stage.BRAKING)

    def _follow_tension_sweep(self, program: Program) -> None:
        of = 1 + len(program.legs)
        self._travel(self.compute_angles(program.tension_N))
        self._end_interval(1, of, program.tension_N, Stage.TRAVELLING)
        self._hold(program.settle_s - T_s)  # the tick of arrival counts
        self._end_interval(1, of, program.tension_N, Stage.SETTLING)
        for number, leg in enumerate(program.legs, start=2):
            share = np.linspace(0.0, 1.0, max(round(leg.duration_s / T_s), 1) + 1)[1:]
            (from_A, from_B), (to_A, to_B) = self.at, self.compute_angles(leg.tension_N)
            self._add(from_A + share * (to_A - from_A), from_B + share * (to_B - from_B))
            self._end_interval(number, of, leg.tension_N, Stage.WINDING)

    def _end_interval(self, number: int, of: int, set_point: float, stage: Stage) -> None:
        """Assign the ticks since the last interval to a stage of a setpoint."""
        begin = self.intervals[-1].end if self.intervals else 0
        self.intervals.append(
            ProgramInterval(
                number=number,
                of=of,
                set_point=set_point,
                stage=stage,
                begin=begin,
                end=self.ticks - self._program_start,
            )
        )

    def _travel(self, target: JointAngles) -> None:
        (from_A, from_B), (to_A, to_B) = self.at, target
        distance = max(abs(to_A - from_A), abs(to_B - from_B))
        ticks = max(math.ceil(distance / (TRAVEL_SPEED * T_s)), 1)
        share = np.minimum(np.arange(1, ticks + 1) * (TRAVEL_SPEED * T_s) / max(distance, 1e-12), 1.0)
        self._add(from_A + share * (to_A - from_A), from_B + share * (to_B - from_B))
        self.at = target

    def _hold(self, seconds: float, *, trimmed: bool = False) -> None:
        ticks = round(seconds / T_s)
        self._add(np.full(ticks, self.at[0]), np.full(ticks, self.at[1]), trimmed=trimmed)

    def _apply_pretension(self) -> None:
        """Simulate pretension from slack as ``motion_primitives.step_pretension`` does, with the joint at rest."""
        r_m = self._parameters.geometry.r_m
        behind = 1.0 - math.exp(-T_s / _WINDING_LAG_S)
        state = motion_primitives.PretensionState(0.0, 0.0, *self.at, 0.0)
        theta = list(self.at)
        ticks: list[JointAngles] = []
        while state.steady_s < motion_primitives.STANDSTILL_S and len(ticks) * T_s < _WINDING_MAX_S:
            F = [
                max(tendon_tension(self._springs[side], r_m * angle), 0.0)
                for side, angle in zip(SIDES, theta, strict=True)
            ]
            state = motion_primitives.step_pretension(state, PRETENSION_N, *F)
            commanded = state.theta_A_ref, state.theta_B_ref
            theta = [angle + behind * (to - angle) for angle, to in zip(theta, commanded, strict=True)]
            ticks.append(commanded)
        self._add(*np.array(ticks).T)
        self.return_to_pretension()

    def _apply_step(self, step: VoltageStep) -> tuple[Array, Array]:
        """Apply a voltage step to models of both motors; return their braking motion.

        The models follow equation 17, with Coulomb friction.
        """
        motors = [_FreeMotor(self._parameters, side, angle) for side, angle in zip(SIDES, self.at, strict=True)]
        turned: list[JointAngles] = []
        while len(turned) < round(step.duration_s / T_s):
            turned.append((motors[0].step(step.u), motors[1].step(step.u)))
            if max(abs(angle - step.theta_start) for angle in turned[-1]) >= step.travel_rad:
                break
        self._add(*np.array(turned).T)
        u_max = self._parameters.motor.u_max
        state = motion_primitives.BrakeState(*turned[-1], 0.0, 0.0)
        braked = turned[-1:]
        for _ in range(round(STEP_BRAKING_S / T_s)):
            u_A, u_B, state = motion_primitives.step_brake(state, *braked[-1], u_max)
            braked.append((motors[0].step(u_A), motors[1].step(u_B)))
        theta_A, theta_B = np.array(braked[1:]).T
        return theta_A, theta_B

    def _add(self, theta_A: Array, theta_B: Array, *, trimmed: bool = False) -> None:
        if theta_A.size > 0:
            self._reference_arrays.append(np.column_stack([theta_A, theta_B]))
            self._trimmed.append((theta_A.size, trimmed))
            self.at = float(theta_A[-1]), float(theta_B[-1])


class _FreeMotor:
    """A motor without load: T_m ω' = K_m u − ω, with the voltage reduced by Coulomb friction."""

    def __init__(self, parameters: PlantParameters, side: Side, theta: float) -> None:
        known, motor = parameters.select_identified(side), parameters.select_motor(side)
        self._K_m, self._friction_V = known.K_m, motor.c0 / motor.K_t
        self._follow = 1.0 - math.exp(-T_s / known.T_m)
        self._theta, self._omega = theta, 0.0

    def step(self, u: float) -> float:
        """Advance by one tick with the voltage ``u`` [V]; return the angle [rad]."""
        against = math.copysign(self._friction_V, self._omega or u)
        before = self._omega
        self._omega += self._follow * (self._K_m * (u - against) - self._omega)
        if before * self._omega < 0.0:
            self._omega = 0.0
        self._theta += T_s * self._omega
        return self._theta


# Timetable -----------------------------------------------------------------------------------------
# Intervals and signals of an identification, derived from the reference trajectory. The forecast of
# the joint's range uses the same trajectory.


TIMETABLE_POINTS = 400
"""Number of points of the signals, in addition to the corners."""

CORNERS_MAX = 4000
"""Maximum number of corners in a plot; more would form a solid band at any width."""


@dataclass(frozen=True)
class Timetable:
    """Intervals of an identification, and signals (n,) over the time ``t`` (n,) [s] since its first tick.

    ``signals`` have the names and units of the columns of a sample. They are NaN where the plan does not determine
    them: motor references from zero volts before a voltage step to the end of its braking. ``theta_A_ref`` is without
    the trim of the force loop, ``u_A`` is the voltage of steps for both motors, 0 while motor loops are closed. ``F_A``
    is the tension that the references cause at q = 0.
    """

    law: Law
    intervals: tuple[ProgramInterval, ...]
    t: Array
    signals: dict[str, Array]

    @property
    def duration_s(self) -> float:
        """Duration from the first to the last tick [s]."""
        return self.intervals[-1].end * T_s

    def title(self, interval: ProgramInterval) -> str:
        """Return the setpoint of an interval as text."""
        return format_set_point(self.law, interval.set_point)


def forecast_identification(
    plan: IdentificationPlan, parameters: PlantParameters, references: JointAngles | None = None
) -> Timetable:
    """Return the timetable of an identification that starts at motor references [rad], by default in pretension."""
    trajectory = ReferenceTrajectory(parameters, InitialState(Mode.PRETENSION, 0.0, (0.0, 0.0), (0.0, 0.0)))
    trajectory.at = trajectory.compute_angles(PRETENSION_N) if references is None else references
    program = plan.program()
    trajectory.follow_program(program)
    return build_timetable(trajectory, program, parameters)


def build_timetable(trajectory: ReferenceTrajectory, program: Program, parameters: PlantParameters) -> Timetable:
    """Return the timetable of the program that a trajectory has followed last."""
    every = _collect_signals(trajectory, program)
    ticks = _select_ticks(every)
    signals = {name: values[ticks] for name, values in every.items()}
    if program.law is Law.TENSION_SWEEP:
        spring, r_m = parameters.make_identified_spring("A"), parameters.geometry.r_m
        signals["F_A"] = np.array(
            [tendon_tension(spring, r_m * angle) for angle in signals["theta_A_ref"]], dtype=np.float64
        )
    return Timetable(program.law, tuple(trajectory.intervals), (ticks + 1) * np.float64(T_s), signals)


def _collect_signals(trajectory: ReferenceTrajectory, program: Program) -> dict[str, Array]:
    """Return the signals of a program at every tick."""
    theta_A, theta_B, _ = trajectory.references()
    last = trajectory.intervals[-1].end
    theta_A, theta_B = theta_A[-last:].copy(), theta_B[-last:].copy()
    if program.law is not Law.MOTOR_STEPS:
        return {"theta_A_ref": theta_A, "theta_B_ref": theta_B}
    u = np.zeros(last)
    for interval in trajectory.intervals:
        if interval.stage is Stage.EXCITING:
            u[interval.begin : interval.end] = interval.set_point
            theta_A[interval.begin - round(ZERO_VOLTS_S / T_s) : interval.end] = np.nan
        elif interval.stage is Stage.BRAKING:
            theta_A[interval.begin : interval.end] = np.nan
    return {"u_A": u, "theta_A_ref": theta_A}


def _select_ticks(signals: dict[str, Array]) -> NDArray[np.int64]:
    """Return the ticks to plot: an even grid, and the corners of piecewise linear signals."""
    ticks = next(iter(signals.values())).size
    corner = np.zeros(ticks, dtype=bool)
    corner[[0, -1]] = True
    for values in signals.values():
        bent = np.abs(np.diff(values, 2)) > 1e-9
        gone = np.isnan(values)
        bent |= (gone[2:] != gone[1:-1]) | (gone[:-2] != gone[1:-1])
        corner[1:-1] |= bent
    if np.count_nonzero(corner) > CORNERS_MAX:
        corner[:] = False
        corner[:: max(1, ticks // CORNERS_MAX)] = True
        corner[-1] = True
    corner[:: max(1, ticks // TIMETABLE_POINTS)] = True
    return np.flatnonzero(corner)


# Forecast ------------------------------------------------------------------------------------------
# Range of joint and tensions during identifications, from the current state of the actuator.
#
# The motors follow the reference trajectory with the four lags of their loops, and the joint rests
# where both tensions are equal (equation 15). The force loop may trim motor A by up to
# ``pid.TRIM_MAX``; the range includes any trim.


STEP_TICKS = 10
"""Interval of the computed positions and tensions [ticks]; the lags of the motors are ten times longer."""

MARGIN_RAD = 0.02
"""Margin of the joint position [rad] for Coulomb friction, unequal motors, and a swing at the start."""

MARGIN_N = 0.5
"""Margin of the tensions [N] for noise and Coulomb friction of the motors."""

PATH_POINTS = 240


@dataclass(frozen=True)
class Forecast:
    """Forecast of consecutive runs, including the motions to the start and back to pretension.

    The joint stays within ``q_low`` to ``q_high`` [rad]; after winding, the tensions stay within ``F_low`` to
    ``F_high`` [N]. ``q_path`` [rad] and ``S_path`` [N·m/rad] are expected while the tendons are taut. ``duration_s`` is
    the total, ``ends_s`` has the end of each run. ``let_slack``: the identification releases the tendons.
    """

    duration_s: float
    ends_s: tuple[float, ...]
    q_start: float
    q_low: float
    q_high: float
    F_low: float
    F_high: float
    q_path: Array
    S_path: Array
    let_slack: bool

    @property
    def message(self) -> str:
        """The range of the joint as text."""
        return messages.joint_will_move(
            q_start=self.q_start, q_low=self.q_low, q_high=self.q_high, let_slack=self.let_slack
        )

    def require_within_range(self, parameters: PlantParameters) -> None:
        """Raise OutOfRangeError if joint or tendons would leave their range."""
        bounds = compute_bounds(parameters)
        remedy = messages.lower_tension_or_smaller_amplitude()
        # The run may start outside the range, but must not move further away.
        reach = max(self.q_high, -self.q_low, key=abs)
        if reach > bounds.q_trip and reach > abs(self.q_start) + MARGIN_RAD:
            raise OutOfRangeError(
                quantity=messages.joint_position_during_motion(),
                value=reach,
                minimum=-bounds.q_trip,
                maximum=bounds.q_trip,
                unit="rad",
                remedy=remedy,
            )
        if self.F_high > bounds.F_max:
            raise OutOfRangeError(
                quantity=messages.tension_during_motion(),
                value=self.F_high,
                minimum=None,
                maximum=bounds.F_max,
                unit="N",
                remedy=remedy,
            )
        if self.F_low < bounds.F_slack and not self.let_slack:
            raise OutOfRangeError(
                quantity=messages.tension_during_motion(),
                value=self.F_low,
                minimum=bounds.F_slack,
                maximum=None,
                unit="N",
                remedy=messages.higher_tension_or_smaller_amplitude(),
            )


def forecast_identifications(
    plans: Sequence[IdentificationPlan], parameters: PlantParameters, start: InitialState, lam_motor: float
) -> Forecast:
    """Return the forecast of consecutive ``plans`` from ``start``, with motor loops of ``lam_motor`` [s]."""
    trajectory = ReferenceTrajectory(parameters, start)
    start_times_s, end_times_s = [], []
    for plan in plans:
        program = plan.program()
        trajectory.move_to_start(program.law)
        start_times_s.append(trajectory.duration_s)
        trajectory.follow_program(program)
        end_times_s.append(trajectory.duration_s)
        trajectory.return_to_pretension()
    asked_A, asked_B, trimmed = trajectory.references()
    theta_A, theta_B = (
        _filter_four_lags(commanded, at, lam_motor)[::STEP_TICKS]
        for commanded, at in zip((asked_A, asked_B), start.theta, strict=True)
    )
    d, g = build_decoupler(parameters), parameters.geometry
    q = np.array([equilibrium(d, A, B) for A, B in zip(theta_A, theta_B, strict=True)])
    spring_A, spring_B = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
    F_A = np.array([tendon_tension(spring_A, x) for x in g.r_m * theta_A - g.r_j * q])
    F_B = np.array([tendon_tension(spring_B, x) for x in g.r_m * theta_B + g.r_j * q])
    taut = np.minimum(F_A, F_B) > 0.0
    taut_ticks = slice(round(start_times_s[0] / T_s) // STEP_TICKS, None)
    let_slack = any(plan.program().law is Law.MOTOR_STEPS for plan in plans)
    q_expected = [start.q, *q[taut]]
    q_low, q_high = min(q_expected) - MARGIN_RAD, max(q_expected) + MARGIN_RAD
    for at in np.flatnonzero(trimmed[::STEP_TICKS]):
        q_low = min(q_low, equilibrium(d, theta_A[at] - pid.TRIM_MAX, theta_B[at]))
        q_high = max(q_high, equilibrium(d, theta_A[at] + pid.TRIM_MAX, theta_B[at]))
    shown_ticks = np.flatnonzero(taut)
    shown_ticks = shown_ticks[:: max(shown_ticks.size // PATH_POINTS, 1)]
    return Forecast(
        duration_s=trajectory.duration_s,
        ends_s=tuple(end_times_s),
        q_start=start.q,
        q_low=q_low,
        q_high=q_high,
        F_low=0.0 if let_slack else float(min(F_A[taut_ticks].min(), F_B[taut_ticks].min())) - MARGIN_N,
        F_high=float(max(F_A.max(), F_B.max())) + MARGIN_N,
        q_path=q[shown_ticks],
        S_path=np.array([stiffness(d, theta_A[i], theta_B[i]) for i in shown_ticks]),
        let_slack=let_slack,
    )


@dataclass(frozen=True)
class ExpectedDuration:
    """Expected durations of a run [s]: before its program starts, and of its program.

    ``timetable`` is that of an identification.
    """

    before_s: float
    program_s: float
    timetable: Timetable | None = None

    @property
    def duration_s(self) -> float:
        """Total duration [s]."""
        return self.before_s + self.program_s


def forecast_duration(plan: Plan, parameters: PlantParameters, start: InitialState) -> ExpectedDuration:
    """Return the expected durations of a run, including the motion to where it can start."""
    program = plan.program()
    trajectory = ReferenceTrajectory(parameters, start)
    trajectory.move_to_start(program.law)
    before_s = trajectory.duration_s
    if program.law not in IDENTIFYING:
        return ExpectedDuration(before_s, program.duration_s)
    trajectory.follow_program(program)
    timetable = build_timetable(trajectory, program, parameters)
    return ExpectedDuration(before_s, timetable.duration_s, timetable)


def _filter_four_lags(commanded: Array, at: float, lam: float) -> Array:
    """Return the response of a motor at rest in ``at`` [rad] to its reference: 1/(λ s + 1)^4."""
    from scipy.signal import lfilter

    pole = math.exp(-T_s / lam)
    moved = commanded - at
    for _ in range(4):
        moved = lfilter([0.0, 1.0 - pole], [1.0, -pole], moved)
    return at + moved
