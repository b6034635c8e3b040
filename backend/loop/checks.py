"""Names the fault that the control step has found, and says what was seen (``backend.control.fault_detection``)."""

import math
from collections.abc import Callable

from backend.control import fault_detection
from backend.control.decoupler import bounds_for
from backend.control.fault_detection import SLACK_MAX_S, FaultDetectionState, Found
from backend.faults import Fault
from backend.loop.sensor_checks import told
from backend.units import in_digits
from plant.interface import NO_RAW, Measurement, MotorCommand, RawReading
from plant.parameters import PlantParameters


class Checks:
    """Names faults of one plant."""

    def __init__(self, parameters: PlantParameters) -> None:
        self._bounds = bounds_for(parameters)

    def told(
        self,
        found: Found,
        seen: FaultDetectionState,
        m: Measurement,
        heard: Measurement,
        command: MotorCommand,
        at_card: RawReading,
        missed: int,
    ) -> tuple[Fault, str]:
        """Return the fault and what was seen.

        ``m`` has the motors' zeros, ``heard`` is that from the joint's middle; ``at_card`` is what they were made from,
        ``missed`` the deadlines since the last tick.
        """
        match found.what:
            case fault_detection.NO_NUMBER | fault_detection.OUT_OF_BOUNDS:
                return self.standing(heard, at_card)
            case fault_detection.TRIPPED:
                read = _read("F_A", m.F_A, ".1f", "N"), _read("F_B", m.F_B, ".1f", "N"), _read("q", m.q, "", "rad")
                return Fault.SAFETY_MODULE, f"the loop read {', '.join(read)} then"
            case fault_detection.INCREDIBLE:
                return told(found, seen.past, seen.newest, m, command)
            case fault_detection.SLACK:
                F_slack = self._bounds.F_slack
                slack, taut = _parted(m, lambda F: F_slack > F)
                return Fault.SLACK, f"{slack} below the bound of {F_slack:g} N for more than {SLACK_MAX_S:g} s{taut}"
            case _:
                return Fault.DEADLINES_MISSED, f"{missed} periods of 1 ms missed in a row"

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
            beyond, within = _parted(m, lambda F: bounds.F_max < F)
            return Fault.FORCE_LIMIT, f"{beyond} above the bound of {bounds.F_max:g} N{within}"
        if abs(m.q) > bounds.q_trip:
            q, q_trip = in_digits(m.q), in_digits(bounds.q_trip)  # whoever reads degrees is to read 90
            return Fault.JOINT_LIMIT, f"q = {q} rad; the bound is {q_trip} rad to either side"
        return Fault.NONE, ""


def _read(name: str, value: float, digits: str, unit: str) -> str:
    """Return a reading in words; one that is no number has no unit."""
    if not math.isfinite(value):
        return f"no number from {name}"
    return f"{name} = {format(value, digits) if digits else in_digits(value)} {unit}"


def _parted(m: Measurement, is_beyond: Callable[[float], bool]) -> tuple[str, str]:
    """Return in words the tensions that are beyond a bound, and behind a semicolon the other one, if any."""
    tensions = {"F_A": m.F_A, "F_B": m.F_B}
    beyond = [f"{name} = {F:.2f} N" for name, F in tensions.items() if is_beyond(F)]
    within = [f"; {_read(name, F, '.2f', 'N')}" for name, F in tensions.items() if not is_beyond(F)]
    return " and ".join(beyond), "".join(within)
