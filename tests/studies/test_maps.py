"""What a cell of a map shows, and what stands at its axes; what is told of runs with an unstable loop."""

import math
from dataclasses import fields
from pathlib import Path

import pytest

from backend.experiments.results.measures import FIGURES
from backend.experiments.settings import SettingError
from backend.reading import Angles
from backend.reports import study_map
from backend.storage.studies import StoredPoint
from backend.studies.maps import LEAST_IS_WORST, NEITHER_IS_WORST, PICKS, WORST, axis_labels, map_of, spreadings
from backend.studies.point import UNSTABLE, PointResult
from backend.studies.runner import as_stored

AXES = {"lam_q": (0.5, 0.8), "lam_S": (0.5, 0.7)}


def runs_of(figure: str, *values: float | None) -> list[StoredPoint]:
    """Return runs on plants that differ, all of them in one cell."""
    return [
        StoredPoint(number, "completed", "", None, {"lam_q": 0.8, "lam_S": 0.5}, {figure: value})
        for number, value in enumerate(values)
    ]


@pytest.mark.parametrize(
    ("figure", "pick", "shown", "value"),
    [
        ("min_tension_N", WORST, "least", 2.0),
        ("bandwidth_q_Hz", WORST, "least", 2.0),
        ("overshoot_q_percent", WORST, "largest", 9.0),
        ("M_s_q", WORST, "largest", 9.0),
        ("stiffness_felt", WORST, "mean", 5.0),
        ("min_tension_N", "mean", "mean", 5.0),
        ("min_tension_N", "largest", "largest", 9.0),
    ],
)
def test_a_cell_shows_the_worst_run_unless_another_is_picked(figure: str, pick: str, shown: str, value: float) -> None:
    drawn = map_of(runs_of(figure, 4.0, 9.0, None, 2.0), AXES, "lam_q", "lam_S", figure, pick)
    assert (drawn.pick, drawn.cells) == (shown, ((None, value), (None, None)))


def test_what_is_no_pick_is_refused() -> None:
    with pytest.raises(SettingError, match="choose one of worst, mean, least, largest"):
        map_of([], AXES, "lam_q", "lam_S", "M_s_q", "median")


def test_figures_whose_worst_is_not_the_largest_are_there() -> None:
    known = {item.name for figures in FIGURES.values() for item in fields(figures) if item.metadata}
    assert {*LEAST_IS_WORST, *NEITHER_IS_WORST} <= known
    assert not set(LEAST_IS_WORST) & set(NEITHER_IS_WORST)
    assert WORST not in PICKS


def test_neighbours_at_an_axis_read_differently() -> None:
    assert axis_labels((0.5, 0.8), "s", Angles.DEGREES) == ["0.5", "0.8"]
    assert axis_labels((10.0051, 10.0053, 10.01), "N", Angles.DEGREES) == ["10.0051", "10.0053", "10.01"]
    assert axis_labels((0.523598775598, 1.0), "rad", Angles.DEGREES) == ["30", "57.3"]
    assert axis_labels((True, False), "1", Angles.DEGREES) == ["True", "False"]
    assert axis_labels(("a", "b"), "1", Angles.DEGREES) == ["a", "b"]


def test_a_picture_tells_its_numbers_apart(tmp_path: Path) -> None:
    drawn = tmp_path / "map.svg"
    study_map.draw_map(
        [[10.0051, None], [10.0093, 10.0]], ("λ_q [s]", ["0.5", "0.8"]), ("S", ["1", "2"]), "F [N]", drawn
    )
    for number in ("10.0051", "10.0093"):
        assert number in drawn.read_text()
    study_map.draw_map([[None]], ("x", ["1"]), ("y", ["1"]), "F [N]", drawn)


XY = {"x": (1, 2), "y": (1,)}
ROWS = [
    as_stored(PointResult(number, "completed", "", True, {"x": x, "y": 1}, {"M_s_q": M_s_q, "rmse_q": math.nan}))
    for number, (x, M_s_q) in enumerate(((1, 1.4), (1, math.inf), (1, 1.2), (2, 1.3)))
]


def test_an_unstable_loop_is_kept_by_its_word() -> None:
    assert ROWS[1].figures == {"M_s_q": UNSTABLE, "rmse_q": None}


def test_no_cell_hides_an_unstable_loop_but_that_of_the_least() -> None:
    drawn = {pick: map_of(ROWS, XY, "x", "y", "M_s_q", pick) for pick in ("mean", "largest", "least")}
    assert drawn["mean"].cells == drawn["largest"].cells == ((None, 1.3),)
    assert drawn["mean"].unstable == drawn["largest"].unstable == ((True, False),)
    assert (drawn["least"].cells, drawn["least"].unstable) == (((1.2, 1.3),), ((False, False),))


def test_a_spread_tells_how_many_loops_are_unstable() -> None:
    (spread,) = spreadings(ROWS, ["M_s_q", "rmse_q"])
    assert (spread.count, spread.unstable, spread.least, spread.median) == (4, 1, 1.2, 1.35)
    assert (spread.mean, spread.largest) == (None, None)
