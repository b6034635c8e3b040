"""Forecast of an identification before it starts: timetable, motor references, where the joint goes."""

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
from backend.experiments.plans import IdentificationPlan, Plan
from backend.realtime import IDENTIFYING, MODES, Law, Mode, Program, VoltageStep, may_start_from
from backend.sample import INDEX
from plant import SIDES, PlantParameters, Side, T_s, spring_elongation, tendon_tension

# Stretches -----------------------------------------------------------------------------------------
#
# What a program of identification does when: its set points in turn, and what is done at each.
# Pure.


class Stage(StrEnum):
    """What is done at a set point, in the order in which it is done."""

    TRAVELLING = "on the way"
    SETTLING = "settling"
    WINDING = "winding"
    EXCITING = "exciting"
    BRAKING = "braking"


@dataclass(frozen=True)
class ProgramInterval:
    """Ticks ``begin`` .. ``end`` of a program, from its first one as 0: one stage of the set point ``number`` ``of``.

    ``set_point`` is a tension [N], of voltage steps a voltage [V].
    """

    number: int
    of: int
    set_point: float
    stage: Stage
    begin: int
    end: int


def format_set_point(law: Law, set_point: float) -> str:
    """Name a set point as it is read: "20 N", "−3.5 V"."""
    return f"{set_point:g} {'V' if law is Law.MOTOR_STEPS else 'N'}".replace("-", "−")


# Way -----------------------------------------------------------------------------------------------
#
# The way of both motor references through a program of identification, as the loop will play it.
# Pure.
#
# One pair of angles [rad] a millisecond, from where the references are to where the program ends,
# and on to pretension. What is done in each of them, and at which set point, goes with it
# (``stretches``). Speeds, pauses and lengths are the loop's own (``backend.realtime.motions``,
# ``motor_steps``, ``tension_sweep``).


Array = NDArray[np.float64]
JointAngles = tuple[float, float]

_WINDING_LAG_S = 0.34
"""How far the motors are behind their references while winding up [s]: the sum of the motor loop's lags."""

_WINDING_MAX_S = 120.0


@dataclass(frozen=True)
class Start:
    """Where an actuator is: mode, joint and motors [rad], motor references [rad]."""

    mode: Mode
    q: float
    theta: JointAngles
    references: JointAngles


def read_start(row: NDArray[np.float64] | None) -> Start:
    """Read a sample of the loop; without one, slack and at zero. A motor without a reference is where it is."""
    if row is None:
        return Start(Mode.OFF, 0.0, (0.0, 0.0), (0.0, 0.0))
    theta = float(row[INDEX["theta_A"]]), float(row[INDEX["theta_B"]])
    commanded = float(row[INDEX["theta_A_ref"]]), float(row[INDEX["theta_B_ref"]])
    references = commanded if math.isfinite(sum(commanded)) else theta
    return Start(MODES[int(row[INDEX["mode"]])], float(row[INDEX["q"]]), theta, references)


