"""Sections shared by reports: frequency responses, rest, impacts, pushes."""

from collections.abc import Iterator, Sequence

import matplotlib
import numpy as np
from numpy.typing import NDArray

from backend.analysis import (
    JOINT_STEP,
    MOTOR_B,
    PUSH_REST_S,
    VARIATION_MAX,
    Array,
    Complex,
    Hit,
    HoldWindow,
    Lines,
    MeasuredPush,
    estimate_run_friction,
    pair_hits,
)
from backend.models import CHANNELS
from backend.recording import Columns
from backend.reports import messages
from backend.reports.model import (
    NO_FIGURE,
    Block,
    Column,
    Figure,
    Paragraph,
    ReportSection,
    Table,
    format_measured,
    share,
)
from backend.reports.plotting import (
    COLOURS,
    INK,
    LIMIT_GREY,
    axis_label,
    cached_figure,
    decimate,
    draw_error,
    figure,
    frequency_axis,
    in_unit,
    limit_line,
    panel_letter,
    to_svg,
    upper_legend,
)
from backend.reports.provenance import format_figure
from backend.reports.run_data import RunData
from backend.storage import Identification, RunKind
from backend.units import AngleUnit, convert_to_display, get_display_unit
from plant import (
    SIDES,
    T_s,
)

# Bode ----------------------------------------------------------------------------------------------
# Frequency responses in a report: measured and predicted gain and phase, and a table of all lines.


MOST_NAMED = 8
"""Maximum number of runs with a label at their curves; for more, the colours show the order."""

_PER_DECADE = 120
_BELOW_DB = -60.0

BODE_NOTES = (
    messages.how_lines_are_measured(variation_max=VARIATION_MAX),
    messages.how_bandwidth_is_measured(),
    messages.how_responses_are_predicted(),
)


def bode_section(found: Sequence[Lines]) -> ReportSection:
    """Return figure and tables; ``found`` is not empty."""
    return ReportSection("Frequency responses", tuple(_bode_blocks(found)))


def _bode_blocks(found: Sequence[Lines]) -> Iterator[Block]:
    yield Figure(
        "bode",
        bode_panels(found, "bode"),
        messages.bode_figure(),
    )
    for lines in found:
        yield line_table(lines)
        if lines.unpredicted:
            yield Paragraph(messages.no_prediction_of_loop(signal=lines.signal, reason=lines.unpredicted))


def line_table(lines: Lines) -> Table:
    """Return a table of all lines.

    Each has its frequency, gain and phase as measured and predicted, the repeatability, and the reason if it was not
    measured.
    """
    columns = (
        Column("f", "Hz"),
        Column("Gain", "dB"),
        Column("Predicted", "dB"),
        Column("Phase", "°"),
        Column("Predicted", "°"),
        Column("Variation", "%"),
        Column("Reason", number=False, wide=True),
    )
    gain, phase = _decibel(lines.H), _degrees(lines.H)
    nothing = np.full(lines.f.size, np.nan)
    expected = lines.expected
    gain_too, phase_too = (nothing, nothing) if expected is None else (_decibel(expected), _degrees(expected))
    rows = tuple(
        (
            format_measured(float(lines.f[k]), 4),
            NO_FIGURE if reason else _format_fixed(gain[k], 2),
            _format_fixed(gain_too[k], 2),
            NO_FIGURE if reason else _format_fixed(phase[k], 1),
            _format_fixed(phase_too[k], 1),
            _format_fixed(100.0 * lines.variation[k], 2),
            messages.line_not_measured(reason=reason) if reason else "",
        )
        for k, reason in enumerate(lines.reasons)
    )
    return Table(messages.lines_of_loop(signal=lines.signal), columns, rows)


