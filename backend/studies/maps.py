"""What the table of a study comes to: maps of a figure over two axes, how each figure is spread, shares of runs. Pure.

No run is left out silently: whatever has no number, did not complete or was not judged is counted beside what has.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from statistics import NormalDist, fmean, median
from typing import TypeVar

from backend.analysis import FIGURES
from backend.documented import ANSWER, HIDDEN, described
from backend.experiments import Experiment
from backend.models import SettingError, Value
from backend.storage import StudyPoint
from backend.studies.point import LOOP_FIGURES, MARGINS, TRUE
from backend.units import AngleUnit, digits_apart, in_digits, read

_T = TypeVar("_T")

DRAWN_FIRST = ("overshoot_q_percent", "min_tension_N", f"M_s_q{TRUE}", "reach_q_s")
"""Figures whose maps come first, where a study has them: overshoot, least tension, M_s, time to 90 %."""


def percentile(values: Sequence[float], percent: float) -> float:
    """Return a percentile of at least one value, between two neighbours of the sorted values by a straight line."""
    ordered = sorted(values)
    low, share = divmod(percent / 100.0 * (len(ordered) - 1), 1.0)
    here = ordered[int(low)]
    if share == 0.0 or math.isinf(here):  # from infinity no straight line begins
        return here
    return here + share * (ordered[int(low) + 1] - here)


def deviation(values: Sequence[float]) -> float | None:
    """Return the standard deviation (n - 1), None for fewer than two values, infinity where a value is infinite."""
    if len(values) < 2:
        return None
    if not all(map(math.isfinite, values)):
        return math.inf
    mean = fmean(values)
    return math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1))


PICKS: dict[str, Callable[[list[float]], float | None]] = {
    "mean": fmean,
    "least": min,
    "largest": max,
    "deviation": deviation,
    "p5": partial(percentile, percent=5.0),
    "median": median,
    "p95": partial(percentile, percent=95.0),
}
"""What a cell shows of the several runs that fall into it."""

PICK_WORDS = {"deviation": "standard deviation", "p5": "5 % percentile", "p95": "95 % percentile"}
"""Of picks whose name does not say it."""

WORST = "worst"
"""As a pick: the run that a cautious person looks at; of what is neither good nor bad, the mean."""
LEAST_IS_WORST = ("min_tension_N", "bandwidth_q_Hz", "bandwidth_S_Hz", *MARGINS)
NEITHER_IS_WORST = (
    "reach_bound_q_s",
    "stiffness_felt",
    "largest_push_N",
    "delay_s",
    "error_integral_A",
    "error_integral_B",
)
"""Figures of which less is not better than more; of those that stand in neither row the largest is the worst."""

COMPLETED = "completed"
SHARE = "share"
"""As a pick: the share of the runs in a cell, in per cent."""
CONFIDENCE = 0.95
"""Of the interval of a share."""


@dataclass(frozen=True)
class FigureName:
    """A figure of the table: ``label`` in words, ``unit`` SI."""

    name: str
    label: str
    unit: str


SHARES = {
    "not_completed": FigureName("not_completed", "Runs not completed", "%"),
    "criteria_failed": FigureName("criteria_failed", "Runs whose criteria do not all hold", "%"),
}
"""Shares of runs: of all that are computed, and of those that were judged."""


@dataclass(frozen=True)
class Map:
    """A figure over two axes: ``cells`` by place of y, then of x; None where no run gave a number.

    Or where it is of a loop that is ``unstable``, at the same places. ``counts`` of the computed ``runs`` in a cell
    gave a number. Of a share ``intervals`` holds its confidence interval [%], None elsewhere.
    """

    __pydantic_config__ = ANSWER

    figure: str
    pick: str = field(
        metadata=described(
            "what a cell shows of several runs; where the worst was asked for, least, largest or mean, which is the "
            "worst; of a share always share"
        )
    )
    x: str
    y: str
    x_values: tuple[Value, ...] = field(metadata=HIDDEN)
    y_values: tuple[Value, ...] = field(metadata=HIDDEN)
    cells: tuple[tuple[float | None, ...], ...]
    unstable: tuple[tuple[bool, ...], ...] = field(
        metadata=described("by the same places, where null stands for an unstable loop")
    )
    counts: tuple[tuple[int, ...], ...] = field(metadata=described("by the same places, how many runs gave a number"))
    runs: tuple[tuple[int, ...], ...] = field(metadata=described("by the same places, how many runs are computed"))
    intervals: tuple[tuple[tuple[float, ...] | None, ...], ...] = field(
        metadata=described(
            "by the same places, both ends of the 95 % confidence interval of a share [%]; null elsewhere"
        )
    )


@dataclass(frozen=True)
class Spreading:
    """How the numbers of a figure lie, over the ``count`` runs that gave one; None for what is infinite.

    ``missing`` runs gave none. Infinite is what comes of the ``unstable`` among those that did. ``p5`` and ``p95`` are
    percentiles; the standard ``deviation`` of a single run is None too.
    """

    name: str
    label: str
    unit: str
    count: int
    missing: int = field(metadata=described("how many computed runs gave no number"))
    unstable: int = field(metadata=described("how many of those that gave one are of an unstable loop"))
    least: float | None
    p5: float | None
    median: float | None
    mean: float | None
    p95: float | None
    largest: float | None
    deviation: float | None


@dataclass(frozen=True)
class Share:
    """``count`` of ``of`` runs, in ``percent``, with the Wilson interval [%]; ``left_out`` were not judged.

    Numbers are None where there is no run to count.
    """

    name: str
    label: str
    count: int = field(metadata=described("runs that did not complete, or whose criteria do not all hold"))
    of: int = field(metadata=described("runs of which that is known"))
    left_out: int = field(metadata=described("computed runs of which it is not known: they were not judged"))
    percent: float | None = field(metadata=described("share", "%"))
    low: float | None = field(metadata=described("lower end of the interval", "%"))
    high: float | None = field(metadata=described("upper end of the interval", "%"))


def list_figure_names(experiment: Experiment) -> dict[str, FigureName]:
    """Return the figures that the runs of a study have, those that are drawn first in front."""
    named = {
        item.name: FigureName(item.name, item.metadata["label"], item.metadata["unit"])
        for measure in experiment.measures
        for item in fields(FIGURES[measure])
        if item.metadata
    }
    named |= {name: FigureName(name, label, unit) for name, (label, unit) in LOOP_FIGURES.items()}
    first = [name for name in DRAWN_FIRST if name in named]
    return {name: named[name] for name in (*first, *(name for name in named if name not in first))}


def map_of(
    points: Sequence[StudyPoint], axes: Mapping[str, tuple[Value, ...]], x: str, y: str, figure: str, pick: str
) -> Map:
    """Return the map of a figure over two of the ``axes``, over all else by ``pick``, one of PICKS or WORST.

    Raises SettingError for what is no axis of the study, or no pick.
    """
    for what, name in (("x", x), ("y", y)):
        if name not in axes:
            raise SettingError(what, name, f"it is no axis of this study; axes are {', '.join(axes) or 'none'}")
    if x == y:
        raise SettingError("y", y, "it is x already")
    legal = (WORST, *PICKS)
    if pick not in legal:
        raise SettingError("pick", pick, f"choose one of {', '.join(legal)}", legal=legal)
    shown = SHARE if figure in SHARES else worst_of(figure) if pick == WORST else pick
    found: dict[tuple[Value, Value], list[float]] = {}
    runs: Counter[tuple[Value, Value]] = Counter()
    for point in points:
        place = point.values[x], point.values[y]
        runs[place] += 1
        value = number_of(point, figure)
        if value is not None:
            found.setdefault(place, []).append(value)

    def over_cells(of: Callable[[tuple[Value, Value]], _T]) -> tuple[tuple[_T, ...], ...]:
        return tuple(tuple(of((at_x, at_y)) for at_x in axes[x]) for at_y in axes[y])

    def cell(place: tuple[Value, Value]) -> float | None:
        values = found.get(place)
        if not values:
            return None
        return 100.0 * fmean(values) if shown == SHARE else PICKS[shown](values)

    def interval(place: tuple[Value, Value]) -> tuple[float, float] | None:
        values = found.get(place)
        return _wilson(round(sum(values)), len(values)) if values and shown == SHARE else None

    cells = over_cells(cell)
    return Map(
        figure=figure,
        pick=shown,
        x=x,
        y=y,
        x_values=axes[x],
        y_values=axes[y],
        cells=tuple(tuple(_finite(value) for value in row) for row in cells),
        unstable=tuple(tuple(value is not None and math.isinf(value) for value in row) for row in cells),
        counts=over_cells(lambda place: len(found.get(place, ()))),
        runs=over_cells(lambda place: runs[place]),
        intervals=over_cells(interval),
    )


def number_of(point: StudyPoint, figure: str) -> float | None:
    """Return the number of a figure in a row, None where there is none; of one of SHARES 1 where the run counts, or 0.

    Where the loop is unstable it is infinity, minus infinity where the least is the worst.
    """
    if figure == "not_completed":
        return float(point.state != COMPLETED)
    if figure == "criteria_failed":
        return None if point.passed is None else float(not point.passed)
    value: float | str | None = point.figures.get(figure)
    if isinstance(value, str):
        return -math.inf if figure in LEAST_IS_WORST else math.inf
    return value


def _finite(value: float | None) -> float | None:
    return None if value is None or math.isinf(value) else value


def worst_of(figure: str) -> str:
    """Return which of PICKS shows the worst run."""
    if figure in NEITHER_IS_WORST:
        return "mean"
    return "least" if figure in LEAST_IS_WORST else "largest"


def format_axis_labels(values: Sequence[Value], unit: str, angles: AngleUnit) -> list[str]:
    """Write the values of an axis as they are read, each apart from the others."""
    numbers = {value: read(value, unit, angles) for value in values if not isinstance(value, bool | str)}
    digits = digits_apart(numbers.values())
    return [in_digits(numbers[value], digits) if value in numbers else str(value) for value in values]


def axes_to_draw(axes: Mapping[str, tuple[Value, ...]]) -> tuple[str, str] | None:
    """Return which axes a map is over where nobody says: λ_q and λ_S, else the first two; None where there is one."""
    if {"lam_q", "lam_S"} <= set(axes):
        return "lam_q", "lam_S"
    names = list(axes)
    return (names[0], names[1]) if len(names) > 1 else None


def spreadings(points: Sequence[StudyPoint], figures: Iterable[FigureName]) -> list[Spreading]:
    """Return how each figure is spread, of those that any run has."""
    found = []
    for figure in figures:
        values = [v for point in points if (v := number_of(point, figure.name)) is not None]
        if values:
            told = {
                shown: _finite(PICKS[shown](values))
                for shown in ("least", "p5", "median", "mean", "p95", "largest", "deviation")
            }
            unstable = sum(map(math.isinf, values))
            found.append(
                Spreading(
                    name=figure.name,
                    label=figure.label,
                    unit=figure.unit,
                    count=len(values),
                    missing=len(points) - len(values),
                    unstable=unstable,
                    **told,
                )
            )
    return found


def shares(points: Sequence[StudyPoint]) -> list[Share]:
    """Return SHARES over all rows that are computed, each with its Wilson interval at CONFIDENCE."""
    found = []
    for name, figure in SHARES.items():
        values = [v for point in points if (v := number_of(point, name)) is not None]
        count, of = round(sum(values)), len(values)
        low, high = _wilson(count, of) if of else (None, None)
        percent = 100.0 * count / of if of else None
        found.append(
            Share(
                name=name,
                label=figure.label,
                count=count,
                of=of,
                left_out=len(points) - of,
                percent=percent,
                low=low,
                high=high,
            )
        )
    return found


def _wilson(count: int, of: int) -> tuple[float, float]:
    """Return the Wilson score interval [%] of ``count`` in ``of`` runs (Wilson 1927)."""
    z = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)
    share, weight = count / of, z * z / of
    middle = (share + 0.5 * weight) / (1.0 + weight)
    half = z / (1.0 + weight) * math.sqrt(share * (1.0 - share) / of + 0.25 * weight / of)
    low = 0.0 if count == 0 else middle - half
    high = 1.0 if count == of else middle + half
    return 100.0 * low, 100.0 * high
