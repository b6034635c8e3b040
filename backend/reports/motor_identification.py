"""The report of a motor identification: both estimates of both motors, and how well they describe the steps."""

import numpy as np

from backend.identification.models import worst
from backend.models.identification import MotorsFound, Pair, grade_of
from backend.reports.document import NO_FIGURE, Block, Column, Figure, Paragraph, Report, Section, Table, exact, shown
from backend.reports.drawing import COLOURS, INK, axis_label, figure, in_unit, panel_letter, to_svg
from backend.reports.drawn_once import drawn_once
from backend.reports.judgement import OUTCOMES, measured_figures
from backend.reports.model_code import motor_blocks
from backend.reports.provenance import facts, parameter_section, settings_table, subtitle
from backend.reports.reproduction import reproduction
from backend.reports.source import Source
from backend.storage.identifications import Identification
from backend.units import Angles
from plant.parameters import SIDES

PAPER = Pair(K_m=2.86, T_m=0.22)
"""The paper's motor: K_m [rad/(V·s)], T_m [s]."""

_NOTES = (
    "Least squares fits K_m, T_m and the Coulomb voltage u_c together, on position, over all steps: "
    "T_m ω' + ω = K_m (u − u_c sign ω). u_c is left out where it does not differ from zero at the 1 % level. Standard "
    "errors allow for coloured residuals.",
    "The 63.21 % rule is the paper's: K_m from the steady speed, T_m where the speed reaches 63.21 % of it. It knows "
    "nothing of dry friction, which lowers its gain most at the smallest voltage, nor that a step ended before its "
    "speed was quite steady, which lowers it at the largest.",
    "Both tendons were slack during the steps. A step that saturates or that a tendon loads is refused and listed.",
)


def motor_identification_report(source: Source) -> Report:
    """Build the report; a run without a model says why it gave none."""
    found, problem = source.identification, source.result.metrics.problem if source.result else ""
    sections = []
    if found is not None:
        tables: list[Block] = [
            _estimates(found.motors),
            _rule(found.motors),
            *motor_blocks({side: found.motors.side(side).model for side in SIDES}),
            *_refused(found.motors),
        ]
        sections.append(Section("Motors", (*tables, *measured_figures(source))))
    sections.append(Section("How it was made", (settings_table(source), *reproduction(source), *_in_force(source))))
    if found is not None:
        sections.append(Section("Figures", _figures(found.motors, source.angles)))
    sections += [Section("Notes", tuple(Paragraph(note) for note in _NOTES)), parameter_section(source)]
    return Report(
        title="Motor identification",
        subtitle=subtitle(source),
        outcome=_outcome(found),
        verdict=found.verdict if found else problem or "No model: the run holds no samples.",
        facts=facts(source),
        sections=tuple(sections),
        footer=f"Sinew {source.run.software} · motor identification · run {source.run.id}",
        date=source.run.started_at,
    )


def _outcome(found: Identification | None) -> str:
    if found is None:
        return "incomplete"
    return OUTCOMES[worst(*(grade_of(found.motors.side(side)) for side in SIDES))]


def _estimates(motors: MotorsFound) -> Table:
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
            for text in (shown(value, 4), shown(error, 2))
        ]
        rows.append((side, "least squares, standard errors", *values))
        ruled = [
            text
            for value, error in ((mean.K_m, spread.K_m), (mean.T_m, spread.T_m))
            for text in (shown(value, 4), shown(error, 2))
        ]
        rows.append((side, "63.21 % rule, mean and spread", *ruled, NO_FIGURE, NO_FIGURE))
        rows.append(
            (
                side,
                "in force before",
                shown(item.before.K_m, 4),
                NO_FIGURE,
                shown(item.before.T_m),
                NO_FIGURE,
                NO_FIGURE,
                NO_FIGURE,
            )
        )
    rows.append(("both", "the paper", shown(PAPER.K_m), NO_FIGURE, shown(PAPER.T_m), NO_FIGURE, NO_FIGURE, NO_FIGURE))
    return Table("Both motors, K_m/(s (T_m s + 1)) with dry friction worth u_c.", columns, tuple(rows))


def _rule(motors: MotorsFound) -> Table:
    columns = (
        Column("Step", "V"),
        *(Column(f"{name} of {side}", unit) for side in SIDES for name, unit in (("K_m", "rad/(V·s)"), ("T_m", "s"))),
    )
    by_voltage = [{item.voltage: item for item in motors.side(side).model.rule} for side in SIDES]
    voltages = sorted({voltage for ruled in by_voltage for voltage in ruled})
    nothing = Pair(None, None)
    rows = tuple(
        (
            exact(voltage),
            *(
                text
                for item in (ruled.get(voltage, nothing) for ruled in by_voltage)
                for text in (shown(item.K_m, 4), shown(item.T_m))
            ),
        )
        for voltage in voltages
    )
    return Table("The 63.21 % rule, step by step.", columns, rows)


def _refused(motors: MotorsFound) -> tuple[Table, ...]:
    refused = [(side, item) for side in SIDES for item in motors.side(side).quality.refused]
    rows = tuple((side, exact(item.voltage), item.reason) for side, item in refused)
    columns = (Column("Motor", number=False), Column("Step", "V"), Column("Reason", number=False, wide=True))
    return (Table("Steps that were refused.", columns, rows),) if rows else ()


def _in_force(source: Source) -> tuple[Paragraph, ...]:
    found = source.identification
    if found is None:
        return ()
    fitted = {side: found.motors.side(side).model.parameters for side in SIDES}
    entries = "; ".join(
        f"[identified_{side}] K_m = {shown(item.K_m, 4)}, T_m = {shown(item.T_m, 4)}" for side, item in fitted.items()
    )
    text = (
        f"Identification {found.run_id} used the voltages and motor angles of that run. The motor loops take "
        f"their model from the parameter file; to use this one, enter there: {entries}."
    )
    return (Paragraph(text),)


def _figures(motors: MotorsFound, angles: Angles) -> tuple[Block, ...]:
    return (
        Figure(
            "steps",
            step_panels(motors, "steps", angles),
            "Turn of each motor after the steps as measured (coloured) and as the least-squares model says (dashed), "
            "and (C, D) their difference.",
        ),
    )


@drawn_once
def step_panels(motors: MotorsFound, name: str, angles: Angles) -> str:
    """Draw every step of both motors, and what the model leaves over."""
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
            turn.set_ylabel(axis_label(rf"turn of $\theta_{side}$", "rad", angles))
            left.set(xlabel="t from the step [s]", ylabel=axis_label("difference", "mrad", angles))
            panel_letter(turn, "AB"[column])
            panel_letter(left, "CD"[column])
        return to_svg(drawn, name)
