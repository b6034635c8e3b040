"""Reports of experiments, by what they measure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.analysis import (
    EvaluationContext,
    Lines,
    Response,
    build_bode_lines,
    compute_responses,
    find_control_law,
    find_hits,
    find_pushes,
    load_bank_points,
    load_initial_tuning,
    measure_holds,
    measure_pushes,
)
from backend.banks import BankError, TuningSettings, list_point_models
from backend.experiments import KIND, ExperimentPlan, Measure, parse_stored_plan
from backend.models import Metrics, StepFigures
from backend.realtime import Law
from backend.recording import Columns
from backend.reports import messages, sections
from backend.reports.model import Column, Figure, Paragraph, Report, ReportSection, Table, format_measured
from backend.reports.plotting import (
    COLOURS,
    INK,
    LIMIT_GREY,
    axis_label,
    cached_figure,
    decimate,
    figure,
    frequency_axis,
    in_unit,
    panel_letter,
    tension_panel,
    to_svg,
    tracking_panels,
    tracking_step_panels,
    upper_legend,
)
from backend.reports.provenance import (
    experiment_report,
    facts,
    format_figure,
    has_tendons,
    lineage,
    parameter_section,
    read_or_none,
    results_section,
    settings_table,
    subtitle,
    tuning_facts,
)
from backend.reports.run_data import RunData
from backend.reports.sections import impact_panels, impact_tables
from backend.tuning import TuningError, make_cascade_tuning, simulate_cascade
from backend.units import AngleUnit, append_unit, convert_to_display, get_display_unit
from plant import SIDES, ParameterError, T_s, parse_parameters

# Compliance ----------------------------------------------------------------------------------------
# The report of a compliance run: whether the joint yields as its stiffness predicts.


_LEAST_N = 0.1
"""Minimum half range [N] of the axis of a force difference; below the noise of the load cells only rounding is
visible."""
_REST_S = 1.0

_COMPLIANCE_NOTES = (
    messages.S_is_an_estimate(),
    messages.push_is_measured_as_reaction(),
    messages.differences_contain_load_cell_delay(),
    messages.position_loop_is_open(),
)


def compliance_report(source: RunData) -> Report:
    """Build the report; for a run without a result it says why."""
    results = () if source.result is None else (_compliance_figures(source, source.result.metrics),)
    return experiment_report(source, "Compliance experiment", "compliance experiment", results, _COMPLIANCE_NOTES)


def tension_figures(source: RunData) -> tuple[Figure, ...]:
    """Return the figure of both tensions, none for an actuator without load cells."""
    if not has_tendons(source):
        return ()
    F_max = source.run.number("safety", "F_max")
    return (Figure("tension", tension_panel(source.columns, F_max, "tension"), messages.tension_figure()),)


def _compliance_figures(source: RunData, metrics: Metrics) -> ReportSection:
    pushed_s = next(phase.start_s for phase in metrics.phases if phase.name == "pushes")
    delay_s = metrics.find_value("delay_s") or 0.0
    r_j = source.run.number("geometry", "r_j")
    panels = force_panels(
        columns=source.columns, r_j=r_j, pushed_s=pushed_s, delay_s=delay_s, name="forces", angles=source.angles
    )
    return ReportSection(
        "Figures",
        (
            Figure(
                "forces",
                panels,
                messages.compliance_figure(),
            ),
            *tension_figures(source),
        ),
    )


@cached_figure
def force_panels(columns: Columns, r_j: float, pushed_s: float, delay_s: float, name: str, angles: AngleUnit) -> str:
    """Draw q, measured and expected force, and their difference (figure 8).

    The difference is drawn raw and with the delay compensated.
    """
    t = columns["t"]
    measured = columns["F_A"] - columns["F_B"]
    expected = -columns["S_ref"] * columns["q"] / r_j
    rest = (t >= pushed_s - _REST_S) & (t < pushed_s)
    delay = int(np.searchsorted(t, t[0] + delay_s - 1e-9))
    end = t.size - delay
    aligned = (measured[delay:] - measured[rest].mean()) - (expected[:end] - expected[rest].mean())
    with figure(3, height_in=4.4, sharex=True, height_ratios=(2, 3, 2)) as (drawn, axes):
        axes[0].plot(*decimate(t, in_unit(columns["q"], "rad", angles)), color=COLOURS["q"], label="$q$")
        axes[0].set_ylabel(axis_label("q", "rad", angles))
        axes[1].plot(*decimate(t, measured), color=COLOURS["F_A"], label="$F_{ext}$")
        axes[1].plot(*decimate(t, expected), color=INK, linewidth=0.7, linestyle=(0, (4, 2)), label="$F_{exp}$")
        if "F_ext_hat" in columns:
            estimated = -(columns["F_ext_hat"] - columns["F_ext_hat"][rest].mean()) + measured[rest].mean()
            axes[1].plot(*decimate(t, estimated), color=COLOURS["u_B"], linewidth=0.7, label="estimated")
        axes[1].set_ylabel("Force [N]")
        axes[2].plot(*decimate(t, measured - expected), color=LIMIT_GREY, linewidth=0.7, label="raw")
        axes[2].plot(*decimate(t[:end], aligned), color=COLOURS["u_B"], linewidth=0.8, label="aligned")
        low, high = axes[2].get_ylim()
        reach = (min(low, -_LEAST_N), max(high, _LEAST_N))
        axes[2].set(xlabel="t [s]", ylabel="Difference [N]", xlim=(t[0], t[-1]), ylim=reach)
        for panel, letter in zip(axes, "ABC", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)


# Paper's law ---------------------------------------------------------------------------------------
# For a run in time-optimal motion: the response of lambda motion, the law of the paper, to the same references.


Array = NDArray[np.float64]
UNITS = {"q": "rad", "S": "N·m/rad"}


@dataclass(frozen=True)
class PaperLawResponse:
    """The response of the paper's law to the references of a run.

    ``columns`` holds t, q and S, each (n,); it is empty if there is a ``reason``.
    """

    columns: Mapping[str, Array] = field(default_factory=dict)
    reason: str = ""


def simulate_paper_law(source: RunData) -> PaperLawResponse | None:
    """Simulate the references of a run under the paper's law.

    Returns None if the run itself used that law, or a law other than the cascade.
    """
    settings = source.run.set_to
    if settings.loop.budget == 0.0 or find_control_law(source.run) != Law.CASCADE:
        return None
    columns = source.columns
    t, known = columns["t"], settings.loop.get_known_values()
    if np.any(np.abs(np.diff(t) - T_s) > 0.5 * T_s):
        return PaperLawResponse(reason=messages.samples_have_gaps())
    if any(np.ptp(columns[f"lam_{name}"]) > 1e-6 for name in ("q", "S")):
        return PaperLawResponse(reason=messages.lambda_was_changed())
    try:
        parameters = parse_parameters(source.run.parameters_name, source.run.parameters)
        choice = TuningSettings.from_values(known)
        tuning = make_cascade_tuning(
            parameters, choice.lambdas, list_point_models(source.bank), None, choice.interpolate
        )
    except (BankError, TuningError, ParameterError) as error:
        return PaperLawResponse(reason=str(error))
    push = columns["F_push"] if np.all(np.isfinite(columns["F_push"])) else None
    found = simulate_cascade(
        parameters=parameters,
        tuning=tuning,
        q_ref=columns["q_ref"],
        S_ref=columns["S_ref"],
        F_push=push,
        seed=int(settings.loop.seed or 0),
    )
    if found.tripped_at >= 0:
        return PaperLawResponse(reason=messages.paper_law_would_trip(t_s=found.tripped_at * T_s))
    return PaperLawResponse({"t": t, "q": found.q, "S": found.S})


def make_law_comparison(steps: Sequence[StepFigures], law: PaperLawResponse, angles: AngleUnit) -> tuple[Table, ...]:
    """Return a table of each step's time to 90 %, measured and with the paper's law."""
    if not law.columns or not steps:
        return ()
    rows = []
    for step in steps:
        unit, theirs = UNITS[step.signal], _to_90_percent_s(step, law)
        gain = None if theirs is None or not step.reach_s else theirs / step.reach_s
        rows.append(
            (
                axis_label(step.signal, unit, angles),
                format_measured(convert_to_display(step.before, unit, angles)),
                format_measured(convert_to_display(step.after, unit, angles)),
                format_figure(step.reach_s),
                format_figure(theirs),
                format_figure(gain, 2),
            )
        )
    columns = (
        Column("Step", number=False),
        Column("from"),
        Column("to"),
        Column("To 90 %, measured", "s"),
        Column("To 90 %, paper's law", "s"),
        Column("paper's law / measured"),
    )
    caption = messages.times_to_90_percent()
    return (Table(caption, columns, tuple(rows)),)


def _to_90_percent_s(step: StepFigures, law: PaperLawResponse) -> float | None:
    """Return the time [s] from a step to 90 % of it.

    Returns None if the next step comes first.
    """
    t = law.columns["t"]
    inside = slice(*np.searchsorted(t, [step.start_s - 1e-9, step.end_s - 1e-9]))
    progress = (law.columns[step.signal][inside] - step.before) / (step.after - step.before)
    there = np.flatnonzero(progress >= 0.9)
    return float(t[inside][there[0]] - step.start_s) if there.size else None


# Recording -----------------------------------------------------------------------------------------
# The report of a session: its curves.


def recording_report(source: RunData) -> Report:
    """Build the report of a session."""
    sections = [
        *results_section(source),
        ReportSection(messages.settings_and_origin(), (*_make_settings_tables(source), *lineage(source))),
    ]
    if source.columns["t"].size:
        sections += [_recording_figures(source), ReportSection("Notes", (Paragraph(messages.S_is_an_estimate()),))]
    return Report(
        title="Session",
        subtitle=subtitle(source),
        outcome="neutral",
        verdict=messages.session_has_no_verdict(),
        facts=(*facts(source), *tuning_facts(source)),
        sections=(*sections, parameter_section(source)),
        footer=messages.footer(software=source.run.software, report="session", run_id=source.run.id),
        date=source.run.started_at,
    )


def _make_settings_tables(source: RunData) -> tuple[Table, ...]:
    return (settings_table(source),) if source.run.set_to.declared else ()


def _recording_figures(source: RunData) -> ReportSection:
    columns, run = source.columns, source.run
    u_max = run.number("motor", "u_max")
    panels = tracking_panels(
        columns=columns,
        start_s=0.0,
        end_s=float(columns["t"][-1]),
        letters="ABCDEF",
        name="panels",
        u_max=u_max,
        angles=source.angles,
    )
    return ReportSection(
        "Figures",
        (
            Figure("panels", panels, messages.session_figure()),
            *tension_figures(source),
        ),
    )


# Robustness ----------------------------------------------------------------------------------------
# The report of a robustness run: how far a load at the gearbox shaft turns a motor, and for how long.


_ROBUSTNESS_NOTES = (
    messages.paper_gives_load_and_M_s(),
    messages.load_pulls_the_tendon(),
    messages.integral_of_error(),
)


def robustness_report(source: RunData) -> Report:
    """Build the report; for a run without a result it says why."""
    results = () if source.result is None else (_robustness_figures(source),)
    return experiment_report(source, "Robustness under a load", "robustness experiment", results, _ROBUSTNESS_NOTES)


def _robustness_figures(source: RunData) -> ReportSection:
    return ReportSection(
        "Figures",
        (
            Figure(
                "errors",
                error_panels(source.columns, "errors", source.angles),
                messages.robustness_figure(),
            ),
            *tension_figures(source),
        ),
    )


@cached_figure
def error_panels(columns: Columns, name: str, angles: AngleUnit) -> str:
    """Draw errors of the motor loops, joint position and voltages over time."""
    t = columns["t"]
    with figure(5, height_in=5.2, sharex=True, height_ratios=(3, 3, 2, 2, 2)) as (drawn, axes):
        for side, error_of, voltage in zip(SIDES, axes[:2], axes[3:], strict=True):
            error, colour = columns[f"theta_{side}_ref"] - columns[f"theta_{side}"], COLOURS[f"u_{side}"]
            error_of.plot(*decimate(t, in_unit(error, "rad", angles)), color=colour, label=f"motor {side}")
            error_of.set_ylabel(axis_label("error", "rad", angles))
            voltage.plot(*decimate(t, columns[f"u_{side}"]), color=colour, label=f"$u_{side}$")
            voltage.set_ylabel("u [V]")
        for pair in (axes[:2], axes[3:]):  # one scale for both motors
            low, high = zip(*(panel.get_ylim() for panel in pair), strict=True)
            for panel in pair:
                panel.set_ylim(min(low), max(high))
        axes[2].plot(*decimate(t, in_unit(columns["q"], "rad", angles)), color=COLOURS["q"], label="$q$")
        axes[2].set_ylabel(axis_label("q", "rad", angles))
        axes[4].set(xlabel="t [s]", xlim=(t[0], t[-1]))
        for panel, letter in zip(axes, "ABCDE", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)


# Tracking ------------------------------------------------------------------------------------------
# The report of a tracking run: references, responses, bounds, and the gains used.


_TRACKING_NOTES = (
    messages.S_is_an_estimate(),
    messages.outer_gains(),
    messages.both_motors_double_the_gains(),
    messages.bound_of_largest_step(),
    messages.tension_after_pretension(),
)

_NAMES = {
    "rise_s": "rise",
    "reach_s": "to 90 %",
    "settling_s": "settling",
    "overshoot_percent": "overshoot",
    "steady_error": "steady error",
    "cross_coupling": "cross-coupling",
}


def tracking_report(source: RunData) -> Report:
    """Build the report of a tracking run; for a run without a result it says why."""
    metrics = source.result.metrics if source.result else None
    steps = (metrics.steps if metrics else None) or ()
    results = []
    law = simulate_paper_law(source) if source.columns["t"].size else None
    if source.columns["t"].size:
        results.append(_tracking_figures(source, metrics, steps, law))
    if steps:
        compared = make_law_comparison(steps, law, source.angles) if law else ()
        results.append(ReportSection("Steps", (*steps_table(steps, source.angles), *compared)))
    return experiment_report(
        source, "Tracking experiment", "tracking experiment", results, (*_TRACKING_NOTES, *_law_notes(law))
    )


def _law_notes(law: PaperLawResponse | None) -> tuple[str, ...]:
    if law is None:
        return ()
    if law.reason:
        return (messages.paper_law_not_computed(reason=law.reason),)
    return (messages.compared_with_paper_law(),)


def _tracking_figures(
    source: RunData, metrics: Metrics | None, steps: Sequence[StepFigures], law: PaperLawResponse | None
) -> ReportSection:
    columns = source.columns
    played_s = float(columns["t"][-1])
    run = source.run
    u_max = run.number("motor", "u_max")
    both = next((phase for phase in (metrics.phases if metrics else ()) if phase.name == "both"), None)
    split_s = min(both.start_s, played_s) if both else played_s
    theirs = law.columns if law and law.columns else None
    is_planned = law is not None
    blocks = [
        Figure(
            "separate",
            tracking_panels(
                columns=columns,
                start_s=0.0,
                end_s=split_s,
                letters="ABCDEF",
                name="separate",
                u_max=u_max,
                angles=source.angles,
                paper_response=theirs,
            ),
            messages.separate_steps_figure(is_simulated=theirs is not None, is_planned=is_planned),
        )
    ]
    if both and split_s < played_s:
        blocks.append(
            Figure(
                "together",
                tracking_panels(
                    columns=columns,
                    start_s=split_s,
                    end_s=played_s,
                    letters="GHIJKL",
                    name="together",
                    u_max=u_max,
                    angles=source.angles,
                    paper_response=theirs,
                ),
                messages.simultaneous_steps_figure(is_simulated=theirs is not None, is_planned=is_planned),
            )
        )
    blocks.extend(tension_figures(source))
    if steps:
        lam = {name: _constant(columns[f"lam_{name}"]) for name in ("q", "S")}
        blocks.append(
            Figure(
                "steps",
                tracking_step_panels(columns, steps, lam, "steps"),
                messages.all_steps_figure(is_planned=is_planned),
            )
        )
    return ReportSection("Figures", tuple(blocks))


def _constant(column: Any) -> float | None:
    return float(column[0]) if float(np.ptp(column)) < 1e-6 else None


def steps_table(steps: Sequence[StepFigures], angles: AngleUnit) -> tuple[Table, ...]:
    """Return a table of all steps, and one of the figures that could not be measured."""
    units = {"q": "rad", "S": "N·m/rad"}
    columns = (
        Column("Phase", number=False),
        Column("Step", number=False),
        Column("from"),
        Column("to"),
        Column("Rise", "s"),
        Column("To 90 %", "s"),
        Column("Settling", "s"),
        Column("Overshoot", "%"),
        Column("Steady error"),
        Column("Cross-coupling", wide=True),
    )
    rows = []
    for step in steps:
        signal, other = step.signal, "S" if step.signal == "q" else "q"
        rows.append(
            (
                step.phase,
                axis_label(signal, units[signal], angles),
                format_measured(convert_to_display(step.before, units[signal], angles)),
                format_measured(convert_to_display(step.after, units[signal], angles)),
                format_figure(step.rise_s),
                format_figure(step.reach_s),
                format_figure(step.settling_s),
                format_figure(step.overshoot_percent, 2),
                format_figure(read_or_none(step.steady_error, units[signal], angles), 2),
                _deviation(step, units[other], angles),
            )
        )
    every = Table(messages.all_completed_steps(), columns, tuple(rows))
    return (every, *_reasons(steps))


def _deviation(step: StepFigures, unit: str, angles: AngleUnit) -> str:
    if not step.alone:
        return messages.both_step()
    value = step.cross_coupling
    return (
        messages.not_measured()
        if value is None
        else append_unit(
            format_measured(convert_to_display(value, unit, angles), 2), get_display_unit(unit, angles).unit
        )
    )


def _reasons(steps: Sequence[StepFigures]) -> tuple[Table, ...]:
    """Return a table of the reasons why figures of steps are missing."""
    rows = []
    for step in steps:
        by_reason: dict[str, list[str]] = {}
        for name, reason in step.reasons.items():
            if name == "cross_coupling" and not step.alone:
                continue
            by_reason.setdefault(reason, []).append(_NAMES[name])
        for reason, names in by_reason.items():
            rows.append((f"{step.start_s:g}", step.signal, ", ".join(names), reason))
    columns = (
        Column("Step at", "s"),
        Column("Signal", number=False),
        Column("Metric", number=False),
        Column("Reason", number=False, wide=True),
    )
    return (
        (
            Table(
                messages.metrics_not_measured_completely(),
                columns,
                tuple(rows),
            ),
        )
        if rows
        else ()
    )


# Experiment from data ------------------------------------------------------------------------------
# The report of an experiment described by data: the figures that belong to its measurements.


_COMPOSED_NOTES = (
    messages.S_is_an_estimate(),
    messages.tension_after_pretension(),
)
_ON = {
    Measure.RESPONSE: (messages.how_responses_are_evaluated(),),
    Measure.BODE: sections.BODE_NOTES,
    Measure.PUSHES: sections.PUSH_NOTES,
    Measure.HOLDS: sections.HOLD_NOTES,
    Measure.IMPACT: (messages.how_impacts_are_simulated(),),
}


def program_report(source: RunData) -> Report:
    """Build the report of an experiment described by data."""
    plan = parse_stored_plan(source.run.kind, source.run.set_to.plan or {})
    if not isinstance(plan, ExperimentPlan):
        raise TypeError(f"run {source.run.id} does not belong to an experiment described by data")
    results = list(_make_signal_sections(source, plan)) if source.columns["t"].size else []
    notes = (
        *_COMPOSED_NOTES,
        *(note for measure, sentences in _ON.items() if measure in plan.experiment.measures for note in sentences),
    )
    name = plan.experiment.name.replace("_", " ")
    return experiment_report(source, plan.experiment.title, name, results, notes)


def _make_signal_sections(source: RunData, plan: ExperimentPlan) -> Iterator[ReportSection]:
    columns, run = source.columns, source.run
    u_max = run.number("motor", "u_max")
    drawn = [
        Figure(
            "whole",
            tracking_panels(
                columns=columns,
                start_s=0.0,
                end_s=float(columns["t"][-1]),
                letters="ABCDEF",
                name="whole",
                u_max=u_max,
                angles=source.angles,
            ),
            messages.whole_experiment_figure(),
        ),
    ]
    # A bank or a voltage limit alone shows nothing here.
    if any(np.ptp(columns[name]) > 0.0 for name in ("lam_q", "lam_S")):
        drawn.append(
            Figure(
                "tuning",
                _lambda_panel(columns, "tuning"),
                messages.lambda_figure(),
            )
        )
    drawn += _of_measures(source, plan)
    drawn.extend(tension_figures(source))
    yield ReportSection("Figures", tuple(drawn))
    yield from _sections(source, plan)
    if Measure.IMPACT in plan.experiment.measures and (hits := find_hits(columns, plan.program())):
        yield ReportSection("Hits", impact_tables(hits, source.angles))
    steps = source.result.metrics.steps if source.result else None
    if steps:
        yield ReportSection("Steps", steps_table(steps, source.angles))


def _of_measures(source: RunData, plan: ExperimentPlan) -> Iterator[Figure]:
    columns, program = source.columns, plan.program()
    measures = plan.experiment.measures
    acted = find_pushes(program)
    if Measure.COMPLIANCE in measures and source.result is not None and acted:
        delay_s = source.result.metrics.find_value("delay_s") or 0.0
        first_s, r_j = acted[0].start * T_s, source.run.number("geometry", "r_j")
        yield Figure(
            "forces",
            force_panels(
                columns=columns, r_j=r_j, pushed_s=first_s, delay_s=delay_s, name="forces", angles=source.angles
            ),
            messages.push_forces_figure(),
        )
    if Measure.LOADS in measures or Measure.DISTURBANCE in measures:
        yield Figure(
            "errors",
            error_panels(columns, "errors", source.angles),
            messages.disturbances_figure(),
        )
    hits = find_hits(columns, program) if Measure.IMPACT in measures else ()
    if hits:
        yield Figure(
            "hits",
            impact_panels(columns, hits, "hits", source.angles),
            messages.hits_figure(),
        )
    found = compute_responses(columns, program) if Measure.RESPONSE in measures else ()
    if found:
        yield Figure(
            "responses",
            response_panels(found, "responses"),
            messages.responses_figure(),
        )


def find_frequency_responses(source: RunData) -> tuple[Lines, ...]:
    """Return the frequency responses that a run measured line by line; else none."""
    if source.run.kind != KIND or not source.columns["t"].size:
        return ()
    plan = parse_stored_plan(source.run.kind, source.run.set_to.plan or {})
    if not isinstance(plan, ExperimentPlan) or Measure.BODE not in plan.experiment.measures:
        return ()
    return build_bode_lines(source.columns, plan.program(), _in_force(source, plan))


def _sections(source: RunData, plan: ExperimentPlan) -> Iterator[ReportSection]:
    measures, columns, program = plan.experiment.measures, source.columns, plan.program()
    in_force = _in_force(source, plan)
    if Measure.BODE in measures and (lines := build_bode_lines(columns, program, in_force)):
        yield sections.bode_section(lines)
    if Measure.PUSHES in measures and (pushes := measure_pushes(columns, program, in_force)):
        yield sections.pushes_section(columns, pushes, source.angles)
    if Measure.HOLDS in measures and (holds := measure_holds(columns, program, in_force.parameters)):
        yield sections.holds_section(columns, holds, in_force.parameters.sensors.joint_step, source.angles)


def _in_force(source: RunData, plan: ExperimentPlan) -> EvaluationContext:
    run = source.run
    parameters = parse_parameters(run.parameters_name, run.parameters)
    return EvaluationContext(parameters, plan, load_initial_tuning(run.set_to.loop), load_bank_points(source.bank))


@cached_figure
def response_panels(found: tuple[Response, ...], name: str) -> str:
    """Draw gain [dB] and phase [°] of each response over frequency [Hz]."""
    with figure(2, height_in=4.0, sharex=True, height_ratios=(1, 1)) as (drawn, axes):
        for response in found:
            colour, label = COLOURS[response.signal], f"${response.signal}$"
            axes[0].semilogx(response.f, 20.0 * np.log10(np.abs(response.H)), ".-", color=colour, label=label)
            axes[1].semilogx(response.f, np.degrees(np.unwrap(np.angle(response.H))), ".-", color=colour, label=label)
        axes[0].set_ylabel("Gain [dB]")
        axes[1].set_ylabel("Phase [°]")
        axes[1].set_xlabel("f [Hz]")
        frequency_axis(axes[1])
        for panel, letter in zip(axes, "AB", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)


@cached_figure
def _lambda_panel(columns: Columns, name: str) -> str:
    t = columns["t"]
    with figure(1, height_in=1.6) as (drawn, axes):
        panel = axes[0] if isinstance(axes, list | tuple | np.ndarray) else axes
        for signal in ("q", "S"):
            lam = in_unit(columns[f"lam_{signal}"], "s", AngleUnit.RADIANS)
            panel.plot(*decimate(t, lam), color=COLOURS[signal], label=rf"$\lambda_{signal}$")
        panel.set(xlabel="t [s]", ylabel=axis_label("λ", "s", AngleUnit.RADIANS), xlim=(t[0], t[-1]))
        upper_legend(panel)
        return to_svg(drawn, name)
