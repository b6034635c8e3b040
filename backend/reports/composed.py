"""The report of an experiment that is data: the figures that go with what it measures, of whatever it plays."""

from collections.abc import Iterator

import numpy as np

from backend.analysis.context import InForce, kept_tuning, points_in
from backend.analysis.disturbance_metrics import hits_of, holds_seen, pushes_seen
from backend.analysis.frequency_metrics import Lines, Response, bode_lines, responses
from backend.analysis.step_metrics import pushes
from backend.experiments.library import stored_plan
from backend.experiments.plans import KIND, ComposedPlan
from backend.experiments.schema import Measure
from backend.recording.reader import Columns
from backend.reports import bode, held, pushed
from backend.reports.compliance import force_panels
from backend.reports.document import Figure, Report, Section
from backend.reports.drawing import (
    COLOURS,
    axis_label,
    figure,
    frequency_axis,
    in_unit,
    panel_letter,
    thinned,
    to_svg,
    upper_legend,
)
from backend.reports.drawn_once import drawn_once
from backend.reports.experiment import experiment_report
from backend.reports.impact import CAPTION, impact_panels, impact_tables
from backend.reports.provenance import S_NOTE
from backend.reports.robustness import error_panels
from backend.reports.source import Source
from backend.reports.tracking import steps_table
from backend.reports.tracking_figures import CUT_OFF, TENSIONS, WHAT_IS_DRAWN, tension_panel, tracking_panels
from backend.units import Angles
from plant.interface import T_s
from plant.parameters import parameters_of

_NOTES = (
    S_NOTE,
    "Tension is counted from the start of the program, after pretension; load-cell noise and delay are part of it. "
    "Root mean squares include the steps themselves and therefore mostly measure how fast λ lets the loop move.",
)
_ON_RESPONSES = (
    "Of a periodic excitation the last period is measured, line by line; of a sweep all of it, smoothed. Gain and "
    "phase are those of the closed loop, from the reference to what is measured, dead time and governor included."
)
_ON_IMPACTS = (
    "F_wall is what the simulated wall does to the joint, tangential at r_j: k_wall δ (1 + c_wall δ') while it is "
    "δ deep, never pulling. In the first milliseconds the wall stops the joint's own inertia, whatever its stiffness; "
    "then the motors press on through the springs, and that is what a soft joint keeps small. A joint that gives way "
    "brings its motors to a stand, position loop open, and goes to its lowest stiffness, for as long as the hit it is "
    "beside would have taken; what it feels is estimated from encoders and springs, less what the experiment has "
    "learned at rest."
)
_ON = {
    Measure.RESPONSE: (_ON_RESPONSES,),
    Measure.BODE: bode.NOTES,
    Measure.PUSHES: pushed.NOTES,
    Measure.HOLDS: held.NOTES,
    Measure.IMPACT: (_ON_IMPACTS,),
}


def composed_report(source: Source) -> Report:
    """Build the report; a run without result says why it has none."""
    plan = stored_plan(source.run.kind, source.run.set_to.plan or {})
    if not isinstance(plan, ComposedPlan):
        raise TypeError(f"run {source.run.id} is of no experiment that is data")
    seen = list(_seen(source, plan)) if source.columns["t"].size else []
    notes = (*_NOTES, *(note for measure, said in _ON.items() if measure in plan.experiment.measures for note in said))
    name = plan.experiment.name.replace("_", " ")
    return experiment_report(source, plan.experiment.title, name, seen, notes)


def _seen(source: Source, plan: ComposedPlan) -> Iterator[Section]:
    columns, run = source.columns, source.run
    u_max, F_max = run.number("motor", "u_max"), run.number("safety", "F_max")
    drawn = [
        Figure(
            "whole",
            tracking_panels(columns, 0.0, float(columns["t"][-1]), "ABCDEF", "whole", u_max, source.angles),
            f"The whole experiment: {WHAT_IS_DRAWN}. References dashed. {CUT_OFF}",
        ),
    ]
    if any(np.ptp(columns[name]) > 0.0 for name in ("lam_q", "lam_S")):  # a bank or a budget alone shows nothing here
        drawn.append(
            Figure(
                "tuning",
                _lambda_panel(columns, "tuning"),
                "λ of both loops as each sample was controlled with; the experiment changes the tuning on its way.",
            )
        )
    drawn += _of_measures(source, plan)
    drawn.append(Figure("tension", tension_panel(columns, F_max, "tension"), TENSIONS))
    yield Section("Figures", tuple(drawn))
    yield from _sections(source, plan)
    if Measure.IMPACT in plan.experiment.measures and (hits := hits_of(columns, plan.program())):
        yield Section("Hits", impact_tables(hits, source.angles))
    steps = source.result.metrics.steps if source.result else None
    if steps:
        yield Section("Steps", steps_table(steps, source.angles))


