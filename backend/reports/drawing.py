"""How all figures of the reports look, and how they become SVG: same input, same bytes."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLOURS = {
    "q": "#0072B2",
    "S": "#E69F00",
    "F_A": "#009E73",
    "F_B": "#CC79A7",
    "u_A": "#56B4E9",
    "u_B": "#D55E00",
}
"""Hue of each signal (Okabe-Ito), the same everywhere; a reference is its signal's hue, dashed."""

LIMIT_GREY = "#8c8c8c"
INK = "#222222"
WIDTH_IN = 6.7
"""Width of the text block of an A4 page [inch]."""

_STYLE = Path(__file__).with_name("report.mplstyle")
_BUCKETS = 900


@contextmanager
def figure(rows: int, columns: int = 1, *, height_in: float, **layout: Any) -> Iterator[tuple[Figure, Any]]:
    """Give a figure of the text's width with its axes, in the style of the reports."""
    with matplotlib.rc_context(fname=_STYLE):
        drawn = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
        yield drawn, drawn.subplots(rows, columns, **layout)


def to_svg(drawn: Figure, name: str) -> str:
    """Return the figure as an SVG element whose ids begin with ``name``, so that several fit on one page."""
    buffer = io.StringIO()
    with matplotlib.rc_context(fname=_STYLE):
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", svg)
    return svg.strip()


def thinned(t: Array, y: Array) -> tuple[Array, Array]:
    """Thin (N,) samples to what a page can show, keeping each stretch's smallest and largest sample."""
    if t.size <= 2 * _BUCKETS:
        return t, y
    edges = np.linspace(0, t.size, _BUCKETS + 1).astype(np.intp)
    kept: list[int] = [0]
    for start, stop in pairwise(edges):
        stretch = y[start:stop]
        kept += sorted({start + int(np.argmin(stretch)), start + int(np.argmax(stretch))})
    kept.append(t.size - 1)
    return t[kept], y[kept]


def panel_letter(axes: Axes, letter: str) -> None:
    """Put the panel's letter above its upper left corner."""
    axes.set_title(letter, loc="left", fontweight="bold", pad=3)


def limit_line(axes: Axes, value: float, label: str) -> None:
    """Draw a bound in grey, named at its left end."""
    axes.axhline(value, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
    axes.annotate(
        label,
        (0.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(3, -1.5),
        textcoords="offset points",
        ha="left",
        va="top",
        fontsize=6.5,
        color=LIMIT_GREY,
    )
