"""Figures of a tracking run: the six panels of the paper's figure 7, tensions, and all steps on one scale."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from backend.documents.result import StepFigures
from backend.reading import Angles
from backend.reports.drawing import (
    COLOURS,
    INK,
    LIMIT_GREY,
    TENSION_WIDTHS,
    axis_label,
    figure,
    in_unit,
    limit_line,
    panel_letter,
    thinned,
    to_svg,
    upper_legend,
)
from backend.reports.drawn_once import drawn_once

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

_UNITS = {"q": "rad", "S": "N·m/rad"}
_LABELS = {"F": "Tension [N]", "u": "Voltage [V]"}
_NAMES = {"q": "$q$", "S": "$S$", "F_A": "$F_A$", "F_B": "$F_B$", "u_A": "$u_A$", "u_B": "$u_B$"}


@drawn_once
def tracking_panels(
    columns: Columns,
    start_s: float,
    end_s: float,
    letters: str,
    name: str,
    u_max: float,
    angles: Angles,
    papers_law: Columns | None = None,
) -> str:
    """Draw q, S and the motor voltages between two times, one below the other (figure 7, A-C or D-F).

    ``papers_law``: t, q and S as the paper's law would have them, drawn behind.
    """
    part = _between(columns, start_s, end_s)
    theirs = _between(papers_law, start_s, end_s) if papers_law else None
    with figure(3, height_in=4.25, sharex=True, height_ratios=(3, 3, 2)) as (drawn, axes):
        for row, signal in zip(axes[:2], ("q", "S"), strict=True):
            if theirs is not None:
                line = thinned(theirs["t"], in_unit(theirs[signal], _UNITS[signal], angles))
                row.plot(*line, color=LIMIT_GREY, linewidth=0.9, label="paper's law, simulated")
            _tracked(row, part, signal, angles)
        _voltages(axes[2], part, u_max)
        for row, letter in zip(axes, letters, strict=True):
            panel_letter(row, letter)
        axes[2].set_xlabel("t [s]")
        axes[2].set_xlim(start_s, end_s)
        return to_svg(drawn, name)


@drawn_once
def tension_panel(columns: Columns, F_max: float, name: str) -> str:
    """Draw both tendon tensions over the whole run, between slack and the bound of the safety module."""
    with figure(1, height_in=1.9) as (drawn, axes):
        for signal, width in TENSION_WIDTHS.items():
            line = thinned(columns["t"], columns[signal])
            axes.plot(*line, color=COLOURS[signal], linewidth=width, label=_NAMES[signal])
        limit_line(axes, F_max, f"trip at {F_max:g} N")
        axes.axhline(0.0, color=LIMIT_GREY, linewidth=0.7)
        axes.set(xlabel="t [s]", ylabel=_LABELS["F"], xlim=(columns["t"][0], columns["t"][-1]))
        upper_legend(axes)
        return to_svg(drawn, name)


@drawn_once
def step_panels(columns: Columns, steps: Sequence[StepFigures], lam: Mapping[str, float | None], name: str) -> str:
    """Draw all steps of q and of S on one scale, from 0 to 1, over the response that λ was chosen for."""
    with figure(1, 2, height_in=2.2, gap_in=(0.0, 0.2), sharey=True) as (drawn, axes):
        for panel, signal, letter in zip(axes, ("q", "S"), "AB", strict=True):
            longest = 0.0
            for step in (item for item in steps if item.signal == signal):
                part = _between(columns, step.start_s, step.end_s)
                if part["t"].size == 0:
                    continue
                t = part["t"] - step.start_s
                y = (part[signal] - step.before) / (step.after - step.before)
                panel.plot(*thinned(t, y), color=COLOURS[signal], linewidth=0.8, alpha=0.75)
                longest = max(longest, float(t[-1]))
            _design(panel, lam[signal], longest)
            panel.set(xlabel="time since the step [s]", xlim=(0.0, longest or 1.0))
            panel.set_title(f"steps of {_NAMES[signal]}", fontsize=7.5)
            panel_letter(panel, letter)
        axes[0].set_ylabel("share of the step")
        return to_svg(drawn, name)


def _tracked(axes: Axes, part: Columns, signal: str, angles: Angles) -> None:
    t, colour, unit = part["t"], COLOURS[signal], _UNITS[signal]
    axes.plot(*thinned(t, in_unit(part[signal], unit, angles)), color=colour, label=_NAMES[signal])
    axes.plot(
        *thinned(t, in_unit(part[f"{signal}_ref"], unit, angles)),
        color=colour,
        linewidth=0.8,
        linestyle=(0, (4, 2)),
        alpha=0.8,
        drawstyle="steps-post",
        label=f"{_NAMES[signal][:-1]}_{{ref}}$",
    )
    axes.set_ylabel(axis_label(signal, unit, angles))
    axes.margins(y=0.08)
    upper_legend(axes)


def _voltages(axes: Axes, part: Columns, u_max: float) -> None:
    for signal in ("u_A", "u_B"):
        axes.plot(*thinned(part["t"], part[signal]), color=COLOURS[signal], linewidth=0.8, label=_NAMES[signal])
    limit_line(axes, u_max, f"±{u_max:g} V")
    axes.axhline(-u_max, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
    axes.set(ylabel=_LABELS["u"], ylim=(-1.25 * u_max, 1.25 * u_max))
    upper_legend(axes)


def _design(axes: Axes, lam: float | None, longest: float) -> None:
    """Draw 1/(λ s + 1)², unless λ changed during the run."""
    if lam is None or longest == 0.0:
        return
    t = np.linspace(0.0, longest, 400)
    y = 1.0 - (1.0 + t / lam) * np.exp(-t / lam)
    axes.plot(
        t, y, color=INK, linewidth=0.8, linestyle=(0, (4, 2)), label=rf"$1/(\lambda s+1)^2$, $\lambda$ = {lam:g} s"
    )
    axes.legend(loc="lower right")


def _between(columns: Columns, start_s: float, end_s: float) -> dict[str, Array]:
    t = columns["t"]
    inside = slice(*np.searchsorted(t, [start_s - 1e-9, end_s - 1e-9]))
    return {name: column[inside] for name, column in columns.items()}
