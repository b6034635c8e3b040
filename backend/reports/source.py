"""What a report is made from: the run as stored, its result, its samples, the bank it used."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from backend.recording.columns import Columns, recorded_columns
from backend.reports.document import Column, Fact, Section, Table, exact, shown
from backend.storage import Database, banks, identifications, results, runs
from backend.storage.banks import Bank
from backend.storage.identifications import Identification
from backend.storage.results import Result
from backend.storage.runs import EndState, Run


@dataclass(frozen=True)
class Source:
    """A run with all that its report says. ``columns`` are its samples, t [s] from the first."""

    run: Run
    result: Result | None
    columns: Columns
    bank: Bank | None
    identification: Identification | None = None


def load_source(database: Database, run_id: int) -> Source:
    """Gather what is stored of a run: its newest result and identification, the bank it used, its samples.

    Raises UnknownRecordError.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
        result = results.newest(session, run_id)
        bank = None if run.bank_id is None else banks.get(session, run.bank_id)
        estimates = identifications.find(session, run_id=run_id)
    return Source(run, result, recorded_columns(database, run_id)[0], bank, estimates[0] if estimates else None)


END_STATES = {
    EndState.RUNNING: "still running",
    EndState.COMPLETED: "completed",
    EndState.STOPPED: "stopped by the operator",
    EndState.TRIPPED: "tripped",
    EndState.LINK_LOST: "link to the loop lost",
    EndState.SERVICE_DIED: "service died",
}


def subtitle(source: Source) -> str:
    """Return one line that tells this run from all others."""
    run = source.run
    return f"Run {run.id} · {run.started_at:%Y-%m-%d %H:%M} UTC · {run.plant}, parameters “{run.parameters_name}”"


def facts(source: Source) -> tuple[Fact, ...]:
    """Return what heads every report: who, when, on what, how it ended, with which software."""
    run = source.run
    ended = END_STATES[EndState(run.end_state)] + (f": {run.end_detail}" if run.end_detail else "")
    lines = [
        Fact("Run", f"{run.id}, {ended}"),
        Fact("Started", f"{run.started_at:%Y-%m-%d %H:%M:%S} UTC by {run.who}"),
        Fact("Plant", f"{run.plant}, parameters “{run.parameters_name}”"),
    ]
    if run.note:
        lines.append(Fact("Note", run.note))
    versions = run.settings.get("versions", {})
    software = ", ".join([f"Sinew {run.software}", *(f"{name} {version}" for name, version in versions.items())])
    return (*lines, Fact("Software", software))


def settings_table(source: Source) -> Table:
    """Return the settings of the plan and of the loop with their units, as the run stored them."""
    rows = tuple(
        (str(item["meaning"]), str(item["symbol"]), _value(item["value"]), _unit(item["unit"]))
        for item in source.run.settings.get("declared", [])
    )
    titles = (
        Column("Setting", number=False, wide=True),
        Column("Symbol", number=False),
        Column("Value"),
        Column("Unit", number=False),
    )
    return Table("Settings of the run.", titles, rows)


def figures_table(metrics: Mapping[str, Any]) -> Table:
    """Return the figures of a result, each with unit and definition."""
    columns = (
        Column("Quantity", number=False),
        Column("Value"),
        Column("Unit", number=False),
        Column("Definition", number=False, wide=True),
    )
    part = "" if metrics["complete"] else " The run is incomplete: only finished steps count."
    rows = tuple(
        (item["label"], shown(item["value"]), _unit(item["unit"]), item["definition"]) for item in metrics["figures"]
    )
    return Table(f"Metrics on measured signals.{part}", columns, rows)


def parameter_section(source: Source) -> Section:
    """Return every number of the parameter set with unit and source."""
    rows = tuple(
        (f"{section}.{entry}", _value(item["value"]), _unit(item["unit"]), str(item["source"]))
        for section, entries in source.run.parameters.items()
        for entry, item in entries.items()
    )
    columns = (
        Column("Parameter", number=False),
        Column("Value"),
        Column("Unit", number=False),
        Column("Source", number=False, wide=True),
    )
    caption = f"Parameter set “{source.run.parameters_name}” as it was when the run began."
    return Section("Plant parameters", (Table(caption, columns, rows),))


def _value(value: Any) -> str:
    if isinstance(value, list):
        return "; ".join(_value(item) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return exact(value) if isinstance(value, float) else str(value)


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit
