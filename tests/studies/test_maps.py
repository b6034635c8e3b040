"""Cells and axis labels of maps, and how runs with an unstable loop are reported."""

import math
from dataclasses import fields
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from scipy.stats import binomtest

from backend.analysis.evaluation import METRICS_BY_MEASURE
from backend.models.settings import SettingError
from backend.reports import study_map
from backend.storage.studies import StudyPoint
from backend.studies.maps import (
    LOWER_IS_WORSE,
    NEITHER_IS_WORSE,
    STATISTICS,
    WORST,
    StudyMetric,
    build_map,
    compute_shares,
    format_axis_labels,
    summarize_distributions,
)
from backend.studies.point import LOOP_METRICS, UNSTABLE
from backend.studies.runner import to_stored_point
from backend.units import AngleUnit
from tests.refusals import refused_because

AXES = {"lam_q": (0.5, 0.8), "lam_S": (0.5, 0.7)}


def named(figure: str) -> StudyMetric:
    """Return a metric with its name as the label."""
    return StudyMetric(figure, figure, "1")


def runs_of(figure: str, *values: float | None) -> list[StudyPoint]:
    """Return runs on different plants, all in one cell."""
    return [
        StudyPoint(number, "completed", "", None, {"lam_q": 0.8, "lam_S": 0.5}, {figure: value})
        for number, value in enumerate(values)
    ]


@pytest.mark.parametrize(
    ("figure", "pick", "shown", "value"),
    [
        ("min_tension_N", WORST, "least", 2.0),
        ("bandwidth_q_Hz", WORST, "least", 2.0),
        ("overshoot_q_percent", WORST, "largest", 9.0),
        ("M_s_q", WORST, "largest", 9.0),
        ("phase_margin_q_true", WORST, "least", 2.0),
        ("stiffness_felt", WORST, "mean", 5.0),
        ("min_tension_N", "mean", "mean", 5.0),
        ("min_tension_N", "largest", "largest", 9.0),
        ("min_tension_N", "median", "median", 4.0),
        ("min_tension_N", "p95", "p95", 8.5),
        ("min_tension_N", "deviation", "deviation", math.sqrt(13.0)),
    ],
)
def test_a_cell_shows_the_worst_run_unless_another_statistic_is_selected(
    figure: str, pick: str, shown: str, value: float
) -> None:
    drawn = build_map(runs_of(figure, 4.0, 9.0, None, 2.0), AXES, "lam_q", "lam_S", figure, pick)
    assert (drawn.pick, drawn.cells) == (shown, ((None, value), (None, None)))
    assert (drawn.counts, drawn.runs) == (((0, 3), (0, 0)), ((0, 4), (0, 0)))


def test_an_unknown_statistic_is_rejected() -> None:
    with refused_because(SettingError, "unknown_statistic") as caught:
        build_map([], AXES, "lam_q", "lam_S", "M_s_q", "spread")
    assert caught.value.legal == (WORST, *STATISTICS)


def test_the_lists_of_metrics_with_another_worst_contain_only_known_metrics() -> None:
    known = {item.name for figures in METRICS_BY_MEASURE.values() for item in fields(figures) if item.metadata} | set(
        LOOP_METRICS
    )
    assert {*LOWER_IS_WORSE, *NEITHER_IS_WORSE} <= known
    assert not set(LOWER_IS_WORSE) & set(NEITHER_IS_WORSE)
    assert WORST not in STATISTICS


def test_adjacent_axis_labels_are_distinct() -> None:
    assert format_axis_labels((0.5, 0.8), "s", AngleUnit.DEGREES) == ["0.5", "0.8"]
    assert format_axis_labels((10.0051, 10.0053, 10.01), "N", AngleUnit.DEGREES) == ["10.0051", "10.0053", "10.01"]
    assert format_axis_labels((0.523598775598, 1.0), "rad", AngleUnit.DEGREES) == ["30", "57.3"]
    assert format_axis_labels((True, False), "1", AngleUnit.DEGREES) == ["True", "False"]
    assert format_axis_labels(("a", "b"), "1", AngleUnit.DEGREES) == ["a", "b"]


def test_a_drawn_map_shows_distinct_numbers(tmp_path: Path) -> None:
    drawn = tmp_path / "map.svg"
    study_map.draw_map(
        [[10.0051, None], [10.0093, 10.0]], ("λ_q [s]", ["0.5", "0.8"]), ("S", ["1", "2"]), "F [N]", drawn
    )
    for number in ("10.0051", "10.0093"):
        assert number in drawn.read_text()
    study_map.draw_map([[None]], ("x", ["1"]), ("y", ["1"]), "F [N]", drawn)


XY = {"x": (1, 2), "y": (1,)}
ROWS = [
    to_stored_point(StudyPoint(number, "completed", "", True, {"x": x, "y": 1}, {"M_s_q": M_s_q, "rmse_q": math.nan}))
    for number, (x, M_s_q) in enumerate(((1, 1.4), (1, math.inf), (1, 1.2), (2, 1.3)))
]


def test_an_unstable_loop_is_stored_as_text() -> None:
    assert ROWS[1].figures == {"M_s_q": UNSTABLE, "rmse_q": None}


def test_every_statistic_except_the_least_shows_an_unstable_loop() -> None:
    drawn = {pick: build_map(ROWS, XY, "x", "y", "M_s_q", pick) for pick in ("mean", "largest", "least")}
    assert drawn["mean"].cells == drawn["largest"].cells == ((None, 1.3),)
    assert drawn["mean"].unstable == drawn["largest"].unstable == ((True, False),)
    assert (drawn["least"].cells, drawn["least"].unstable) == (((1.2, 1.3),), ((False, False),))