def _of_measures(source: Source, plan: ComposedPlan) -> Iterator[Figure]:
    columns, program = source.columns, plan.program()
    measures = plan.experiment.measures
    acted = pushes(program)
    if Measure.COMPLIANCE in measures and source.result is not None and acted:
        delay_s = source.result.metrics.value_of("delay_s") or 0.0
        first_s, r_j = acted[0].start * T_s, source.run.number("geometry", "r_j")
        yield Figure(
            "forces",
            force_panels(columns, r_j, first_s, delay_s, "forces", source.angles),
            "Pushes on the joint: (A) joint position, (B) measured force F_ext and the force F_exp that stiffness and "
            "position let expect, (C) their difference as measured (grey) and aligned.",
        )
    if Measure.LOADS in measures or Measure.DISTURBANCE in measures:
        yield Figure(
            "errors",
            error_panels(columns, "errors", source.angles),
            "Disturbances: (A) errors of both motor loops, (B) joint position, (C) both voltages.",
        )
    hits = hits_of(columns, program) if Measure.IMPACT in measures else ()
    if hits:
        yield Figure(
            "hits",
            impact_panels(columns, hits, "hits", source.angles),
            CAPTION,
        )
    found = responses(columns, program) if Measure.RESPONSE in measures else ()
    if found:
        yield Figure(
            "responses",
            response_panels(found, "responses"),
            "Frequency responses of the closed loops: (A) gain, (B) phase, at each line or band that was excited.",
        )


def lines_of(source: Source) -> tuple[Lines, ...]:
    """Return the frequency responses of a run that measured them line by line, none of any other."""
    if source.run.kind != KIND or not source.columns["t"].size:
        return ()
    plan = stored_plan(source.run.kind, source.run.set_to.plan or {})
    if not isinstance(plan, ComposedPlan) or Measure.BODE not in plan.experiment.measures:
        return ()
    return bode_lines(source.columns, plan.program(), _in_force(source, plan))


def _sections(source: Source, plan: ComposedPlan) -> Iterator[Section]:
    measures, columns, program = plan.experiment.measures, source.columns, plan.program()
    in_force = _in_force(source, plan)
    if Measure.BODE in measures and (lines := bode_lines(columns, program, in_force)):
        yield bode.bode_section(lines)
    if Measure.PUSHES in measures and (seen := pushes_seen(columns, program, in_force)):
        yield pushed.pushes_section(columns, seen, source.angles)
    if Measure.HOLDS in measures and (holds := holds_seen(columns, program, in_force.parameters)):
        yield held.holds_section(columns, holds, in_force.parameters.sensors.joint_step, source.angles)


def _in_force(source: Source, plan: ComposedPlan) -> InForce:
    run = source.run
    parameters = parameters_of(run.parameters_name, run.parameters)
    return InForce(parameters, plan, kept_tuning(run.set_to.loop), points_in(source.bank))


@drawn_once
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


@drawn_once
def _lambda_panel(columns: Columns, name: str) -> str:
    t = columns["t"]
    with figure(1, height_in=1.6) as (drawn, axes):
        panel = axes[0] if isinstance(axes, list | tuple | np.ndarray) else axes
        for signal in ("q", "S"):
            lam = in_unit(columns[f"lam_{signal}"], "s", Angles.RADIANS)
            panel.plot(*thinned(t, lam), color=COLOURS[signal], label=rf"$\lambda_{signal}$")
        panel.set(xlabel="t [s]", ylabel=axis_label("λ", "s", Angles.RADIANS), xlim=(t[0], t[-1]))
        upper_legend(panel)
        return to_svg(drawn, name)
