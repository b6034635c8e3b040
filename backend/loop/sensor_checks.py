"""What is said of readings that cannot be true; ``backend.control.fault_detection`` finds them."""

from typing import Final

from backend.control import fault_detection
from backend.control.fault_detection import Found
from backend.faults import Fault
from plant.interface import Measurement, MotorCommand

_NAMES: Final = ("q", "theta_A", "theta_B", "F_A", "F_B")
_UNITS: Final = ("rad", "rad", "rad", "N", "N")


def told(found: Found, past: Measurement, raw: Measurement, m: Measurement, command: MotorCommand) -> tuple[Fault, str]:
    """Fault and words of readings that cannot be true.

    ``past`` and ``raw`` are as read, before and now; ``m`` has the zeros; ``command`` was written in between.
    """
    side, still = found.which, found.still
    if found.doubt == fault_detection.JUMPED:
        way = f"{past[side]:.3f} to {raw[side]:.3f} {_UNITS[side]}"
        return Fault.SENSOR_JUMP, f"{_NAMES[side]} went from {way}"
    theta, F = _NAMES[1 + side], _NAMES[3 + side]
    if found.doubt == fault_detection.REVERSED:
        return Fault.MOTOR_REVERSED, f"{theta} runs away from {command[side]:.1f} V, faster and faster"
    if found.doubt == fault_detection.UNMOVED:
        stands = f"{theta} stands at {raw[1 + side]:.3f} rad although its motor gets {command[side]:.1f} V"
        return Fault.SENSOR_STUCK, stands
    if found.doubt == fault_detection.STUCK:
        turned = f"although its motor turned by {fault_detection.TURNED_RAD:g} rad"
        return Fault.SENSOR_STUCK, f"{F} stands at {raw[3 + side]:.2f} N {turned}"
    seen = f"{F} = {m[3 + side]:.1f} N, but the encoders stretch that spring to {m[3 + side] - found.excess:.1f} N"
    if still >= 0:
        return Fault.SENSOR_STUCK, f"{_NAMES[still]} stands still; {seen}"
    return Fault.IMPLAUSIBLE, seen
