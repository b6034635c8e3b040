"""Reports of identifications of actuator, motors and springs."""

from collections.abc import Mapping

import numpy as np

from backend.identification import TABLE_1, Residuals, read_whiteness_test, worst_grade
from backend.models import (
    CHANNELS,
    ArxEstimate,
    ChannelName,
    FailedCandidate,
    IdentifiedChannel,
    MotorConstants,
    MotorsResult,
    SpringModel,
    SpringResult,
    TriedStructure,
    UnreadableDocumentError,
)
from backend.reports import messages
from backend.reports.model import (
    NO_FIGURE,
    Block,
    Code,
    Column,
    Fact,
    Figure,
    Paragraph,
    Report,
    ReportSection,
    Table,
    exact,
    format_measured,
    share,
)
from backend.reports.model_code import actuator_blocks, motor_blocks, spring_blocks
from backend.reports.plotting import (
    COLOURS,
    INK,
    LIMIT_GREY,
    STEP_RAD,
    WRITTEN,
    axis_label,
    bode_panels,
    build_model,
    cached_figure,
    figure,
    identification_step_panels,
    in_unit,
    panel_letter,
    record_panels,
    residual_panels,
    to_svg,
    upper_legend,
)
from backend.reports.provenance import (
    OUTCOMES,
    facts,
    measured_figures,
    parameter_section,
    reproduction,
    settings_table,
    subtitle,
)
from backend.reports.run_data import RunData
from backend.storage import Identification, read_method_name
from backend.units import AngleUnit
from plant import (
    SIDES,
)

# Actuator identification ---------------------------------------------------------------------------
# The report of an actuator identification: models, their quality, and comparison with the paper.


_STRUCTURES = {"first": "K/(Ts+1)", "third": "third order", "lags4": "K/(τs+1)⁴"}

_ACTUATOR_NOTES = (
    messages.S_is_an_estimate(),
    messages.gains_are_for_one_motor(),
    messages.fit_is_of_simulation(),
    messages.table_1_has_other_conditions(),
)


def actuator_identification_report(source: RunData) -> Report:
    """Build the report; for a run without a model it says why."""
    found, problem = source.identification, source.result.metrics.problem if source.result else ""
    tension_N = held_N(source)
    sections = []
    if found is not None:
        sections += [
            ReportSection(
                "Models",
                (
                    _models(found),
                    _candidates(found),
                    _comparison(found, tension_N),
                    *measured_figures(source),
                ),
            ),
            ReportSection("Coefficients", actuator_blocks(found.actuator.model)),
        ]
    sections.append(
        ReportSection(
            messages.settings_and_origin(), (settings_table(source), *reproduction(source), *_actuator_data(found))
        )
    )
    if found is not None:
        sections.append(ReportSection("Figures", _actuator_figures(source, found)))
    sections += [
        ReportSection("Notes", tuple(Paragraph(note) for note in _ACTUATOR_NOTES)),
        parameter_section(source),
    ]
    return Report(
        title=messages.actuator_identification_at(tension_N=tension_N),
        subtitle=subtitle(source),
        outcome=_actuator_outcome(found),
        verdict=found.verdict if found else problem or messages.no_model(),
        facts=(*facts(source), *_point(found)),
        sections=tuple(sections),
        footer=messages.footer(software=source.run.software, report="actuator identification", run_id=source.run.id),
        date=source.run.started_at,
    )


def held_N(source: RunData) -> float:
    """Return the tension [N] during the run, from the plan.

    Raises UnreadableDocumentError.
    """
    tension = (source.run.set_to.plan or {}).get("tension_N")
    if not isinstance(tension, int | float):
        raise UnreadableDocumentError(messages.plan_without_tension(run_id=source.run.id))
    return tension


def _actuator_outcome(found: Identification | None) -> str:
    if found is None:
        return "incomplete"
    return OUTCOMES[worst_grade(*(found.actuator.channel(key).quality.grade for key in CHANNELS))]