@cached_figure
def bode_panels(found: Sequence[Lines], name: str) -> str:
    """Draw measured and predicted gain [dB] and phase [°] over frequency [Hz]."""
    with figure(2, height_in=4.4, sharex=True, height_ratios=(1, 1)) as (drawn, axes):
        for lines in found:
            colour, is_measured = COLOURS[lines.signal], lines.measured
            if lines.predicted is not None:
                f = _grid(lines)
                H = lines.predicted.response(f)
                axes[0].semilogx(f, _decibel(H), color=colour, linewidth=0.8, label=f"${lines.signal}$, predicted")
                axes[1].semilogx(f, _degrees(H), color=colour, linewidth=0.8, label=f"${lines.signal}$, predicted")
            for panel, values in ((axes[0], _decibel(lines.H)), (axes[1], _degrees(lines.H))):
                label = f"${lines.signal}$, measured"
                panel.semilogx(
                    lines.f[is_measured], values[is_measured], "o", color=colour, markersize=2.6, label=label
                )
                panel.semilogx(lines.f[~is_measured], values[~is_measured], "x", color=LIMIT_GREY, markersize=3.0)
        limit_line(axes[0], -3.0103, "−3 dB", above=True)
        frequency_axis(axes[1])
        low, high = axes[0].get_ylim()
        axes[0].set(ylabel="Gain [dB]", ylim=(max(low, _BELOW_DB), max(high, 1.0)))
        axes[1].set(ylabel="Phase [°]", xlabel="f [Hz]")
        for panel, letter in zip(axes, "AB", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)


@cached_figure
def overlay_bode(runs: Sequence[tuple[int, Sequence[Lines]]], name: str) -> str:
    """Draw measured and predicted gain and phase of q and S of all runs."""
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(runs)))
    with figure(2, 2, height_in=4.4, sharex=True) as (drawn, axes):
        for column, signal in enumerate(("q", "S")):
            for colour, (number, found) in zip(colours, runs, strict=True):
                lines = next((one for one in found if one.signal == signal), None)
                if lines is None:
                    continue
                is_measured = lines.measured
                for panel, of in ((axes[0][column], _decibel), (axes[1][column], _degrees)):
                    label = f"run {number}" if len(runs) <= MOST_NAMED else None
                    panel.semilogx(
                        lines.f[is_measured], of(lines.H)[is_measured], "o", color=colour, markersize=2.2, label=label
                    )
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


def _format_fixed(value: float, digits: int) -> str:
    if not np.isfinite(value):
        return NO_FIGURE
    text = f"{value:.{digits}f}"
    return f"{0.0:.{digits}f}" if float(text) == 0.0 else text.replace("-", "−")


# Rest ----------------------------------------------------------------------------------------------
# Rest in a report: each hold window as curves in counts and volts, and in a table.


HOLD_NOTES = (
    messages.how_holds_are_evaluated(),
    messages.friction_causes_limit_cycle(),
)


def holds_section(columns: Columns, found: Sequence[HoldWindow], count: float, angles: AngleUnit) -> ReportSection:
    """Return figure and table of hold windows; ``found`` is not empty.

    ``count`` [rad] is the resolution of the joint encoder, 0 if it is exact.
    """
    return ReportSection("Rest", tuple(_hold_blocks(columns, found, count or JOINT_STEP, angles)))


def _hold_blocks(columns: Columns, found: Sequence[HoldWindow], count: float, angles: AngleUnit) -> Iterator[Block]:
    yield Figure(
        "holds",
        hold_panels(columns, found, count, "holds"),
        messages.holds_figure(),
    )
    yield hold_table(found, angles)


def hold_table(found: Sequence[HoldWindow], angles: AngleUnit) -> Table:
    """Return a table of windows: ranges, distance from the reference, motor motion."""
    angle = get_display_unit("rad", angles).unit
    columns = (
        Column("From", "s"),
        Column("q_ref", angle),
        Column("S_ref", "N·m/rad"),
        Column("q, p-p", "counts"),
        Column("q, p-p", angle),
        Column("q − q_ref, max.", "counts"),
        Column("q − q_ref, mean", angle),
        Column("u, p-p", "V"),
        Column("S, p-p", "N·m/rad"),
        Column("Moving", "%"),
    )
    rows = tuple(
        (
            format_measured(one.start_s, 4),
            format_measured(convert_to_display(one.q_ref, "rad", angles), 4),
            format_measured(one.S_ref, 3),
            format_measured(one.q_swing_counts, 3),
            format_measured(convert_to_display(one.q_swing, "rad", angles), 2),
            format_measured(one.off_counts, 3),
            format_measured(convert_to_display(one.off, "rad", angles), 2),
            format_measured(one.u_swing, 3),
            format_measured(one.S_swing, 2),
            format_measured(one.moving_percent, 2),
        )
        for one in found
    )
    return Table(messages.holds_table(), columns, rows)