def test_margins_of_an_unstable_loop_rank_as_the_worst() -> None:
    rows = [
        to_stored_point(StudyPoint(number, "completed", "", True, {"x": 1, "y": 1}, {"gain_margin_q": margin}))
        for number, margin in enumerate((3.0, -math.inf, 4.0))
    ]
    assert rows[1].figures == {"gain_margin_q": UNSTABLE}
    drawn = {pick: build_map(rows, XY, "x", "y", "gain_margin_q", pick) for pick in (WORST, "mean", "p5", "largest")}
    for pick in (WORST, "mean", "p5"):
        assert (drawn[pick].cells, drawn[pick].unstable) == (((None, None),), ((True, False),))
    assert drawn["largest"].cells == ((4.0, None),)
    (spread,) = summarize_distributions(rows, [named("gain_margin_q")])
    assert (spread.unstable, spread.least, spread.median, spread.largest, spread.deviation) == (1, None, 3.0, 4.0, None)


def test_a_distribution_counts_unstable_loops() -> None:
    (spread,) = summarize_distributions(ROWS, [named("M_s_q"), named("rmse_q")])
    assert (spread.count, spread.missing, spread.unstable, spread.least, spread.median) == (4, 0, 1, 1.2, 1.35)
    assert (spread.mean, spread.largest, spread.p95, spread.deviation) == (None, None, None, None)
    assert spread.p5 == pytest.approx(1.215)


def test_a_distribution_matches_numpy_and_counts_runs_without_a_value() -> None:
    values = np.random.default_rng(4).normal(8.0, 2.0, 37)
    (spread,) = summarize_distributions(runs_of("rmse_q", *values, None, None), [named("rmse_q")])
    assert (spread.count, spread.missing, spread.unstable) == (37, 2, 0)
    assert spread.deviation == pytest.approx(np.std(values, ddof=1))
    percentiles = (spread.p5, spread.median, spread.p95)
    assert percentiles == pytest.approx(tuple(np.percentile(values, (5.0, 50.0, 95.0))))
    (alone,) = summarize_distributions(runs_of("rmse_q", 2.0), [named("rmse_q")])
    assert (alone.p5, alone.p95, alone.deviation, alone.unstable) == (2.0, 2.0, None, 0)


def ended(*ends: tuple[str, bool | None]) -> list[StudyPoint]:
    values = {"lam_q": 0.8, "lam_S": 0.5}
    return [StudyPoint(number, state, "", passed, values, {}) for number, (state, passed) in enumerate(ends)]


def test_shares_have_a_confidence_interval_and_count_runs_without_a_verdict() -> None:
    runs = ended(*[("completed", True)] * 8, *[("completed", False)] * 7, ("tripped", False), *[("refused", None)] * 2)
    not_completed, failed = compute_shares(runs)
    assert (not_completed.name, not_completed.count, not_completed.of, not_completed.left_out) == (
        "not_completed",
        3,
        18,
        0,
    )
    assert (failed.name, failed.count, failed.of, failed.left_out) == ("criteria_failed", 8, 16, 2)
    for share in (not_completed, failed):
        interval = binomtest(share.count, share.of).proportion_ci(0.95, "wilson")
        assert (share.low, share.high) == pytest.approx((100.0 * interval.low, 100.0 * interval.high))
        assert share.percent == pytest.approx(100.0 * share.count / share.of)
    none, all_of_them = (compute_shares(ended(*[("completed", passed)] * 5))[1] for passed in (True, False))
    assert (none.percent, none.low, all_of_them.percent, all_of_them.high) == (0.0, 0.0, 100.0, 100.0)
    assert none.high == pytest.approx(100.0 * binomtest(0, 5).proportion_ci(0.95, "wilson").high)
    unjudged = compute_shares(ended(("refused", None)))[1]
    assert (unjudged.of, unjudged.left_out, unjudged.percent, unjudged.low, unjudged.high) == (0, 1, None, None, None)


def test_a_map_of_a_share_has_the_interval_of_each_cell() -> None:
    runs = ended(("completed", True), ("lost", None), ("tripped", False))
    drawn = build_map(runs, AXES, "lam_q", "lam_S", "criteria_failed", WORST)
    assert drawn.pick == "share"
    assert [cell for row in drawn.cells for cell in row] == [None, 50.0, None, None]
    assert (drawn.counts[0][1], drawn.runs[0][1]) == (2, 3)
    interval = binomtest(1, 2).proportion_ci(0.95, "wilson")
    assert drawn.intervals[0][1] == pytest.approx((100.0 * interval.low, 100.0 * interval.high))
    assert drawn.intervals[1] == (None, None)


def test_the_colour_range_spans_at_least_a_twentieth_of_the_value() -> None:
    low, high = study_map.colour_range([8.847, 8.856])
    assert high - low == pytest.approx(0.05 * 8.856)
    assert (low + high) / 2.0 == pytest.approx(8.8515)
    assert study_map.colour_range([8.0, 9.0]) == (8.0, 9.0)
    assert study_map.colour_range([-0.01, 0.02]) == (-0.01, 0.02)
    for alike in ([0.0], [3.0, 3.0], []):
        low, high = study_map.colour_range(alike)
        assert high > low


def test_numbers_are_readable_on_any_colour() -> None:
    """The text contrast is at least 4.5 as defined by WCAG 2.1."""
    for share in np.linspace(0.0, 1.0, 101):
        colour = matplotlib.colormaps["viridis"](share)
        ink = 1.0 if study_map.ink_on(colour) == "white" else 0.0
        parts = np.array(colour[:3])
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        lightest, darkest = sorted((float(linear @ (0.2126, 0.7152, 0.0722)), ink), reverse=True)
        assert (lightest + 0.05) / (darkest + 0.05) >= 4.5