def _point(found: Identification | None) -> tuple[Fact, ...]:
    if found is None:
        return ()
    q, S = found.actuator.model.q_nominal, found.actuator.model.S_nominal
    return (Fact("Operating point", messages.operating_point(q=q, S=S)),)


def _models(found: Identification) -> Table:
    columns = (
        Column("Model", number=False),
        Column("Structure", number=False),
        Column("K"),
        Column("±"),
        Column("K geometry"),
        Column("Error", "%"),
        Column("T", "s"),
        Column("±", "s"),
        Column("Fit", "%"),
        Column("Residuals", number=False, wide=True),
    )
    rows = tuple(_model_row(key, found.actuator.channel(key)) for key in CHANNELS)
    return Table(
        messages.transfer_functions(),
        columns,
        rows,
    )


def _model_row(key: str, channel: IdentifiedChannel) -> tuple[str, ...]:
    model, quality = channel.model, channel.quality
    reduced, error = model.first_order, quality.gain_error_percent
    return (
        key,
        _structure(model.structure),
        format_measured(reduced.K, 4),
        format_measured(reduced.K_std, 2),
        format_measured(quality.gain_geometry, 4),
        ("+" if error is not None and error > 0 else "") + format_measured(error, 2),
        format_measured(reduced.T),
        format_measured(reduced.T_std, 2),
        share(quality.fit_percent),
        _residuals(quality.residuals),
    )


def _residuals(tests: Residuals) -> str:
    white, free = read_whiteness_test(tests.whiteness), read_whiteness_test(tests.input_correlation)
    return messages.residual_tests(
        is_white=white.passed,
        white=white.statistic,
        white_max=white.critical,
        is_independent=free.passed,
        cross=free.statistic,
        cross_max=free.critical,
    )


def _actuator_figures(source: RunData, found: Identification) -> tuple[Block, ...]:
    angles = source.angles
    columns, start, period_s = source.columns, found.actuator_record.first_sample, found.actuator_record.period_s
    channels = {key: found.actuator.channel(key).model for key in CHANNELS}
    models = {key: build_model(channel) for key, channel in channels.items()}
    residuals = {key: found.actuator.channel(key).quality.residuals for key in CHANNELS}
    return (
        Figure(
            "record",
            record_panels(columns=columns, start=start, models=models, period_s=period_s, name="record", angles=angles),
            messages.record_figure(),
        ),
        Figure(
            "bode",
            bode_panels(columns, start, channels, period_s, "bode"),
            messages.model_bode_figure(),
        ),
        Figure(
            "step",
            identification_step_panels(channels, "step", angles),
            messages.step_response_figure(step_rad=STEP_RAD[angles], angles=angles),
        ),
        Figure(
            "residuals",
            residual_panels(residuals, "residuals"),
            messages.residuals_figure(),
        ),
    )


def _candidates(found: Identification) -> Table:
    columns = (
        Column("Model", number=False),
        Column("Structure", number=False),
        Column("K"),
        Column("T", "s"),
        Column("Fit", "%"),
        Column("BIC"),
        Column("Grade", number=False, wide=True),
    )
    rows = []
    for key in CHANNELS:
        for item in found.actuator.channel(key).quality.candidates:
            rows.append((key, _structure(item.structure), *_make_candidate_row(item)))
    return Table(
        messages.candidate_structures(),
        columns,
        tuple(rows),
    )


def _make_candidate_row(item: TriedStructure | FailedCandidate) -> tuple[str, ...]:
    if isinstance(item, FailedCandidate):
        return (*4 * (NO_FIGURE,), item.problem)
    BIC = NO_FIGURE if item.BIC is None else f"{item.BIC:.0f}".replace("-", "−")
    return (
        format_measured(item.K, 4),
        format_measured(item.T),
        share(item.fit_percent),
        BIC,
        item.problem or item.grade,
    )


