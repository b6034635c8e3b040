"""The way of both motor references through a program of identification, as the loop will play it. Pure.

One pair of angles [rad] a millisecond, from where the references are to where the program ends, and on to pretension.
What is done in each of them, and at which set point, goes with it (``stretches``).
Speeds, pauses and lengths are the loop's own (``backend.realtime.motions``, ``motor_steps``, ``tension_sweep``).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control import motion_primitives
from backend.control.motion_primitives import PRETENSION_N, STEP_BRAKING_S, ZERO_VOLTS_S
from backend.control.motion_types import TRAVEL_SPEED
from backend.experiments.forecasts.stretches import Stage, Stretch
from backend.realtime.program import MODES, Law, Mode, Program, VoltageStep, starts_from
from backend.sample import INDEX
from plant.dynamics import elongation, tension
from plant.interface import T_s
from plant.parameters import SIDES, PlantParameters, Side

Array = NDArray[np.float64]
Angles = tuple[float, float]

_WINDING_LAG_S = 0.34
"""How far the motors are behind their references while winding up [s]: the sum of the motor loop's lags."""

_WINDING_MAX_S = 120.0


@dataclass(frozen=True)
class Start:
    """Where an actuator is: mode, joint and motors [rad], motor references [rad]."""

    mode: Mode
    q: float
    theta: Angles
    references: Angles


def start_from(row: NDArray[np.float64] | None) -> Start:
    """Read a sample of the loop; without one, slack and at zero. A motor without a reference is where it is."""
    if row is None:
        return Start(Mode.OFF, 0.0, (0.0, 0.0), (0.0, 0.0))
    theta = float(row[INDEX["theta_A"]]), float(row[INDEX["theta_B"]])
    asked = float(row[INDEX["theta_A_ref"]]), float(row[INDEX["theta_B_ref"]])
    references = asked if math.isfinite(sum(asked)) else theta
    return Start(MODES[int(row[INDEX["mode"]])], float(row[INDEX["q"]]), theta, references)


