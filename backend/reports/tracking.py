"""The report of a tracking run: what was asked, what came out, against which bounds, from which gains."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from backend.models.run import Metrics, StepFigures
from backend.reports.document import Column, Figure, Report, Section, Table, shown
from backend.reports.drawing import axis_label
from backend.reports.experiment import experiment_report
from backend.reports.followed import GOVERNOR, PapersLaw, beside, papers_law
from backend.reports.judgement import NOT_MEASURED, measured, read_or_none
from backend.reports.provenance import S_NOTE
from backend.reports.source import Source
from backend.reports.tracking_figures import (
    CUT_OFF,
    TENSIONS,
    WHAT_IS_DRAWN,
    step_panels,
    tension_panel,
    tracking_panels,
)
from backend.units import Angles, read, reading_of, with_unit

_NOTES = (
    S_NOTE,
    "Outer gains follow k_p = (2T − λ)/(K λ). The paper's table 2, in the text we have, prints k_p = 2/(K λ), which is "
    "dimensionally wrong and does not place the poles at −1/λ (erratum E1).",
    "Both motors move together through the decoupler, which doubles the gains identified with one motor excited; the "
    "gains are scaled for that (erratum E3).",
    "The bound beside the largest q step is the time in which one motor, unloaded and at full voltage from the first "
    "moment, turns by 90 % of what the step needs: speed K_m u_max, lag T_m. No law can be faster on these motors.",
    "Tension is counted from the start of the program, after pretension; load-cell noise and delay are part of it. "
    "Root mean squares include the steps themselves and therefore mostly measure how fast λ lets the loop move.",
)

_NAMES = {
    "rise_s": "rise",
    "reach_s": "to 90 %",
    "settling_s": "settling",
    "overshoot_percent": "overshoot",
    "steady_error": "steady error",
    "cross_coupling": "deviation of the other",
}


def tracking_report(source: Source) -> Report:
    """Build the report of a tracking run; a run without result says why it has none."""
    metrics = source.result.metrics if source.result else None
    steps = (metrics.steps if metrics else None) or ()
    seen = []
    law = papers_law(source) if source.columns["t"].size else None
    if source.columns["t"].size:
        seen.append(_figures(source, metrics, steps, law))
    if steps:
        compared = beside(steps, law, source.angles) if law else ()
        seen.append(Section("Steps", (*steps_table(steps, source.angles), *compared)))
    return experiment_report(source, "Tracking experiment", "tracking experiment", seen, (*_NOTES, *_law_notes(law)))


def _law_notes(law: PapersLaw | None) -> tuple[str, ...]:
    if law is None:
        return ()
    if law.reason:
        return (f"What the paper's law would have made of these references was not computed: {law.reason}.",)
    return (GOVERNOR,)


def _figures(source: Source, metrics: Metrics | None, steps: Sequence[StepFigures], law: PapersLaw | None) -> Section:
    columns = source.columns
    played_s = float(columns["t"][-1])
    run = source.run
    u_max, F_max = run.number("motor", "u_max"), run.number("safety", "F_max")
    both = next((phase for phase in (metrics.phases if metrics else ()) if phase.name == "both"), None)
    split_s = min(both.start_s, played_s) if both else played_s
    theirs = law.columns if law and law.columns else None
    beside_it = " In grey the paper's law on the same references, simulated." if theirs else ""
    blocks = [
        Figure(
            "separate",
            tracking_panels(columns, 0.0, split_s, "ABCDEF", "separate", u_max, source.angles, theirs),
            f"Position and stiffness moved one after the other: {WHAT_IS_DRAWN}. References dashed.{beside_it} "
            f"{CUT_OFF} Compare q, S and u with figure 7A–C of the paper{_of_governor(law)}.",
        )
    ]
    if both and split_s < played_s:
        blocks.append(
            Figure(
                "together",
                tracking_panels(columns, split_s, played_s, "GHIJKL", "together", u_max, source.angles, theirs),
                "Position and stiffness moved at once: the same in (G) to (L). "
                f"References dashed.{beside_it} Compare q, S and u with figure 7D–F of the paper{_of_governor(law)}.",
            )
        )
    blocks.append(Figure("tension", tension_panel(columns, F_max, "tension"), TENSIONS))
    if steps:
        lam = {name: _constant(columns[f"lam_{name}"]) for name in ("q", "S")}
        blocks.append(
            Figure(
                "steps",
                step_panels(columns, steps, lam, "steps"),
                "All steps on one scale, (A) of joint position and (B) of stiffness, over the response that λ stands "
                f"for on a first-order process (dashed), and (C, D) what is left of each in per cent of the step, with "
                f"the band of ±2 % in which it counts as settled. {_what_shapes_a_step(law)}",
            )
        )
    return Section("Figures", tuple(blocks))


def _of_governor(law: PapersLaw | None) -> str:
    return "" if law is None else ", which has the governor and no plan"


def _what_shapes_a_step(law: PapersLaw | None) -> str:
    if law is None:
        return (
            "The motor loops' lags delay the real one; the reference governor slows large steps, so that the motors "
            "stay within their voltage."
        )
    return (
        "A trajectory moves a model of motors and joint, and its voltages drive the motors: a step takes the time that "
        "the motors need within the voltage limit, and λ sets how deviations from the model are corrected."
    )


def _constant(column: Any) -> float | None:
    return float(column[0]) if float(np.ptp(column)) < 1e-6 else None


def steps_table(steps: Sequence[StepFigures], angles: Angles) -> tuple[Table, ...]:
    """Return a table of every step, and one of what could not be measured of them."""
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
        Column("Deviation of the other", wide=True),
    )
    rows = []
    for step in steps:
        signal, other = step.signal, "S" if step.signal == "q" else "q"
        rows.append(
            (
                step.phase,
                axis_label(signal, units[signal], angles),
                shown(read(step.before, units[signal], angles)),
                shown(read(step.after, units[signal], angles)),
                measured(step.rise_s),
                measured(step.reach_s),
                measured(step.settling_s),
                measured(step.overshoot_percent, 2),
                measured(read_or_none(step.steady_error, units[signal], angles), 2),
                _deviation(step, units[other], angles),
            )
        )
    every = Table("Every step that was played to its end.", columns, tuple(rows))
    return (every, *_reasons(steps))


def _deviation(step: StepFigures, unit: str, angles: Angles) -> str:
    if not step.alone:
        return "both step"
    value = step.cross_coupling
    return (
        NOT_MEASURED if value is None else with_unit(shown(read(value, unit, angles), 2), reading_of(unit, angles).unit)
    )


def _reasons(steps: Sequence[StepFigures]) -> tuple[Table, ...]:
    """Return why figures of steps are missing, a line for each step and reason."""
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
        Column("of", number=False),
        Column("What", number=False),
        Column("Why it was not measured", number=False, wide=True),
    )
    return (
        (
            Table(
                "What could not be measured; a figure that stands above all the same is at least that.",
                columns,
                tuple(rows),
            ),
        )
        if rows
        else ()
    )
