"""Rest in a report: each stretch that was held, as it looks in counts and volts, and in a table."""

from collections.abc import Iterator, Sequence

from backend.analysis.disturbance_metrics import JOINT_STEP, Held
from backend.recording.reader import Columns
from backend.reports.document import Block, Column, Figure, Section, Table, shown
from backend.reports.drawing import COLOURS, figure, panel_letter, thinned, to_svg, upper_legend
from backend.reports.drawn_once import drawn_once
from backend.units import Angles, read, reading_of
from plant.interface import T_s

NOTES = (
    "A stretch is held where the references stand as before it and nothing pushes or loads. Readings are what the "
    "encoders tell: a joint that stands between two counts may show either, so half a count is granted where they have "
    "counts. Motors are told to move in a tick in which the count of either changed.",
    "Against stiction an integrator hunts for a count forever. Once the joint has arrived, the outer integrators "
    "ignore errors below half a count of the joint and 0.01 N·m/rad, in both motions. The law as printed in the paper "
    "does not.",
)


def holds_section(columns: Columns, found: Sequence[Held], count: float, angles: Angles) -> Section:
    """Return figure and table; ``found`` is not empty, ``count`` [rad] is the joint encoder's, 0 where it is exact."""
    return Section("Rest", tuple(_blocks(columns, found, count or JOINT_STEP, angles)))


def _blocks(columns: Columns, found: Sequence[Held], count: float, angles: Angles) -> Iterator[Block]:
    yield Figure(
        "holds",
        hold_panels(columns, found, count, "holds"),
        "Stretches that are held, all from their beginnings: (A) joint off its reference in counts of its encoder, "
        "(B) stiffness off its reference, (C, D) voltages off their means.",
    )
    yield hold_table(found, angles)


def hold_table(found: Sequence[Held], angles: Angles) -> Table:
    """Return each stretch with its swings, its distance from the reference, and how much the motors moved."""
    angle = reading_of("rad", angles).unit
    columns = (
        Column("From", "s"),
        Column("q_ref", angle),
        Column("S_ref", "N·m/rad"),
        Column("Swing of q", "counts"),
        Column("Swing of q", angle),
        Column("Off", "counts"),
        Column("Mean off", angle),
        Column("Swing of u", "V"),
        Column("Swing of S", "N·m/rad"),
        Column("Moving", "%"),
    )
    rows = tuple(
        (
            shown(one.start_s, 4),
            shown(read(one.q_ref, "rad", angles), 4),
            shown(one.S_ref, 3),
            shown(one.q_swing_counts, 3),
            shown(read(one.q_swing, "rad", angles), 2),
            shown(one.off_counts, 3),
            shown(read(one.off, "rad", angles), 2),
            shown(one.u_swing, 3),
            shown(one.S_swing, 2),
            shown(one.moving_percent, 2),
        )
        for one in found
    )
    caption = (
        "Stretches of rest: largest less smallest reading of q, S and of the voltage that swings more; the largest and "
        "the mean distance of q from q_ref; ticks in which a motor's count changed."
    )
    return Table(caption, columns, rows)


@drawn_once
def hold_panels(columns: Columns, found: Sequence[Held], count: float, name: str) -> str:
    """Draw each stretch over the time since its beginning."""
    with figure(4, height_in=5.0, sharex=True) as (drawn, axes):
        for place, one in enumerate(found):
            window = slice(round(one.start_s / T_s), round(one.end_s / T_s) + 1)
            t = columns["t"][window] - one.start_s
            labels = {signal: f"${signal}$" if place == 0 else None for signal in ("q", "S", "u_A", "u_B")}
            off = (columns["q"][window] - columns["q_ref"][window]) / count
            axes[0].plot(*thinned(t, off), color=COLOURS["q"], linewidth=0.7, label=labels["q"])
            off = 1e3 * (columns["S"][window] - columns["S_ref"][window])
            axes[1].plot(*thinned(t, off), color=COLOURS["S"], linewidth=0.7, label=labels["S"])
            for panel, signal in zip(axes[2:], ("u_A", "u_B"), strict=True):
                u = columns[signal][window]
                panel.plot(
                    *thinned(t, 1e3 * (u - u.mean())), color=COLOURS[signal], linewidth=0.7, label=labels[signal]
                )
        axes[0].set_ylabel("q off [counts]")
        axes[1].set_ylabel("S off [mN·m/rad]")
        axes[2].set_ylabel("u − mean [mV]")
        axes[3].set(xlabel="t [s]", ylabel="u − mean [mV]", xlim=(0.0, max(one.end_s - one.start_s for one in found)))
        for panel, letter in zip(axes, "ABCD", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)
