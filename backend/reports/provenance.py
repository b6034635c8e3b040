"""What every report says of where a run comes from: who, when, on what, with which settings, gains and parameters."""

from collections.abc import Sequence
from typing import Any

from backend.documents.actuator import CHANNELS
from backend.documents.plant_numbers import PLANT_NUMBERS
from backend.documents.run_settings import DeclaredValue
from backend.loop.program import Law
from backend.reading import Angles, read, reading_of
from backend.reports.document import Column, Fact, Paragraph, Section, Table, exact, shown
from backend.reports.source import Source
from backend.storage.bank_entry import name_of_entry
from backend.storage.banks import BankEntry
from backend.storage.runs import EndState
from plant.choice import SIMULATED

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
        lines.append(Fact("Note", run.note, quoted=True))
    versions = run.set_to.versions or {}
    software = ", ".join([f"Sinew {run.software}", *(f"{name} {version}" for name, version in versions.items())])
    return (*lines, Fact("Software", software))


def tuning_facts(source: Source) -> tuple[Fact, ...]:
    """Return λ as the samples have it, the rest of the tuning in use and the seed of the simulator."""
    settings = source.run.set_to
    loop = settings.loop
    parts = [f"λ_{name} = {_lam_text(source, name)}" for name in ("q", "S")]
    if loop.lam_motor is not None:
        parts.append(f"λ_motor = {exact(loop.lam_motor)} s")
    parts.append("b was not recorded then" if loop.b is None else f"b = {exact(loop.b)}")
    bank = source.bank
    gains = f"bank “{bank.name}” version {bank.version}" if bank else "from geometry, 20 N point"
    law = settings.law
    controller = f"cascade, gains of {gains}" if bank else f"cascade, gains {gains}"
    if law != Law.CASCADE:
        controller = f"{law}, for comparison; the cascade's gains were not in use"
    if bank is not None and len(bank.entries) > 1 and law == Law.CASCADE:
        controller += ", interpolating between entries" if loop.interpolate else ", switching between entries"
    if law == Law.CASCADE:
        if loop.budget:
            controller += f"; motion time-optimal within U_plan = {exact(loop.budget)} V"
        else:
            controller += "; motion lambda: the paper's law with the governor"
        if loop.k_ext:
            controller += f"; pushes rejected by feed-forward, k_ext = {exact(loop.k_ext)}"
    lines = [Fact("Tuning", ", ".join(parts)), Fact("Controller", controller)]
    if source.run.plant in SIMULATED and loop.seed is not None:
        lines.append(Fact("Seed", str(loop.seed)))
    return tuple(lines)


def _lam_text(source: Source, name: str) -> str:
    column = source.columns[f"lam_{name}"]
    if column.size == 0:
        return "not known, no sample was recorded"
    low, high = float(column.min()), float(column.max())
    low_text, high_text = exact(round(low, 5)), exact(round(high, 5))
    return f"{low_text} s" if low_text == high_text else f"{low_text} to {high_text} s (changed during the run)"


def settings_table(source: Source) -> Table:
    """Return the settings of the plan and of the loop with their units, as the run stored them."""
    return table_of(source.run.set_to.declared or (), source)


def table_of(declared: Sequence[DeclaredValue], source: Source) -> Table:
    """Return settings with their units."""
    rows = tuple(
        (
            item.meaning,
            item.symbol,
            chosen(item.value, item.unit, source.angles),
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
    return Table("Settings of the run.", titles, rows)


def lineage(source: Source) -> tuple[Paragraph | Table, ...]:
    """Return where the gains came from: the entries of the bank with their identifications."""
    if source.bank is None:
        return (
            Paragraph(
                "Gains were computed from the plant's geometry and its nominal lags; no identification was used."
            ),
        )
    rows = tuple(
        (
            name_of_entry(entry),
            shown(entry.S_nominal, 4),
            *(shown(value, 4) for value in (entry.known.K_q, entry.known.T_q, entry.known.K_S, entry.known.T_S)),
            _came_from(source, entry),
            *_fits(source, entry),
        )
        for entry in source.bank.entries
    )
    columns = (
        Column("Entry", number=False),
        Column("S_nominal", "N·m/rad"),
        Column("K_q"),
        Column("T_q", "s"),
        Column("K_S"),
        Column("T_S", "s"),
        Column("From", number=False),
        Column("Fit of G_q", number=False),
        Column("Fit of G_S", number=False),
    )
    return (Table(f"Entries of bank “{source.bank.name}” version {source.bank.version}.", columns, rows),)


def _came_from(source: Source, entry: BankEntry) -> str:
    run_id = None if entry.identification_id is None else source.runs_of[entry.identification_id]
    return "imported" if run_id is None else f"identification {run_id}"


def _fits(source: Source, entry: BankEntry) -> tuple[str, ...]:
    """Return how good both models of an entry are; an imported one came without that."""
    fits = source.fits.get(entry.identification_id or 0)
    return ("not known", "not known") if fits is None else tuple(fits[name].in_words() for name in CHANNELS)


def parameter_section(source: Source) -> Section:
    """Return every number of the parameter set with unit and source."""
    rows = tuple(
        (
            f"{section}.{entry}",
            chosen(number.value, number.unit, source.angles),
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
    caption = f"Parameter set “{source.run.parameters_name}” as it was when the run began."
    return Section("Plant parameters", (Table(caption, columns, rows),))


def chosen(value: Any, unit: str, angles: Angles) -> str:
    """Return a number that somebody chose, or a list of such, as it is read."""
    if isinstance(value, list):
        return "; ".join(chosen(item, unit, angles) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return exact(read(value, unit, angles))
    return str(value)


def shown_unit(unit: str, angles: Angles) -> str:
    """Return a unit as it is printed; counts have none."""
    return "" if unit == "1" else reading_of(unit, angles).unit
