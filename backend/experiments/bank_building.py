"""From chosen identifications to a controller bank, and from a bank to the gains the loop is given."""

from collections.abc import Sequence

from backend.experiments.bank_consistency import (
    BankError,
    NamedEntry,
    point_of,
    require_consistent,
    require_same_parameters,
)
from backend.experiments.tuning_choice import TuningChoice
from backend.loop.commands import SetTuning
from backend.loop.tuned import tuning_for
from backend.storage import Database, Session, banks, identifications, runs
from backend.storage.banks import Bank, BankEntry
from backend.storage.identifications import Identification
from backend.tuning.models import PointModel
from plant.parameters import PlantParameters


def entry_of(identification: Identification) -> BankEntry:
    """Return the bank entry that an actuator identification gives. Raises BankError."""
    if identification.kind != "actuator":
        raise BankError(
            f"identification {identification.id} is of kind {identification.kind}: choose actuator identifications"
        )
    if not identification.usable:
        raise BankError(f"identification {identification.id} is not usable for tuning: {identification.verdict}")
    G_q, G_S = (identification.model[name]["first_order"] for name in ("G_q", "G_S"))
    model = {"K_q": G_q["K"], "T_q": G_q["T"], "K_S": G_S["K"], "T_S": G_S["T"]}
    model["tension_N"] = identification.options["tension_N"]
    return BankEntry(identification.model["S_nominal"], model, identification.id)


def build_bank(
    database: Database, parameters: PlantParameters, name: str, chosen: Sequence[int], who: str, note: str = ""
) -> Bank:
    """Store the next version of a bank from identifications, ordered by stiffness.

    Raises BankError, UnknownRecordError.
    """
    require_name(name)
    with database.reading() as session:
        named = [_named(session, parameters, number) for number in chosen]
    entries = require_consistent(parameters, named)
    with database.session() as session:
        return banks.add(session, name.strip(), entries, who, note)


def require_name(name: str) -> None:
    """Raise BankError unless a bank can be called so."""
    if not name.strip():
        raise BankError("a bank needs a name")


def points_of(bank: Bank | None) -> tuple[PointModel, ...]:
    """Return the models of a bank's entries; none without a bank."""
    return tuple(point_of(entry) for entry in (bank.entries if bank else ()))


def tuning_command(parameters: PlantParameters, choice: TuningChoice, bank: Bank | None) -> SetTuning:
    """Return the command that puts a tuning on the models of ``bank`` into use. Raises TuningError."""
    return tuning_for(parameters, choice.lambdas, points_of(bank), interpolate=choice.interpolate)


def _named(session: Session, parameters: PlantParameters, number: int) -> NamedEntry:
    found = identifications.get(session, number)
    entry, name = entry_of(found), f"identification {found.id}"
    if found.run_id is not None:
        require_same_parameters(parameters, name, runs.get(session, found.run_id).parameters)
    return NamedEntry(name, entry)
