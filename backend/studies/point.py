"""One simulated run of a study: its inputs, its row in the table, and its robustness metrics."""

import math
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from backend import __version__
from backend.banks import list_point_models
from backend.errors import InvalidValueError, RequestRejectedError
from backend.execution import ProgramRejectedError, simulate_in_memory
from backend.experiments import (
    ExperimentDefinition,
    ExperimentPlan,
    LoopSettings,
    build_experiment_definition,
    parser,
    split_values,
)
from backend.models import Value, complete_motion
from backend.storage import Bank, StudyPoint, UnknownRecordError, build_unknown_record_error
from backend.studies import messages
from backend.tuning import PointModel, Robustness, TuningError, compute_loop_margins
from plant import ErrorCode, ParameterError, PlantParameters, parse_parameters

# Loop metrics --------------------------------------------------------------------------------------
# Robustness metrics of a row, for the identified model and for the drawn plant.


TRUE = "_true"
"""Suffix of the metrics of the drawn plant; metrics without it are of the identified model."""

_LOOPS = {"q": "position loop", "S": "stiffness loop", "motor": "motor loops"}
_PLANTS = {"": "identified model", TRUE: "drawn plant"}
_KINDS = {
    "M_s": ("Sensitivity peak", "1"),
    "gain_margin": ("Gain margin", "1"),
    "phase_margin": ("Phase margin", "rad"),
}

LOOP_METRICS: dict[str, tuple[str, str]] = {
    f"{kind}_{loop}{plant}": (f"{label}, {_LOOPS[loop]}, {_PLANTS[plant]}", unit)
    for kind, (label, unit) in _KINDS.items()
    for loop in _LOOPS
    for plant in _PLANTS
}
"""Label and SI unit of each metric by its name, such as ``M_s_q`` and ``M_s_q_true``."""

MARGIN_METRICS = tuple(name for name in LOOP_METRICS if "margin" in name)
"""Metrics of which a lower value is worse."""


def compute_loop_metrics(
    parameters: PlantParameters, points: tuple[PointModel, ...], loop: LoopSettings
) -> dict[str, float | None]:
    """Return LOOP_METRICS for the active gains; ``parameters`` hold the drawn plant and its identified model.

    An unstable loop has M_s = inf and margins of -inf; an unbounded margin is None. Raises TuningError.
    """
    found: dict[str, float | None] = {}
    for ending in _PLANTS:
        margins = compute_loop_margins(parameters, points, loop.lambdas, true_plant=ending == TRUE)
        for name in _LOOPS:
            found |= {f"{kind}_{name}{ending}": value for kind, value in _list_metrics(getattr(margins, name))}
    return {name: found[name] for name in LOOP_METRICS}


def _list_metrics(loop: Robustness) -> Iterator[tuple[str, float | None]]:
    yield "M_s", loop.M_s
    yield "gain_margin", _margin(loop, loop.gain_margin)
    yield "phase_margin", _margin(loop, loop.phase_margin)


def _margin(loop: Robustness, margin: float) -> float | None:
    if not loop.stable:
        return -math.inf
    return None if math.isinf(margin) else margin


# Point ---------------------------------------------------------------------------------------------
# A point is computed from plain data alone, so its row depends on neither machine nor order.


REFUSED = "refused"
"""State of a point with invalid inputs: an unsafe λ, impossible plant parameters."""
FAILED = "failed"
"""State of a point whose computation raised an unexpected error."""
LOST = "lost"
"""State of a point whose process died on every attempt."""
UNSTABLE = "unstable"
"""Replaces sensitivity peak and margins of an unstable loop in the table."""

_REJECTIONS = (InvalidValueError, ParameterError, TuningError, ProgramRejectedError, UnknownRecordError)


@dataclass(frozen=True)
class StudyBase:
    """Inputs common to all runs of a study, as plain data.

    ``experiment`` is its canonical text, ``parameters`` the document of the plant, ``settings`` those that no axis
    varies, tuning included, ``banks`` all that any run uses, ``software`` the version of Sinew that computes.
    """

    experiment: str
    run_kind: str
    parameters_name: str
    parameters: dict[str, Any]
    settings: dict[str, Value]
    banks: tuple[Bank, ...] = ()
    software: str = __version__


@dataclass(frozen=True)
class Point:
    """Inputs of one run: ``settings`` by name, and plant parameters (``plant``, SI) by section.entry."""

    number: int
    settings: dict[str, Value]
    plant: dict[str, float]


class OtherSoftwareError(RequestRejectedError):
    """The study belongs to another version of Sinew, which may compute different rows."""

    def __init__(self, software: str) -> None:
        super().__init__(ErrorCode.NOT_NOW, messages.other_software(installed=__version__, recorded=software))


def require_version(software: str) -> None:
    """Raise OtherSoftwareError unless the study was created with this version of Sinew."""
    if software != __version__:
        raise OtherSoftwareError(software)


