"""From chosen identifications to a controller bank, and from a bank to the gains the loop is given."""

from collections.abc import Sequence
from typing import Protocol

from backend.documents.bank_entry import ENTRY, EntryModel
from backend.experiments.banks.bank_consistency import (
    BankError,
    NamedEntry,
    point_of,
    require_consistent,
    require_same_parameters,
)
from backend.experiments.banks.tuning_choice import TuningChoice
from backend.plain_text import PlainTextError, require_line
from backend.realtime.gains import tuning_for
from backend.realtime.program import SetTuning
from backend.storage import banks, identifications, runs
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Database, Session
from backend.storage.identifications import Identification
from backend.tuning.gains import PointModel
from plant.parameters import PlantParameters


class HasEntries(Protocol):
    """A bank as it is stored, or as a report carries it."""

    @property
    def entries(self) -> tuple[BankEntry, ...]:
        """Its entries in order of stiffness."""


def name_of(identification: Identification) -> str:
    """Return what an identification is called: by the run it came from, or by what it was made of."""
    if identification.run_id is None:
        return f"{identification.kind} identification from elsewhere (estimate {identification.id})"
    return f"identification {identification.run_id}"


def entry_of(identification: Identification) -> BankEntry:
    """Return the bank entry that an actuator identification gives. Raises BankError."""
    if identification.kind != "actuator":
        raise BankError(f"{name_of(identification)} is of kind {identification.kind}: choose actuator identifications")
    if not identification.usable:
        raise BankError(f"{name_of(identification)} is not usable for tuning: {identification.verdict}")
    found = identification.early_model
    G_q, G_S = (None if channel is None else channel.first_order for channel in (found.G_q, found.G_S))
    if found.S_nominal is None or G_q is None or G_S is None:
        raise BankError(f"{name_of(identification)} kept no first-order models: evaluate its run again")
    tension_N = identification.actuator_options.tension_N
    model = EntryModel(K_q=G_q.K, T_q=G_q.T, K_S=G_S.K, T_S=G_S.T, tension_N=tension_N)
    return BankEntry(found.S_nominal, ENTRY.write(model), identification.id)


def build_bank(
    database: Database, parameters: PlantParameters, name: str, run_ids: Sequence[int], who: str, note: str = ""
) -> Bank:
    """Store the next version of a bank from the newest estimates of identification runs, ordered by stiffness.

    Raises BankError, UnknownRecordError.
    """
    require_name(name)
    with database.reading() as session:
        named = [_named(session, parameters, run_id) for run_id in run_ids]
    entries = require_consistent(parameters, named)
    with database.session() as session:
        return banks.add(session, name.strip(), entries, who, note)


def require_name(name: str) -> None:
    """Raise BankError unless a bank can be called so."""
    if not name.strip():
        raise BankError("a bank needs a name")
    try:
        require_line(name)
    except PlainTextError as error:
        raise BankError(f"name of a bank: {error}") from None


def points_of(bank: HasEntries | None) -> tuple[PointModel, ...]:
    """Return the models of a bank's entries; none without a bank."""
    return tuple(point_of(entry) for entry in (bank.entries if bank else ()))


def tuning_command(parameters: PlantParameters, choice: TuningChoice, bank: Bank | None) -> SetTuning:
    """Return the command that puts a tuning on the models of ``bank`` into use. Raises TuningError."""
    return tuning_for(
        parameters, choice.lambdas, points_of(bank), None, choice.interpolate, choice.budget, choice.k_ext
    )


def _named(session: Session, parameters: PlantParameters, run_id: int) -> NamedEntry:
    found = identifications.of_run(session, run_id)
    entry, name = entry_of(found), name_of(found)
    require_same_parameters(parameters, name, runs.get(session, run_id).parameters)
    return NamedEntry(name, entry)
