"""What every report says of where a run comes from: who, when, on what, with which settings, gains and parameters."""

from collections.abc import Sequence
from typing import Any

from backend.analysis.evaluation import USED, law_of, used_settings
from backend.models.identification import CHANNELS
from backend.models.run import PLANT_NUMBERS, DeclaredValue
from backend.realtime.program import Law
from backend.reports.document import Column, Fact, Paragraph, Section, Table, exact, shown
from backend.reports.source import Source
from backend.storage.banks import BankEntry, name_of_entry
from backend.storage.runs import EndState
from backend.units import Angles, read, reading_of
from plant.interface import SIMULATED

S_NOTE = (
    "S is everywhere the estimate 2 r_j² (k_1 + k_2 r_m (θ_A + θ_B)) from measured angles and the identified spring, "
    "not a direct measurement of stiffness. It is wrong by as much as the identified springs are wrong: where they are "
    "20 % stiffer than identified, S is 14.4 N·m/rad while 12 is asked for and shown, and no law based on angles can "
    "notice."
)
"""Said wherever S is shown as measured."""

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


_CONTROLLERS = {
    Law.SINGLE_LOOP: (
        "single loop on position and stiffness, for comparison: without motor loops, without bank and outer gains",
        "the identified geometry, spring and motors (K_m, T_m); its gains are for the point at 20 N",
    ),
    Law.FEEDBACK_LINEARIZATION: (
        "feedback linearisation (the static law), for comparison: without motor loops, without bank and outer gains",
        "the true plant: the equations and all numbers that the simulator computes with, friction and the differences "
        "between the sides included. On a rig nobody has such a model",
    ),
    Law.FORCE_HOLD: ("motor loops alone: motor A holds the tension, the excitation is added to its reference", ""),
    Law.MOTOR_STEPS: ("steps of voltage; between them the motor loops alone", ""),
    Law.TENSION_SWEEP: ("motor loops alone: they follow a sweep of the tension", ""),
}
"""What a law without the outer loops of the cascade is, and what it knows of the plant."""

_KNOWN = "the identified geometry, springs and motors (K_m, T_m), not their friction"


def tuning_facts(source: Source) -> tuple[Fact, ...]:
    """Return the parts of the tuning that the law uses, λ as the samples have it, and the seed of the simulator."""
    loop, law = source.run.set_to.loop, law_of(source.run)
    used = USED[law]
    parts = [f"λ_{name} = {_lam_text(source, name)}" for name in ("q", "S") if f"lam_{name}" in used]
    if loop.lam_motor is not None and "lam_motor" in used:
        parts.append(f"λ_motor = {exact(loop.lam_motor)} s")
    if "b" in used:
        parts.append("b was not recorded then" if loop.b is None else f"b = {exact(loop.b)}")
    controller, known = _CONTROLLERS.get(law) or (_cascade_in_words(source, law), _KNOWN)
    lines = [Fact("Tuning", ", ".join(parts)), Fact("Controller", controller)]
    if known:
        lines.append(Fact("The law knows", known))
    if source.run.plant in SIMULATED and loop.seed is not None:
        lines.append(Fact("Seed", str(loop.seed)))
    return tuple(lines)


def _cascade_in_words(source: Source, law: Law) -> str:
    """Return where the cascade's gains come from, and how it follows references and answers pushes."""
    loop, bank = source.run.set_to.loop, source.bank
    words = "cascade, " if law == Law.CASCADE else "cascade with the position loop open, "
    words += f"gains of bank “{bank.name}” version {bank.version}" if bank else "gains from geometry, 20 N point"
    if bank is not None and len(bank.entries) > 1:
        words += ", interpolating between entries" if loop.interpolate else ", switching between entries"
    if loop.budget:
        words += f"; motion time-optimal within U_plan = {exact(loop.budget)} V"
    elif law == Law.CASCADE:
        words += "; motion lambda: the paper's law with the governor"
    if loop.k_ext and law == Law.CASCADE:
        words += f"; pushes rejected by feed-forward, k_ext = {exact(loop.k_ext)}"
    return words


def _lam_text(source: Source, name: str) -> str:
    column = source.columns[f"lam_{name}"]
    if column.size == 0:
        return "not known, no sample was recorded"
    low, high = float(column.min()), float(column.max())
    low_text, high_text = exact(round(low, 5)), exact(round(high, 5))
    return f"{low_text} s" if low_text == high_text else f"{low_text} to {high_text} s (changed during the run)"


def settings_table(source: Source) -> Table:
    """Return the settings of the plan, and those of the loop that its law uses, with their units."""
    return table_of(() if source.run.set_to.declared is None else used_settings(source.run), source)


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
    """Return where the gains came from: the entries of the bank with their identifications.

    Nothing for a law that uses none of these gains.
    """
    if "bank" not in USED[law_of(source.run)]:
        return ()
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
