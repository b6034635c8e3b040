"""Voltage limit of time-optimal motion: the rest of the voltage is for load, friction and feedback."""

from backend.errors import require_within
from plant.parameters import PlantParameters

LEAST, MOST, USUAL = 0.2, 0.9, 0.85
"""Shares of the output range: least and most that are offered, and what is proposed."""


def plan_range(parameters: PlantParameters) -> tuple[float, float]:
    """Return the smallest and largest voltage limit [V] that are offered."""
    u_max = parameters.motor.u_max
    return round(LEAST * u_max, 3), round(MOST * u_max, 3)


def usual_budget(parameters: PlantParameters) -> float:
    """Return the voltage limit [V] that is proposed."""
    return round(USUAL * parameters.motor.u_max, 3)


def require_budget(parameters: PlantParameters, u_plan: float) -> None:
    """Raise OutOfRangeError unless ``u_plan`` [V] is offered; 0 V is ``lambda`` motion, which has no limit."""
    if u_plan != 0.0:
        remedy = "the rest of the voltage is for load, friction and feedback"
        require_within("u_plan", u_plan, *plan_range(parameters), "V", remedy)