def _structure(name: str) -> str:
    return _STRUCTURES.get(name, name.replace(":", " "))


def _comparison(found: Identification, tension_N: float) -> Table:
    nearest = min(TABLE_1, key=lambda tension: abs(tension - tension_N))
    row = TABLE_1[nearest]
    columns = (
        Column("Transfer function", number=False, wide=True),
        Column("K, this run"),
        Column("K, geometry"),
        Column("K, ARX"),
        Column("K, table 1"),
        Column("T, this run", "s"),
        Column("T, ARX", "s"),
        Column("T, table 1", "s"),
    )
    paper = {"G_q": (row.K_q, row.T_q), "G_S": (row.K_S, row.T_S)}
    channels = {key: found.actuator.channel(key) for key in CHANNELS}
    rows = tuple(_make_comparison_row(key, channel, *paper[key]) for key, channel in channels.items())
    missing: dict[str, str | None] = {
        key: arx.problem if arx else None
        for key, arx in ((key, channel.quality.arx) for key, channel in channels.items())
        if not isinstance(arx, ArxEstimate)
    }
    return Table(messages.compared_with_table_1(tension_N=nearest, missing=missing), columns, rows)


def _make_comparison_row(key: str, channel: IdentifiedChannel, K: float, T: float) -> tuple[str, ...]:
    first_order, arx = channel.model.first_order, channel.quality.arx
    by_arx = (arx.K, arx.T) if isinstance(arx, ArxEstimate) else (None, None)
    return (
        key,
        format_measured(first_order.K, 4),
        format_measured(channel.quality.gain_geometry, 4),
        format_measured(by_arx[0], 4),
        format_measured(K, 4),
        format_measured(first_order.T),
        format_measured(by_arx[1]),
        format_measured(T),
    )


def _actuator_data(found: Identification | None) -> tuple[Block, ...]:
    if found is None:
        return ()
    data = found.actuator_record
    text = messages.actuator_samples_used(
        run_id=found.run_id,
        samples=data.samples,
        period_s=data.period_s,
        first_sample=data.first_sample,
        method=read_method_name(found),
    )
    again = "\n".join(build_estimate_command(found, key) for key in CHANNELS)
    return (Paragraph(text), Code(messages.commands_repeat_estimate(), again))


def build_estimate_command(found: Identification, key: ChannelName) -> str:
    """Return the command that repeats the estimate of a channel from exported samples.

    It gives the same figures and the same verdict.
    """
    data, channel = found.actuator_record, found.actuator.channel(key)
    known = {"--gain": channel.quality.gain_geometry, "--resolution": channel.quality.y_resolution}
    words = [f"{name} {value!r}" for name, value in known.items() if value is not None]
    if (estimator := found.actuator_options.estimator) is not None:  # earlier versions had one only
        words.append(f"--method {estimator}")
    lines = (
        f"sinew identify data data.csv --input theta_A_ref --output {WRITTEN[key][0]}",
        f"--period {data.period_s:g} --skip {data.first_sample} --structure {channel.model.structure}",
        " ".join(words),
    )
    return " \\\n  ".join(line for line in lines if line)


# Motor identification ------------------------------------------------------------------------------
# The report of a motor identification: both estimates of both motors, and how well they fit the steps.


PAPER = MotorConstants(K_m=2.86, T_m=0.22)
"""The motor of the paper: K_m [rad/(V·s)], T_m [s]."""

_MOTOR_NOTES = (
    messages.how_motors_are_fitted(),
    messages.how_rule_estimates_motors(),
    messages.tendons_were_slack(),
)


