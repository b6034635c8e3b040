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
    S_NOTE,
    facts,
    measured_figures,
    parameter_section,
    reproduction,
    settings_table,
    subtitle,
)
from backend.reports.run_data import RunData
from backend.storage import Identification, read_method_name
from backend.units import AngleUnit, format_quantity
from plant import (
    SIDES,
    Angle,
)

# Actuator identification ---------------------------------------------------------------------------
# The report of an actuator identification: models, their quality, and comparison with the paper.


_STRUCTURES = {"first": "K/(Ts+1)", "third": "third order", "lags4": "K/(τs+1)⁴"}

_ACTUATOR_NOTES = (
    S_NOTE,
    "Gains are for one motor: through the decoupler both motors move, which doubles them, and the controllers are "
    "scaled for that (erratum E3). T is the sum of the model's time constants and dead time (sum of "
    "lags), K its static gain; the λ formulas use K and T.",
    "The fit in percent is that of a simulation on the last third of the record by a model fitted to the first two "
    "thirds. Standard errors allow for coloured residuals; they do not cover effects that the structure omits.",
    "The paper's table 1 was fitted as first order to a 1 ms sequence on the real rig, where friction grows with "
    "tension. Agreement with its T and its gains of G_S is therefore not expected; agreement with its "
    "gains of G_q and with the geometry is.",
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
        ReportSection("Settings and origin", (settings_table(source), *reproduction(source), *_actuator_data(found)))
    )
    if found is not None:
        sections.append(ReportSection("Figures", _actuator_figures(source, found)))
    sections += [
        ReportSection("Notes", tuple(Paragraph(note) for note in _ACTUATOR_NOTES)),
        parameter_section(source),
    ]
    return Report(
        title=f"Actuator identification at {exact(tension_N)} N",
        subtitle=subtitle(source),
        outcome=_actuator_outcome(found),
        verdict=found.verdict if found else problem or "No model: the run contains no samples.",
        facts=(*facts(source), *_point(found)),
        sections=tuple(sections),
        footer=f"Sinew {source.run.software} · actuator identification · run {source.run.id}",
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
    at = "" if q is None else f"q = {Angle(q):.6g}, "
    return (Fact("Point", f"{at}S = {format_measured(S, 4)} N·m/rad at rest before the excitation"),)


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
        "Transfer functions from θ_A,ref to q [rad/rad] and to S [N·m/rad per rad]: static gain K and sum of lags T "
        "with standard errors, gain against geometry, fit on validation data. Residual tests: the "
        "largest correlation in "
        "standard deviations, and its bound at the 1 % level for all lags together.",
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
    return (
        f"{'white' if white.passed else 'coloured'} ({white.statistic:.1f} of {white.critical:.1f}), "
        f"{'independent of' if free.passed else 'correlated with'} input ({free.statistic:.1f} of {free.critical:.1f})"
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
            "The record: (A) excitation on the held tension, (B) joint position and (D) joint stiffness, each with the "
            "identified model simulated from rest on the recorded input (dashed), (C, E) measured less simulated, "
            "(F, G) tendon tensions.",
        ),
        Figure(
            "bode",
            bode_panels(columns, start, channels, period_s, "bode"),
            "Frequency responses of (A, C) G_q and (B, D) G_S: identified model, its first-order reduction (dashed), "
            "and a non-parametric estimate from the data where the coherence exceeds 0.9 (dots).",
        ),
        Figure(
            "step",
            identification_step_panels(channels, "step", angles),
            "Response of (A) G_q and (B) G_S to a step of θ_A,ref by "
            f"{format_quantity(STEP_RAD[angles], 'rad', angles)}, and of their first-order reductions (dashed).",
        ),
        Figure(
            "residuals",
            residual_panels(residuals, "residuals"),
            "Residual autocorrelation (A, B) and input–residual cross-correlation (C, D). Grey: the "
            "bounds of the tests; for a complete model, all correlations stay within them in 99 of 100 records.",
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
        "Candidate structures for the same record, best first (usable before unusable, then by BIC).",
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
    title = (
        f"First-order models compared with the paper's table 1 at {exact(nearest)} N. ARX: the "
        "paper's method, first order with a low-pass filter, on the same record, for comparison only. "
        f"{_missing_arx(channels)}"
    )
    return Table(title.strip(), columns, rows)


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


def _missing_arx(channels: Mapping[ChannelName, IdentifiedChannel]) -> str:
    found = {key: channel.quality.arx for key, channel in channels.items()}
    missing = {key: arx for key, arx in found.items() if not isinstance(arx, ArxEstimate)}
    return " ".join(f"{key}: {arx.problem if arx else 'not computed'}." for key, arx in missing.items())


def _actuator_data(found: Identification | None) -> tuple[Block, ...]:
    if found is None:
        return ()
    data = found.actuator_record
    text = (
        f"Identification {found.run_id} used {data.samples} samples at {exact(1e3 * data.period_s)} ms, "
        f"from sample {data.first_sample} of that run on: input θ_A,ref, outputs q and S. "
        f"Method: {read_method_name(found)}."
    )
    again = "\n".join(build_estimate_command(found, key) for key in CHANNELS)
    return (Paragraph(text), Code("To estimate G_q and G_S again from data.csv, the samples of the run:", again))


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
    "A least-squares fit to the positions of all steps estimates K_m, T_m and the Coulomb voltage u_c together: "
    "T_m ω' + ω = K_m (u − u_c sign ω). u_c is omitted where it does not differ from zero at the 1 % level. Standard "
    "errors allow for coloured residuals.",
    "The 63.21 % rule is the paper's: K_m from the steady speed, T_m where the speed reaches 63.21 % of "
    "it. The rule neglects Coulomb friction, which lowers its gain most at the smallest voltage, and "
    "steps that end before the speed is steady, which lower it at the largest.",
    "Both tendons were slack during the steps. A step with saturation or with a tendon load is rejected and listed.",
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
        ReportSection("Settings and origin", (settings_table(source), *reproduction(source), *_in_force(source)))
    )
    if found is not None:
        sections.append(ReportSection("Figures", _motor_figures(found.motors, source.angles)))
    sections += [ReportSection("Notes", tuple(Paragraph(note) for note in _MOTOR_NOTES)), parameter_section(source)]
    return Report(
        title="Motor identification",
        subtitle=subtitle(source),
        outcome=_motor_outcome(found),
        verdict=found.verdict if found else problem or "No model: the run contains no samples.",
        facts=facts(source),
        sections=tuple(sections),
        footer=f"Sinew {source.run.software} · motor identification · run {source.run.id}",
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
        rows.append((side, "least squares, standard errors", *values))
        ruled = [
            text
            for value, error in ((mean.K_m, spread.K_m), (mean.T_m, spread.T_m))
            for text in (format_measured(value, 4), format_measured(error, 2))
        ]
        rows.append((side, "63.21 % rule, mean and spread", *ruled, NO_FIGURE, NO_FIGURE))
        rows.append(
            (
                side,
                "previously active",
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
    return Table("Both motors, K_m/(s (T_m s + 1)) with Coulomb voltage u_c.", columns, tuple(rows))


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
    return Table("The 63.21 % rule for each step.", columns, rows)


def _make_rejected_table(motors: MotorsResult) -> tuple[Table, ...]:
    refused = [(side, item) for side in SIDES for item in motors.side(side).quality.refused]
    rows = tuple((side, exact(item.voltage), item.reason) for side, item in refused)
    columns = (Column("Motor", number=False), Column("Step", "V"), Column("Reason", number=False, wide=True))
    return (Table("Rejected steps.", columns, rows),) if rows else ()


def _in_force(source: RunData) -> tuple[Paragraph, ...]:
    found = source.identification
    if found is None:
        return ()
    fitted = {side: found.motors.side(side).model.parameters for side in SIDES}
    entries = "; ".join(
        f"[identified_{side}] K_m = {format_measured(item.K_m, 4)}, T_m = {format_measured(item.T_m, 4)}"
        for side, item in fitted.items()
    )
    text = (
        f"Identification {found.run_id} used the voltages and motor angles of that run. The motor loops take "
        f"their model from the parameter file; to use this model, enter in that file: {entries}."
    )
    return (Paragraph(text),)


def _motor_figures(motors: MotorsResult, angles: AngleUnit) -> tuple[Block, ...]:
    return (
        Figure(
            "steps",
            step_panels(motors, "steps", angles),
            "Angle of each motor after the steps, measured (coloured) and by the least-squares model "
            "(dashed), and (C, D) their difference.",
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
            turn.set_ylabel(axis_label(rf"rotation of $\theta_{side}$", "rad", angles))
            left.set(xlabel="t from the step [s]", ylabel=axis_label("difference", "mrad", angles))
            panel_letter(turn, "AB"[column])
            panel_letter(left, "CD"[column])
        return to_svg(drawn, name)


# Spring identification -----------------------------------------------------------------------------
# The report of a spring identification: polynomials of several orders, their errors, and the recommended order.


_ORDER_COLOURS = {2: INK, 3: COLOURS["u_B"], 5: COLOURS["u_A"]}

_SPRING_NOTES = (
    "Elongations are x_A = r_m θ_A − r_j q and x_B = r_m θ_B + r_j q (equations 1 and 2). They are "
    "relative to the encoder zeros that pretension set, based on the springs active before.",
    "Each pair is a mean over 0.1 s. Cross-validation error: the error at each pair of a polynomial "
    "fitted to all other pairs. A higher order is recommended only if it reduces this error by at least 20 % "
    "and increases monotonically; the analytic decoupler needs order 2. The paper's order 2 stayed below 0.85 N.",
    "The curves for rising and falling force differ (hysteresis) because of the load cells' delay and of "
    "friction between spring and load cell; the polynomial is fitted to both curves and lies between them.",
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
        ReportSection("Settings and origin", (settings_table(source), *reproduction(source), *_spring_data(source)))
    )
    if found is not None:
        sections.append(ReportSection("Figures", _spring_figures(found.springs)))
    sections += [ReportSection("Notes", tuple(Paragraph(note) for note in _SPRING_NOTES)), parameter_section(source)]
    return Report(
        title="Spring identification",
        subtitle=subtitle(source),
        outcome="incomplete" if found is None else "passed" if found.usable else "failed",
        verdict=found.verdict if found else problem or "No model: the run contains no samples.",
        facts=facts(source),
        sections=tuple(sections),
        footer=f"Sinew {source.run.software} · spring identification · run {source.run.id}",
        date=source.run.started_at,
    )


def _fits(side: str, model: SpringModel) -> Table:
    columns = (
        Column("Order"),
        Column("k_0 ± [N], k_1 ± [N/m], k_2 ± [N/m²] …", number=False, wide=True),
        Column("RMS", "N"),
        Column("Largest", "N"),
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
            "recommended" if fit.order == model.recommended else "" if fit.rising else "falls",
        )
        for fit in model.fits
    )
    before = ", ".join(format_measured(k, 5) for k in model.before or ())
    caption = f"Spring {side}: F(x) = k_0 + k_1 x + k_2 x² + … Previously active: {before or 'a table'}."
    return Table(caption, columns, rows)


def _reasons(springs: Mapping[str, SpringResult]) -> tuple[Paragraph, ...]:
    return tuple(Paragraph(f"Spring {side}: {springs[side].model.reason}.") for side in SIDES)


def _spring_data(source: RunData) -> tuple[Paragraph, ...]:
    found = source.identification
    if found is None:
        return ()
    pairs = found.springs["A"].quality.pairs
    text = f"Identification {found.run_id} used {pairs} pairs of each spring, from the sweep of that run."
    return (Paragraph(text),)


def _spring_figures(springs: Mapping[str, SpringResult]) -> tuple[Block, ...]:
    return (
        Figure(
            "springs",
            spring_panels(springs, "springs"),
            "Characteristic of (A) spring A and (B) spring B: measured pairs (dots) and the recommended polynomial; "
            "(C, D) measured minus fitted force by order, dots with increasing force, crosses with "
            "decreasing force. Compare figure "
            "3 of the paper.",
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
