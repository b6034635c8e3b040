"""Robustness figures of a study's row: of the identified model, and of the plant that was drawn."""

import math
from collections.abc import Iterator

from backend.experiments.plans.loop_settings import LoopSettings
from backend.tuning.gains import PointModel
from backend.tuning.robustness import Robustness, loop_margins
from plant.parameters import PlantParameters

TRUE = "_true"
"""Ending of the names of figures of the drawn plant; without it they are of the identified model."""

_LOOPS = {"q": "position loop", "S": "stiffness loop", "motor": "motor loops"}
_PLANTS = {"": "identified model", TRUE: "drawn plant"}
_KINDS = {
    "M_s": ("Sensitivity peak", "1"),
    "gain_margin": ("Gain margin", "1"),
    "phase_margin": ("Phase margin", "rad"),
}

LOOP_FIGURES: dict[str, tuple[str, str]] = {
    f"{kind}_{loop}{plant}": (f"{label}, {_LOOPS[loop]}, {_PLANTS[plant]}", unit)
    for kind, (label, unit) in _KINDS.items()
    for loop in _LOOPS
    for plant in _PLANTS
}
"""Label and SI unit of each figure by its name, such as ``M_s_q`` and ``M_s_q_true``."""

MARGINS = tuple(name for name in LOOP_FIGURES if "margin" in name)
"""Of these less is worse."""


def loop_figures(
    parameters: PlantParameters, points: tuple[PointModel, ...], loop: LoopSettings
) -> dict[str, float | None]:
    """Return LOOP_FIGURES for the gains in use; ``parameters`` hold the drawn plant and its identified model.

    An unstable loop has M_s = inf and margins of -inf, a gain margin without bound is None. Raises TuningError.
    """
    found: dict[str, float | None] = {}
    for ending in _PLANTS:
        margins = loop_margins(parameters, points, loop.lambdas, true_plant=ending == TRUE)
        for name in _LOOPS:
            found |= {f"{kind}_{name}{ending}": value for kind, value in _of(getattr(margins, name))}
    return {name: found[name] for name in LOOP_FIGURES}


def _of(loop: Robustness) -> Iterator[tuple[str, float | None]]:
    yield "M_s", loop.M_s
    yield "gain_margin", _margin(loop, loop.gain_margin)
    yield "phase_margin", _margin(loop, loop.phase_margin)


def _margin(loop: Robustness, margin: float) -> float | None:
    if not loop.stable:
        return -math.inf
    return None if math.isinf(margin) else margin
