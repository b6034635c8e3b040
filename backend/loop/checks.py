"""Fault detection in the tick: each check names the fault and says what was seen. The first one found counts."""

import math

from backend.controllers.limits import bounds_for
from backend.faults import Fault
from backend.loop.sensor_checks import SensorChecks
from backend.reading import in_digits
from plant.interface import NO_RAW, ZERO_VOLTS, Measurement, MotorCommand, RawReading, T_s
from plant.parameters import PlantParameters

SLACK_MAX_S = 0.1
"""How long a tendon may be slack while the loops are closed [s]."""


class Checks:
    """Looks at every measurement; ``command`` is what was written last, set by the loop.

    ``unattended_max_s`` [s] is how long the plant may be left alone.
    """

    def __init__(self, parameters: PlantParameters, unattended_max_s: float) -> None:
        self.command: MotorCommand = ZERO_VOLTS
        self._bounds = bounds_for(parameters)
        self._sensors = SensorChecks(parameters)
        self._missed_max = round(unattended_max_s / T_s)
        self._slack_s = 0.0

    def step(
        self,
        raw: Measurement,
        m: Measurement,
        zeroed: bool,
        taut_wanted: bool,
        missed: int,
        at_card: RawReading = NO_RAW,
    ) -> tuple[Fault, str]:
        """Return the first fault found and what was seen, or ``Fault.NONE``.

        ``raw`` is as read, ``at_card`` what it was made from; in ``m`` the motor encoders have their zeros, which are
        known where ``zeroed``.
        ``taut_wanted``: the mode keeps tendons under tension; ``missed``: deadlines missed since the last tick.
        """
        fault, seen = self.standing(m, at_card)
        if fault in (Fault.SENSOR_INVALID, Fault.SENSOR_SATURATED):
            return fault, seen
        if m.safety_trip:
            return Fault.SAFETY_MODULE, ""
        doubtful, contradiction = self._sensors.step(raw, m, self.command, zeroed, missed)
        if doubtful is Fault.SENSOR_JUMP or fault is Fault.NONE:
            fault, seen = doubtful, contradiction
        slack = taut_wanted and min(m.F_A, m.F_B) < self._bounds.F_slack
        self._slack_s = self._slack_s + T_s if slack else 0.0
        if fault is not Fault.NONE:
            return fault, seen
        if self._slack_s > SLACK_MAX_S:
            return Fault.SLACK, f"F_A = {m.F_A:.1f} N, F_B = {m.F_B:.1f} N: slack for more than {SLACK_MAX_S:g} s"
        if missed >= self._missed_max:
            return Fault.DEADLINES_MISSED, f"{missed} periods of 1 ms missed in a row"
        return Fault.NONE, ""

    def standing(self, m: Measurement, at_card: RawReading = NO_RAW) -> tuple[Fault, str]:
        """Return the fault that one measurement shows by itself, without what came before."""
        bounds = self._bounds
        if not math.isfinite(m.q + m.theta_A + m.theta_B + m.F_A + m.F_B):
            silent = [name for name, value in zip(m._fields[:5], m[:5], strict=True) if not math.isfinite(value)]
            volts = {"F_A": at_card.V_A, "F_B": at_card.V_B}  # a number there, and yet no newtons
            at_end = [
                f"{name} reads {volts[name]:.2f} V" for name in silent if math.isfinite(volts.get(name, math.nan))
            ]
            if len(at_end) == len(silent):
                return Fault.SENSOR_SATURATED, f"{', '.join(at_end)}: the end of its input, or of its calibration"
            return Fault.SENSOR_INVALID, f"no number from {', '.join(silent)}"
        if max(m.F_A, m.F_B) > bounds.F_max:
            return Fault.FORCE_LIMIT, f"F_A = {m.F_A:.1f} N, F_B = {m.F_B:.1f} N; the bound is {bounds.F_max:g} N"
        if abs(m.q) > bounds.q_trip:
            q, q_trip = in_digits(m.q), in_digits(bounds.q_trip)  # whoever reads degrees is to read 90
            return Fault.JOINT_LIMIT, f"q = {q} rad; the bound is {q_trip} rad to either side"
        return Fault.NONE, ""
