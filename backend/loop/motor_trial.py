"""Turning one motor a little, before anybody knows which way it turns: a voltage that rises, and the same backwards.

No loop is closed here: whichever way the motor goes, and whatever its sensors say, the voltages are bounded in size and
time, so that even with nothing to be seen the joint goes less than 0.1 rad.
"""

import math

from backend.control import cascade, pid
from backend.control.motion_types import Carry, Decision, Target
from backend.loop.causes import Cause
from backend.loop.motion import Trial
from plant.interface import Measurement, T_s

TRIAL_MAX_V = 1.0
"""Largest voltage [V]: a tenth of what the motors bear."""

RISE_V_PER_S = 1.0
TRAVEL_RAD = 0.2
"""A motor that has turned so far [rad] has shown its direction; it runs on by about as much, 0.03 rad at the joint."""

JOINT_RAD = 0.02
TENSION_N = 3.0
"""So much at the joint [rad], or in a tendon [N], ends the way out too, whatever the motors' encoders say."""

COAST_S = 0.2
"""At zero volts between the ways out and back [s]: what has moved is read then."""

REST_S = 0.3


class MotorTrial(Trial):
    """One motor out and back; the other one gets nothing."""

    cause = Cause.MOTOR_TRIED

    def __init__(self, carry: Carry, target: Target, m: Measurement, motor: str) -> None:
        super().__init__(carry, target)
        self._began = m
        self._is_A = motor == "A"
        self._ticks = 0
        self._out = 0

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> Decision:
        """One tick of the way out, of standing, of the way back."""
        self._ticks += 1
        if not self._out and (self._shown(m) or self._ticks * T_s >= TRIAL_MAX_V / RISE_V_PER_S):
            self._out = self._ticks
        u = self._voltage()
        u_A, u_B = (u, 0.0) if self._is_A else (0.0, u)
        nan = math.nan
        self._carry = Carry(
            pid.at_rest_motor_pair(tuning.motors, m.theta_A, m.theta_B, u_A, u_B), tuning.motors, m.theta_A, m.theta_B
        )
        return Decision(u_A, u_B, nan, nan, self.target, nan, nan, nan, 0, pushes=False, done=False)

    def _voltage(self) -> float:
        if not self._out:
            return RISE_V_PER_S * T_s * self._ticks
        back = self._ticks - self._out - round(COAST_S / T_s)
        self.done = back > self._out + round(REST_S / T_s)
        return -RISE_V_PER_S * T_s * back if 0 < back <= self._out else 0.0

    def _shown(self, m: Measurement) -> bool:
        began = self._began
        within = (
            abs(m.theta_A - began.theta_A) < TRAVEL_RAD
            and abs(m.theta_B - began.theta_B) < TRAVEL_RAD
            and abs(m.q - began.q) < JOINT_RAD
            and abs(m.F_A - began.F_A) < TENSION_N
            and abs(m.F_B - began.F_B) < TENSION_N
        )
        return not within  # more volts for a reading that is no number: never
