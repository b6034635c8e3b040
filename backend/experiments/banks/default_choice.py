"""The tuning where nobody has chosen one: the method's defaults, each λ moved into what the plant's numbers leave.

The motion is ``lambda``, the paper's law; the voltage limit of ``time-optimal`` is the usual share of the plant's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor

from backend.experiments.banks.tuning_choice import TuningChoice
from backend.tuning.gains import LAM_MAX, PointModel, motor_model
from backend.tuning.preview import Previewer, usual_budget
from backend.tuning.robustness import common_range
from plant.parameters import SIDES, PlantParameters

_STEP, _STEP_OF_MOTOR = 1e-3, 1e-4
"""A λ that is moved ends on a multiple of this [s]: all of it is shown where the tuning is."""


@dataclass(frozen=True)
class DefaultChoice:
    """What is in force by default, and ``moved``: a sentence on each λ that the method has otherwise, empty mostly.

    ``previewer`` is for these models and this λ_motor.
    """

    choice: TuningChoice
    moved: str
    previewer: Previewer


def default_choice(
    parameters: PlantParameters, points: Sequence[PointModel] = (), known: Previewer | None = None
) -> DefaultChoice:
    """Return the defaults on the models ``points``, of geometry where there are none.

    ``known`` is for the same models and saves work where λ_motor and b are the same too. The choice names no bank,
    whoever has models of one does. Raises TuningError where no λ would do.
    """
    method = TuningChoice()
    lam_motor = default_lam_motor(parameters)
    if known is None or not known.is_for(lam_motor, method.b):
        known = Previewer(parameters, points, lam_motor=lam_motor, b=method.b)
    lam_q_min, lam_S_min = known.safe_range()
    choice = replace(
        method,
        lam_q=_into(method.lam_q, lam_q_min, LAM_MAX, _STEP),
        lam_S=_into(method.lam_S, lam_S_min, LAM_MAX, _STEP),
        lam_motor=lam_motor,
        u_plan=usual_budget(parameters),
    )
    moved = replace(choice, u_plan=method.u_plan).differences(method)  # a limit has no effect in ``lambda``
    said = f"the method's default is not offered for these models, the nearest that is: {', '.join(moved)}"
    return DefaultChoice(choice, said if moved else "", known)


def default_lam_motor(parameters: PlantParameters) -> float:
    """Return λ_motor [s] where nobody has chosen one. Raises TuningError where none would do."""
    offered = common_range([motor_model(parameters, side) for side in SIDES])
    return _into(TuningChoice().lam_motor, *offered, _STEP_OF_MOTOR)


def _into(lam: float, low: float, high: float, step: float) -> float:
    """Return ``lam`` [s], or the nearest multiple of the step within low to high; a bound where there is none."""
    if low <= lam <= high:
        return lam
    steps = ceil(low / step) if lam < low else floor(high / step)
    return min(max(round(steps * step, 4), low), high)
