"""Summaries of a study's table: maps of a metric over two axes, distribution of each metric, shares of runs.

Runs without a value, not completed or without criteria are counted and reported, never dropped silently.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from statistics import NormalDist, fmean, median
from typing import TypeVar

from backend.analysis import METRICS_BY_MEASURE
from backend.experiments import Experiment
from backend.models import SettingError, Value
from backend.response_docs import HIDDEN_FIELD, RESPONSE_CONFIG, describe_field
from backend.storage import StudyPoint
from backend.studies import messages
from backend.studies.point import LOOP_METRICS, MARGIN_METRICS, TRUE
from backend.units import AngleUnit, convert_to_display, count_distinguishing_digits, format_number

_T = TypeVar("_T")

METRICS_DRAWN_FIRST = ("overshoot_q_percent", "min_tension_N", f"M_s_q{TRUE}", "reach_q_s")
"""Metrics whose maps come first, if a study has them: overshoot, least tension, M_s, time to 90 %."""


def compute_percentile(values: Sequence[float], percent: float) -> float:
    """Return a percentile of one or more values, by linear interpolation between sorted neighbours."""
    ordered = sorted(values)
    low, share = divmod(percent / 100.0 * (len(ordered) - 1), 1.0)
    here = ordered[int(low)]
    if share == 0.0 or math.isinf(here):  # infinity cannot be interpolated
        return here
    return here + share * (ordered[int(low) + 1] - here)


def compute_deviation(values: Sequence[float]) -> float | None:
    """Return the standard deviation (n - 1); None for fewer than two values, infinity if a value is infinite."""
    if len(values) < 2:
        return None
    if not all(map(math.isfinite, values)):
        return math.inf
    mean = fmean(values)
    return math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1))


STATISTICS: dict[str, Callable[[list[float]], float | None]] = {
    "mean": fmean,
    "least": min,
    "largest": max,
    "deviation": compute_deviation,
    "p5": partial(compute_percentile, percent=5.0),
    "median": median,
    "p95": partial(compute_percentile, percent=95.0),
}
"""Statistics over the runs of a cell; their names are values of the parameter ``pick`` of the interface."""


WORST = "worst"
"""Value of ``pick`` for the worst run; the mean for metrics without a bad direction."""
LOWER_IS_WORSE = ("min_tension_N", "bandwidth_q_Hz", "bandwidth_S_Hz", *MARGIN_METRICS)
NEITHER_IS_WORSE = (
    "reach_bound_q_s",
    "stiffness_felt",
    "largest_push_N",
    "delay_s",
    "error_integral_A",
    "error_integral_B",
)
"""Metrics without a bad direction; for all metrics in neither list, the largest value is the worst."""

COMPLETED = "completed"
SHARE = "share"
"""Value of ``Map.pick`` for the share of the runs in a cell, in percent."""
CONFIDENCE = 0.95
"""Confidence level of the interval of a share."""


@dataclass(frozen=True)
class StudyMetric:
    """A metric of the table, with its label and SI unit."""

    name: str
    label: str
    unit: str


SHARES = {
    "not_completed": StudyMetric("not_completed", "Runs not completed", "%"),
    "criteria_failed": StudyMetric("criteria_failed", "Runs that did not pass all criteria", "%"),
}
"""Shares of runs: of all computed runs, and of the runs with criteria."""


@dataclass(frozen=True)
class Map:
    """A metric over two axes. Cells are indexed by y, then by x.

    A cell is None if none of its runs has a value, or if the value is infinite because a loop is unstable; ``unstable``
    distinguishes them. ``counts`` of the computed ``runs`` in a cell have a value. ``intervals`` are the confidence
    intervals [%] of a share, None otherwise.
    """

    __pydantic_config__ = RESPONSE_CONFIG

    figure: str
    pick: str = field(
        metadata=describe_field(
            "statistic of the runs in a cell; if the worst was requested, the worst of least, largest "
            "and mean; always share for a share"
        )
    )
    x: str
    y: str
    x_values: tuple[Value, ...] = field(metadata=HIDDEN_FIELD)
    y_values: tuple[Value, ...] = field(metadata=HIDDEN_FIELD)
    cells: tuple[tuple[float | None, ...], ...]
    unstable: tuple[tuple[bool, ...], ...] = field(
        metadata=describe_field("for each cell, whether null means an unstable loop")
    )
    counts: tuple[tuple[int, ...], ...] = field(
        metadata=describe_field("for each cell, the number of runs with a value")
    )
    runs: tuple[tuple[int, ...], ...] = field(metadata=describe_field("for each cell, the number of computed runs"))
    intervals: tuple[tuple[tuple[float, ...] | None, ...], ...] = field(
        metadata=describe_field(
            "for each cell, both ends of the 95 % confidence interval of a share [%]; null for other metrics"
        )
    )


@dataclass(frozen=True)
class Spreading:
    """Distribution of a metric over the ``count`` runs that have a value.

    ``missing`` runs have none. The ``unstable`` runs have an infinite value; an infinite statistic is None. ``p5`` and
    ``p95`` are percentiles. The standard ``deviation`` of a single run is None.
    """

    name: str
    label: str
    unit: str
    count: int
    missing: int = field(metadata=describe_field("number of computed runs without a value"))
    unstable: int = field(metadata=describe_field("number of runs with a value whose loop is unstable"))
    least: float | None
    p5: float | None
    median: float | None
    mean: float | None
    p95: float | None
    largest: float | None
    deviation: float | None


@dataclass(frozen=True)
class Share:
    """``count`` of ``of`` runs, in percent, with its Wilson interval [%]; ``left_out`` runs have no verdict.

    ``percent``, ``low`` and ``high`` are None if ``of`` is 0.
    """

    name: str
    label: str
    count: int = field(metadata=describe_field("runs that did not complete, or that did not pass all criteria"))
    of: int = field(metadata=describe_field("runs for which this is known"))
    left_out: int = field(
        metadata=describe_field("computed runs for which this is unknown, because they have no verdict")
    )
    percent: float | None = field(metadata=describe_field("share", "%"))
    low: float | None = field(metadata=describe_field("lower end of the 95 % confidence interval", "%"))
    high: float | None = field(metadata=describe_field("upper end of the 95 % confidence interval", "%"))


def list_metric_names(experiment: Experiment) -> dict[str, StudyMetric]:
    """Return the metrics of the runs of a study by name, METRICS_DRAWN_FIRST first."""
    named = {
        item.name: StudyMetric(item.name, item.metadata["label"], item.metadata["unit"])
        for measure in experiment.measures
        for item in fields(METRICS_BY_MEASURE[measure])
        if item.metadata
    }
    named |= {name: StudyMetric(name, label, unit) for name, (label, unit) in LOOP_METRICS.items()}
    first = [name for name in METRICS_DRAWN_FIRST if name in named]
    return {name: named[name] for name in (*first, *(name for name in named if name not in first))}


def build_map(
    points: Sequence[StudyPoint], axes: Mapping[str, tuple[Value, ...]], x: str, y: str, figure: str, pick: str
) -> Map:
    """Return the map of a metric over two of the ``axes``.

    Each cell combines its runs by the statistic ``pick``, one of STATISTICS or WORST. Raises SettingError for an
    unknown axis or statistic.
    """
    for what, name in (("x", x), ("y", y)):
        if name not in axes:
            raise SettingError(what, name, messages.not_an_axis(axes=", ".join(axes) or "none"))
    if x == y:
        raise SettingError("y", y, messages.same_axis_twice())
    legal = (WORST, *STATISTICS)
    if pick not in legal:
        raise SettingError("pick", pick, messages.unknown_statistic(known=", ".join(legal)), legal=legal)
    shown = SHARE if figure in SHARES else select_worst_statistic(figure) if pick == WORST else pick
    found: dict[tuple[Value, Value], list[float]] = {}
    runs: Counter[tuple[Value, Value]] = Counter()
    for point in points:
        cell = point.values[x], point.values[y]
        runs[cell] += 1
        value = get_metric_value(point, figure)
        if value is not None:
            found.setdefault(cell, []).append(value)

    def compute_cells(function: Callable[[tuple[Value, Value]], _T]) -> tuple[tuple[_T, ...], ...]:
        return tuple(tuple(function((at_x, at_y)) for at_x in axes[x]) for at_y in axes[y])

    def compute_statistic(cell: tuple[Value, Value]) -> float | None:
        values = found.get(cell)
        if not values:
            return None
        return 100.0 * fmean(values) if shown == SHARE else STATISTICS[shown](values)

    def compute_interval(cell: tuple[Value, Value]) -> tuple[float, float] | None:
        values = found.get(cell)
        return _wilson(round(sum(values)), len(values)) if values and shown == SHARE else None

    cells = compute_cells(compute_statistic)
    return Map(
        figure=figure,
        pick=shown,
        x=x,
        y=y,
        x_values=axes[x],
        y_values=axes[y],
        cells=tuple(tuple(_finite(value) for value in row) for row in cells),
        unstable=tuple(tuple(value is not None and math.isinf(value) for value in row) for row in cells),
        counts=compute_cells(lambda cell: len(found.get(cell, ()))),
        runs=compute_cells(lambda cell: runs[cell]),
        intervals=compute_cells(compute_interval),
    )


def get_metric_value(point: StudyPoint, figure: str) -> float | None:
    """Return the value of a metric in a row; None without a value.

    A metric of SHARES is 1 or 0. The value of an unstable loop is infinity, or minus infinity if lower is worse.
    """
    if figure == "not_completed":
        return float(point.state != COMPLETED)
    if figure == "criteria_failed":
        return None if point.passed is None else float(not point.passed)
    value: float | str | None = point.figures.get(figure)
    if isinstance(value, str):
        return -math.inf if figure in LOWER_IS_WORSE else math.inf
    return value


def _finite(value: float | None) -> float | None:
    return None if value is None or math.isinf(value) else value


def select_worst_statistic(figure: str) -> str:
    """Return the name of the statistic that shows the worst run."""
    if figure in NEITHER_IS_WORSE:
        return "mean"
    return "least" if figure in LOWER_IS_WORSE else "largest"


def format_axis_labels(values: Sequence[Value], unit: str, angles: AngleUnit) -> list[str]:
    """Return the values of an axis as texts, with enough digits to distinguish them."""
    numbers = {value: convert_to_display(value, unit, angles) for value in values if not isinstance(value, bool | str)}
    digits = count_distinguishing_digits(numbers.values())
    return [format_number(numbers[value], digits) if value in numbers else str(value) for value in values]


def choose_map_axes(axes: Mapping[str, tuple[Value, ...]]) -> tuple[str, str] | None:
    """Return the default axes of a map: λ_q and λ_S, else the first two; None if there is only one."""
    if {"lam_q", "lam_S"} <= set(axes):
        return "lam_q", "lam_S"
    names = list(axes)
    return (names[0], names[1]) if len(names) > 1 else None


def summarize_distributions(points: Sequence[StudyPoint], figures: Iterable[StudyMetric]) -> list[Spreading]:
    """Return the distribution of each metric that any run has."""
    found = []
    for figure in figures:
        values = [v for point in points if (v := get_metric_value(point, figure.name)) is not None]
        if values:
            statistics = {
                shown: _finite(STATISTICS[shown](values))
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
                    **statistics,
                )
            )
    return found


def compute_shares(points: Sequence[StudyPoint]) -> list[Share]:
    """Return SHARES over all computed rows, each with its Wilson interval at CONFIDENCE."""
    found = []
    for name, figure in SHARES.items():
        values = [v for point in points if (v := get_metric_value(point, name)) is not None]
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
