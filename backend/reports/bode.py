"""Frequency responses in a report: gain and phase as measured beside the predicted ones, and each line in a table."""

from collections.abc import Iterator, Sequence

import matplotlib
import numpy as np

from backend.analysis.frequency_metrics import UNLIKE, Array, Complex, Lines
from backend.reports.document import NO_FIGURE, Block, Column, Figure, Paragraph, Section, Table, shown
from backend.reports.drawing import (
    COLOURS,
    LIMIT_GREY,
    figure,
    frequency_axis,
    limit_line,
    panel_letter,
    to_svg,
    upper_legend,
)
from backend.reports.drawn_once import drawn_once

MOST_NAMED = 8
"""More runs than this are not named beside their curves: their colours tell the order."""

_PER_DECADE = 120
_BELOW_DB = -60.0
_TITLES = {"q": "position loop", "S": "stiffness loop"}

NOTES = (
    "Each line of a multisine or a sequence is measured on its last period, Y/U of the discrete Fourier transform over "
    "whole periods, which is the least-squares fit of a sine; of a sweep all of it, in bands of 12 %. A line is not "
    f"measured where it differs by more than {100.0 * UNLIKE:g} % from one period to the next, or where a limit acted.",
    "Bandwidth and resonance are relative to the gain 1 at rest, which integral action gives. Between two lines, and "
    "between rest and the lowest line, 1/|H|² is interpolated over f² by a monotone cubic.",
    "Predicted is what the plant, linearised about the references with its identified numbers, voltages held over a "
    "period, and the loops as they run give with the gains in use. In time-optimal motion the trajectory is in it, "
    "as long as the voltage that the references ask for is within its limit. Friction is not.",
)


def bode_section(found: Sequence[Lines]) -> Section:
    """Return figure and tables; ``found`` is not empty."""
    return Section("Frequency responses", tuple(_blocks(found)))


def _blocks(found: Sequence[Lines]) -> Iterator[Block]:
    yield Figure(
        "bode",
        bode_panels(found, "bode"),
        "Bode diagram of the closed loops, from the reference to what is measured: (A) gain, (B) phase. Points are "
        "measured, crosses are lines that are not (their reason stands in the table), lines are predicted.",
    )
    for lines in found:
        yield line_table(lines)
        if lines.unpredicted:
            yield Paragraph(f"The {_TITLES[lines.signal]} has no prediction: {lines.unpredicted}.")


def line_table(lines: Lines) -> Table:
    """Return each line: frequency, gain and phase measured and predicted, repeatability, why it is not measured."""
    columns = (
        Column("f", "Hz"),
        Column("Gain", "dB"),
        Column("Predicted", "dB"),
        Column("Phase", "°"),
        Column("Predicted", "°"),
        Column("Unlike", "%"),
        Column("Remark", number=False, wide=True),
    )
    gain, phase = _decibel(lines.H), _degrees(lines.H)
    nothing = np.full(lines.f.size, np.nan)
    expected = lines.expected
    gain_too, phase_too = (nothing, nothing) if expected is None else (_decibel(expected), _degrees(expected))
    rows = tuple(
        (
            shown(float(lines.f[k]), 4),
            NO_FIGURE if reason else _fixed(gain[k], 2),
            _fixed(gain_too[k], 2),
            NO_FIGURE if reason else _fixed(phase[k], 1),
            _fixed(phase_too[k], 1),
            _fixed(100.0 * lines.unlike[k], 2),
            f"not measured: {reason}" if reason else "",
        )
        for k, reason in enumerate(lines.reasons)
    )
    caption = (
        f"Lines of the {_TITLES[lines.signal]}: gain and phase of {lines.signal} over {lines.signal}_ref, and by how "
        "much the line differed from the period before, or in a sweep √(1 − γ²) of its band."
    )
    return Table(caption, columns, rows)


@drawn_once
def bode_panels(found: Sequence[Lines], name: str) -> str:
    """Draw gain [dB] and phase [°] of each response over frequency [Hz], with what was predicted."""
    with figure(2, height_in=4.4, sharex=True, height_ratios=(1, 1)) as (drawn, axes):
        for lines in found:
            colour, kept = COLOURS[lines.signal], lines.measured
            if lines.predicted is not None:
                f = _grid(lines)
                H = lines.predicted.response(f)
                axes[0].semilogx(f, _decibel(H), color=colour, linewidth=0.8, label=f"${lines.signal}$, predicted")
                axes[1].semilogx(f, _degrees(H), color=colour, linewidth=0.8, label=f"${lines.signal}$, predicted")
            for panel, values in ((axes[0], _decibel(lines.H)), (axes[1], _degrees(lines.H))):
                label = f"${lines.signal}$, measured"
                panel.semilogx(lines.f[kept], values[kept], "o", color=colour, markersize=2.6, label=label)
                panel.semilogx(lines.f[~kept], values[~kept], "x", color=LIMIT_GREY, markersize=3.0)
        limit_line(axes[0], -3.0103, "−3 dB", above=True)
        frequency_axis(axes[1])
        low, high = axes[0].get_ylim()
        axes[0].set(ylabel="Gain [dB]", ylim=(max(low, _BELOW_DB), max(high, 1.0)))
        axes[1].set(ylabel="Phase [°]", xlabel="f [Hz]")
        for panel, letter in zip(axes, "AB", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)


@drawn_once
def overlay_bode(runs: Sequence[tuple[int, Sequence[Lines]]], name: str) -> str:
    """Draw gain and phase of q and of S, of all runs on the same axes, with what was predicted of each."""
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(runs)))
    with figure(2, 2, height_in=4.4, sharex=True) as (drawn, axes):
        for column, signal in enumerate(("q", "S")):
            for colour, (number, found) in zip(colours, runs, strict=True):
                lines = next((one for one in found if one.signal == signal), None)
                if lines is None:
                    continue
                kept = lines.measured
                for panel, of in ((axes[0][column], _decibel), (axes[1][column], _degrees)):
                    label = f"run {number}" if len(runs) <= MOST_NAMED else None
                    panel.semilogx(lines.f[kept], of(lines.H)[kept], "o", color=colour, markersize=2.2, label=label)
                    if lines.predicted is not None:
                        f = _grid(lines)
                        panel.semilogx(f, of(lines.predicted.response(f)), color=colour, linewidth=0.7)
            axes[0][column].set_ylabel(f"Gain of ${signal}$ [dB]")
            axes[1][column].set(ylabel=f"Phase of ${signal}$ [°]", xlabel="f [Hz]")
            frequency_axis(axes[1][column])
        if len(runs) <= MOST_NAMED:
            upper_legend(axes[0][1])
        return to_svg(drawn, name)


def _grid(lines: Lines) -> Array:
    low, high = float(lines.f[0]), float(lines.f[-1])
    return np.geomspace(low, high, max(int(_PER_DECADE * np.log10(high / low)), 2))


def _decibel(H: Complex) -> Array:
    with np.errstate(divide="ignore"):
        return np.asarray(20.0 * np.log10(np.abs(H)))


def _degrees(H: Complex) -> Array:
    return np.asarray(np.degrees(np.unwrap(np.angle(H))))


def _fixed(value: float, digits: int) -> str:
    if not np.isfinite(value):
        return NO_FIGURE
    text = f"{value:.{digits}f}"
    return f"{0.0:.{digits}f}" if float(text) == 0.0 else text.replace("-", "−")