def motor_identification_report(source: RunData) -> Report:
    """Build the report; for a run without a model it says why."""
    found, problem = source.identification, source.result.metrics.problem if source.result else ""
    sections = []
    if found is not None:
        tables: list[Block] = [
            _estimates(found.motors),
            _rule(found.motors),
            *motor_blocks({side: found.motors.side(side).model for side in SIDES}),
            *_make_rejected_table(found.motors),
        ]
        sections.append(ReportSection("Motors", (*tables, *measured_figures(source))))
    sections.append(
        ReportSection(
            messages.settings_and_origin(), (settings_table(source), *reproduction(source), *_in_force(source))
        )
    )
    if found is not None:
        sections.append(ReportSection("Figures", _motor_figures(found.motors, source.angles)))
    sections += [ReportSection("Notes", tuple(Paragraph(note) for note in _MOTOR_NOTES)), parameter_section(source)]
    return Report(
        title="Motor identification",
        subtitle=subtitle(source),
        outcome=_motor_outcome(found),
        verdict=found.verdict if found else problem or messages.no_model(),
        facts=facts(source),
        sections=tuple(sections),
        footer=messages.footer(software=source.run.software, report="motor identification", run_id=source.run.id),
        date=source.run.started_at,
    )


def _motor_outcome(found: Identification | None) -> str:
    if found is None:
        return "incomplete"
    return OUTCOMES[worst_grade(*(found.motors.side(side).quality.grade for side in SIDES))]


def _estimates(motors: MotorsResult) -> Table:
    columns = (
        Column("Motor", number=False),
        Column("Estimate", number=False, wide=True),
        Column("K_m", "rad/(V·s)"),
        Column("±"),
        Column("T_m", "s"),
        Column("±", "s"),
        Column("u_c", "V"),
        Column("±", "V"),
    )
    rows: list[tuple[str, ...]] = []
    for side in SIDES:
        item = motors.side(side).model
        fitted, std, mean, spread = item.parameters, item.std_errors, item.rule_mean, item.rule_spread
        values = [
            text
            for value, error in ((fitted.K_m, std.K_m), (fitted.T_m, std.T_m), (fitted.u_c, std.u_c))
            for text in (format_measured(value, 4), format_measured(error, 2))
        ]
        rows.append((side, messages.least_squares_estimate(), *values))
        ruled = [
            text
            for value, error in ((mean.K_m, spread.K_m), (mean.T_m, spread.T_m))
            for text in (format_measured(value, 4), format_measured(error, 2))
        ]
        rows.append((side, messages.rule_estimate(), *ruled, NO_FIGURE, NO_FIGURE))
        rows.append(
            (
                side,
                messages.previously_active(),
                format_measured(item.before.K_m, 4),
                NO_FIGURE,
                format_measured(item.before.T_m),
                NO_FIGURE,
                NO_FIGURE,
                NO_FIGURE,
            )
        )
    rows.append(
        (
            "both",
            "the paper",
            format_measured(PAPER.K_m),
            NO_FIGURE,
            format_measured(PAPER.T_m),
            NO_FIGURE,
            NO_FIGURE,
            NO_FIGURE,
        )
    )
    return Table(messages.models_of_motors(), columns, tuple(rows))


def _rule(motors: MotorsResult) -> Table:
    columns = (
        Column("Step", "V"),
        *(Column(f"{name} of {side}", unit) for side in SIDES for name, unit in (("K_m", "rad/(V·s)"), ("T_m", "s"))),
    )
    by_voltage = [{item.voltage: item for item in motors.side(side).model.rule} for side in SIDES]
    voltages = sorted({voltage for ruled in by_voltage for voltage in ruled})
    nothing = MotorConstants(None, None)
    rows = tuple(
        (
            exact(voltage),
            *(
                text
                for item in (ruled.get(voltage, nothing) for ruled in by_voltage)
                for text in (format_measured(item.K_m, 4), format_measured(item.T_m))
            ),
        )
        for voltage in voltages
    )
    return Table(messages.rule_for_each_step(), columns, rows)