class ReferenceTrajectory:
    """References of motors A and B [rad], a millisecond each, put together piece by piece.

    ``trimmed`` marks where the force loop may add its trim to motor A. ``stretches`` are those of the program that was
    played last.
    """

    def __init__(self, parameters: PlantParameters, start: Start) -> None:
        self.at = start.references
        self._mode = start.mode
        self._parameters = parameters
        self._springs = {side: parameters.make_identified_spring(side) for side in SIDES}
        self._pieces: list[Array] = []
        self._trimmed: list[tuple[int, bool]] = []
        self.intervals: list[ProgramInterval] = []
        self._began = 0

    @property
    def ticks(self) -> int:
        """Length so far."""
        return sum(ticks for ticks, _ in self._trimmed)

    @property
    def duration_s(self) -> float:
        """Length so far [s]."""
        return self.ticks * T_s

    def references(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return θ_A,ref and θ_B,ref [rad] of every tick, and where the force loop trims."""
        both = np.concatenate(self._pieces)
        return (
            both[:, 0],
            both[:, 1],
            np.repeat([is_trimmed for _, is_trimmed in self._trimmed], [n for n, _ in self._trimmed]),
        )

    def move_to_start(self, law: Law) -> None:
        """Wind up or travel to pretension, where the program cannot start from the present mode."""
        if self._mode in (Mode.OFF, Mode.STOPPING, Mode.TRIPPED):
            self._apply_pretension()
            return
        is_moving = self._mode is Mode.PRETENSION and self.at != self.compute_angles(PRETENSION_N)
        if is_moving or not may_start_from(law, self._mode):
            self.return_to_pretension()

    def return_to_pretension(self) -> None:
        """Travel to pretension and stand there as long as it takes to be granted."""
        self._travel(self.compute_angles(PRETENSION_N))
        self._hold(motion_primitives.STANDSTILL_S)
        self._mode = Mode.PRETENSION

    def follow_program(self, program: Program) -> None:
        """Go through a program of identification, from the way to its start to its end."""
        self.intervals, self._began = [], self.ticks
        if program.law is Law.FORCE_HOLD:
            self._force_hold(program)
        elif program.law is Law.MOTOR_STEPS:
            self._motor_steps(program)
        elif program.law is Law.TENSION_SWEEP:
            self._tension_sweep(program)
        else:
            raise ValueError(f"{program.law} follows references of the joint, not of the motors")

    def compute_angles(self, F: float) -> JointAngles:
        """Angles [rad] that hold F [N] in both tendons at q = 0."""
        r_m = self._parameters.geometry.r_m
        return spring_elongation(self._springs["A"], F) / r_m, spring_elongation(self._springs["B"], F) / r_m

    def _force_hold(self, program: Program) -> None:
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

    def _motor_steps(self, program: Program) -> None:
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

    def _tension_sweep(self, program: Program) -> None:
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
        """Put what the program was played by since the last interval to a set point's stage."""
        begin = self.intervals[-1].end if self.intervals else 0
        self.intervals.append(
            ProgramInterval(
                number=number, of=of, set_point=set_point, stage=stage, begin=begin, end=self.ticks - self._began
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
        """Pretension from slack, as ``pretension.step`` winds: the zero is found anew, the joint is left at rest."""
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
        """Step both motors as they are known (equation 17, with dry friction); return the way of braking them."""
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
            self._pieces.append(np.column_stack([theta_A, theta_B]))
            self._trimmed.append((theta_A.size, trimmed))
            self.at = float(theta_A[-1]), float(theta_B[-1])


class _FreeMotor:
    """A motor without load: T_m ω' = K_m u − ω, the voltage less what dry friction takes."""

    def __init__(self, parameters: PlantParameters, side: Side, theta: float) -> None:
        known, motor = parameters.select_identified(side), parameters.select_motor(side)
        self._K_m, self._friction_V = known.K_m, motor.c0 / motor.K_t
        self._follow = 1.0 - math.exp(-T_s / known.T_m)
        self._theta, self._omega = theta, 0.0

    def step(self, u: float) -> float:
        """One tick under ``u`` [V]; return the angle [rad]."""
        against = math.copysign(self._friction_V, self._omega or u)
        before = self._omega
        self._omega += self._follow * (self._K_m * (u - against) - self._omega)
        if before * self._omega < 0.0:
            self._omega = 0.0
        self._theta += T_s * self._omega
        return self._theta


# Timetable -----------------------------------------------------------------------------------------
#
# When an identification does what, and what it plays, from its first tick to its last one. Pure.
#
# It is read from the way of the motor references through the program that the loop is sent
# (``way``), which the forecast of the joint's range follows too: parts, times and pictures come
# from one place.


TIMETABLE_POINTS = 400
"""So many over the whole, besides the corners of what is asked for."""

CORNERS_MAX = 4000
"""Most corners that are drawn; with more the line is a solid band at any width."""


@dataclass(frozen=True)
class Timetable:
    """The stretches of an identification, and signals (n,) over ``t`` (n,) [s] since its first tick.

    ``signals`` are by the names of the sample's columns and in their units; NaN where the plan does not say: motor
    references from the zero volts before a step to the end of braking after it. ``theta_A_ref`` is without the trim of
    the force loop, ``u_A`` the voltage of steps for both motors, 0 where motor loops decide. ``F_A`` is the tension
    that the references give at q = 0.
    """

    law: Law
    intervals: tuple[ProgramInterval, ...]
    t: Array
    signals: dict[str, Array]

    @property
    def duration_s(self) -> float:
        """Length from the first tick to the last one [s]."""
        return self.intervals[-1].end * T_s

    def title(self, interval: ProgramInterval) -> str:
        """Name the set point of a interval."""
        return format_set_point(self.law, interval.set_point)


def forecast_identification(
    plan: IdentificationPlan, parameters: PlantParameters, references: JointAngles | None = None
) -> Timetable:
    """Go through an identification that begins with motor references [rad]; without any, in pretension."""
    trajectory = ReferenceTrajectory(parameters, Start(Mode.PRETENSION, 0.0, (0.0, 0.0), (0.0, 0.0)))
    trajectory.at = trajectory.compute_angles(PRETENSION_N) if references is None else references
    program = plan.program()
    trajectory.follow_program(program)
    return build_timetable(trajectory, program, parameters)


def build_timetable(trajectory: ReferenceTrajectory, program: Program, parameters: PlantParameters) -> Timetable:
    """Return the timetable of the program that a way was played by last."""
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
    """Return what is asked for in every tick of a program."""
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
    """Return the ticks to draw: an even grid, and each that begins or ends a straight piece of what is asked for."""
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
#
# Where an identification takes the joint and the tendons, told before it starts and from where the
# joint is. Pure.
#
# The references go the way that the loop will play (``way``), the motors follow through the four
# lags of their loops, and the joint rests where both tendons pull alike (equation 15). The force
# loop may trim motor A by ``force_hold.TRIM_MAX``: what is announced holds for any trim.


STEP_TICKS = 10
"""Joint and tendons are computed every so many ticks: the motors' lags are ten times longer."""

MARGIN_RAD = 0.02
"""What the joint may swing beside its rest [rad]: dry friction, unlike motors, a swing that the start interrupts."""

MARGIN_N = 0.5
"""What the load cells may read beside the tension at rest [N]: noise, and the motors' dry friction."""

PATH_POINTS = 240


@dataclass(frozen=True)
class Forecast:
    """What runs in turn will do, the way there and back to pretension included.

    The joint stays within ``q_low`` .. ``q_high`` [rad], the tendons, once wound up, within ``F_low`` ..
    ``F_high`` [N]; ``q_path`` [rad] and ``S_path`` [N·m/rad] are where it is expected while the tendons are taut.
    ``duration_s`` is the whole, ``ends_s`` when each run is over. ``let_slack``: the tendons are let go on purpose.
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
        """Where the joint goes, in words."""
        at, low, high = (math.degrees(q) for q in (self.q_start, self.q_low, self.q_high))
        within = f"{math.floor(low)} to {math.ceil(high)}°".replace("-", "−")
        words = f"the joint is at {at:.0f}° and will move within {within}, then back to 0°".replace("-", "−")
        return words + ("; nothing holds it while the tendons are slack" if self.let_slack else "")

    def require_within_range(self, parameters: PlantParameters) -> None:
        """Raise OutOfRangeError where the joint or a tendon would leave its range."""
        bounds = compute_bounds(parameters)
        remedy = "take a lower tension or a smaller amplitude"
        # A start beyond the range is no reason to stay there: only what the run itself does is refused.
        reach = max(self.q_high, -self.q_low, key=abs)
        if reach > bounds.q_trip and reach > abs(self.q_start) + MARGIN_RAD:
            raise OutOfRangeError(
                quantity="joint position on the way",
                value=reach,
                minimum=-bounds.q_trip,
                maximum=bounds.q_trip,
                unit="rad",
                remedy=remedy,
            )
        if self.F_high > bounds.F_max:
            raise OutOfRangeError(
                quantity="tension on the way",
                value=self.F_high,
                minimum=None,
                maximum=bounds.F_max,
                unit="N",
                remedy=remedy,
            )
        if self.F_low < bounds.F_slack and not self.let_slack:
            remedy = "take a higher tension or a smaller amplitude: a tendon would go slack"
            raise OutOfRangeError(
                quantity="tension on the way",
                value=self.F_low,
                minimum=bounds.F_slack,
                maximum=None,
                unit="N",
                remedy=remedy,
            )


def forecast_identifications(
    plans: Sequence[IdentificationPlan], parameters: PlantParameters, start: Start, lam_motor: float
) -> Forecast:
    """Follow ``plans`` in turn from ``start``, with motor loops of ``lam_motor`` [s]."""
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
class Expected:
    """How long a run takes [s] from its order to where its program begins, and from there to its end.

    An identification has its ``forecast_identification``; the way there is as long as the actuator takes for it.
    """

    before_s: float
    program_s: float
    timetable: Timetable | None = None

    @property
    def duration_s(self) -> float:
        """The whole [s]."""
        return self.before_s + self.program_s


def forecast_duration(plan: Plan, parameters: PlantParameters, start: Start) -> Expected:
    """Tell how long a run takes from its order to its end, the way to where it can start included."""
    program = plan.program()
    trajectory = ReferenceTrajectory(parameters, start)
    trajectory.move_to_start(program.law)
    before_s = trajectory.duration_s
    if program.law not in IDENTIFYING:
        return Expected(before_s, program.duration_s)
    trajectory.follow_program(program)
    timetable = build_timetable(trajectory, program, parameters)
    return Expected(before_s, timetable.duration_s, timetable)


def _filter_four_lags(commanded: Array, at: float, lam: float) -> Array:
    """Response of a motor at rest in ``at`` [rad] to its reference: 1/(λ s + 1)^4."""
    from scipy.signal import lfilter

    pole = math.exp(-T_s / lam)
    moved = commanded - at
    for _ in range(4):
        moved = lfilter([0.0, 1.0 - pole], [1.0, -pole], moved)
    return at + moved
