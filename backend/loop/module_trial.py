"""Trying the safety module: a trip that is provoked at the pretension, with the loop going on to drive for a moment.

Only so does it show whether the module itself cuts the drives, or merely says so and the loop lets go.
"""

import math

from backend.control import cascade, pid
from backend.control.motion_types import Carry, Decision, Target
from backend.loop.motion import Interpreted
from backend.loop.motor_trial import TRIAL_MAX_V
from plant.interface import Measurement, T_s

DRIVEN_S = 0.3
"""So long after the trip the motors are driven [s]; then come zero volts."""

RISE_V_PER_S = 3.0
RISE_MAX_N = 3.0
"""A tendon that gets tauter by more [N] meanwhile ends it at once."""


class ModuleTrial(Interpreted):
    """Hold the motors; from the module's trip on drive them with a voltage that rises, and be done after DRIVEN_S.

    Friction holds a motor within a band of voltages, at whose lower end it creeps back although it has its drive. The
    rise makes the difference: what has its drive winds up, and what lost it is turned back by its tendon.
    """

    def __init__(self, carry: Carry, target: Target, m: Measurement) -> None:
        super().__init__(carry, target)
        self._u_A = self._u_B = 0.0
        self._ticks = 0
        self._tautest = max(m.F_A, m.F_B) + RISE_MAX_N

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> Decision:
        """One tick of holding, or of driving."""
        if not (self._ticks or m.safety_trip):
            held = self.follow(tuning, m, self._carry.theta_A_ref, self._carry.theta_B_ref)
            self._u_A, self._u_B = held.u_A, held.u_B
            return held
        self._ticks += 1
        within = self._tautest >= m.F_A and self._tautest >= m.F_B
        self.done = self.done or not within or self._ticks * T_s >= DRIVEN_S
        self._u_A, self._u_B = (min(max(u, 0.0) + RISE_V_PER_S * T_s, TRIAL_MAX_V) for u in (self._u_A, self._u_B))
        at_rest = pid.at_rest_motor_pair(tuning.motors, m.theta_A, m.theta_B, self._u_A, self._u_B)
        self._carry = Carry(at_rest, tuning.motors, m.theta_A, m.theta_B)
        nan = math.nan
        return Decision(self._u_A, self._u_B, nan, nan, self.target, nan, nan, nan, 0, pushes=False, done=self.done)