@cached_figure
def hold_panels(columns: Columns, found: Sequence[HoldWindow], count: float, name: str) -> str:
    """Draw each window over the time since its start."""
    with figure(4, height_in=5.0, sharex=True) as (drawn, axes):
        for place, one in enumerate(found):
            window = slice(round(one.start_s / T_s), round(one.end_s / T_s) + 1)
            t = columns["t"][window] - one.start_s
            labels = {signal: f"${signal}$" if place == 0 else None for signal in ("q", "S", "u_A", "u_B")}
            off = (columns["q"][window] - columns["q_ref"][window]) / count
            axes[0].plot(*decimate(t, off), color=COLOURS["q"], linewidth=0.7, label=labels["q"])
            off = 1e3 * (columns["S"][window] - columns["S_ref"][window])
            axes[1].plot(*decimate(t, off), color=COLOURS["S"], linewidth=0.7, label=labels["S"])
            for panel, signal in zip(axes[2:], ("u_A", "u_B"), strict=True):
                u = columns[signal][window]
                panel.plot(
                    *decimate(t, 1e3 * (u - u.mean())), color=COLOURS[signal], linewidth=0.7, label=labels[signal]
                )
        axes[0].set_ylabel("q − q_ref [counts]")
        axes[1].set_ylabel("S − S_ref [mN·m/rad]")
        axes[2].set_ylabel("u − mean [mV]")
        axes[3].set(xlabel="t [s]", ylabel="u − mean [mV]", xlim=(0.0, max(one.end_s - one.start_s for one in found)))
        for panel, letter in zip(axes, "ABCD", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)


# Identifications -----------------------------------------------------------------------------------
# Results of the identifications of a series, with tables for each kind.


_RUN, _GRADE = Column("Run"), Column("Grade", number=False)
_UNITS = {"G_q": "", "G_S": "N·m/rad²"}


def identifications_section(sources: Sequence[RunData]) -> tuple[ReportSection, ...]:
    """Return one section with all identifications of the runs.

    Returns nothing if there are none.
    """
    found = [source.identification for source in sources if source.identification is not None]
    if not found:
        return ()
    by_kind = {kind: [one for one in found if one.kind == kind] for kind in ("motor", "spring", "actuator")}
    tables = [*_motors(by_kind["motor"]), *_springs(by_kind["spring"]), *_actuators(by_kind["actuator"])]
    friction = _friction([source for source in sources if source.run.kind == RunKind.ACTUATOR_IDENTIFICATION])
    verdicts = (Paragraph(messages.verdict_of_run(run_id=one.run_id, verdict=one.verdict)) for one in found)
    return (ReportSection("Identifications", (*tables, *friction, *verdicts)),)


def _motors(found: Sequence[Identification]) -> Iterator[Table]:
    for side in SIDES:
        rows = []
        for one in found:
            motor = one.motors.side(side)
            model, std = motor.model.parameters, motor.model.std_errors
            figures = ((model.K_m, std.K_m), (model.T_m, std.T_m), (model.u_c, std.u_c))
            rows.append((str(one.run_id), *(_with_error(*figure) for figure in figures), str(motor.quality.grade)))
        if rows:
            columns = (_RUN, Column("K_m", "rad/(V·s)"), Column("T_m", "s"), Column("u_c", "V"), _GRADE)
            yield Table(messages.motors_of_series(side=side), columns, tuple(rows))


def _springs(found: Sequence[Identification]) -> Iterator[Table]:
    for side in SIDES:
        rows = []
        for one in found:
            model = one.springs[side].model
            fit = next(fit for fit in model.fits if fit.order == model.recommended)
            k = ", ".join(_with_error(*pair) for pair in zip(fit.k, fit.std_errors, strict=True))
            rows.append((str(one.run_id), str(fit.order), k, format_measured(fit.rms_N)))
        if rows:
            columns = (_RUN, Column("Order"), Column("k_0, k_1, …", "N/m^i", wide=True), Column("RMS", "N"))
            yield Table(messages.springs_of_series(side=side), columns, tuple(rows))


