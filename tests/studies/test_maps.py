"""What a map and the spread of a figure show of runs with an unstable loop."""

import math

from backend.studies.maps import map_of, spreadings
from backend.studies.point import UNSTABLE, PointResult
from backend.studies.runner import as_stored

AXES = {"x": (1, 2), "y": (1,)}
ROWS = [
    as_stored(PointResult(number, "completed", "", True, {"x": x, "y": 1}, {"M_s_q": M_s_q, "rmse_q": math.nan}))
    for number, (x, M_s_q) in enumerate(((1, 1.4), (1, math.inf), (1, 1.2), (2, 1.3)))
]


def test_an_unstable_loop_is_kept_by_its_word() -> None:
    assert ROWS[1].figures == {"M_s_q": UNSTABLE, "rmse_q": None}


def test_no_cell_hides_an_unstable_loop_but_that_of_the_least() -> None:
    drawn = {pick: map_of(ROWS, AXES, "x", "y", "M_s_q", pick) for pick in ("mean", "largest", "least")}
    assert drawn["mean"].cells == drawn["largest"].cells == ((None, 1.3),)
    assert drawn["mean"].unstable == drawn["largest"].unstable == ((True, False),)
    assert (drawn["least"].cells, drawn["least"].unstable) == (((1.2, 1.3),), ((False, False),))


def test_a_spread_tells_how_many_loops_are_unstable() -> None:
    (spread,) = spreadings(ROWS, ["M_s_q", "rmse_q"])
    assert (spread.count, spread.unstable, spread.least, spread.median) == (4, 1, 1.2, 1.35)
    assert (spread.mean, spread.largest) == (None, None)
