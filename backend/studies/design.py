"""Studies as data, and the runs that each has. Pure."""

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
from backend.studies.point import Point, StudyBase, number_of, planned, plant_with
from plant import ParameterError

# Study ---------------------------------------------------------------------------------------------
#
# A study as data: one experiment, simulated many times with other settings, another plant, other
# noise. Pure.
#
# A name without a dot is a setting of the experiment or of the loop; one with a dot is a number of
# the plant, such as ``motor.c0`` or, of a row of numbers, ``spring.k.0``. All numbers in SI.


FORMAT = 1
"""Version of this form; another one is refused."""

POINTS_MAX = 100_000
"""Runs of one study, at most."""

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
Number = int | float
Varied = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}(\.[A-Za-z0-9_]{1,40}){0,2}$")]


@validated(frozen=True, kw_only=True, config=_STRICT)
class VariedSetting:
    """What is gone through value by value: ``values``, or ``count`` from ``first`` to ``last``.

    ``spacing`` even: equal differences; factor: equal ratios.
    """

    over: Varied
    values: Annotated[tuple[Value, ...], Field(max_length=POINTS_MAX)] = ()
    first: Number | None = None
    last: Number | None = None
    count: Annotated[int, Field(ge=2, le=POINTS_MAX)] | None = None
    spacing: Literal["even", "factor"] = "even"


@validated(frozen=True, kw_only=True, config=_STRICT)
class Spread:
    """How a number of the plant is drawn around what it is: by ``relative`` of itself, or by ``absolute``.

    That is the half width of ``uniform``, the standard deviation of ``normal``, which ends at three of them.
    """

    of: Varied
    by: Literal["uniform", "normal"] = "uniform"
    relative: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
    absolute: Annotated[float, Field(gt=0.0)] | None = None


