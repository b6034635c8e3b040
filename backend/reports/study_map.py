"""A map of a study as a picture: one figure over two axes, each cell with its number where there is room."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backend.reports.plotting import figure
from backend.units import count_range_digits, format_number

_MAX_LABELS = 12
"""Cells along an axis up to which each has its number written into it."""

_LEAST_RANGE = 0.05
"""The colours range over this share of the largest magnitude at least: what is alike looks alike."""


def draw_map(
    cells: Sequence[Sequence[float | None]],
    x: tuple[str, Sequence[str]],
    y: tuple[str, Sequence[str]],
    label: str,
    file: Path,
    notes: Sequence[Sequence[str]] = (),
) -> None:
    """Write a picture of ``cells``, by place of y, then of x; ``x`` and ``y`` are an axis and its values in words.

    ``notes`` by the same places are written below the numbers, where there is room for these. The ending of ``file``
    says its form: png, svg or pdf. Raises OSError, ValueError for another ending.
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
    """Return the numbers at the ends of the colours: least and largest, and further apart where these are alike."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    wide = _LEAST_RANGE * max(abs(low), abs(high))
    if high - low >= wide and high > low:
        return low, high
    middle, half = 0.5 * (low + high), 0.5 * wide or 0.5
    return middle - half, middle + half


def ink_on(colour: Sequence[float]) -> str:
    """Return black or white, whichever is read better on a ``colour`` (red, green, blue from 0 to 1; WCAG 2.1)."""
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in colour[:3]]
    luminance = float(np.dot((0.2126, 0.7152, 0.0722), linear))
    return "black" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "white"
