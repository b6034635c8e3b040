"""Pushes in a report: each beside what the gains in use let expect and what its stiffness alone would give."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from backend.analysis.disturbance_metrics import PUSH_REST_S, Push
from backend.recording.reader import Columns
from backend.reports.document import NO_FIGURE, Block, Column, Figure, Paragraph, Section, Table, shown
from backend.reports.drawing import (
    COLOURS,
    INK,
    axis_label,
    draw_error,
    figure,
    in_unit,
    panel_letter,
    thinned,
    to_svg,
    upper_legend,
)
from backend.reports.drawn_once import drawn_once
from backend.units import Angles, read, reading_of
from plant.interface import T_s

NOTES = (
    "Deviations count from the tenth of a second before each push. Expected is what the plant, linearised with its "
    "identified numbers, and the loops as they run give under the same force with the gains in use; friction is not in "
    "it. It is the same in both motions: the loops that answer a push are the same.",
    "Static is r_j F/S: so far the joint gives way to a constant force where the position loop is open. A step in "
    "closed loop exceeds it by the joint's swing, and is then brought back by the integral; an impulse is over before.",
)


def pushes_section(columns: Columns, found: Sequence[Push], angles: Angles) -> Section:
    """Return figure and table; ``found`` is not empty."""
    return Section("Pushes", tuple(_blocks(columns, found, angles)))


def _blocks(columns: Columns, found: Sequence[Push], angles: Angles) -> Iterator[Block]:
    yield Figure(
        "pushes",
        push_panels(columns, found, "pushes", angles),
        "Pushes at the joint: (A) force, (B) deviation of the joint from before the push, measured, and expected "
        "(dashed), (C) measured less expected, (D) stiffness off its reference; beyond the panel it is on its way to "
        "another one.",
    )
    yield push_table(found, angles)
    if why := next((one.unpredicted for one in found if one.unpredicted), ""):
        yield Paragraph(f"Not all pushes have a prediction: {why}.")


def push_table(found: Sequence[Push], angles: Angles) -> Table:
    """Return each push with its peak, the expected and the static one, and how soon the joint was back."""
    angle = reading_of("rad", angles).unit
    columns = (
        Column("Push", number=False),
        Column("From", "s"),
        Column("S_ref", "N·m/rad"),
        Column("F", "N"),
        Column("Impulse", "N·s"),
        Column("Peak of q", angle),
        Column("Expected", angle),
        Column("Off", "%"),
        Column("Static", angle),
        Column("Peak of S", "N·m/rad"),
        Column("Back", "s"),
    )
    rows = tuple(
        (
            one.window.shape,
            shown(one.window.pushed.start * T_s, 4),
            shown(one.S, 4),
            shown(one.F, 3),
            shown(one.impulse, 3),
            shown(read(one.peak_q, "rad", angles), 4),
            NO_FIGURE if one.expected_peak is None else shown(read(one.expected_peak, "rad", angles), 4),
            shown(one.off_percent, 2),
            NO_FIGURE if one.window.shape == "impulse" else shown(read(one.static, "rad", angles), 4),
            shown(one.peak_S, 2),
            shown(one.back_s, 3),
        )
        for one in found
    )
    caption = (
        "Pushes: largest deviation of q and S, the peak that was expected, the measured one over it less one, r_j F/S, "
        "and the time from the end of the push until q stays within 0.01 rad of its reference."
    )
    return Table(caption, columns, rows)


@drawn_once
def push_panels(columns: Columns, found: Sequence[Push], name: str, angles: Angles) -> str:
    """Draw force, deviation of the joint with what was expected, and deviation of the stiffness."""
    first, last = found[0].window.pushed.start, max(one.window.until for one in found)
    window = slice(max(first - round(1.0 / T_s), 0), min(last, columns["t"].size))
    t = columns["t"][window]
    with figure(4, height_in=5.2, sharex=True, height_ratios=(2, 3, 2, 2)) as (drawn, axes):
        axes[0].plot(*thinned(t, columns["F_push"][window]), color=INK, label="$F_{push}$")
        axes[0].set_ylabel("Force [N]")
        off = columns["q"][window] - columns["q_ref"][window]
        axes[1].plot(*thinned(t, in_unit(off, "rad", angles)), color=COLOURS["q"], label="$q$")
        apart: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        for place, one in enumerate(found):
            if one.expected is None:
                continue
            start = one.window.pushed.start
            at, label = columns["t"][start : start + one.expected.size], "expected" if place == 0 else None
            expected = in_unit(one.expected, "rad", angles)
            axes[1].plot(*thinned(at, expected), color=INK, linewidth=0.7, linestyle=(0, (4, 2)), label=label)
            before = max(start - round(PUSH_REST_S / T_s), 0)
            measured = columns["q"][start : start + one.expected.size] - columns["q"][before : start + 1].mean()
            apart.append((at[: measured.size], in_unit(measured - one.expected[: measured.size], "rad", angles)))
        reach = max((float(np.abs(error).max(initial=0.0)) for _, error in apart), default=0.0)
        angle = reading_of("rad", angles).unit
        for at, error in apart:
            draw_error(axes[2], at, error, "apart", angle, colour=COLOURS["q"], reach=reach)
        axes[1].set_ylabel(axis_label("deviation", "rad", angles))
        off_S = columns["S"][window] - columns["S_ref"][window]
        steps = np.flatnonzero(np.diff(columns["S_ref"][window]) != 0.0)
        if steps.size:  # the steps themselves are none of the deviation
            reach = 1.2 * max(max(one.peak_S for one in found), 1e-3)
            axes[3].set_ylim(-reach, reach)
        axes[3].plot(*thinned(t, off_S), color=COLOURS["S"], label="$S$")
        axes[3].set(xlabel="t [s]", ylabel="S − S_ref [N·m/rad]".replace("S_ref", "$S_{ref}$"), xlim=(t[0], t[-1]))
        for panel, letter in zip(axes, "ABCD", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)