def run_point(base: StudyBase, point: Point) -> StudyPoint:
    """Simulate one point and return its row, also if it fails. Raises OtherSoftwareError only."""
    require_version(base.software)
    figures: dict[str, float | None] = {}
    try:
        return _simulate_point(base, point, figures)
    except _REJECTIONS as error:
        return build_failed_point(point, REFUSED, str(error), figures)
    except Exception as error:
        reason = messages.point_failed(error=type(error).__name__, reason=str(error))
        return build_failed_point(point, FAILED, reason, figures)


def build_failed_point(
    point: Point, state: str, detail: str, figures: Mapping[str, float | None] = MappingProxyType({})
) -> StudyPoint:
    """Return the row of a point without a completed run, with the reason and the metrics known so far."""
    return StudyPoint(
        number=point.number,
        state=state,
        detail=detail,
        passed=None,
        values=_get_varied_values(point),
        figures=dict(figures),
    )


def plan_point(base: StudyBase, point: Point) -> tuple[PlantParameters, ExperimentPlan, LoopSettings]:
    """Return plant, experiment plan and loop settings of a point.

    Raises SettingError, OutOfRangeError, ExperimentError, ParameterError.
    """
    entry = _load_definition(base.experiment, base.run_kind)
    plan, loop = split_values(
        entry.settings, entry.make_plan, {**complete_motion(base.settings), **complete_motion(point.settings)}
    )
    assert isinstance(plan, ExperimentPlan)
    return replace_plant_numbers(base.parameters_name, base.parameters, point.plant), plan, loop


def replace_plant_numbers(name: str, document: Mapping[str, Any], numbers: Mapping[str, float]) -> PlantParameters:
    """Return plant parameters with some ``numbers`` replaced, by section.entry or section.entry.index.

    Raises ParameterError for an unknown parameter or a value out of bounds.
    """
    changed = deepcopy(dict(document))
    for path, number in numbers.items():
        section, entry, *index = path.split(".")
        try:
            parameter = changed[section][entry]
            get_plant_number(parameter["value"], index)  # raises unless it exists
        except (KeyError, IndexError, TypeError, ValueError):
            raise ParameterError(messages.unknown_plant_number(name=path)) from None
        if index:
            parameter["value"][int(index[0])] = number
        else:
            parameter["value"] = number
    return parse_parameters(name, changed)


def get_plant_number(value: Any, index: list[str]) -> float:
    """Return a parameter, or the element of a list at an index given as a list of zero or one text.

    Raises IndexError, TypeError, ValueError.
    """
    if index and index[0] != str(int(index[0])):
        raise ValueError("a place must be written in its canonical form")
    number = value[int(index[0])] if index else value
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise TypeError("it is not a number")
    return float(number)


@dataclass(frozen=True)
class NamedPlantNumber:
    """A plant parameter with its name in a study."""

    name: str
    value: float
    unit: str


def list_variable_numbers(parameters: PlantParameters) -> list[NamedPlantNumber]:
    """Return every number of the plant parameters that a study can vary, each element of a list by itself."""
    found: list[NamedPlantNumber] = []
    for section, entries in parameters.to_document().items():
        for entry, parameter in entries.items() if isinstance(entries, Mapping) else ():
            value, unit = parameter.get("value"), str(parameter.get("unit", ""))
            row = value if isinstance(value, list) else [value]
            suffixes = [f".{index}" for index in range(len(row))] if isinstance(value, list) else [""]
            for suffix, number in zip(suffixes, row, strict=True):
                if isinstance(number, int | float) and not isinstance(number, bool):
                    found.append(NamedPlantNumber(f"{section}.{entry}{suffix}", float(number), unit))
    return found


def _simulate_point(base: StudyBase, point: Point, figures: dict[str, float | None]) -> StudyPoint:
    """Simulate a point; add the robustness metrics to ``figures`` first, so that a failed run has them too."""
    parameters, plan, loop = plan_point(base, point)
    banks = {bank.id: bank for bank in base.banks}

    def load_bank(number: int) -> Bank:
        if number not in banks:
            raise build_unknown_record_error("bank", number)
        return banks[number]

    figures |= compute_loop_metrics(parameters, list_point_models(load_bank(loop.bank) if loop.bank else None), loop)
    result = simulate_in_memory(parameters, plan, loop, load_bank)
    verdicts = [item.passed for item in result.criteria]
    passed = None if not verdicts or (None in verdicts and False not in verdicts) else all(verdicts)
    measured = {item.name: item.value for item in result.metrics.figures}
    return StudyPoint(
        number=point.number,
        state=result.end_state,
        detail=result.end_detail,
        passed=passed,
        values=_get_varied_values(point),
        figures=measured | figures,
    )


def _get_varied_values(point: Point) -> dict[str, Value]:
    return {**point.settings, **point.plant}


@lru_cache(maxsize=8)
def _load_definition(experiment: str, run_kind: str) -> ExperimentDefinition:
    return build_experiment_definition(parser.parse_canonical(experiment), run_kind=run_kind)
