"""Fault detection in the tick: each check names the fault and says what was seen."""

import math

from backend.controllers.limits import Bounds
from backend.faults import Fault
from plant.interface import Measurement, T_s

SLACK_MAX_S = 0.1
"""How long a tendon may be slack while the loops are closed [s]."""

DEADLINES_IN_A_ROW = 400
"""So many periods missed at a stretch are a fault. Virtual machines pause for up to 300 ms now and then, which harms no
simulator; on a rig the card's watchdog has taken the drives away long before."""


class Checks:
    """Looks at every measurement; remembers how long a tendon has been slack."""

    def __init__(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self._slack_s = 0.0

    def step(self, m: Measurement, taut_wanted: bool, missed: int) -> tuple[Fault, str]:
        """Return the first fault found and what was seen, or ``Fault.NONE``.

        ``taut_wanted``: the mode keeps tendons under tension; ``missed``: deadlines missed since the last tick.
        """
        bounds = self._bounds
        if not math.isfinite(m.q + m.theta_A + m.theta_B + m.F_A + m.F_B):
            return Fault.SENSOR_INVALID, f"a sensor gives no number: {m._asdict()}"
        if m.safety_trip:
            return Fault.SAFETY_MODULE, "the independent safety module has cut the motors"
        if max(m.F_A, m.F_B) > bounds.F_max:
            return Fault.FORCE_LIMIT, f"F_A = {m.F_A:.1f} N, F_B = {m.F_B:.1f} N; the bound is {bounds.F_max:g} N"
        if abs(m.q) > bounds.q_trip:
            return Fault.JOINT_LIMIT, f"q = {m.q:.3f} rad; the bound is {bounds.q_trip:.3f} rad to either side"
        slack = taut_wanted and min(m.F_A, m.F_B) < bounds.F_slack
        self._slack_s = self._slack_s + T_s if slack else 0.0
        if self._slack_s > SLACK_MAX_S:
            return Fault.SLACK, f"F_A = {m.F_A:.1f} N, F_B = {m.F_B:.1f} N: slack for more than {SLACK_MAX_S:g} s"
        if missed >= DEADLINES_IN_A_ROW:
            return Fault.DEADLINES_MISSED, f"{missed} periods of 1 ms missed in a row"
        return Fault.NONE, ""