@validated(frozen=True, kw_only=True, config=_STRICT)
class Study:
    """All combinations of the ``axes``, each with all ``draws`` of the plant, each of these with all ``seeds``.

    ``experiment`` is a name, or ``written`` is one. ``seed`` begins the draws; the noise has the seeds from the setting
    ``seed`` on. Every combination meets the same draws and the same noise.
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
#
# Which runs a study has: plain arithmetic on its text, the same wherever and whenever it is done.


SIGMAS = 3.0
"""Where a normal spread ends: values beyond are not drawn, for no bound could be promised."""
_NORMAL = NormalDist()
_SEED = "seed"


@dataclass(frozen=True)
class Design:
    """The points of a study by their number, from 0. The last axis changes fastest but for draws, and seeds."""

    study: Study
    base: StudyBase

    def __len__(self) -> int:
        shape = [len(values) for _, values in self.axes]
        return prod(shape) * self.study.draws * self.study.seeds

    def point(self, number: int) -> Point:
        """Return the point of a number. Raises IndexError."""
        if not 0 <= number < len(self):
            raise IndexError(number)
        rest, noise = divmod(number, self.study.seeds)
        rest, draw = divmod(rest, self.study.draws)
        chosen: dict[str, Value] = {}
        for name, values in reversed(self.axes):
            rest, place = divmod(rest, len(values))
            chosen[name] = values[place]
        ordered = {name: chosen[name] for name, _ in self.axes}
        settings = {name: value for name, value in ordered.items() if "." not in name}
        if self.study.seeds > 1:
            settings[_SEED] = self.first_seed + noise
        plant = {name: float(value) for name, value in ordered.items() if "." in name}
        return Point(number, settings, plant | self._drawn(draw))

    @cached_property
    def axes(self) -> tuple[tuple[str, tuple[Value, ...]], ...]:
        """What is gone through, and its values, in order."""
        return tuple((axis.over, values_of(axis)) for axis in self.study.axes)

    @property
    def first_seed(self) -> int:
        """The seed of the noise, where the seeds begin."""
        return int(self.base.settings.get(_SEED, 0))

    def _drawn(self, draw: int) -> dict[str, float]:
        if not self.study.spread:
            return {}
        uniform = np.random.Generator(np.random.PCG64([self.study.seed, draw])).random(len(self.study.spread))
        return {
            spread.of: self._nominal(spread) + scale_of(spread, self._nominal(spread)) * _shape(spread, float(u))
            for spread, u in zip(self.study.spread, uniform, strict=True)
        }

    def _nominal(self, spread: Spread) -> float:
        section, entry, *place = spread.of.split(".")
        return number_of(self.base.parameters[section][entry]["value"], place)


def values_of(axis: VariedSetting) -> tuple[Value, ...]:
    """Return the values of an axis, the ends exactly as they are written."""
    if axis.values:
        return axis.values
    assert axis.first is not None  # _require_axis has looked
    assert axis.last is not None
    assert axis.count is not None
    space = np.linspace if axis.spacing == "even" else np.geomspace
    between = [float(value) for value in space(axis.first, axis.last, axis.count)[1:-1]]
    return (axis.first, *between, axis.last)


def scale_of(spread: Spread, nominal: float) -> float:
    """Return half width or standard deviation in the unit of the number."""
    return abs(nominal) * spread.relative if spread.relative is not None else float(spread.absolute or 0.0)


def designed(study: Study, lines: Lines, base: StudyBase, settings: tuple[Setting, ...]) -> Design:
    """Return the design of a study whose every value can be, each by itself.

    What only their combination forbids is told by the row of the point. ``settings`` are those of the experiment.
    Raises ExperimentError naming line, value, bound and unit.
    """
    known = {setting.name: setting for setting in (*settings, *describe_settings(LoopSettings))}
    for name, value in study.settings.items():
        _require_setting(known, name, value, ("settings", name), lines)
    taken: set[str] = set()
    for place, axis in enumerate(study.axes):
        path: Path = ("axes", place)
        _require_axis(axis, path, lines)
        _require_apart(values_of(axis), (*path, "over"), lines)
        _require_new(axis.over, taken, (*path, "over"), lines)
        for value in _outermost(values_of(axis)) if "." in axis.over else values_of(axis):
            if "." in axis.over:
                _require_number(base, axis.over, value, (*path, "over"), lines)
            else:
                _require_setting(known, axis.over, value, (*path, "over"), lines)
    for place, spread in enumerate(study.spread):
        path = ("spread", place)
        _require_new(spread.of, taken, (*path, "of"), lines)
        _require_spread(base, spread, path, lines)
    design = Design(study, base)
    _require_counts(study, design, lines, _SEED in taken)
    if study.seeds > 1:
        _require_setting(known, _SEED, design.first_seed + study.seeds - 1, ("seeds",), lines)
    try:
        planned(base, design.point(0))
    except ParameterError as error:
        raise ExperimentError(str(error), ("spread",), find_line(("spread",), lines)) from None
    return design


def _outermost(values: tuple[Value, ...]) -> tuple[Value, ...]:
    """Return the values of a number by which its bounds are kept or not; all, where one of them is none."""
    numbers = [value for value in values if not isinstance(value, bool | str)]
    return (min(numbers), max(numbers)) if len(numbers) == len(values) else values


def _require_counts(study: Study, design: Design, lines: Lines, seeds_are_an_axis: bool) -> None:
    with error_context((), lines):
        check_range("points", len(design), 1, POINTS_MAX, "1", words="runs of the study")
    if study.draws > 1 and not study.spread:
        raise ExperimentError("nothing is drawn: name a spread, or leave draws out", ("draws",), _line("draws", lines))
    if study.seeds > 1 and seeds_are_an_axis:
        raise ExperimentError("the seed is an axis already", ("seeds",), _line("seeds", lines))


def _line(name: str, lines: Lines) -> int | None:
    return find_line((name,), lines)


def _require_new(name: str, taken: set[str], path: Path, lines: Lines) -> None:
    if name in taken:
        raise ExperimentError(f"{name} is varied twice", path, find_line(path, lines))
    taken.add(name)


def _require_apart(values: tuple[Value, ...], path: Path, lines: Lines) -> None:
    twice = next((value for value, count in Counter(values).items() if count > 1), None)
    if twice is not None:
        raise ExperimentError(f"{twice} is gone through more than once", path, find_line(path, lines))


def _require_axis(axis: VariedSetting, path: Path, lines: Lines) -> None:
    ends = (axis.first, axis.last, axis.count)
    if bool(axis.values) == any(end is not None for end in ends) or (not axis.values and None in ends):
        why = "say either values, or first, last and count"
        raise ExperimentError(why, path, find_line(path, lines))
    if axis.first is not None and axis.last is not None and axis.spacing == "factor" and axis.first * axis.last <= 0:
        why = f"by equal factors one does not come from {axis.first:g} to {axis.last:g}: choose spacing even"
        raise ExperimentError(why, (*path, "spacing"), find_line((*path, "spacing"), lines))


def _require_setting(known: dict[str, Setting], name: str, value: Value, path: Path, lines: Lines) -> None:
    with error_context(path, lines):
        if name not in known:
            raise SettingError(name, value, f"unknown setting; known are {', '.join(known)}", legal=tuple(known))
        known[name].parse(value)


def _require_spread(base: StudyBase, spread: Spread, path: Path, lines: Lines) -> None:
    if (spread.relative is None) == (spread.absolute is None):
        raise ExperimentError("say either relative or absolute", path, find_line(path, lines))
    nominal = _require_number(base, spread.of, None, (*path, "of"), lines)
    reach = scale_of(spread, nominal) * (SIGMAS if spread.by == "normal" else 1.0)
    if reach == 0.0:
        why = f"{spread.of} is 0, of which nothing relative can be drawn: say absolute"
        raise ExperimentError(why, (*path, "relative"), find_line((*path, "relative"), lines))
    for end in (nominal - reach, nominal + reach):
        _require_number(base, spread.of, end, path, lines)


def _require_number(base: StudyBase, name: str, value: Any, path: Path, lines: Lines) -> float:
    """Return what a number of the plant is; ``value`` is what it is to be, None for what it is."""
    section, entry, *place = (*name.split("."), "")
    try:
        nominal = number_of(base.parameters[section][entry]["value"], [part for part in place if part])
        if value is not None:
            if isinstance(value, bool | str):
                raise ParameterError(f"{value!r} is not a number")
            plant_with(base.parameters_name, base.parameters, {name: float(value)})
    except (KeyError, IndexError, TypeError, ValueError) as error:
        told = str(error) if isinstance(error, ParameterError) else f"{name}: the plant has no such number"
        raise ExperimentError(told, path, find_line(path, lines)) from None
    return nominal


def _shape(spread: Spread, u: float) -> float:
    """Return a number of the standard form of a spread for one drawn evenly from 0 to 1."""
    if spread.by == "uniform":
        return 2.0 * u - 1.0
    low, high = _NORMAL.cdf(-SIGMAS), _NORMAL.cdf(SIGMAS)
    return _NORMAL.inv_cdf(low + u * (high - low))
