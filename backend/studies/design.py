"""The document of a study, and its design: the points that it describes, one simulated run each."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod
from statistics import NormalDist
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass as validated

from backend.errors import Path, check_range
from backend.experiments import (
    Experiment,
    ExperimentError,
    Lines,
    LoopSettings,
    Name,
    Title,
    Words,
    error_context,
    find_line,
)
from backend.models import Setting, SettingError, Value, describe_settings
from backend.studies import messages
from backend.studies.point import Point, StudyBase, get_plant_number, plan_point, replace_plant_numbers
from plant import ParameterError

# Study ---------------------------------------------------------------------------------------------
# A study simulates one experiment many times with different settings, plant parameters and noise.
#
# A name without a dot is a setting of the experiment or of the loop. A name with a dot is a plant
# parameter, such as ``motor.c0``, or ``spring.k.0`` for an element of a list. All numbers are in SI.


FORMAT = 1
"""Version of this document format; others are rejected."""

POINTS_MAX = 100_000
"""Maximum number of runs of one study."""

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
Number = int | float
VariedName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}(\.[A-Za-z0-9_]{1,40}){0,2}$")]


@validated(frozen=True, kw_only=True, config=_STRICT)
class VariedSetting:
    """A setting or plant parameter with the values it takes: ``values``, or ``count`` from ``first`` to ``last``.

    ``spacing``: ``even`` means equal differences, ``factor`` equal ratios.
    """

    over: VariedName
    values: Annotated[tuple[Value, ...], Field(max_length=POINTS_MAX)] = ()
    first: Number | None = None
    last: Number | None = None
    count: Annotated[int, Field(ge=2, le=POINTS_MAX)] | None = None
    spacing: Literal["even", "factor"] = "even"


@validated(frozen=True, kw_only=True, config=_STRICT)
class Spread:
    """Distribution from which a plant parameter is drawn, around its nominal value.

    ``relative`` (to the nominal value) or ``absolute`` is the half width of a ``uniform`` distribution, or the standard
    deviation of a ``normal`` one, which is truncated at three standard deviations.
    """

    of: VariedName
    by: Literal["uniform", "normal"] = "uniform"
    relative: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
    absolute: Annotated[float, Field(gt=0.0)] | None = None


@validated(frozen=True, kw_only=True, config=_STRICT)
class Study:
    """All combinations of the ``axes``, each with all ``draws`` of the plant and all ``seeds`` of the noise.

    ``experiment`` is the name of an experiment; ``written`` is one in full and replaces it. ``seed`` seeds the draws.
    The noise uses ``seeds`` consecutive seeds from the setting ``seed`` on. All combinations use the same draws and the
    same noise.
    """

    format: Literal[1]
    name: Name
    title: Title
    description: Words = ""
    experiment: Annotated[str, Field(min_length=1, max_length=60)] = "tracking"
    written: Experiment | None = None
    settings: Mapping[Name, Value] = Field(default_factory=dict)
    axes: Annotated[tuple[VariedSetting, ...], Field(max_length=6)] = ()
    spread: Annotated[tuple[Spread, ...], Field(max_length=40)] = ()
    draws: Annotated[int, Field(ge=1, le=POINTS_MAX)] = 1
    seeds: Annotated[int, Field(ge=1, le=POINTS_MAX)] = 1
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0


STUDY: TypeAdapter[Study] = TypeAdapter(Study)


# Design --------------------------------------------------------------------------------------------
# The points of a study follow from its document alone, so every machine computes the same ones.


SIGMAS = 3.0
"""Truncation of a normal distribution, in standard deviations; without it no bound could be checked in advance."""
_NORMAL = NormalDist()
_SEED = "seed"


@dataclass(frozen=True)
class Design:
    """The points of a study, numbered from 0: seeds change fastest, then draws, then the last axis."""

    study: Study
    base: StudyBase

    def __len__(self) -> int:
        shape = [len(values) for _, values in self.axes]
        return prod(shape) * self.study.draws * self.study.seeds

    def point(self, number: int) -> Point:
        """Return the point with this number. Raises IndexError."""
        if not 0 <= number < len(self):
            raise IndexError(number)
        rest, noise = divmod(number, self.study.seeds)
        rest, draw = divmod(rest, self.study.draws)
        selected: dict[str, Value] = {}
        for name, values in reversed(self.axes):
            rest, index = divmod(rest, len(values))
            selected[name] = values[index]
        ordered = {name: selected[name] for name, _ in self.axes}
        settings = {name: value for name, value in ordered.items() if "." not in name}
        if self.study.seeds > 1:
            settings[_SEED] = self.first_seed + noise
        plant = {name: float(value) for name, value in ordered.items() if "." in name}
        return Point(number, settings, plant | self._draw_plant_values(draw))

    @cached_property
    def axes(self) -> tuple[tuple[str, tuple[Value, ...]], ...]:
        """Names of the axes with their values, in order."""
        return tuple((axis.over, list_axis_values(axis)) for axis in self.study.axes)

    @property
    def first_seed(self) -> int:
        """First seed of the noise."""
        return int(self.base.settings.get(_SEED, 0))

    def _draw_plant_values(self, draw: int) -> dict[str, float]:
        if not self.study.spread:
            return {}
        uniform = np.random.Generator(np.random.PCG64([self.study.seed, draw])).random(len(self.study.spread))
        values = {}
        for spread, u in zip(self.study.spread, uniform, strict=True):
            nominal = self._get_nominal_value(spread)
            values[spread.of] = nominal + compute_scale(spread, nominal) * _map_to_distribution(spread, float(u))
        return values

    def _get_nominal_value(self, spread: Spread) -> float:
        section, entry, *index = spread.of.split(".")
        return get_plant_number(self.base.parameters[section][entry]["value"], index)


def list_axis_values(axis: VariedSetting) -> tuple[Value, ...]:
    """Return the values of an axis; the first and the last one are exactly those of the document."""
    if axis.values:
        return axis.values
    assert axis.first is not None  # checked by _require_axis
    assert axis.last is not None
    assert axis.count is not None
    space = np.linspace if axis.spacing == "even" else np.geomspace
    between = [float(value) for value in space(axis.first, axis.last, axis.count)[1:-1]]
    return (axis.first, *between, axis.last)


def compute_scale(spread: Spread, nominal: float) -> float:
    """Return the half width or standard deviation in the unit of the parameter."""
    return abs(nominal) * spread.relative if spread.relative is not None else float(spread.absolute or 0.0)


def build_design(study: Study, lines: Lines, base: StudyBase, settings: tuple[Setting, ...]) -> Design:
    """Return the design of a study after checking each value by itself.

    An invalid combination of valid values is reported in the row of its point. ``settings`` are those of the
    experiment. Raises ExperimentError with line, value, bound and unit.
    """
    known = {setting.name: setting for setting in (*settings, *describe_settings(LoopSettings))}
    for name, value in study.settings.items():
        _require_setting(known, name, value, ("settings", name), lines)
    taken: set[str] = set()
    for index, axis in enumerate(study.axes):
        path: Path = ("axes", index)
        _require_axis(axis, path, lines)
        _require_apart(list_axis_values(axis), (*path, "over"), lines)
        _require_new(axis.over, taken, (*path, "over"), lines)
        for value in _select_extremes(list_axis_values(axis)) if "." in axis.over else list_axis_values(axis):
            if "." in axis.over:
                _require_number(base, axis.over, value, (*path, "over"), lines)
            else:
                _require_setting(known, axis.over, value, (*path, "over"), lines)
    for index, spread in enumerate(study.spread):
        path = ("spread", index)
        _require_new(spread.of, taken, (*path, "of"), lines)
        _require_spread(base, spread, path, lines)
    design = Design(study, base)
    _require_counts(study, design, lines, _SEED in taken)
    if study.seeds > 1:
        _require_setting(known, _SEED, design.first_seed + study.seeds - 1, ("seeds",), lines)
    try:
        plan_point(base, design.point(0))
    except ParameterError as error:
        raise ExperimentError(error.message, ("spread",), find_line(("spread",), lines)) from None
    return design


def _select_extremes(values: tuple[Value, ...]) -> tuple[Value, ...]:
    """Return the least and the largest value; all values if one of them is not a number."""
    numbers = [value for value in values if not isinstance(value, bool | str)]
    return (min(numbers), max(numbers)) if len(numbers) == len(values) else values


def _require_counts(study: Study, design: Design, lines: Lines, seeds_are_an_axis: bool) -> None:
    with error_context((), lines):
        check_range("points", len(design), 1, POINTS_MAX, "1", label=messages.runs_of_study())
    if study.draws > 1 and not study.spread:
        raise ExperimentError(messages.draws_without_spread(), ("draws",), _line("draws", lines))
    if study.seeds > 1 and seeds_are_an_axis:
        raise ExperimentError(messages.seed_is_an_axis(), ("seeds",), _line("seeds", lines))


def _line(name: str, lines: Lines) -> int | None:
    return find_line((name,), lines)


def _require_new(name: str, taken: set[str], path: Path, lines: Lines) -> None:
    if name in taken:
        raise ExperimentError(messages.varied_twice(name=name), path, find_line(path, lines))
    taken.add(name)


def _require_apart(values: tuple[Value, ...], path: Path, lines: Lines) -> None:
    twice = next((value for value, count in Counter(values).items() if count > 1), None)
    if twice is not None:
        raise ExperimentError(messages.value_given_twice(value=twice), path, find_line(path, lines))


def _require_axis(axis: VariedSetting, path: Path, lines: Lines) -> None:
    ends = (axis.first, axis.last, axis.count)
    if bool(axis.values) == any(end is not None for end in ends) or (not axis.values and None in ends):
        raise ExperimentError(messages.values_or_range(), path, find_line(path, lines))
    if axis.first is not None and axis.last is not None and axis.spacing == "factor" and axis.first * axis.last <= 0:
        no_factors = messages.no_equal_factors(first=axis.first, last=axis.last)
        raise ExperimentError(no_factors, (*path, "spacing"), find_line((*path, "spacing"), lines))


def _require_setting(known: dict[str, Setting], name: str, value: Value, path: Path, lines: Lines) -> None:
    with error_context(path, lines):
        if name not in known:
            raise SettingError(name, value, messages.unknown_setting(known=", ".join(known)), legal=tuple(known))
        known[name].parse(value)


def _require_spread(base: StudyBase, spread: Spread, path: Path, lines: Lines) -> None:
    if (spread.relative is None) == (spread.absolute is None):
        raise ExperimentError(messages.relative_or_absolute(), path, find_line(path, lines))
    nominal = _require_number(base, spread.of, None, (*path, "of"), lines)
    reach = compute_scale(spread, nominal) * (SIGMAS if spread.by == "normal" else 1.0)
    if reach == 0.0:
        zero = messages.relative_to_zero(name=spread.of)
        raise ExperimentError(zero, (*path, "relative"), find_line((*path, "relative"), lines))
    for end in (nominal - reach, nominal + reach):
        _require_number(base, spread.of, end, path, lines)


def _require_number(base: StudyBase, name: str, value: Any, path: Path, lines: Lines) -> float:
    """Return the nominal value of a plant parameter; check that it may be ``value``, unless that is None."""
    section, entry, *index = (*name.split("."), "")
    try:
        nominal = get_plant_number(base.parameters[section][entry]["value"], [part for part in index if part])
        if value is not None:
            if isinstance(value, bool | str):
                raise ParameterError(messages.not_a_number(value=value))
            replace_plant_numbers(base.parameters_name, base.parameters, {name: float(value)})
    except (KeyError, IndexError, TypeError, ValueError) as error:
        reason = error.message if isinstance(error, ParameterError) else messages.unknown_plant_number(name=name)
        raise ExperimentError(reason, path, find_line(path, lines)) from None
    return nominal


def _map_to_distribution(spread: Spread, u: float) -> float:
    """Map ``u``, uniform in 0 to 1, to the standard form of a distribution: scale 1, mean 0."""
    if spread.by == "uniform":
        return 2.0 * u - 1.0
    low, high = _NORMAL.cdf(-SIGMAS), _NORMAL.cdf(SIGMAS)
    return _NORMAL.inv_cdf(low + u * (high - low))
