"""Robustness of all three loops with the gains in use: on the identified model, or on the plant itself.

A controller knows the identified model alone. On a plant that differs from it, the same gains have other sensitivity
peaks and margins; a simulator knows that plant and can tell them. Friction is left out of both (``linear_model``).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from backend.tuning.formulas import motor_gains
from backend.tuning.gains import motor_loops, position_gains, stiffness_gains
from backend.tuning.linear_model import decoupled_model
from backend.tuning.models import Lambdas, PointModel, designed_point, motor_model, true_motor_model
from backend.tuning.motor_loop import motor_robustness
from backend.tuning.robustness import OuterProcess, Robustness
from plant.parameters import SIDES, PlantParameters


@dataclass(frozen=True)
class LoopMargins:
    """The loops of ``q``, of ``S`` and of the motors, each the worst of all points of a bank or of both motors."""

    q: Robustness
    S: Robustness
    motor: Robustness


def loop_margins(
    parameters: PlantParameters, points: Sequence[PointModel], lambdas: Lambdas, *, true_plant: bool
) -> LoopMargins:
    """Return the robustness that the gains of ``lambdas`` at ``points`` have, on the true plant or on its model.

    Without points it is the 20 N point from geometry. Each outer loop is opened at its control signal while the other
    one is open (``robustness``), each motor loop is sampled and unloaded (``motor_loop``). Raises TuningError for a λ
    that has no gains.
    """
    points = points or (designed_point(parameters, lambdas.lam_motor),)
    loops = motor_loops(parameters, lambdas.lam_motor)
    q, S = [], []
    for point in points:
        model = decoupled_model(parameters, loops, point.S_nominal, true_plant=true_plant)
        q.append(OuterProcess(model[0, 0]).robustness(position_gains(parameters, point, lambdas)))
        S.append(OuterProcess(model[1, 1]).robustness(stiffness_gains(parameters, point, lambdas)))
    inner = []
    for side in SIDES:
        known = motor_model(parameters, side)
        gains = motor_gains(known.K_m, known.T_m, lambdas.lam_motor)
        inner.append(motor_robustness(true_motor_model(parameters, side) if true_plant else known, gains))
    return LoopMargins(_worst(q), _worst(S), _worst(inner))


def _worst(found: Iterable[Robustness]) -> Robustness:
    """Return the worst of each figure, whichever loop it is of."""
    loops = list(found)
    return Robustness(
        max(loop.M_s for loop in loops),
        min(loop.gain_margin for loop in loops),
        max(loop.gain_reduction for loop in loops),
        min(loop.phase_margin for loop in loops),
        stable=all(loop.stable for loop in loops),
    )
