"""The report of a compliance run: whether the joint gives way as its stiffness says."""

import numpy as np

from backend.models.run import Metrics
from backend.recording.reader import Columns
from backend.reports.document import Figure, Report, Section
from backend.reports.drawing import (
    COLOURS,
    INK,
    LIMIT_GREY,
    axis_label,
    figure,
    in_unit,
    panel_letter,
    thinned,
    to_svg,
    upper_legend,
)
from backend.reports.drawn_once import drawn_once
from backend.reports.experiment import experiment_report
from backend.reports.provenance import S_NOTE
from backend.reports.source import Source
from backend.reports.tracking_figures import TENSIONS, tension_panel
from backend.units import Angles

_LEAST_N = 0.1
"""Least reach of the axis of a difference of forces: below the load cells' noise there is only rounding to see."""
_REST_S = 1.0

_NOTES = (
    S_NOTE,
    "The force of the hand is measured as the reaction F_ext = F_A − F_B; commanded stiffness and measured position "
    "let expect F_exp = −S_ref q/r_j (equations 22 and 25 of the paper, a linear approximation).",
    "Raw differences hold the load cells' delay and offset, as the paper's 2.239 N does. Aligned means: the measured "
    "force is moved back by the delay that fits best, and each force counts from its mean over the second before the "
    "first push.",
    "The position loop is open: the decoupler's geometry alone holds q = 0, the stiffness loop is closed.",
)


def compliance_report(source: Source) -> Report:
    """Build the report; a run without result says why it has none."""
    seen = () if source.result is None else (_figures(source, source.result.metrics),)
    return experiment_report(source, "Compliance experiment", "compliance experiment", seen, _NOTES)


def _figures(source: Source, metrics: Metrics) -> Section:
    pushed_s = next(phase.start_s for phase in metrics.phases if phase.name == "pushes")
    delay_s = metrics.value_of("delay_s") or 0.0
    r_j = source.run.number("geometry", "r_j")
    F_max = source.run.number("safety", "F_max")
    panels = force_panels(source.columns, r_j, pushed_s, delay_s, "forces", source.angles)
    return Section(
        "Figures",
        (
            Figure(
                "forces",
                panels,
                "Pushes on the joint: (A) joint position, (B) measured force F_ext, the force F_exp that stiffness "
                "and position let expect, and the force that encoders and springs tell without a load cell, (C) the "
                "difference of the first two as measured (grey) and aligned. Compare figure 8 of the paper.",
            ),
            Figure(
                "tension",
                tension_panel(source.columns, F_max, "tension"),
                TENSIONS,
            ),
        ),
    )


@drawn_once
def force_panels(columns: Columns, r_j: float, pushed_s: float, delay_s: float, name: str, angles: Angles) -> str:
    """Draw q, measured and expected force, and their difference raw and aligned (figure 8)."""
    t = columns["t"]
    measured = columns["F_A"] - columns["F_B"]
    expected = -columns["S_ref"] * columns["q"] / r_j
    rest = (t >= pushed_s - _REST_S) & (t < pushed_s)
    delay = int(np.searchsorted(t, t[0] + delay_s - 1e-9))
    end = t.size - delay
    aligned = (measured[delay:] - measured[rest].mean()) - (expected[:end] - expected[rest].mean())
    with figure(3, height_in=4.4, sharex=True, height_ratios=(2, 3, 2)) as (drawn, axes):
        axes[0].plot(*thinned(t, in_unit(columns["q"], "rad", angles)), color=COLOURS["q"], label="$q$")
        axes[0].set_ylabel(axis_label("q", "rad", angles))
        axes[1].plot(*thinned(t, measured), color=COLOURS["F_A"], label="$F_{ext}$")
        axes[1].plot(*thinned(t, expected), color=INK, linewidth=0.7, linestyle=(0, (4, 2)), label="$F_{exp}$")
        if "F_ext_hat" in columns:
            estimated = -(columns["F_ext_hat"] - columns["F_ext_hat"][rest].mean()) + measured[rest].mean()
            axes[1].plot(*thinned(t, estimated), color=COLOURS["u_B"], linewidth=0.7, label="estimated")
        axes[1].set_ylabel("Force [N]")
        axes[2].plot(*thinned(t, measured - expected), color=LIMIT_GREY, linewidth=0.7, label="raw")
        axes[2].plot(*thinned(t[:end], aligned), color=COLOURS["u_B"], linewidth=0.8, label="aligned")
        low, high = axes[2].get_ylim()
        reach = (min(low, -_LEAST_N), max(high, _LEAST_N))
        axes[2].set(xlabel="t [s]", ylabel="Difference [N]", xlim=(t[0], t[-1]), ylim=reach)
        for panel, letter in zip(axes, "ABC", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)