class Way:
    """References of motors A and B [rad], a millisecond each, put together piece by piece.

    ``trimmed`` marks where the force loop may add its trim to motor A. ``stretches`` are those of the program that was
    played last.
    """

    def __init__(self, parameters: PlantParameters, start: Start) -> None:
        self.at = start.references
        self._mode = start.mode
        self._parameters = parameters
        self._springs = {side: parameters.identified_spring(side) for side in SIDES}
        self._pieces: list[Array] = []
        self._trimmed: list[tuple[int, bool]] = []
        self.stretches: list[Stretch] = []
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
        return both[:, 0], both[:, 1], np.repeat([held for _, held in self._trimmed], [n for n, _ in self._trimmed])

    def to_where_it_can_start(self, law: Law) -> None:
        """Wind up or travel to pretension, where the program cannot start from the present mode."""
        if self._mode in (Mode.OFF, Mode.STOPPING, Mode.TRIPPED):
            self._wind_up()
            return
        on_the_way = self._mode is Mode.PRETENSION and self.at != self.wound(PRETENSION_N)
        if on_the_way or not starts_from(law, self._mode):
            self.home()

    def home(self) -> None:
        """Travel to pretension and stand there as long as it takes to be granted."""
        self._walk(self.wound(PRETENSION_N))
        self._hold(motion_primitives.STANDSTILL_S)
        self._mode = Mode.PRETENSION

    def play(self, program: Program) -> None:
        """Go through a program of identification, from the way to its start to its end."""
        self.stretches, self._began = [], self.ticks
        if program.law is Law.FORCE_HOLD:
            self._force_hold(program)
        elif program.law is Law.MOTOR_STEPS:
            self._motor_steps(program)
        elif program.law is Law.TENSION_SWEEP:
            self._tension_sweep(program)
        else:
            raise ValueError(f"{program.law} follows references of the joint, not of the motors")

    def wound(self, F: float) -> Angles:
        """Angles [rad] that hold F [N] in both tendons at q = 0."""
        r_m = self._parameters.geometry.r_m
        return elongation(self._springs["A"], F) / r_m, elongation(self._springs["B"], F) / r_m

    def _force_hold(self, program: Program) -> None:
        if program.excitation is None:
            raise ValueError("a force-hold program needs an excitation")
        at = 1, 1, program.tension_N
        self._walk((sum(self.wound(program.tension_N)), 0.0))
        self._done(*at, Stage.TRAVELLING)
        theta_A, theta_B = self.at
        self._hold(program.settle_s, trimmed=True)
        self._done(*at, Stage.SETTLING)
        excitation = program.excitation
        levels = [1.0 if level == "+" else -1.0 for level in excitation.levels * excitation.periods]
        offsets = excitation.amplitude_rad * np.repeat(levels, max(round(excitation.chip_s / T_s), 1))
        self._add(theta_A + offsets, np.full(offsets.size, theta_B), trimmed=True)
        self._done(*at, Stage.EXCITING)
        self.at = theta_A, theta_B

    def _motor_steps(self, program: Program) -> None:
        settled_s = program.settle_s - T_s  # the tick of arrival counts
        self._walk(self.wound(PRETENSION_N))
        self._hold(settled_s)
        for number, step in enumerate(program.steps, start=1):
            at = number, len(program.steps), step.u
            self._walk((step.theta_start, step.theta_start))
            self._done(*at, Stage.TRAVELLING)
            self._hold(settled_s)
            self._hold(ZERO_VOLTS_S)
            self._done(*at, Stage.SETTLING)
            braked = self._drive(step)
            self._done(*at, Stage.EXCITING)
            self._add(*braked)
            self._done(*at, Stage.BRAKING)

    def _tension_sweep(self, program: Program) -> None:
        of = 1 + len(program.legs)
        self._walk(self.wound(program.tension_N))
        self._done(1, of, program.tension_N, Stage.TRAVELLING)
        self._hold(program.settle_s - T_s)  # the tick of arrival counts
        self._done(1, of, program.tension_N, Stage.SETTLING)
        for number, leg in enumerate(program.legs, start=2):
            share = np.linspace(0.0, 1.0, max(round(leg.duration_s / T_s), 1) + 1)[1:]
            (from_A, from_B), (to_A, to_B) = self.at, self.wound(leg.tension_N)
            self._add(from_A + share * (to_A - from_A), from_B + share * (to_B - from_B))
            self._done(number, of, leg.tension_N, Stage.WINDING)

    def _done(self, number: int, of: int, set_point: float, stage: Stage) -> None:
        """Put what the program was played by since the last stretch to a set point's stage."""
        begin = self.stretches[-1].end if self.stretches else 0
        self.stretches.append(Stretch(number, of, set_point, stage, begin, self.ticks - self._began))

    def _walk(self, goal: Angles) -> None:
        (from_A, from_B), (to_A, to_B) = self.at, goal
        distance = max(abs(to_A - from_A), abs(to_B - from_B))
        ticks = max(math.ceil(distance / (TRAVEL_SPEED * T_s)), 1)
        share = np.minimum(np.arange(1, ticks + 1) * (TRAVEL_SPEED * T_s) / max(distance, 1e-12), 1.0)
        self._add(from_A + share * (to_A - from_A), from_B + share * (to_B - from_B))
        self.at = goal

    def _hold(self, seconds: float, *, trimmed: bool = False) -> None:
        ticks = round(seconds / T_s)
        self._add(np.full(ticks, self.at[0]), np.full(ticks, self.at[1]), trimmed=trimmed)

    def _wind_up(self) -> None:
        """Pretension from slack, as ``pretension.step`` winds: the zero is found anew, the joint is left at rest."""
        r_m = self._parameters.geometry.r_m
        behind = 1.0 - math.exp(-T_s / _WINDING_LAG_S)
        state = motion_primitives.PretensionState(0.0, 0.0, *self.at, 0.0)
        theta = list(self.at)
        ticks: list[Angles] = []
        while state.steady_s < motion_primitives.STANDSTILL_S and len(ticks) * T_s < _WINDING_MAX_S:
            F = [max(tension(self._springs[side], r_m * angle), 0.0) for side, angle in zip(SIDES, theta, strict=True)]
            state = motion_primitives.step_pretension(state, PRETENSION_N, *F)
            asked = state.theta_A_ref, state.theta_B_ref
            theta = [angle + behind * (to - angle) for angle, to in zip(theta, asked, strict=True)]
            ticks.append(asked)
        self._add(*np.array(ticks).T)
        self.home()

    def _drive(self, step: VoltageStep) -> tuple[Array, Array]:
        """Step both motors as they are known (equation 17, with dry friction); return the way of braking them."""
        motors = [_FreeMotor(self._parameters, side, angle) for side, angle in zip(SIDES, self.at, strict=True)]
        turned: list[Angles] = []
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
        known, motor = parameters.identified_of(side), parameters.motor_of(side)
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
