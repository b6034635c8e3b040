"""What a report shows of impacts: each hit in a table, its force over time, peak and impulse over the speed."""

from collections.abc import Sequence

import numpy as np

from backend.experiments.results.impact import Hit
from backend.reading import Angles, read, reading_of
from backend.recording.columns import Columns
from backend.reports.document import Column, Table, shown
from backend.reports.drawing import COLOURS, axis_label, figure, in_unit, panel_letter, to_svg, upper_legend
from backend.reports.judgement import measured
from plant.interface import T_s

_BEFORE = 20
"""Samples before the touch that are drawn."""

_HUES = tuple(COLOURS.values())


def hits_table(hits: Sequence[Hit], angles: Angles) -> Table:
    """Return every hit, in order."""
    speed = reading_of("rad/s", angles).unit
    columns = (
        Column("At", "s"),
        Column("S_ref", reading_of("N·m/rad", angles).unit),
        Column("Approach", speed),
        Column("Peak force", "N"),
        Column("Impulse", "N·s"),
        Column("In contact", "ms"),
    )
    rows = tuple(
        (
            shown(hit.window.start * T_s, 4),
            shown(read(hit.S_ref, "N·m/rad", angles)),
            measured(read(hit.speed, "rad/s", angles) if np.isfinite(hit.speed) else None),
            shown(hit.peak_N, 3),
            shown(hit.impulse_Ns, 3),
            shown(1e3 * hit.contact_s, 3),
        )
        for hit in hits
    )
    return Table("Every hit: the approach is measured over the 50 ms before the touch.", columns, rows)


def impact_panels(columns: Columns, hits: Sequence[Hit], name: str, angles: Angles) -> str:
    """Draw the force of each hit from its touch on, and peak and impulse over the speed of approach."""
    force = np.abs(columns["F_wall"])
    at = {S: _HUES[place % len(_HUES)] for place, S in enumerate(sorted({round(hit.S_ref, 6) for hit in hits}))}
    with figure(3, height_in=5.0, gap_in=(0.5, 0.6)) as (drawn, axes):
        for S, colour in at.items():
            alike = [hit for hit in hits if round(hit.S_ref, 6) == S]
            label = f"S = {read(S, 'N·m/rad', angles):.3g} {reading_of('N·m/rad', angles).unit}"
            for place, hit in enumerate(alike):
                first = max(hit.window.start - _BEFORE, 0)
                shape = force[first : hit.window.stop + _BEFORE]
                t = 1e3 * (np.arange(shape.size) - (hit.window.start - first)) * T_s
                axes[0].plot(t, shape, color=colour, linewidth=0.8, label=label if place == 0 else None)
            speeds = in_unit(np.array([hit.speed for hit in alike]), "rad/s", angles)
            order = np.argsort(speeds)
            for panel, values in (
                (axes[1], [hit.peak_N for hit in alike]),
                (axes[2], [hit.impulse_Ns for hit in alike]),
            ):
                panel.plot(speeds[order], np.array(values)[order], "o-", color=colour, markersize=3.5, label=label)
        axes[0].set(xlabel="after the touch [ms]", ylabel="|F_wall| [N]")
        axes[1].set_ylabel("peak [N]")
        axes[2].set(xlabel=axis_label("speed of approach", "rad/s", angles), ylabel="impulse [N·s]")
        for panel in axes[1:]:
            panel.set_ylim(bottom=0.0)
        for panel, letter in zip(axes, "ABC", strict=True):
            panel_letter(panel, letter)
        upper_legend(axes[0])
        return to_svg(drawn, name)
