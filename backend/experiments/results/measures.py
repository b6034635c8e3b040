"""What can be measured of an experiment, each measure with its figures; what bounds of them may speak of."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from backend.documents.experiment import Bound, Experiment, Measure
from backend.errors import Path
from backend.experiments.composing.expressions import ExpressionError, require_known
from backend.experiments.composing.refused import ExperimentError, Lines, line_of
from backend.experiments.composing.settings import OF_THE_PLANT
from backend.experiments.results.bode import BodeFigures
from backend.experiments.results.compliance import ComplianceFigures
from backend.experiments.results.disturbance import DisturbanceFigures
from backend.experiments.results.held import HoldFigures
from backend.experiments.results.impact import ImpactFigures
from backend.experiments.results.metrics import Overall
from backend.experiments.results.pushed import PushFigures
from backend.experiments.results.response import ResponseFigures
from backend.experiments.results.robustness import RobustnessFigures
from backend.models.run import Value
from backend.tuning.gains import Lambdas
from plant.parameters import PlantParameters

FIGURES: dict[Measure, type[Any]] = {
    Measure.STEPS: Overall,
    Measure.COMPLIANCE: ComplianceFigures,
    Measure.LOADS: RobustnessFigures,
    Measure.RESPONSE: ResponseFigures,
    Measure.DISTURBANCE: DisturbanceFigures,
    Measure.BODE: BodeFigures,
    Measure.PUSHES: PushFigures,
    Measure.HOLDS: HoldFigures,
    Measure.IMPACT: ImpactFigures,
}


def names_of(measures: tuple[Measure, ...]) -> tuple[str, ...]:
    """Return the names of all figures that these measures give."""
    listed = [item.name for measure in measures for item in fields(FIGURES[measure]) if item.metadata]
    return tuple(dict.fromkeys(listed))


def known_to_bounds(
    values: dict[str, Value], parameters: PlantParameters, lambdas: Lambdas
) -> dict[str, bool | int | float | str]:
    """Return what the bounds of an experiment's criteria may speak of, by name."""
    return {
        **values,
        "u_max": parameters.motor.u_max,
        "F_max": parameters.safety.F_max,
        "r_j": parameters.geometry.r_j,
        "r_m": parameters.geometry.r_m,
        "lam_q": lambdas.lam_q,
        "lam_S": lambdas.lam_S,
        "lam_motor": lambdas.lam_motor,
        "ideal": parameters.name == "ideal",
    }


_OF_PLANT_AND_TUNING = (*OF_THE_PLANT, "lam_q", "lam_S", "lam_motor")


def require_measurable(experiment: Experiment, values: Mapping[str, Value], lines: Lines) -> None:
    """Raise ExperimentError for a criterion that no run could be judged by."""
    legal = names_of(experiment.measures)
    known = {**values, **dict.fromkeys(_OF_PLANT_AND_TUNING, 1.0)}
    for place, bound in enumerate(experiment.criteria):
        path: Path = ("criteria", place)
        if bound.figure not in legal:
            given = ", ".join(experiment.measures)
            why = f"{bound.figure!r} is no figure of what is measured ({given}); there are {', '.join(legal)}"
            raise ExperimentError(why, (*path, "figure"), line_of((*path, "figure"), lines))
        if (bound.below is None) is (bound.above is None):
            raise ExperimentError("it needs a bound, either below or above", path, line_of(path, lines))
        try:
            require_known(limit_of(bound), known)
        except ExpressionError as error:
            raise ExperimentError(str(error), path, line_of(path, lines)) from None


def limit_of(bound: Bound) -> float | str:
    """Return the bound itself, whichever side it is on."""
    limit = bound.below if bound.below is not None else bound.above
    assert limit is not None
    return limit
