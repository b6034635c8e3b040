"""How much voltage a plan may count on: what is left belongs to load, friction and feedback."""

from backend.refusal import require_within
from plant.parameters import PlantParameters

LEAST, MOST, USUAL = 0.2, 0.9, 0.85
"""Shares of the output range: least and most that are offered, and what is proposed."""


def plan_range(parameters: PlantParameters) -> tuple[float, float]:
    """Smallest and largest budget [V] that are offered beside 0, the paper's governor."""
    u_max = parameters.motor.u_max
    return round(LEAST * u_max, 3), round(MOST * u_max, 3)


def usual_budget(parameters: PlantParameters) -> float:
    """Budget [V] that is proposed."""
    return round(USUAL * parameters.motor.u_max, 3)


def require_budget(parameters: PlantParameters, u_plan: float) -> None:
    """Raise OutOfRangeError unless ``u_plan`` [V] is offered."""
    if u_plan != 0.0:
        remedy = "choose 0 for the paper's governor; the rest of the voltage is for load, friction and feedback"
        require_within("u_plan", u_plan, *plan_range(parameters), "V", remedy)
