"""Figures of a series: its metrics from run to run, and the curves of all runs on the same axes."""

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from backend.models.run import Figure
from backend.reports.drawing import INK, axis_label, figure, in_unit, thinned, to_svg, upper_legend
from backend.reports.drawn_once import drawn_once
from backend.reports.provenance import shown_unit
from backend.units import Angles, read

_COLUMNS = 3
_ROW_IN = 1.25
_UNITS = {"q": "rad", "S": "N·m/rad"}
_LEGEND = 8
"""Runs that are named beside the curves; of more, first and last."""


def is_partial(item: Figure | None) -> bool:
    """Whether a figure has a value that was not measured whole."""
    return item is not None and item.value is not None and item.reason != ""


@drawn_once
def metric_panels(metrics: Sequence[Sequence[Figure | None]], angles: Angles) -> str:
    """Draw each metric over the places of the runs in their list, from 1 on, one panel each."""
    rows = -(-len(metrics) // _COLUMNS)
    with figure(rows, _COLUMNS, height_in=0.6 + rows * _ROW_IN, gap_in=(0.42, 0.5), squeeze=False) as (drawn, axes):
        for panel, items in zip(axes.flat, metrics, strict=False):
            of = next(item for item in items if item is not None)
            values = [
                np.nan if item is None or item.value is None else read(item.value, of.unit, angles) for item in items
            ]
            places, partial = np.arange(1, len(items) + 1), [is_partial(item) for item in items]
            panel.plot(places, values, color=INK, linewidth=0.6, marker="o", markersize=2.5)
            if any(partial):
                hollow = {"linestyle": "", "marker": "o", "markersize": 2.5, "markerfacecolor": "white"}
                panel.plot(places[partial], np.array(values)[partial], color=INK, **hollow)
            unit = shown_unit(of.unit, angles)
            panel.set_title(_short(of.label) + (f" [{unit}]" if unit else ""), fontsize=6.5)
            panel.xaxis.set_major_locator(MaxNLocator(6, integer=True))
            panel.set_xlim(0.5, len(items) + 0.5)
        for panel in axes.flat[len(metrics) :]:
            panel.set_visible(False)
        for panel in axes.flat[max(len(metrics) - _COLUMNS, 0) : len(metrics)]:  # the lowest of each column
            panel.set_xlabel("place in the list of runs")
        return to_svg(drawn, "metrics")


@drawn_once
def overlay(runs: Sequence[tuple[int, Mapping[str, NDArray[np.float64]]]], angles: Angles) -> str:
    """Draw q and S of all runs over the time since the first sample of each."""
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(runs)))
    with figure(2, height_in=3.6, sharex=True) as (drawn, axes):
        for panel, signal in zip(axes, ("q", "S"), strict=True):
            for place, (number, columns) in enumerate(runs):
                named = len(runs) <= _LEGEND or place in (0, len(runs) - 1)
                _curve(panel, columns, signal, colours[place], f"run {number}" if named else "", angles)
            panel.set_ylabel(axis_label(signal, _UNITS[signal], angles))
        upper_legend(axes[0])
        axes[1].set_xlabel("t [s]")
        axes[1].set_xlim(0.0, max(float(columns["t"][-1]) for _, columns in runs) or 1.0)
        return to_svg(drawn, "curves")


def _curve(
    panel: Axes,
    columns: Mapping[str, NDArray[np.float64]],
    signal: str,
    colour: NDArray[np.float64],
    label: str,
    angles: Angles,
) -> None:
    unit, t = _UNITS[signal], columns["t"]
    panel.plot(*thinned(t, in_unit(columns[signal], unit, angles)), color=colour, linewidth=0.8, label=label or None)
    reference = in_unit(columns[f"{signal}_ref"], unit, angles)
    panel.plot(*thinned(t, reference), color=colour, linewidth=0.5, linestyle=(0, (4, 2)), alpha=0.7)


def _short(label: str) -> str:
    return label if len(label) <= 34 else label[:33] + "…"
