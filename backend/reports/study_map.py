"""A map of a study as a picture: one figure over two axes, each cell with its number where there is room."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backend.reading import digits_over, in_digits
from backend.reports.drawing import figure

_ROOM = 12
"""Cells along an axis up to which each has its number written into it."""


def draw_map(
    cells: Sequence[Sequence[float | None]],
    x: tuple[str, Sequence[str]],
    y: tuple[str, Sequence[str]],
    label: str,
    file: Path,
) -> None:
    """Write a picture of ``cells``, by place of y, then of x; ``x`` and ``y`` are an axis and its values in words.

    The ending of ``file`` says its form: png, svg or pdf. Raises OSError, ValueError for another ending.
    """
    table = np.array([[np.nan if value is None else value for value in row] for row in cells], np.float64)
    with figure(1, height_in=4.2) as (drawn, axes):
        image = axes.imshow(table, origin="lower", aspect="auto", cmap="viridis")
        for axis, (name, values) in ((axes.xaxis, x), (axes.yaxis, y)):
            axis.set_label_text(name)
            step = max(1, len(values) // _ROOM)
            axis.set_ticks(range(0, len(values), step), values[::step])
        if max(table.shape) <= _ROOM:
            digits = digits_over(table[np.isfinite(table)].tolist(), 3)
            for (row, column), value in np.ndenumerate(table):
                if np.isfinite(value):
                    axes.text(
                        column, row, in_digits(value, digits), ha="center", va="center", fontsize=7, color="white"
                    )
        drawn.colorbar(image, ax=axes, label=label)
        drawn.savefig(file)
