"""Labels of the figures in reports, against where their lines are."""

import re

import numpy as np
import pytest

from backend.reports.drawing import COLOURS, figure
from backend.reports.tracking_figures import tension_panel
from tests.reports.figure_labels import assert_labels_are_true


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 1.0), (6.2, 7.6), (9.9998, 10.0003), (-2.5, 10.0), (1e-4, 9e-4), (0.0, 2e-5), (1234.5, 1234.9), (0, 3e5)],
)
def test_labels_tell_where_their_lines_are(low: float, high: float) -> None:
    with figure(1, height_in=2.0) as (drawn, axes):
        axes.plot(np.linspace(low, high, 50), np.linspace(low, high, 50))
        assert_labels_are_true(drawn)


def test_equal_tensions_stay_two_lines_to_the_eye() -> None:
    t = np.linspace(0.0, 10.0, 200)
    drawing = tension_panel({"t": t, "F_A": 20.0 + t, "F_B": 20.0 + t}, 50.0, "tension")
    broad, narrow = (width_of_line(drawing, COLOURS[name]) for name in ("F_A", "F_B"))
    assert broad > 2.0 * narrow
    assert drawing.index(COLOURS["F_A"].lower()) < drawing.index(COLOURS["F_B"].lower())  # the narrow one on top


def width_of_line(drawing: str, colour: str) -> float:
    styles = re.findall(r'style="(fill: none; stroke: [^"]*)"', drawing)
    style = next(style for style in styles if colour.lower() in style)
    found = re.search(r"stroke-width: ([0-9.]+)", style)
    return float(found[1]) if found else 1.0  # the style's own width, which is not said again