def _actuators(found: Sequence[Identification]) -> Iterator[Table]:
    for name in CHANNELS:
        rows = []
        for one in found:
            channel = one.actuator.channel(name)
            model, quality = channel.model.first_order, channel.quality
            gain = quality.gain_geometry
            off = None if gain is None else 100.0 * (model.K / gain - 1.0)
            figures = _with_error(model.K, model.K_std), _with_error(model.T, model.T_std)
            known = format_measured(off, 2), share(quality.fit_percent)
            rows.append(
                (
                    str(one.run_id),
                    format_measured(one.actuator.model.S_nominal, 4),
                    *figures,
                    *known,
                    str(quality.grade),
                )
            )
        if rows:
            columns = (
                _RUN,
                Column("S", "N·m/rad"),
                Column("K", _UNITS[name]),
                Column("T", "s"),
                Column("K vs. geometry", "%"),
                Column("fit", "%"),
                _GRADE,
            )
            yield Table(messages.models_of_series(name=name), columns, tuple(rows))


def _friction(sources: Sequence[RunData]) -> tuple[Paragraph, ...]:
    """Return the load-dependent friction estimated from all actuator identifications.

    Returns nothing if there are none.
    """
    if not sources:
        return ()
    found = estimate_run_friction([(source.run, source.columns) for source in sources])
    return (Paragraph(". ".join((found.sentence, *found.left_out, f"{MOTOR_B[0].upper()}{MOTOR_B[1:]}")) + "."),)


def _with_error(value: float | None, std: float | None) -> str:
    return f"{format_measured(value, 4)} ± {format_measured(std, 2)}"


# Impact --------------------------------------------------------------------------------------------
# Impacts in a report: a table of hits, their force over time, and the effect of the contact reaction.


_BEFORE = 20
"""Number of samples drawn before the contact."""

_HUES = tuple(COLOURS.values())


def impact_tables(hits: Sequence[Hit], angles: AngleUnit) -> tuple[Table, ...]:
    """Return a table of all hits, and one of pairs without and with reaction.

    The second table is left out if there are no such pairs.
    """
    return hits_table(hits, angles), *reaction_tables(hits, angles)


def hits_table(hits: Sequence[Hit], angles: AngleUnit) -> Table:
    """Return a table of all hits in order."""
    columns = (
        Column("Time", "s"),
        Column("S_ref", get_display_unit("N·m/rad", angles).unit),
        Column("Approach", get_display_unit("rad/s", angles).unit),
        Column("Peak force", "N"),
        Column("Impulse", "N·s"),
        Column("In contact", "ms"),
        Column("Threshold", "N"),
        Column("Detected after", "ms"),
        Column("Reaction after", "ms"),
        Column("Peak after", "ms"),
    )
    rows = tuple(
        (
            format_measured(hit.window.start * T_s, 4),
            format_measured(convert_to_display(hit.S_ref, "N·m/rad", angles)),
            format_figure(convert_to_display(hit.speed, "rad/s", angles) if np.isfinite(hit.speed) else None),
            format_measured(hit.peak_N, 3),
            format_measured(hit.impulse_Ns, 3),
            format_measured(1e3 * hit.contact_s, 3),
            format_measured(hit.contact_N, 3) if hit.reacts else NO_FIGURE,
            *(_ms(time_s, hit) for time_s in (hit.detection_s, hit.reaction_s, hit.to_peak_s)),
        )
        for hit in hits
    )
    return Table(
        messages.all_hits(),
        columns,
        rows,
    )


def _ms(time_s: float, hit: Hit) -> str:
    if not hit.reacts:
        return NO_FIGURE
    return f"{1e3 * time_s:.0f}" if np.isfinite(time_s) else messages.not_detected()


