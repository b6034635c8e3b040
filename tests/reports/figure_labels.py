"""Checks that the axis labels of a figure match the positions of its lines."""

import re

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FuncFormatter
from matplotlib.transforms import Bbox, BboxBase

_WORDS = (FixedFormatter, FuncFormatter)
"""What Matplotlib makes of labels that are named one by one: the second where their places are named as well."""


def read_label(label: str) -> float:
    """Return the value that a label shows."""
    return float(re.sub(r"\$\\mathdefault\{(.*)\}\$", r"\1", label).replace("\N{MINUS SIGN}", "-"))


def assert_figure_is_readable(drawn: Figure) -> None:
    """Draw a figure once and apply all checks of this module."""
    drawn.draw_without_rendering()
    assert_labels_match_positions(drawn)
    assert_texts_are_legible(drawn)


def assert_labels_match_positions(drawn: Figure) -> None:
    """Check that each label of a linear axis shows the position of its line, without an offset.

    An axis with named positions, like the cells of a map, has texts as labels. The figure must be drawn.
    """
    for panel in drawn.axes:
        for axis in (panel.xaxis, panel.yaxis):
            if axis.get_scale() == "linear" and not isinstance(axis.get_major_formatter(), _WORDS):
                assert_axis_labels_match(axis)


def assert_axis_labels_match(axis: Axis) -> None:
    assert axis.get_offset_text().get_text() == "", "labels are to be read with something added"
    seen = [tick for tick in axis.get_major_ticks() if tick.label1.get_visible() and tick.label1.get_text()]
    distance = np.diff(np.sort([tick.get_loc() for tick in seen])).min() if len(seen) > 1 else 1.0
    for tick in seen:
        read = read_label(tick.label1.get_text())
        assert abs(read - tick.get_loc()) < 1e-3 * distance, f"{read} stands at {tick.get_loc()}"


_A_PIXEL = 1.0


def assert_texts_are_legible(drawn: Figure) -> None:
    """Check that no text of a drawn figure leaves it, overlaps another panel or the numbers of its axis."""
    panels = [panel for panel in drawn.axes if panel.get_visible()]
    for panel in panels:
        others = [other.get_window_extent() for other in panels if other is not panel]
        numbers = [box for axis in (panel.xaxis, panel.yaxis) for box in _numbers(axis)]
        for what, box in _words(panel):
            assert _within(box, drawn.bbox), f"{what} leaves the figure"
            assert not any(_overlap(box, other) for other in others), f"{what} lies on another panel"
            assert not any(_overlap(box, number) for number in numbers), f"{what} lies on a number of its axis"
        for note in (text for text in panel.texts if text.get_text()):
            box, frame = note.get_window_extent(), panel.get_window_extent()
            assert _within(box, frame) or not _overlap(box, frame), f"{note.get_text()!r} lies on the edge of its panel"


def _words(panel: Axes) -> list[tuple[str, Bbox]]:
    named = [(panel.xaxis.label, "xlabel"), (panel.yaxis.label, "ylabel"), (panel.title, "title")]
    words = [(f"{what} {text.get_text()!r}", text.get_window_extent()) for text, what in named if text.get_text()]
    legend = panel.get_legend()
    if legend is not None:
        entries = ", ".join(text.get_text() for text in legend.get_texts())
        words.append((f"legend {entries}", legend.get_window_extent()))
    return words


def _numbers(axis: Axis) -> list[Bbox]:
    labels = [tick.label1 for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())]
    return [label.get_window_extent() for label in labels if label.get_visible() and label.get_text()]


def _within(box: Bbox, outer: BboxBase) -> bool:
    return bool(
        box.x0 >= outer.x0 - _A_PIXEL
        and box.y0 >= outer.y0 - _A_PIXEL
        and box.x1 <= outer.x1 + _A_PIXEL
        and box.y1 <= outer.y1 + _A_PIXEL
    )


def _overlap(one: Bbox, other: Bbox) -> bool:
    return bool(
        min(one.x1, other.x1) - max(one.x0, other.x0) > _A_PIXEL
        and min(one.y1, other.y1) - max(one.y0, other.y0) > _A_PIXEL
    )
