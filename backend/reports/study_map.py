"""A map of a study as a picture: a figure over two axes, with numbers in cells."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backend.reports.plotting import figure
from backend.units import count_range_digits, format_number

_MAX_LABELS = 12
"""Maximum number of cells along an axis with a number written into each."""

_LEAST_RANGE = 0.05
"""Minimum range of the colours as a share of the largest magnitude, so that similar values look similar."""


def draw_map(
    cells: Sequence[Sequence[float | None]],
    x: tuple[str, Sequence[str]],
    y: tuple[str, Sequence[str]],
    label: str,
    file: Path,
    notes: Sequence[Sequence[str]] = (),
) -> None:
    """Write a picture of ``cells`` [y][x].

    ``x`` and ``y`` have the name of an axis and its values. ``notes`` [y][x] are written below the numbers, if there is
    room for these. The suffix of ``file`` is the format: png, svg or pdf. Raises OSError, and ValueError for another
    suffix.
    """
    table = np.array([[np.nan if value is None else value for value in row] for row in cells], np.float64)
    with figure(1, height_in=4.2) as (drawn, axes):
        axes.grid(visible=False)  # its lines would cross the numbers
        low, high = colour_range(table[np.isfinite(table)].tolist())
        image = axes.imshow(table, origin="lower", aspect="auto", cmap="viridis", vmin=low, vmax=high)
        for axis, (name, values) in ((axes.xaxis, x), (axes.yaxis, y)):
            axis.set_label_text(name)
            step = max(1, len(values) // _MAX_LABELS)
            axis.set_ticks(range(0, len(values), step), values[::step])
        if max(table.shape) <= _MAX_LABELS:
            digits = count_range_digits(table[np.isfinite(table)].tolist(), 3)
            for (row, column), value in np.ndenumerate(table):
                note = notes[row][column] if notes else ""
                below = f"\n{note}" if note else ""
                if np.isfinite(value):
                    ink, words = ink_on(image.cmap(image.norm(value))), format_number(value, digits)
                elif note:
                    ink, words = "black", "–"
                else:
                    continue
                axes.text(column, row, words + below, ha="center", va="center", fontsize=7, color=ink)
        drawn.colorbar(image, ax=axes, label=label)
        drawn.savefig(file)


def colour_range(values: Sequence[float]) -> tuple[float, float]:
    """Return the values at the ends of the colour range: minimum and maximum.

    The range is widened to at least ``_LEAST_RANGE`` of the largest magnitude.
    """
    low, high = min(values, default=0.0), max(values, default=1.0)
    wide = _LEAST_RANGE * max(abs(low), abs(high))
    if high - low >= wide and high > low:
        return low, high
    middle, half = 0.5 * (low + high), 0.5 * wide or 0.5
    return middle - half, middle + half


def ink_on(colour: Sequence[float]) -> str:
    """Return black or white, whichever has more contrast on ``colour``.

    ``colour`` is red, green and blue from 0 to 1; the contrast is that of WCAG 2.1.
    """
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in colour[:3]]
    luminance = float(np.dot((0.2126, 0.7152, 0.0722), linear))
    return "black" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "white"
