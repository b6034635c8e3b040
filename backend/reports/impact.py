"""What a report shows of impacts: each hit in a table, its force over time, what giving way changes of it."""

from collections.abc import Sequence

import numpy as np

from backend.analysis.disturbance_metrics import Hit, beside_each_other
from backend.recording.reader import Columns
from backend.reports.document import NO_FIGURE, Column, Table, shown
from backend.reports.drawing import COLOURS, axis_label, figure, in_unit, panel_letter, to_svg, upper_legend
from backend.reports.drawn_once import drawn_once
from backend.reports.judgement import measured
from backend.units import Angles, read, reading_of
from plant.interface import T_s

CAPTION = (
    "Hits on the wall: (A) its force on the joint from the touch on, (B) largest force and (C) impulse over the speed "
    "of approach, at each stiffness. Dashed, with open marks: the joint gives way to the contact, from the dot in A on."
)

_BEFORE = 20
"""Samples before the touch that are drawn."""

_HUES = tuple(COLOURS.values())


def impact_tables(hits: Sequence[Hit], angles: Angles) -> tuple[Table, ...]:
    """Return every hit, and those with reaction beside those without, where there are both."""
    return hits_table(hits, angles), *reaction_tables(hits, angles)


def hits_table(hits: Sequence[Hit], angles: Angles) -> Table:
    """Return every hit, in order."""
    columns = (
        Column("At", "s"),
        Column("S_ref", reading_of("N·m/rad", angles).unit),
        Column("Approach", reading_of("rad/s", angles).unit),
        Column("Peak force", "N"),
        Column("Impulse", "N·s"),
        Column("In contact", "ms"),
        Column("Gives way from", "N"),
        Column("Felt after", "ms"),
        Column("Gives way after", "ms"),
        Column("Largest after", "ms"),
    )
    rows = tuple(
        (
            shown(hit.window.start * T_s, 4),
            shown(read(hit.S_ref, "N·m/rad", angles)),
            measured(read(hit.speed, "rad/s", angles) if np.isfinite(hit.speed) else None),
            shown(hit.peak_N, 3),
            shown(hit.impulse_Ns, 3),
            shown(1e3 * hit.contact_s, 3),
            shown(hit.contact_N, 3) if hit.reacts else NO_FIGURE,
            *(_ms(time_s, hit) for time_s in (hit.felt_s, hit.gave_way_s, hit.fell_s)),
        )
        for hit in hits
    )
    return Table(
        "Every hit: the approach is measured over the 50 ms before the touch. Felt: from the touch until the estimated "
        "force passes that from which on the joint gives way; from there until it gives way (0: in the same sample), "
        "and until the wall's force is at its largest, from where on it falls.",
        columns,
        rows,
    )


def _ms(time_s: float, hit: Hit) -> str:
    if not hit.reacts:
        return NO_FIGURE
    return f"{1e3 * time_s:.0f}" if np.isfinite(time_s) else "not felt"


def reaction_tables(hits: Sequence[Hit], angles: Angles) -> tuple[Table, ...]:
    """Return hits with reaction beside those without, of one stiffness and speed; none where there are none."""
    pairs, _ = beside_each_other(hits)
    if not pairs:
        return ()
    columns = (
        Column("S_ref", reading_of("N·m/rad", angles).unit),
        Column("Approach", reading_of("rad/s", angles).unit),
        Column("Peak without", "N"),
        Column("Peak with", "N"),
        Column("With over without"),
        Column("Impulse without", "N·s"),
        Column("Impulse with", "N·s"),
        Column("With over without"),
    )
    rows = tuple(
        (
            shown(read(plain.S_ref, "N·m/rad", angles)),
            shown(read(plain.speed, "rad/s", angles)),
            shown(plain.peak_N, 3),
            shown(reacted.peak_N, 3),
            shown(reacted.peak_N / plain.peak_N, 3),
            shown(plain.impulse_Ns, 3),
            shown(reacted.impulse_Ns, 3),
            shown(reacted.impulse_Ns / plain.impulse_Ns, 3),
        )
        for plain, reacted in sorted(pairs, key=lambda pair: (pair[0].S_ref, pair[0].speed))
    )
    return (Table("Hits that are alike, without and with contact reaction.", columns, rows),)


@drawn_once
def impact_panels(columns: Columns, hits: Sequence[Hit], name: str, angles: Angles) -> str:
    """Draw the force of each hit from its touch on, and peak and impulse over the speed of approach."""
    force = np.abs(columns["F_wall"])
    groups = sorted({(hit.reacts, round(hit.S_ref, 6)) for hit in hits})
    stiffnesses = sorted({S for _, S in groups})
    with figure(3, height_in=5.4, gap_in=(0.5, 0.6)) as (drawn, axes):
        for reacts, S in groups:
            alike = [hit for hit in hits if (hit.reacts, round(hit.S_ref, 6)) == (reacts, S)]
            colour = _HUES[stiffnesses.index(S) % len(_HUES)]
            line = {"color": colour, "linestyle": (0, (4, 2)) if reacts else "-"}
            label = f"S = {read(S, 'N·m/rad', angles):.3g} {reading_of('N·m/rad', angles).unit}"
            label += ", gives way" if reacts else ""
            for place, hit in enumerate(alike):
                first = max(hit.window.start - _BEFORE, 0)
                shape = force[first : hit.window.stop + _BEFORE]
                t = 1e3 * (np.arange(shape.size) - (hit.window.start - first)) * T_s
                axes[0].plot(t, shape, linewidth=0.8, label=label if place == 0 else None, **line)
                if np.isfinite(hit.gave_way_s):
                    at = round((hit.felt_s + hit.gave_way_s) / T_s)
                    axes[0].plot(1e3 * at * T_s, force[hit.window.start + at], "o", color=colour, markersize=3.0)
            speeds = in_unit(np.array([hit.speed for hit in alike]), "rad/s", angles)
            order = np.argsort(speeds)
            marks = {"marker": "o", "markersize": 3.5, "markerfacecolor": "white" if reacts else colour}
            for panel, values in (
                (axes[1], [hit.peak_N for hit in alike]),
                (axes[2], [hit.impulse_Ns for hit in alike]),
            ):
                panel.plot(speeds[order], np.array(values)[order], **marks, **line)
        axes[0].set(xlabel="after the touch [ms]", ylabel="$|F_{wall}|$ [N]")
        axes[1].set(xlabel=axis_label("speed of approach", "rad/s", angles), ylabel="peak [N]")
        axes[2].set(xlabel=axis_label("speed of approach", "rad/s", angles), ylabel="impulse [N·s]")
        for panel in axes:
            panel.set_ylim(bottom=0.0)
        for panel, letter in zip(axes, "ABC", strict=True):
            panel_letter(panel, letter)
        upper_legend(axes[0])
        return to_svg(drawn, name)
