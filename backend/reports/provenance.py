"""Parts that all reports share: provenance, verdict, metrics and reproduction."""

import json
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from backend.analysis import USED_SETTINGS, find_control_law, select_used_settings
from backend.experiments import PAPER_EXPERIMENTS, experiments_by_name, library, parser
from backend.identification import Grade
from backend.models import (
    CHANNELS,
    DEFINITIONS,
    PLANT_NUMBERS,
    DeclaredValue,
    Metrics,
    Outcome,
    RunCriterion,
    Value,
    judge_run,
)
from backend.realtime import Law
from backend.reports import messages
from backend.reports.model import (
    Block,
    Code,
    Column,
    Fact,
    Paragraph,
    Report,
    ReportSection,
    Table,
    exact,
    format_measured,
)
from backend.reports.run_data import RunData
from backend.storage import BankEntry, EndState, RunKind, stored_entry_name
from backend.units import AngleUnit, convert_to_display, get_display_unit
from plant import SHIPPED, SIMULATED, SIMULATOR, load_parameters

# Provenance ----------------------------------------------------------------------------------------
# The origin of a run in a report: who, when, plant, settings, gains and parameters.


END_STATES = {
    EndState.RUNNING: messages.still_running(),
    EndState.COMPLETED: "completed",
    EndState.STOPPED: messages.stopped_before_its_end(),
    EndState.TRIPPED: "tripped",
    EndState.LINK_LOST: messages.connection_lost(),
    EndState.SERVICE_DIED: messages.service_died(),
}


def subtitle(source: RunData) -> str:
    """Return one line that identifies the run."""
    run = source.run
    return messages.subtitle_of_run(
        run_id=run.id, started_at=run.started_at, plant=run.plant, parameters=run.parameters_name
    )


def facts(source: RunData) -> tuple[Fact, ...]:
    """Return the heading of a report: who, when, plant, end and software."""
    run = source.run
    end = END_STATES[EndState(run.end_state)]
    lines = [
        Fact("Run", messages.run_and_its_end(run_id=run.id, end=end, detail=run.end_detail)),
        Fact("Started", messages.start_of_run(started_at=run.started_at, who=run.who)),
        Fact("Plant", messages.plant_and_parameters(plant=run.plant, parameters=run.parameters_name)),
    ]
    if run.note:
        lines.append(Fact("Note", run.note, quoted=True))
    versions = run.set_to.versions or {}
    return (*lines, Fact("Software", messages.software_versions(software=run.software, versions=versions)))


_CONTROLLERS = {
    Law.SINGLE_LOOP: (messages.single_loop_for_comparison(), messages.single_loop_model()),
    Law.FEEDBACK_LINEARIZATION: (messages.linearization_for_comparison(), messages.linearization_model()),
    Law.FORCE_HOLD: (messages.motor_A_holds_tension(), ""),
    Law.MOTOR_STEPS: (messages.voltage_steps(), ""),
    Law.TENSION_SWEEP: (messages.motor_loops_follow_sweep(), ""),
}
"""Description of each law without the outer loops of the cascade, and the part of the plant that it knows."""


def tuning_facts(source: RunData) -> tuple[Fact, ...]:
    """Return the tuning that the law uses, λ as recorded, and the simulator's seed."""
    loop, law = source.run.set_to.loop, find_control_law(source.run)
    used = USED_SETTINGS[law]
    parts: list[str] = [
        messages.lambda_in_use(loop=name, range_s=_find_range(source, f"lam_{name}"))
        for name in ("q", "S")
        if f"lam_{name}" in used
    ]
    if loop.lam_motor is not None and "lam_motor" in used:
        parts.append(messages.lambda_motor_in_use(lam_s=loop.lam_motor))
    if "b" in used:
        parts.append(messages.setpoint_weight(b=loop.b))
    controller, known = _CONTROLLERS.get(law) or (_describe_cascade(source, law), messages.cascade_model())
    lines = [Fact("Tuning", ", ".join(parts)), Fact("Controller", controller)]
    if known:
        lines.append(Fact(messages.model_of_controller(), known))
    if source.run.plant in SIMULATED and loop.seed is not None:
        lines.append(Fact("Seed", str(loop.seed)))
    return tuple(lines)