def _make_rejected_table(motors: MotorsResult) -> tuple[Table, ...]:
    refused = [(side, item) for side in SIDES for item in motors.side(side).quality.refused]
    rows = tuple((side, exact(item.voltage), item.reason) for side, item in refused)
    columns = (Column("Motor", number=False), Column("Step", "V"), Column("Reason", number=False, wide=True))
    return (Table(messages.rejected_steps(), columns, rows),) if rows else ()


def _in_force(source: RunData) -> tuple[Paragraph, ...]:
    found = source.identification
    if found is None:
        return ()
    fitted = {side: found.motors.side(side).model.parameters for side in SIDES}
    models = {side: (item.K_m, item.T_m) for side, item in fitted.items()}
    return (Paragraph(messages.motors_of_parameter_file(run_id=found.run_id, models=models)),)


def _motor_figures(motors: MotorsResult, angles: AngleUnit) -> tuple[Block, ...]:
    return (
        Figure(
            "steps",
            step_panels(motors, "steps", angles),
            messages.motor_steps_figure(),
        ),
    )


@cached_figure
def step_panels(motors: MotorsResult, name: str, angles: AngleUnit) -> str:
    """Draw every step of both motors and the residual of the model."""
    with figure(2, 2, height_in=4.0, sharex=True, height_ratios=(3, 2)) as (drawn, axes):
        for column, side in enumerate(SIDES):
            turn, left = axes[0][column], axes[1][column]
            for item in motors.side(side).quality.steps:
                t, measured, model = (np.array(values) for values in (item.t, item.measured, item.model))
                apart = in_unit(1e3 * (measured - model), "mrad", angles)
                measured, model = (in_unit(turned, "rad", angles) for turned in (measured, model))
                turn.plot(t, measured, color=COLOURS[f"u_{side}"], linewidth=1.0)
                turn.plot(t, model, color=INK, linewidth=0.6, linestyle=(0, (4, 2)))
                turn.annotate(f"{item.voltage:+.3g} V".replace("-", "−"), (t[-1], measured[-1]), fontsize=6)
                left.plot(t, apart, color=COLOURS[f"u_{side}"], linewidth=0.7)
            turn.margins(x=0.12)
            turn.set_ylabel(axis_label(f"rotation of motor {side}", "rad", angles))
            left.set(xlabel="t from the step [s]", ylabel=axis_label("difference", "mrad", angles))
            panel_letter(turn, "AB"[column])
            panel_letter(left, "CD"[column])
        return to_svg(drawn, name)


# Spring identification -----------------------------------------------------------------------------
# The report of a spring identification: polynomials of several orders, their errors, and the recommended order.


_ORDER_COLOURS = {2: INK, 3: COLOURS["u_B"], 5: COLOURS["u_A"]}

_SPRING_NOTES = (
    messages.elongations_are_relative(),
    messages.how_springs_are_fitted(),
    messages.springs_show_hysteresis(),
)


def spring_identification_report(source: RunData) -> Report:
    """Build the report; for a run without a model it says why."""
    found, problem = source.identification, source.result.metrics.problem if source.result else ""
    sections = []
    if found is not None:
        tables = tuple(_fits(side, found.springs[side].model) for side in SIDES)
        code = spring_blocks({side: found.springs[side].model for side in SIDES})
        sections.append(ReportSection("Springs", (*tables, *_reasons(found.springs), *code, *measured_figures(source))))
    sections.append(
        ReportSection(
            messages.settings_and_origin(), (settings_table(source), *reproduction(source), *_spring_data(source))
        )
    )
    if found is not None:
        sections.append(ReportSection("Figures", _spring_figures(found.springs)))
    sections += [ReportSection("Notes", tuple(Paragraph(note) for note in _SPRING_NOTES)), parameter_section(source)]
    return Report(
        title="Spring identification",
        subtitle=subtitle(source),
        outcome="incomplete" if found is None else "passed" if found.usable else "failed",
        verdict=found.verdict if found else problem or messages.no_model(),
        facts=facts(source),
        sections=tuple(sections),
        footer=messages.footer(software=source.run.software, report="spring identification", run_id=source.run.id),
        date=source.run.started_at,
    )


