"""Bounds between operator, controller and plant: said once, read by loop, API and page."""

from typing import NamedTuple

from backend.controllers.envelope import Envelope
from plant.parameters import PlantParameters


class Bounds(NamedTuple):
    """Bounds of one plant.

    ``q_min``..``q_max`` [rad] and ``S_min``..``S_max`` [N·m/rad] for references; ``F_slack``, ``F_max`` [N] for the
    tendons; ``q_trip`` [rad] where the joint trips; ``u_max`` [V]; ``omega_max`` [rad/s] for the motor references;
    ``envelope`` for what the outer loops may ask of the decoupler.
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
    envelope: Envelope


REFERENCE_MARGIN_RAD = 0.17
"""Joint references end this far before the trip [rad] (10 degrees: an overshoot of 5 % of the full range)."""

STIFFNESS_RANGE = (8.0, 15.0)
"""Stiffness in use [N·m/rad] (method section 1)."""

OMEGA_MAX = 20.0
"""Fastest motor reference [rad/s]: 28.6 rad/s is what 10 V reaches without load (method section 5)."""

F_SLACK = 1.0
"""A tendon below this tension counts as slack [N]: above the load cells' noise, below any wanted tension."""


F_FLOOR = 4.0
"""Tension that the controller keeps in each tendon [N]: twice what must never be undercut, under a push it can see."""

CEILING_MARGIN_N = 2.0
"""How far below the trip the controller keeps each tendon [N]; the highest reference, 15 N·m/rad, takes 46.3 N."""


def bounds_for(parameters: PlantParameters) -> Bounds:
    """Bounds of a parameter set."""
    q_trip, F_max = parameters.geometry.q_max, parameters.safety.F_max
    q_max = q_trip - REFERENCE_MARGIN_RAD
    # Against a push the equilibrium lies beyond the reference; when the push ends, the joint must not hit its stop.
    envelope = Envelope(F_FLOOR, F_max - CEILING_MARGIN_N, q_trip - 0.5 * REFERENCE_MARGIN_RAD)
    u_max = parameters.motor.u_max
    return Bounds(-q_max, q_max, *STIFFNESS_RANGE, F_SLACK, F_max, q_trip, u_max, OMEGA_MAX, envelope)