def _describe_cascade(source: RunData, law: Law) -> str:
    """Return the origin of the cascade's gains, the motion, and the push rejection."""
    loop, bank = source.run.set_to.loop, source.bank
    return messages.cascade_controller(
        is_position_loop_closed=law == Law.CASCADE,
        bank=bank.name if bank else None,
        bank_version=bank.version if bank else 0,
        entries=len(bank.entries) if bank else 0,
        interpolate=bool(loop.interpolate),
        U_plan=loop.budget,
        k_ext=loop.k_ext or 0.0,
        has_tendons=has_tendons(source),
    )


def _find_range(source: RunData, name: str) -> tuple[float, float] | None:
    column = source.columns[name]
    return (float(column.min()), float(column.max())) if column.size else None


def settings_table(source: RunData) -> Table:
    """Return the settings of the plan, and those of the loop that its law uses."""
    return make_settings_table(() if source.run.set_to.declared is None else select_used_settings(source.run), source)


def make_settings_table(declared: Sequence[DeclaredValue], source: RunData) -> Table:
    """Return a table of settings with their units."""
    rows = tuple(
        (
            item.meaning,
            item.symbol,
            format_setting(item.value, item.unit, source.angles),
            shown_unit(item.unit, source.angles),
        )
        for item in declared
    )
    titles = (
        Column("Setting", number=False, wide=True),
        Column("Symbol", number=False),
        Column("Value"),
        Column("Unit", number=False),
    )
    return Table(messages.settings_of_run(), titles, rows)


def lineage(source: RunData) -> tuple[Paragraph | Table, ...]:
    """Return the origin of the gains: bank entries with their identifications.

    Returns nothing for a law that uses none of these gains.
    """
    if "bank" not in USED_SETTINGS[find_control_law(source.run)]:
        return ()
    if source.bank is None:
        return (Paragraph(messages.gains_of_geometry()),)
    rows = tuple(
        (
            stored_entry_name(entry),
            format_measured(entry.S_nominal, 4),
            *(
                format_measured(value, 4)
                for value in (entry.known.K_q, entry.known.T_q, entry.known.K_S, entry.known.T_S)
            ),
            _came_from(source, entry),
            *_fits(source, entry),
        )
        for entry in source.bank.entries
    )
    columns = (
        Column("Operating point", number=False),
        Column("S_nominal", "N·m/rad"),
        Column("K_q"),
        Column("T_q", "s"),
        Column("K_S"),
        Column("T_S", "s"),
        Column("From", number=False),
        Column("Fit of G_q", number=False),
        Column("Fit of G_S", number=False),
    )
    caption = messages.entries_of_bank(name=source.bank.name, version=source.bank.version)
    return (Table(caption, columns, rows),)


def _came_from(source: RunData, entry: BankEntry) -> str:
    run_id = None if entry.identification_id is None else source.runs_of[entry.identification_id]
    return "imported" if run_id is None else messages.identification_of_run(run_id=run_id)


def _fits(source: RunData, entry: BankEntry) -> tuple[str, ...]:
    """Return the fits of both models of an entry; an imported one has none."""
    fits = source.fits.get(entry.identification_id or 0)
    return tuple(messages.not_known() if fits is None else fits[name].in_words() for name in CHANNELS)


def parameter_section(source: RunData) -> ReportSection:
    """Return every number of the parameter set with unit and source."""
    rows = tuple(
        (
            f"{section}.{entry}",
            format_setting(number.value, number.unit, source.angles),
            shown_unit(number.unit, source.angles),
            number.source,
        )
        for section, entries in PLANT_NUMBERS.read(source.run.parameters, f"run {source.run.id}").items()
        for entry, number in entries.items()
    )
    columns = (
        Column("Parameter", number=False),
        Column("Value"),
        Column("Unit", number=False),
        Column("Source", number=False, wide=True, quoted=True),
    )
    caption = messages.parameter_set_at_start(name=source.run.parameters_name)
    return ReportSection("Plant parameters", (Table(caption, columns, rows),))


