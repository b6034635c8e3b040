"""Bounds between operator, controller and plant: said once, read by loop, API and page."""

from typing import NamedTuple

from plant.parameters import PlantParameters


class Bounds(NamedTuple):
    """Bounds of one plant.

    ``q_min``..``q_max`` [rad] and ``S_min``..``S_max`` [N·m/rad] for references; ``F_slack``, ``F_max`` [N] for the
    tendons; ``q_trip`` [rad] where the joint trips; ``u_max`` [V]; ``omega_max`` [rad/s] for the motor references.
    """

    q_min: float
    q_max: float
    S_min: float
    S_max: float
    F_slack: float
    F_max: float
    q_trip: float
    u_max: float
    omega_max: float


REFERENCE_MARGIN_RAD = 0.17
"""Joint references end this far before the trip [rad] (10 degrees: an overshoot of 5 % of the full range)."""

STIFFNESS_RANGE = (8.0, 15.0)
"""Stiffness in use [N·m/rad] (method section 1)."""

OMEGA_MAX = 20.0
"""Fastest motor reference [rad/s]: 28.6 rad/s is what 10 V reaches without load (method section 5)."""

F_SLACK = 1.0
"""A tendon below this tension counts as slack [N]: above the load cells' noise, below any wanted tension."""


def bounds_for(parameters: PlantParameters) -> Bounds:
    """Bounds of a parameter set."""
    q_trip, F_max = parameters.geometry.q_max, parameters.safety.F_max
    q_max = q_trip - REFERENCE_MARGIN_RAD
    return Bounds(-q_max, q_max, *STIFFNESS_RANGE, F_SLACK, F_max, q_trip, parameters.motor.u_max, OMEGA_MAX)
