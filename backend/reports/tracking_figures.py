"""Figures of a tracking run: the six panels of the paper's figure 7, tensions, and all steps on one scale."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from backend.analysis.step_metrics import AT_REST, SETTLING_BAND
from backend.models.run import StepFigures
from backend.reports.drawing import (
    COLOURS,
    INK,
    LIMIT_GREY,
    axis_label,
    draw_error,
    figure,
    in_unit,
    limit_line,
    panel_letter,
    thinned,
    to_svg,
    upper_legend,
)
from backend.reports.drawn_once import drawn_once
from backend.units import Angles, reading_of

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

WHAT_IS_DRAWN = (
    "(A) joint position and (B) its error q − q_ref, (C) stiffness and (D) its error S − S_ref, (E, F) voltages"
)
CUT_OFF = (
    "Errors are drawn on the scale of what is left of them once a step has come within 2 % of its end; beyond the "
    "panel the signal is on its way."
)
TENSIONS = "Tendon tensions as the load cells show them: (A) of tendon A, (B) of tendon B."

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
    """Draw q, q − q_ref, S, S − S_ref, u_A and u_B between two times, one below the other (q, S, u: figure 7).

    ``papers_law``: t, q and S as the paper's law would have them, drawn behind.
    """
    part = _between(columns, start_s, end_s)
    theirs = _between(papers_law, start_s, end_s) if papers_law else None
    with figure(6, height_in=6.3, sharex=True, height_ratios=(5, 3, 5, 3, 3, 3)) as (drawn, axes):
        for (row, error), signal in zip((axes[:2], axes[2:4]), ("q", "S"), strict=True):
            if theirs is not None:
                line = thinned(theirs["t"], in_unit(theirs[signal], _UNITS[signal], angles))
                row.plot(*line, color=LIMIT_GREY, linewidth=0.9, label="paper's law, simulated")
            _tracked(row, part, signal, angles)
            _error(error, part, signal, angles)
        for panel, signal in zip(axes[4:], ("u_A", "u_B"), strict=True):
            _voltage(panel, part, signal, u_max)
        for row, letter in zip(axes, letters, strict=True):
            panel_letter(row, letter)
        axes[-1].set_xlabel("t [s]")
        axes[-1].set_xlim(start_s, end_s)
        return to_svg(drawn, name)


@drawn_once
def tension_panel(columns: Columns, F_max: float, name: str) -> str:
    """Draw both tendon tensions over the whole run, one below the other, between slack and the bound of the module."""
    with figure(2, height_in=2.7, sharex=True, sharey=True) as (drawn, axes):
        for panel, signal, letter in zip(axes, ("F_A", "F_B"), "AB", strict=True):
            panel.plot(*thinned(columns["t"], columns[signal]), color=COLOURS[signal], label=_NAMES[signal])
            limit_line(panel, F_max, f"trip at {F_max:g} N")
            panel.axhline(0.0, color=LIMIT_GREY, linewidth=0.7)
            panel.set_ylabel(_LABELS["F"])
            upper_legend(panel)
            panel_letter(panel, letter)
        axes[1].set(xlabel="t [s]", xlim=(columns["t"][0], columns["t"][-1]))
        return to_svg(drawn, name)


@drawn_once
def step_panels(columns: Columns, steps: Sequence[StepFigures], lam: Mapping[str, float | None], name: str) -> str:
    """Draw all steps of q and of S on one scale, from 0 to 1, over the response that λ was chosen for.

    Below them what is left of each step, on the scale of the band in which it counts as settled.
    """
    with figure(2, 2, height_in=3.6, gap_in=(0.3, 0.2), sharex="col", sharey="row") as (drawn, axes):
        for column, signal in enumerate(("q", "S")):
            panel, left = axes[0][column], axes[1][column]
            longest = 0.0
            for step in (item for item in steps if item.signal == signal):
                part = _between(columns, step.start_s, step.end_s)
                if part["t"].size == 0:
                    continue
                t = part["t"] - step.start_s
                y = (part[signal] - step.before) / (step.after - step.before)
                panel.plot(*thinned(t, y), color=COLOURS[signal], linewidth=0.8, alpha=0.75)
                left.plot(*thinned(t, 100.0 * (y - 1.0)), color=COLOURS[signal], linewidth=0.8, alpha=0.75)
                longest = max(longest, float(t[-1]))
            _design(panel, left, lam[signal], longest)
            for bound in (-100.0 * SETTLING_BAND, 100.0 * SETTLING_BAND):
                left.axhline(bound, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
            left.set(xlabel="time since the step [s]", xlim=(0.0, longest or 1.0), ylim=(-5.0, 5.0))
            panel.set_title(f"steps of {_NAMES[signal]}", fontsize=7.5)
            panel_letter(panel, "AB"[column])
            panel_letter(left, "CD"[column])
        axes[0][0].set_ylabel("share of the step")
        axes[1][0].set_ylabel("off its end [%]")
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


def _error(axes: Axes, part: Columns, signal: str, angles: Angles) -> None:
    """Draw a signal minus its reference; beyond the panel it is on its way to another reference."""
    apart = part[signal] - part[f"{signal}_ref"]
    reading = reading_of(_UNITS[signal], angles)
    reach = reading.factor * largest_error(signal, apart, part[f"{signal}_ref"])
    scaled = apart * reading.factor
    draw_error(axes, part["t"], scaled, f"$e_{signal}$", reading.unit, colour=COLOURS[signal], reach=reach)


def largest_error(signal: str, error: Array, reference: Array) -> float:
    """Return the largest |error| (N,) where the signal is not on its way to a reference that has stepped.

    It is on its way from a step of the reference, or from the first sample, until its error is for the first time below
    2 % of the step or of what it rests within. Without a step all of it counts. 0 where nothing is left.
    """
    jumps = np.abs(np.diff(reference))
    finite = reference[np.isfinite(reference)]
    steps: list[int] = (np.flatnonzero(jumps > 0.02 * np.ptp(finite)) + 1).tolist() if finite.size else []
    sizes = [abs(reference[step] - reference[step - 1]) for step in steps]
    if error.size and abs(error[0]) > 0.0:  # it begins on the way to its first reference
        steps, sizes = [0, *steps], [abs(error[0]), *sizes]
    known = np.isfinite(error)
    for start, end, size in zip(steps, [*steps, error.size][1:], sizes, strict=True):
        there = np.flatnonzero(np.abs(error[start:end]) <= max(0.02 * size, AT_REST[signal]))
        known[start : start + there[0] if there.size else end] = False
    return float(np.abs(error[known]).max()) if known.any() else 0.0


def _voltage(axes: Axes, part: Columns, signal: str, u_max: float) -> None:
    axes.plot(*thinned(part["t"], part[signal]), color=COLOURS[signal], linewidth=0.8, label=_NAMES[signal])
    limit_line(axes, u_max, f"±{u_max:g} V")
    axes.axhline(-u_max, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
    axes.set(ylabel=_LABELS["u"], ylim=(-1.25 * u_max, 1.25 * u_max))
    upper_legend(axes)


def _design(axes: Axes, left: Axes, lam: float | None, longest: float) -> None:
    """Draw 1/(λ s + 1)², unless λ changed during the run, and what is left of it."""
    if lam is None or longest == 0.0:
        return
    t = np.linspace(0.0, longest, 400)
    y = 1.0 - (1.0 + t / lam) * np.exp(-t / lam)
    dashed: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": (0, (4, 2))}
    axes.plot(t, y, label=rf"$1/(\lambda s+1)^2$, $\lambda$ = {lam:g} s", **dashed)
    left.plot(t, 100.0 * (y - 1.0), **dashed)
    axes.legend(loc="lower right")


def _between(columns: Columns, start_s: float, end_s: float) -> dict[str, Array]:
    t = columns["t"]
    inside = slice(*np.searchsorted(t, [start_s - 1e-9, end_s - 1e-9]))
    return {name: column[inside] for name, column in columns.items()}
