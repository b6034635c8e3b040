"""From chosen identifications to a controller bank, and from a bank to the gains the loop is given."""

from collections.abc import Sequence
from itertools import pairwise

from backend.experiments.loop_settings import LoopSettings
from backend.loop.commands import SetTuning
from backend.loop.tuned import tuning_for
from backend.storage import Database, banks, identifications
from backend.storage.banks import Bank, BankEntry
from backend.storage.identifications import Identification
from backend.tuning.models import PointModel
from plant.parameters import PlantParameters

LEAST_DISTANCE = 0.3
"""Two entries closer than this in stiffness [N·m/rad] describe the same point: one of them is superfluous."""

MODEL_NAMES = ("K_q", "T_q", "K_S", "T_S")


class BankError(ValueError):
    """The chosen identifications make no bank; the message says which and why."""


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
    for name, value in model.items():
        if not value > 0.0:
            raise BankError(f"identification {identification.id} has {name} = {value:g}: it must be above 0")
    model["tension_N"] = identification.options["tension_N"]
    return BankEntry(identification.model["S_nominal"], model, identification.id)


def build_bank(database: Database, name: str, chosen: Sequence[int], who: str, note: str = "") -> Bank:
    """Store the next version of a bank from identifications, ordered by stiffness.

    Raises BankError, UnknownRecordError.
    """
    if not name.strip():
        raise BankError("a bank needs a name")
    if not chosen:
        raise BankError("a bank needs at least one identification")
    with database.reading() as session:
        found = [identifications.get(session, number) for number in chosen]
    entries = sorted((entry_of(identification) for identification in found), key=lambda entry: entry.S_nominal)
    for below, above in pairwise(entries):
        if above.S_nominal - below.S_nominal < LEAST_DISTANCE:
            distance = above.S_nominal - below.S_nominal
            raise BankError(
                f"identifications {below.identification_id} and {above.identification_id} are {distance:.2f} N·m/rad "
                f"apart, less than {LEAST_DISTANCE:g}: choose one of them"
            )
    with database.session() as session:
        return banks.add(session, name.strip(), entries, who, note)


def points_of(bank: Bank | None) -> tuple[PointModel, ...]:
    """Return the models of a bank's entries; none without a bank."""
    entries = bank.entries if bank else ()
    return tuple(PointModel(entry.S_nominal, **{name: entry.model[name] for name in MODEL_NAMES}) for entry in entries)


def tuning_command(parameters: PlantParameters, settings: LoopSettings, bank: Bank | None) -> SetTuning:
    """Return the command that puts a bank into use with these λ. Raises TuningError."""
    return tuning_for(parameters, settings.lambdas, points_of(bank), interpolate=settings.interpolate)