def format_setting(value: Any, unit: str, angles: AngleUnit) -> str:
    """Return a chosen number, or a list of them, in the display unit."""
    if isinstance(value, list):
        return "; ".join(format_setting(item, unit, angles) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return exact(convert_to_display(value, unit, angles))
    return str(value)


def shown_unit(unit: str, angles: AngleUnit) -> str:
    """Return a unit for display; counts have none."""
    return "" if unit == "1" else get_display_unit(unit, angles).unit


# Verdict -------------------------------------------------------------------------------------------
# The verdict on a run in one word and one sentence, the same in report, page, dry run and command line. Pure functions.


__all__ = ["SEEN", "Outcome", "RunVerdict", "judge_stored_run"]


@dataclass(frozen=True)
class RunVerdict:
    """The outcome and a sentence that states it."""

    outcome: Outcome
    sentence: str


def judge_stored_run(metrics: Metrics | None, criteria: Sequence[RunCriterion], problem: str = "") -> RunVerdict:
    """Judge a run by its stored metrics and criteria.

    ``problem`` is the reason if there are no metrics.
    """
    if metrics is None:
        return RunVerdict(judge_run(metrics, criteria), messages.no_result(problem=problem))
    if not metrics.complete:
        sentence = messages.run_incomplete(
            played_s=metrics.played_s, planned_s=metrics.planned_s, failed=_titles(criteria, passed=False)
        )
        return RunVerdict(judge_run(metrics, criteria), sentence)
    if not criteria:
        return RunVerdict(judge_run(metrics, criteria), messages.no_criteria())
    failed, unmeasured = _titles(criteria, passed=False), _titles(criteria, passed=None)
    sentence = messages.verdict_on_criteria(criteria=len(criteria), failed=failed, unmeasured=unmeasured)
    return RunVerdict(judge_run(metrics, criteria), sentence)


SEEN = {"<": "lower bound", ">": "upper bound"}
"""Meaning of a figure that was measured in part, by the relation to its bound."""


def _titles(criteria: Sequence[RunCriterion], *, passed: bool | None) -> list[str]:
    return [item.title for item in criteria if item.passed is passed]


# Results -------------------------------------------------------------------------------------------
# The result of a run: criteria, figures, and a sentence.


OUTCOMES = {Grade.USABLE: "passed", Grade.CAUTION: "incomplete", Grade.UNUSABLE: "failed"}
"""Outcome of a report by the grade of its model."""

_WORDS = {True: "pass", False: "fail", None: messages.not_measured()}


def verdict(source: RunData) -> tuple[str, str]:
    """Return the outcome (passed, failed, incomplete or neutral) and its sentence."""
    result = source.result
    found = (
        judge_stored_run(None, (), source.run.evaluation_problem)
        if result is None
        else judge_stored_run(result.metrics, result.criteria)
    )
    return found.outcome, found.sentence


def definitions_facts(sources: Sequence[RunData]) -> tuple[Fact, ...]:
    """Return a line that names runs evaluated by other than the present definitions.

    Returns nothing if there are none.
    """
    of = {source.run.id: source.result.metrics.definitions for source in sources if source.result is not None}
    others = {number: version for number, version in of.items() if version != DEFINITIONS}
    if not others:
        return ()
    text = messages.result_of_earlier_definitions(versions=others, current=DEFINITIONS, is_series=len(sources) > 1)
    return (Fact("Definitions", text),)


def format_figure(value: float | None, digits: int = 3) -> str:
    """Format a figure, or "not measured"."""
    return messages.not_measured() if value is None else format_measured(value, digits)


def read_or_none(value: float | None, unit: str, angles: AngleUnit) -> float | None:
    """Return a figure in the display unit; None if it was not measured."""
    return None if value is None else convert_to_display(value, unit, angles)


def results_section(source: RunData) -> tuple[ReportSection, ...]:
    """Return criteria and figures; nothing for a run without a result."""
    if source.result is None:
        return ()
    tables = (
        criteria_table(source.result.criteria, source.angles),
        figures_table(source.result.metrics, source.angles),
    )
    return (ReportSection("Results", tables if source.result.criteria else tables[1:]),)


def criteria_table(criteria: Sequence[RunCriterion], angles: AngleUnit) -> Table:
    """Return each criterion with bound, figure and result."""
    columns = (
        Column("Criterion", number=False),
        Column("Bound"),
        Column("Value"),
        Column("Unit", number=False),
        Column("Result", number=False, wide=True),
    )
    rows = tuple(
        (
            item.title,
            f"{item.relation} {exact(convert_to_display(item.bound, item.unit, angles))}",
            format_figure(read_or_none(item.figure, item.unit, angles)),
            shown_unit(item.unit, angles),
            _with_reason(
                _WORDS[item.passed],
                item.reason,
                "" if item.passed is None else SEEN[item.relation],
            ),
        )
        for item in criteria
    )
    return Table("Criteria.", columns, rows)


def measured_figures(source: RunData) -> tuple[Table, ...]:
    """Return the table of figures; nothing for a run without a result."""
    return () if source.result is None else (figures_table(source.result.metrics, source.angles),)


def figures_table(metrics: Metrics, angles: AngleUnit) -> Table:
    """Return the figures of a result with units and definitions."""
    columns = (
        Column("Quantity", number=False),
        Column("Value"),
        Column("Unit", number=False),
        Column("Definition", number=False, wide=True),
    )
    rows = tuple(
        (
            item.label,
            format_figure(read_or_none(item.value, item.unit, angles)),
            shown_unit(item.unit, angles),
            _with_reason(
                item.definition,
                item.reason,
                "" if item.value is None else SEEN["<"],
            ),
        )
        for item in metrics.figures
    )
    return Table(messages.metrics_of_signals(complete=metrics.complete), columns, rows)


def _with_reason(text: str, reason: str, comparison: str) -> str:
    if not reason:
        return text
    return f"{text}; {comparison}: {reason}" if comparison else f"{text}; {reason}"


# Reproduction --------------------------------------------------------------------------------------
# Reproduction of a simulated run: a command to copy, and the files that it needs.


_IDENTIFY = {
    RunKind.ACTUATOR_IDENTIFICATION: "actuator",
    RunKind.MOTOR_IDENTIFICATION: "motor",
    RunKind.SPRING_IDENTIFICATION: "spring",
}
_PARAMETERS_FILE, _EXPERIMENT_FILE = "parameters.toml", "experiment.json"
_FOLDER = "reproduced"
_LINE = 92
"""Maximum length of a command line [characters], so that it fits between the margins of a page."""


def reproduction(source: RunData) -> tuple[Block, ...]:
    """Return the command that repeats a run and its files, or the reason for none."""
    if reason := _not_again(source):
        return (Paragraph(messages.no_command_repeats_run(reason=reason)),)
    return tuple(_blocks(source))


def _not_again(source: RunData) -> str:
    run = source.run
    if run.plant != SIMULATOR.name:
        return messages.not_on_simulator(plant=run.plant)
    if run.set_to.plan is None:
        return messages.operated_manually()
    if run.end_state != EndState.COMPLETED:
        return messages.program_not_completed()
    return ""


def _blocks(source: RunData) -> Iterator[Block]:
    run, plan = source.run, dict(source.run.set_to.plan or {})
    words = ["sinew"]
    experiment = str(plan.pop("experiment")) if "experiment" in plan else ""
    files: list[Code] = []
    if run.kind in _IDENTIFY:
        words += ["identify", _IDENTIFY[RunKind(run.kind)]]
    elif not experiment or (ready := _ready_made(experiment)):
        words += ["experiment", run.kind if not experiment else ready]
    else:
        words += ["experiment", _EXPERIMENT_FILE]
        caption = messages.experiment_as_executed(file=_EXPERIMENT_FILE)
        files.append(Code(caption, _indent_json(json.loads(experiment))))
    lines = [" ".join(words)]
    lines += [
        f"--set {_quote_option(name, value)}" for name, value in {**plan, **run.set_to.loop.get_known_values()}.items()
    ]
    parameters = run.parameters_name
    if not _is_shipped(source):
        parameters = _PARAMETERS_FILE
        files.append(Code(messages.parameters_of_plant(file=_PARAMETERS_FILE), _toml(source)))
    where = [f"--params {parameters}", f"--out {_FOLDER}/report"]
    if source.bank is None:
        where.append(f"--data {_FOLDER}")
    yield Code(_caption(source, bool(files)), " \\\n  ".join([lines[0], *_wrap_words([*lines[1:], *where])]))
    yield from files


def _wrap_words(words: Sequence[str]) -> Iterator[str]:
    """Yield lines of as many words as fit; a word with line breaks stands alone."""
    line = ""
    for word in words:
        if line and ("\n" in line + word or len(line) + len(word) >= _LINE):
            yield line
            line = ""
        line = f"{line} {word}".strip()
    yield line


def _caption(source: RunData, files: bool) -> str:
    bank = source.bank
    return messages.repeat_this_run(
        folder=_FOLDER,
        bank=bank.name if bank else None,
        bank_version=bank.version if bank else 0,
        has_files=files,
        is_real_time=source.run.set_to.granted is not None,
    )


def _ready_made(experiment: str) -> str:
    """Return the name of the built-in experiment with the same text.

    Returns "" if there is none.
    """
    name = str(json.loads(experiment).get("name", ""))
    if name not in PAPER_EXPERIMENTS and name not in experiments_by_name():
        return ""
    try:
        return name if parser.to_canonical_text(library.load_ready_experiment(name)[0]) == experiment else ""
    except (KeyError, OSError):
        return ""


def _quote_option(name: str, value: Value) -> str:
    if isinstance(value, bool):
        return f"{name}={str(value).lower()}"
    return shlex.quote(f"{name}={value if isinstance(value, str) else repr(value)}")


def _is_shipped(source: RunData) -> bool:
    """Return whether the parameters equal those of a set that is part of Sinew."""
    name = source.run.parameters_name
    return name in SHIPPED and load_parameters(name).to_document() == source.run.parameters


def _indent_json(document: object) -> str:
    return json.dumps(document, indent=1, ensure_ascii=True)


def _toml(source: RunData) -> str:
    """Return a parameter set as TOML; its strings are escaped as in JSON."""
    lines = []
    for section, entries in PLANT_NUMBERS.read(source.run.parameters, f"run {source.run.id}").items():
        lines.append(f"[{section}]")
        for entry, number in entries.items():
            annotation = f"unit = {_quote_toml(number.unit)}, source = {_quote_toml(number.source)}"
            lines.append(f"{entry} = {{ value = {json.dumps(number.value)}, {annotation} }}")
        lines.append("")
    return "\n".join(lines[:-1])


def _quote_toml(words: str) -> str:
    return json.dumps(words, ensure_ascii=False).replace("\x7f", "\\u007f")


# Experiment ----------------------------------------------------------------------------------------
# The common structure of the reports of all experiments with criteria.


def has_tendons(source: RunData) -> bool:
    """Return whether the actuator of the run has tendons with load cells."""
    return "spring" in source.run.parameters


def _select_notes(source: RunData, notes: tuple[str, ...]) -> Iterator[str]:
    """Yield the notes that apply to the actuator of the run."""
    for note in notes:
        if has_tendons(source) or note not in _NOTES_ON_TENDONS:
            yield note
        elif note == messages.S_is_an_estimate():
            yield messages.S_of_mechanism()


_NOTES_ON_TENDONS = (
    messages.S_is_an_estimate(),
    messages.both_motors_double_the_gains(),
    messages.tension_after_pretension(),
)


def experiment_report(
    source: RunData, title: str, name: str, results: Iterable[ReportSection], notes: tuple[str, ...]
) -> Report:
    """Build the report of an experiment.

    It has verdict and criteria, origin, figures (``results``), notes and parameters. ``name`` is the name of the
    experiment in the footer. The report of a run without a result says why.
    """
    outcome, sentence = verdict(source)
    return Report(
        title=title,
        subtitle=subtitle(source),
        outcome=outcome,
        verdict=sentence,
        facts=(*facts(source), *tuning_facts(source)),
        sections=(
            *results_section(source),
            ReportSection(
                messages.settings_and_origin(), (settings_table(source), *reproduction(source), *lineage(source))
            ),
            *results,
            ReportSection("Notes", tuple(Paragraph(note) for note in _select_notes(source, notes))),
            parameter_section(source),
        ),
        footer=messages.footer(software=source.run.software, report=name, run_id=source.run.id),
        date=source.run.started_at,
    )