def _fits(side: str, model: SpringModel) -> Table:
    columns = (
        Column("Order"),
        Column("k_0 ± [N], k_1 ± [N/m], k_2 ± [N/m²] …", number=False, wide=True),
        Column("RMS", "N"),
        Column("Max. error", "N"),
        Column("Cross-validation", "N"),
        Column("Use", number=False),
    )
    rows = tuple(
        (
            str(fit.order),
            ", ".join(
                f"{format_measured(k, 5)} ± {format_measured(std, 2)}"
                for k, std in zip(fit.k, fit.std_errors, strict=True)
            ),
            format_measured(fit.rms_N),
            format_measured(fit.max_N),
            format_measured(fit.cross_validation_N),
            "recommended" if fit.order == model.recommended else "" if fit.rising else "not monotonic",
        )
        for fit in model.fits
    )
    return Table(messages.polynomials_of_spring(side=side, before=model.before or ()), columns, rows)


def _reasons(springs: Mapping[str, SpringResult]) -> tuple[Paragraph, ...]:
    return tuple(Paragraph(messages.order_of_spring(side=side, reason=springs[side].model.reason)) for side in SIDES)


def _spring_data(source: RunData) -> tuple[Paragraph, ...]:
    found = source.identification
    if found is None:
        return ()
    pairs = found.springs["A"].quality.pairs
    return (Paragraph(messages.spring_pairs_used(run_id=found.run_id, pairs=pairs)),)


def _spring_figures(springs: Mapping[str, SpringResult]) -> tuple[Block, ...]:
    return (
        Figure(
            "springs",
            spring_panels(springs, "springs"),
            messages.springs_figure(),
        ),
    )


SMALL_N = 0.05
"""Errors below this limit [N] are drawn in mN, because tick labels in N would be too long for the axis."""


@cached_figure
def spring_panels(springs: Mapping[str, SpringResult], name: str) -> str:
    """Draw force over elongation of both springs, and errors of each order (figure 3)."""
    with figure(2, 2, height_in=4.6, sharex=True, height_ratios=(3, 3)) as (drawn, axes):
        for column, side in enumerate(SIDES):
            force, error = axes[0][column], axes[1][column]
            found, recommended = springs[side].quality, str(springs[side].model.recommended)
            x, rising = 1e3 * np.array(found.x), np.array(found.rising)
            colour = COLOURS[f"F_{side}"]
            force.plot(x, found.F, color=colour, linestyle="none", marker="o", markersize=1.6, label="pairs")
            curve_x, curve = 1e3 * np.array(found.curve_x), found.curve[recommended]
            force.plot(curve_x, curve, color=INK, linewidth=0.8, label=f"order {recommended}")
            force.set_ylabel(f"$F_{side}$ [N]")
            upper_legend(force)
            small = max(np.max(np.abs(errors)) for errors in found.errors.values()) < SMALL_N
            factor, unit = (1e3, "mN") if small else (1.0, "N")
            for order, errors in found.errors.items():
                drawn_in = _ORDER_COLOURS.get(int(order), LIMIT_GREY)
                for direction, marker in ((rising, "."), (~rising, "x")):
                    label = f"order {order}" if marker == "." else None
                    style = {"color": drawn_in, "linestyle": "none", "marker": marker, "markersize": 2.0}
                    error.plot(
                        x[direction], factor * np.array(errors)[direction], label=label, markeredgewidth=0.4, **style
                    )
            error.axhline(0.0, color=LIMIT_GREY, linewidth=0.5)
            error.set(xlabel=f"$x_{side}$ [mm]", ylabel=f"error [{unit}]")
            error.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
            panel_letter(force, "AB"[column])
            panel_letter(error, "CD"[column])
        return to_svg(drawn, name)