def reaction_tables(hits: Sequence[Hit], angles: AngleUnit) -> tuple[Table, ...]:
    """Return pairs of hits without and with reaction at equal stiffness and speed.

    Returns nothing if there are none.
    """
    pairs, _ = pair_hits(hits)
    if not pairs:
        return ()
    columns = (
        Column("S_ref", get_display_unit("N·m/rad", angles).unit),
        Column("Approach", get_display_unit("rad/s", angles).unit),
        Column("Peak without", "N"),
        Column("Peak with", "N"),
        Column("Ratio with/without"),
        Column("Impulse without", "N·s"),
        Column("Impulse with", "N·s"),
        Column("Ratio with/without"),
    )
    rows = tuple(
        (
            format_measured(convert_to_display(plain.S_ref, "N·m/rad", angles)),
            format_measured(convert_to_display(plain.speed, "rad/s", angles)),
            format_measured(plain.peak_N, 3),
            format_measured(reacted.peak_N, 3),
            format_measured(reacted.peak_N / plain.peak_N, 3),
            format_measured(plain.impulse_Ns, 3),
            format_measured(reacted.impulse_Ns, 3),
            format_measured(reacted.impulse_Ns / plain.impulse_Ns, 3),
        )
        for plain, reacted in sorted(pairs, key=lambda pair: (pair[0].S_ref, pair[0].speed))
    )
    return (Table(messages.comparable_hits(), columns, rows),)


@cached_figure
def impact_panels(columns: Columns, hits: Sequence[Hit], name: str, angles: AngleUnit) -> str:
    """Draw the force of each hit from contact on, and peak and impulse over speed."""
    force = np.abs(columns["F_wall"])
    groups = sorted({(hit.reacts, round(hit.S_ref, 6)) for hit in hits})
    stiffnesses = sorted({S for _, S in groups})
    with figure(3, height_in=5.4, gap_in=(0.5, 0.6)) as (drawn, axes):
        for reacts, S in groups:
            alike = [hit for hit in hits if (hit.reacts, round(hit.S_ref, 6)) == (reacts, S)]
            colour = _HUES[stiffnesses.index(S) % len(_HUES)]
            line = {"color": colour, "linestyle": (0, (4, 2)) if reacts else "-"}
            label = f"S = {convert_to_display(S, 'N·m/rad', angles):.3g} {get_display_unit('N·m/rad', angles).unit}"
            label += ", with reaction" if reacts else ""
            for place, hit in enumerate(alike):
                first = max(hit.window.start - _BEFORE, 0)
                shape = force[first : hit.window.stop + _BEFORE]
                t = 1e3 * (np.arange(shape.size) - (hit.window.start - first)) * T_s
                axes[0].plot(t, shape, linewidth=0.8, label=label if place == 0 else None, **line)
                if np.isfinite(hit.reaction_s):
                    at = round((hit.detection_s + hit.reaction_s) / T_s)
                    axes[0].plot(1e3 * at * T_s, force[hit.window.start + at], "o", color=colour, markersize=3.0)
            speeds = in_unit(np.array([hit.speed for hit in alike]), "rad/s", angles)
            order = np.argsort(speeds)
            marks = {"marker": "o", "markersize": 3.5, "markerfacecolor": "white" if reacts else colour}
            for panel, values in (
                (axes[1], [hit.peak_N for hit in alike]),
                (axes[2], [hit.impulse_Ns for hit in alike]),
            ):
                panel.plot(speeds[order], np.array(values)[order], **marks, **line)
        axes[0].set(xlabel="time since the contact [ms]", ylabel="$|F_{wall}|$ [N]")
        axes[1].set(xlabel=axis_label("approach speed", "rad/s", angles), ylabel="peak [N]")
        axes[2].set(xlabel=axis_label("approach speed", "rad/s", angles), ylabel="impulse [N·s]")
        for panel in axes:
            panel.set_ylim(bottom=0.0)
        for panel, letter in zip(axes, "ABC", strict=True):
            panel_letter(panel, letter)
        upper_legend(axes[0])
        return to_svg(drawn, name)


# Pushes --------------------------------------------------------------------------------------------
# Pushes in a report: the measured response, the response expected with the gains in use, and the static deflection of
# the stiffness alone.


PUSH_NOTES = (
    messages.how_pushes_are_predicted(),
    messages.static_deflection(),
)


def pushes_section(columns: Columns, found: Sequence[MeasuredPush], angles: AngleUnit) -> ReportSection:
    """Return figure and table of pushes; ``found`` is not empty."""
    return ReportSection("Pushes", tuple(_push_blocks(columns, found, angles)))


def _push_blocks(columns: Columns, found: Sequence[MeasuredPush], angles: AngleUnit) -> Iterator[Block]:
    yield Figure(
        "pushes",
        push_panels(columns, found, "pushes", angles),
        messages.pushes_figure(),
    )
    yield push_table(found, angles)
    if why := next((one.unpredicted for one in found if one.unpredicted), ""):
        yield Paragraph(messages.not_all_pushes_predicted(reason=why))


