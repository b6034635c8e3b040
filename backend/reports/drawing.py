"""How all figures of the reports look, and how they become SVG: same input, same bytes."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from backend.units import Angles, reading_of

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
_FEW_NAMED = 5
_SMALL, _NOTHING = 0.02, 1e-9
_PREFIXES = ("", "m", "µ", "n")


@contextmanager
def figure(
    rows: int, columns: int = 1, *, height_in: float, gap_in: tuple[float, float] = (0.24, 0.6), **layout: Any
) -> Iterator[tuple[Figure, Any]]:
    """Give a figure of the text's width with its axes, in the style of the reports.

    Margins and the gaps below and beside panels [inch] are fixed: measuring every label takes as long as drawing it.
    """
    left, right, top, bottom = 0.58, 0.06, 0.22, 0.38
    height = (height_in - top - bottom - (rows - 1) * gap_in[0]) / rows
    width = (WIDTH_IN - left - right - (columns - 1) * gap_in[1]) / columns
    placing = {
        "left": left / WIDTH_IN,
        "right": 1.0 - right / WIDTH_IN,
        "top": 1.0 - top / height_in,
        "bottom": bottom / height_in,
        "hspace": gap_in[0] / height,
        "wspace": gap_in[1] / width,
    }
    with matplotlib.rc_context(fname=_STYLE):
        drawn = Figure(figsize=(WIDTH_IN, height_in))
        axes = drawn.subplots(rows, columns, gridspec_kw=placing, **layout)
        for panel in drawn.axes:
            beside = panel.transAxes + ScaledTranslation(-0.46, 0.0, drawn.dpi_scale_trans)
            panel.yaxis.set_label_coords(0.0, 0.5, transform=beside)
        yield drawn, axes


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
    widest = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(widest), edges[1:, None] - 1)  # a stretch's last once more
    stretches, bare = y[places], np.isnan(y[places])
    lowest = np.where(bare, np.inf, stretches).argmin(axis=1)
    highest = np.where(bare, -np.inf, stretches).argmax(axis=1)
    both = np.sort(edges[:-1, None] + np.stack([lowest, highest], axis=1), axis=1)
    one = np.stack([both[:, 0] != both[:, 1], np.full(_BUCKETS, True)], axis=1)
    kept = np.concatenate([[0], both[one], [t.size - 1]])
    return t[kept], y[kept]


def panel_letter(axes: Axes, letter: str) -> None:
    """Put the panel's letter above its upper left corner."""
    axes.set_title(letter, loc="left", fontweight="bold", pad=3)


def upper_legend(axes: Axes) -> None:
    """Put the legend, where there is one, in one line above the upper right corner, clear of all curves."""
    named = len(axes.get_legend_handles_labels()[1])
    if named == 0:
        return
    apart, handle = (1.2, 1.8) if named <= _FEW_NAMED else (0.8, 0.9)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=named,
        borderaxespad=0.1,
        columnspacing=apart,
        handlelength=handle,
    )


def limit_line(axes: Axes, value: float, label: str, *, above: bool = False) -> None:
    """Draw a bound in grey, named at its left end, below it or ``above``."""
    axes.axhline(value, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
    axes.annotate(
        label,
        (0.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(3, 1.5 if above else -1.5),
        textcoords="offset points",
        ha="left",
        va="bottom" if above else "top",
        fontsize=6.5,
        color=LIMIT_GREY,
    )


def draw_error(axes: Axes, t: Array, error: Array, label: str, unit: str, *, colour: str, reach: float) -> None:
    """Draw an error over time on a scale from −``reach`` to ``reach``; small ones in m, µ or n of the unit.

    A small number in whole units would have no room beside its axis.
    """
    power = 0
    while _NOTHING < reach * 10.0**power < _SMALL:
        power += 3
    axes.plot(*thinned(t, error * 10.0**power), color=colour, linewidth=0.8)
    axes.axhline(0.0, color=LIMIT_GREY, linewidth=0.6)
    largest = reach * 10.0**power if reach > _NOTHING else 1.0
    axes.set_ylim(-1.15 * largest, 1.15 * largest)
    axes.set_ylabel(f"{label} [{_PREFIXES[power // 3]}{unit}]")


def frequency_axis(axes: Axes) -> None:
    """Write frequencies [Hz] at an axis as they are spoken of, at 1, 2 and 5 of each decade."""
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda f, _place: f"{f:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def in_unit(values: NDArray[np.float64], unit: str, angles: Angles) -> NDArray[np.float64]:
    """Return values in SI as they are read."""
    return values * reading_of(unit, angles).factor


def axis_label(symbol: str, unit: str, angles: Angles) -> str:
    """Return what stands beside an axis: the symbol and the unit in which it is read."""
    return f"{symbol} [{reading_of(unit, angles).unit}]"
