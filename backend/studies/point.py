"""One run of a study and its robustness figures, computed from plain data."""

import math
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from backend import __version__
from backend.banks import entry_points
from backend.errors import InvalidValueError, RequestRejectedError
from backend.execution import NotPlayedError, play_in_memory
from backend.experiments import (
    ExperimentDefinition,
    ExperimentPlan,
    LoopSettings,
    build_library_entry,
    parser,
    split_values,
)
from backend.models import Value, complete_motion
from backend.storage import Bank, StudyPoint, UnknownRecordError
from backend.tuning import PointModel, Robustness, TuningError, compute_loop_margins
from plant import ErrorCode, ParameterError, PlantParameters, parse_parameters

# Loop figures --------------------------------------------------------------------------------------
#
# Robustness figures of a study's row: of the identified model, and of the plant that was drawn.


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
        margins = compute_loop_margins(parameters, points, loop.lambdas, true_plant=ending == TRUE)
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


# Point ---------------------------------------------------------------------------------------------
#
# One run of a study, computed from plain data alone: wherever and in whichever order, the same row.


REFUSED = "refused"
"""State of a point that no run can be made of: λ that is not safe, a plant that cannot be."""
FAILED = "failed"
"""State of a point that could not be computed for a reason that nobody foresaw."""
LOST = "lost"
"""State of a point over which the process that computes it has died again and again."""
UNSTABLE = "unstable"
"""In the table in place of the sensitivity peak and the margins of an unstable loop."""

_REFUSALS = (InvalidValueError, ParameterError, TuningError, NotPlayedError, UnknownRecordError)


@dataclass(frozen=True)
class StudyBase:
    """What all runs of a study have in common, as plain data.

    ``experiment`` is its canonical text, ``parameters`` the document of the plant, ``settings`` those that no axis
    changes, tuning included; ``banks`` are all that are used. ``software`` is the version that computes.
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
    """What one run has of its own: ``settings`` by name, numbers of the ``plant`` by section.entry, in SI."""

    number: int
    settings: dict[str, Value]
    plant: dict[str, float]


class OtherSoftwareError(RequestRejectedError):
    """Another version of Sinew could give other rows than those that are there."""

    def __init__(self, software: str) -> None:
        super().__init__(
            ErrorCode.NOT_NOW,
            f"Sinew {__version__} computes here, the study is of Sinew {software}: "
            "use that one, or begin the study anew",
        )


def require_version(software: str) -> None:
    """Raise OtherSoftwareError where this Sinew is not the one that a study was begun with."""
    if software != __version__:
        raise OtherSoftwareError(software)


def run_point(base: StudyBase, point: Point) -> StudyPoint:
    """Simulate one point. Whatever becomes of it is a row; OtherSoftwareError alone is raised."""
    require_version(base.software)
    figures: dict[str, float | None] = {}
    try:
        return _computed(base, point, figures)
    except _REFUSALS as error:
        return without_run(point, REFUSED, str(error), figures)
    except Exception as error:
        return without_run(point, FAILED, f"{type(error).__name__}: {error}", figures)


def without_run(
    point: Point, state: str, detail: str, figures: Mapping[str, float | None] = MappingProxyType({})
) -> StudyPoint:
    """Return the row of a point that was not run, why, and the ``figures`` that are known all the same."""
    return StudyPoint(
        number=point.number, state=state, detail=detail, passed=None, values=_values(point), figures=dict(figures)
    )


def planned(base: StudyBase, point: Point) -> tuple[PlantParameters, ExperimentPlan, LoopSettings]:
    """Return what a point is a run of. Raises SettingError, OutOfRangeError, ExperimentError, ParameterError."""
    entry = _entry(base.experiment, base.run_kind)
    plan, loop = split_values(
        entry.settings, entry.make, {**complete_motion(base.settings), **complete_motion(point.settings)}
    )
    assert isinstance(plan, ExperimentPlan)
    return plant_with(base.parameters_name, base.parameters, point.plant), plan, loop


def plant_with(name: str, document: Mapping[str, Any], numbers: Mapping[str, float]) -> PlantParameters:
    """Return a set of parameters with other ``numbers``, by section.entry or section.entry.place.

    Raises ParameterError for one that is not there or out of its bounds.
    """
    changed = deepcopy(dict(document))
    for path, number in numbers.items():
        section, entry, *place = path.split(".")
        try:
            held = changed[section][entry]
            number_of(held["value"], place)  # there has to be one
        except (KeyError, IndexError, TypeError, ValueError):
            raise ParameterError(f"{path}: the plant has no such number") from None
        if place:
            held["value"][int(place[0])] = number
        else:
            held["value"] = number
    return parse_parameters(name, changed)


def number_of(value: Any, place: list[str]) -> float:
    """Return a number of an entry, or that at a place of its row. Raises IndexError, TypeError, ValueError."""
    if place and place[0] != str(int(place[0])):
        raise ValueError("a place has one way to be written")
    number = value[int(place[0])] if place else value
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise TypeError("it is no number")
    return float(number)


@dataclass(frozen=True)
class NamedPlantNumber:
    """A number of the plant by its name in a study."""

    name: str
    value: float
    unit: str


def list_variable_numbers(parameters: PlantParameters) -> list[NamedPlantNumber]:
    """Return every number of a plant that a study can vary, by section and entry, of a row each."""
    found: list[NamedPlantNumber] = []
    for section, entries in parameters.to_document().items():
        for entry, said in entries.items() if isinstance(entries, Mapping) else ():
            value, unit = said.get("value"), str(said.get("unit", ""))
            row = value if isinstance(value, list) else [value]
            places = [f".{place}" for place in range(len(row))] if isinstance(value, list) else [""]
            for place, number in zip(places, row, strict=True):
                if isinstance(number, int | float) and not isinstance(number, bool):
                    found.append(NamedPlantNumber(f"{section}.{entry}{place}", float(number), unit))
    return found


def _computed(base: StudyBase, point: Point, figures: dict[str, float | None]) -> StudyPoint:
    """Simulate a point, and put into ``figures`` what is known before that as soon as it is."""
    parameters, plan, loop = planned(base, point)
    banks = {bank.id: bank for bank in base.banks}

    def bank_of(number: int) -> Bank:
        if number not in banks:
            raise UnknownRecordError(f"there is no bank {number}")
        return banks[number]

    figures |= loop_figures(parameters, entry_points(bank_of(loop.bank) if loop.bank else None), loop)
    played = play_in_memory(parameters, plan, loop, bank_of)
    judged = [item.passed for item in played.criteria]
    passed = None if not judged or (None in judged and False not in judged) else all(judged)
    measured = {item.name: item.value for item in played.metrics.figures}
    return StudyPoint(
        number=point.number,
        state=played.end_state,
        detail=played.end_detail,
        passed=passed,
        values=_values(point),
        figures=measured | figures,
    )


def _values(point: Point) -> dict[str, Value]:
    return {**point.settings, **point.plant}


@lru_cache(maxsize=8)
def _entry(experiment: str, run_kind: str) -> ExperimentDefinition:
    return build_library_entry(parser.parse_canonical(experiment), run_kind=run_kind)
