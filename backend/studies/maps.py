"""What the table of a study comes to: maps of a figure over two axes, and how each figure is spread. Pure."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from statistics import fmean, median

from backend.documents.experiment import Experiment
from backend.documents.run_settings import Value
from backend.experiments.results.measures import FIGURES
from backend.experiments.settings import SettingError
from backend.reading import Angles, digits_apart, in_digits, read
from backend.storage.studies import StoredPoint

DRAWN_FIRST = ("overshoot_q_percent", "min_tension_N", "M_s_q", "reach_q_s")
"""Figures whose maps come first, where a study has them: overshoot, least tension, M_s, time to 90 %."""

PICKS: dict[str, Callable[[list[float]], float]] = {"mean": fmean, "least": min, "largest": max}
"""What a cell shows of the several runs that fall into it."""

WORST = "worst"
"""As a pick: the run that a cautious person looks at; of what is neither good nor bad, the mean."""
LEAST_IS_WORST = ("min_tension_N", "bandwidth_q_Hz", "bandwidth_S_Hz")
NEITHER_IS_WORST = (
    "reach_bound_q_s",
    "stiffness_felt",
    "largest_push_N",
    "delay_s",
    "error_integral_A",
    "error_integral_B",
)
"""Figures of which less is not better than more; of those that stand in neither row the largest is the worst."""


@dataclass(frozen=True)
class FigureName:
    """A figure of the table: ``label`` in words, ``unit`` SI."""

    name: str
    label: str
    unit: str


@dataclass(frozen=True)
class Map:
    """A figure over two axes: ``cells`` by place of y, then of x; None where no run gave a number.

    Or where it is of a loop that is ``unstable``, at the same places.
    """

    figure: str
    pick: str
    """One of PICKS."""
    x: str
    y: str
    x_values: tuple[Value, ...]
    y_values: tuple[Value, ...]
    cells: tuple[tuple[float | None, ...], ...]
    unstable: tuple[tuple[bool, ...], ...]


@dataclass(frozen=True)
class Spreading:
    """How the numbers of a figure lie, over the ``count`` runs that gave one; None for what is infinite.

    That is of the ``unstable`` among them.
    """

    figure: str
    count: int
    unstable: int
    least: float | None
    median: float | None
    mean: float | None
    largest: float | None


def figure_names(experiment: Experiment) -> dict[str, FigureName]:
    """Return the figures that the runs of a study have, those that are drawn first in front."""
    named = {
        item.name: FigureName(item.name, item.metadata["label"], item.metadata["unit"])
        for measure in experiment.measures
        for item in fields(FIGURES[measure])
        if item.metadata
    }
    named |= {
        "M_s_q": FigureName("M_s_q", "Sensitivity peak of the position loop", "1"),
        "M_s_S": FigureName("M_s_S", "Sensitivity peak of the stiffness loop", "1"),
    }
    first = [name for name in DRAWN_FIRST if name in named]
    return {name: named[name] for name in (*first, *(name for name in named if name not in first))}


def map_of(
    points: Sequence[StoredPoint], axes: Mapping[str, tuple[Value, ...]], x: str, y: str, figure: str, pick: str
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
    shown = worst_of(figure) if pick == WORST else pick
    found: dict[tuple[Value, Value], list[float]] = {}
    for point in points:
        value = number_of(point, figure)
        if value is not None:
            found.setdefault((point.values[x], point.values[y]), []).append(value)

    def cell(at_x: Value, at_y: Value) -> float | None:
        values = found.get((at_x, at_y))
        return PICKS[shown](values) if values else None

    cells = tuple(tuple(cell(at_x, at_y) for at_x in axes[x]) for at_y in axes[y])
    finite = tuple(tuple(_finite(value) for value in row) for row in cells)
    unstable = tuple(tuple(value == math.inf for value in row) for row in cells)
    return Map(figure, shown, x, y, axes[x], axes[y], finite, unstable)


def number_of(point: StoredPoint, figure: str) -> float | None:
    """Return the number of a figure in a row, infinity where the loop is unstable; None where there is none."""
    value: float | str | None = point.figures.get(figure)
    return math.inf if isinstance(value, str) else value


def _finite(value: float | None) -> float | None:
    return None if value == math.inf else value


def worst_of(figure: str) -> str:
    """Return which of PICKS shows the worst run."""
    if figure in NEITHER_IS_WORST:
        return "mean"
    return "least" if figure in LEAST_IS_WORST else "largest"


def axis_labels(values: Sequence[Value], unit: str, angles: Angles) -> list[str]:
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


def spreadings(points: Sequence[StoredPoint], names: Sequence[str]) -> list[Spreading]:
    """Return how each figure is spread, of those that any run has."""
    found = []
    for name in names:
        values = [v for point in points if (v := number_of(point, name)) is not None]
        if values:
            told = (_finite(of(values)) for of in (min, median, fmean, max))
            found.append(Spreading(name, len(values), values.count(math.inf), *told))
    return found
