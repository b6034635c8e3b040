"""What somebody reads off the axes of a figure, against where its lines are."""

import re

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FuncFormatter

_WORDS = (FixedFormatter, FuncFormatter)
"""What Matplotlib makes of labels that are named one by one: the second where their places are named as well."""


def as_read(label: str) -> float:
    """What somebody reads off a label."""
    return float(re.sub(r"\$\\mathdefault\{(.*)\}\$", r"\1", label).replace("\N{MINUS SIGN}", "-"))


def assert_labels_are_true(drawn: Figure) -> None:
    """Each label of a linear axis tells its own line: as read, with nothing to be added to it.

    Of an axis whose places were named one by one, as a map's cells, the labels are words.
    """
    drawn.draw_without_rendering()
    for panel in drawn.axes:
        for axis in (panel.xaxis, panel.yaxis):
            if axis.get_scale() == "linear" and not isinstance(axis.get_major_formatter(), _WORDS):
                assert_true(axis)


def assert_true(axis: Axis) -> None:
    assert axis.get_offset_text().get_text() == "", "labels are to be read with something added"
    seen = [tick for tick in axis.get_major_ticks() if tick.label1.get_visible() and tick.label1.get_text()]
    distance = np.diff(np.sort([tick.get_loc() for tick in seen])).min() if len(seen) > 1 else 1.0
    for tick in seen:
        read = as_read(tick.label1.get_text())
        assert abs(read - tick.get_loc()) < 1e-3 * distance, f"{read} stands at {tick.get_loc()}"