def push_table(found: Sequence[MeasuredPush], angles: AngleUnit) -> Table:
    """Return a table of pushes: measured, expected and static peak, and recovery time."""
    angle = get_display_unit("rad", angles).unit
    columns = (
        Column("Push", number=False),
        Column("From", "s"),
        Column("S_ref", "N·m/rad"),
        Column("F", "N"),
        Column("Impulse", "N·s"),
        Column("Peak of q", angle),
        Column("Predicted", angle),
        Column("Error", "%"),
        Column("Static", angle),
        Column("Peak of S", "N·m/rad"),
        Column("Recovery", "s"),
    )
    rows = tuple(
        (
            one.window.shape,
            format_measured(one.window.pushed.start * T_s, 4),
            format_measured(one.S, 4),
            format_measured(one.F, 3),
            format_measured(one.impulse, 3),
            format_measured(convert_to_display(one.peak_q, "rad", angles), 4),
            NO_FIGURE
            if one.expected_peak is None
            else format_measured(convert_to_display(one.expected_peak, "rad", angles), 4),
            format_measured(one.off_percent, 2),
            NO_FIGURE
            if one.window.shape == "impulse"
            else format_measured(convert_to_display(one.static, "rad", angles), 4),
            format_measured(one.peak_S, 2),
            format_measured(one.back_s, 3),
        )
        for one in found
    )
    return Table(messages.pushes_table(tolerance_rad=0.01), columns, rows)


@cached_figure
def push_panels(columns: Columns, found: Sequence[MeasuredPush], name: str, angles: AngleUnit) -> str:
    """Draw force, deviation of the joint with the expected one, and of the stiffness."""
    first, last = found[0].window.pushed.start, max(one.window.until for one in found)
    window = slice(max(first - round(1.0 / T_s), 0), min(last, columns["t"].size))
    t = columns["t"][window]
    with figure(4, height_in=5.2, sharex=True, height_ratios=(2, 3, 2, 2)) as (drawn, axes):
        axes[0].plot(*decimate(t, columns["F_push"][window]), color=INK, label="$F_{push}$")
        axes[0].set_ylabel("Force [N]")
        off = columns["q"][window] - columns["q_ref"][window]
        axes[1].plot(*decimate(t, in_unit(off, "rad", angles)), color=COLOURS["q"], label="$q$")
        apart: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        for place, one in enumerate(found):
            if one.expected is None:
                continue
            start = one.window.pushed.start
            at, label = columns["t"][start : start + one.expected.size], "predicted" if place == 0 else None
            expected = in_unit(one.expected, "rad", angles)
            axes[1].plot(*decimate(at, expected), color=INK, linewidth=0.7, linestyle=(0, (4, 2)), label=label)
            before = max(start - round(PUSH_REST_S / T_s), 0)
            measured = columns["q"][start : start + one.expected.size] - columns["q"][before : start + 1].mean()
            apart.append((at[: measured.size], in_unit(measured - one.expected[: measured.size], "rad", angles)))
        reach = max((float(np.abs(error).max(initial=0.0)) for _, error in apart), default=0.0)
        angle = get_display_unit("rad", angles).unit
        for at, error in apart:
            draw_error(axes[2], at, error, "difference", angle, colour=COLOURS["q"], reach=reach)
        axes[1].set_ylabel(axis_label("deviation", "rad", angles))
        off_S = columns["S"][window] - columns["S_ref"][window]
        steps = np.flatnonzero(np.diff(columns["S_ref"][window]) != 0.0)
        if steps.size:  # the steps themselves do not count as deviation
            reach = 1.2 * max(max(one.peak_S for one in found), 1e-3)
            axes[3].set_ylim(-reach, reach)
        axes[3].plot(*decimate(t, off_S), color=COLOURS["S"], label="$S$")
        axes[3].set(xlabel="t [s]", ylabel="S − S_ref [N·m/rad]".replace("S_ref", "$S_{ref}$"), xlim=(t[0], t[-1]))
        for panel, letter in zip(axes, "ABCD", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)
