"""Unloaded voltage steps: tendons let slack, each step from rest, braked before the motors run out of room."""

import math
from collections.abc import Callable

from backend.controllers import brake, cascade, motors
from backend.loop.motion import Carry, Decision, MotorPositions, clipped, walk
from backend.loop.player import Target
from backend.loop.program import STEP_BRAKING_S, ZERO_VOLTS_S, Program
from plant.interface import Measurement, T_s

_ZERO_TICKS = round(ZERO_VOLTS_S / T_s)
_BRAKING_TICKS = round(STEP_BRAKING_S / T_s)
_Stage = Callable[[cascade.Tuning, Measurement], Decision]


class MotorSteps(MotorPositions):
    """Motor identification: walk to where a step starts, stand, zero volts, step, brake, and so on.

    The way to the first step leads through ``centre``, theta_A and theta_B [rad] that hold the joint at q = 0: a joint
    let loose elsewhere would leave one of the tendons taut. A step ends early where a tendon pulls by more than
    ``F_slack`` [N] or a motor is beyond ``theta_max`` [rad].
    """

    def __init__(
        self,
        carry: Carry,
        target: Target,
        program: Program,
        centre: tuple[float, float],
        F_slack: float,
        theta_max: float,
    ) -> None:
        super().__init__(carry, target)
        self._steps = list(program.steps)
        self._settle_ticks = round(program.settle_s / T_s)
        self._F_slack, self._theta_max = F_slack, theta_max
        self._goals = [centre]
        self._stage: _Stage = self._positioned
        self._began = 0.0, 0.0
        self._brake = brake.State(0.0, 0.0, 0.0, 0.0)
        self._ticks = 0
        self._plan_way()

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick of the stage in progress."""
        self._ticks += 1
        return self._stage(tuning, m)

    def _positioned(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        references = walk(self._carry.theta_A_ref, self._carry.theta_B_ref, *self._goals[0])
        if references != self._goals[0]:
            self._ticks = 0
        elif self._ticks >= self._settle_ticks:
            self._goals.pop(0)
            self._ticks = 0
            if not self._goals:
                self._stage = self._standing
        return self.follow(tuning, m, *references)

    def _standing(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        if self._ticks >= _ZERO_TICKS:
            self._enter(self._driven)
            self._began = m.theta_A, m.theta_B
        return self._open_loop(tuning, m, 0.0, 0.0)

    def _driven(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        wanted = self._steps[0]
        turned = max(abs(m.theta_A - self._began[0]), abs(m.theta_B - self._began[1]))
        out_of_room = turned >= wanted.travel_rad or max(abs(m.theta_A), abs(m.theta_B)) > self._theta_max
        if self._ticks > round(wanted.duration_s / T_s) or out_of_room or max(m.F_A, m.F_B) > self._F_slack:
            self._enter(self._braked)
            self._brake = brake.State(m.theta_A, m.theta_B, 0.0, 0.0)
            return self._braked(tuning, m)
        return self._open_loop(tuning, m, wanted.u, wanted.u)

    def _braked(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        u_A, u_B, self._brake = brake.step(self._brake, m.theta_A, m.theta_B, tuning.u_max)
        if self._ticks >= _BRAKING_TICKS:
            self._steps.pop(0)
            self.done = not self._steps
            if not self.done:
                self._plan_way()
                self._enter(self._positioned)
        return self._open_loop(tuning, m, u_A, u_B)

    def _plan_way(self) -> None:
        start = self._steps[0].theta_start
        self._goals.append((start, start))

    def _enter(self, stage: _Stage) -> None:
        self._stage, self._ticks = stage, 0

    def _open_loop(self, tuning: cascade.Tuning, m: Measurement, u_A: float, u_B: float) -> Decision:
        # Whatever comes next takes the motors over where they are, at these voltages.
        state = motors.at_rest(tuning.motors, m.theta_A, m.theta_B, u_A, u_B)
        self._carry = Carry(state, tuning.motors, m.theta_A, m.theta_B)
        limits = clipped(abs(u_A) == tuning.u_max, abs(u_B) == tuning.u_max)
        nan = math.nan
        return Decision(u_A, u_B, nan, nan, self.target, nan, nan, nan, limits)
