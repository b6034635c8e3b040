"""The tuning in force as the data folder keeps it: for the next start of the service, and for the command line."""

import hashlib
import json
from dataclasses import dataclass

from backend.documents.kept_tuning import KEPT, KeptTuning
from backend.documents.plant_numbers import PLANT_NUMBERS
from backend.experiments.banks.tuning_choice import TuningChoice
from backend.storage import settings
from backend.storage.database import Database, Session
from backend.storage.settings import StoredSetting
from plant.parameters import PlantParameters

NAME = "tuning in force"
_LATER = ("motion", "u_plan", "k_ext")


@dataclass(frozen=True)
class KeptChoice:
    """What was in force, who left it so, and whether that was with the same numbers of the plant.

    ``lacks`` names parts that the document does not hold, as it is older than they are: they are at their defaults. One
    without ``motion``, ``u_plan`` or ``k_ext`` lacks nothing: there was the paper's law only, and pushes were the
    position loop's.
    """

    choice: TuningChoice
    who: str
    same_plant: bool
    lacks: tuple[str, ...] = ()


def put(database: Database, choice: TuningChoice, parameters: PlantParameters, who: str) -> None:
    """Keep a choice that has come into force."""
    with database.session() as session:
        document = KEPT.write(KeptTuning(**choice.document(), parameters=digest(parameters)))
        settings.put(session, NAME, document, who)


def newest(database: Database, parameters: PlantParameters) -> KeptChoice | None:
    """Return what was in force last, None on a new data folder.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    with database.reading() as session:
        kept = settings.newest(session, NAME)
    if kept is None:
        return None
    tuning = _read(kept)
    lacks = tuple(name for name in TuningChoice().document() if name not in _LATER and getattr(tuning, name) is None)
    return KeptChoice(TuningChoice.of(tuning.known()), kept.who, tuning.parameters == digest(parameters), lacks)


def earlier(session: Session, choice: TuningChoice, parameters: PlantParameters) -> TuningChoice | None:
    """Return the newest kept choice for this plant other than ``choice``; None where there is none.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    mine = digest(parameters)
    read = (_read(one) for one in settings.history(session, NAME))
    kept = (TuningChoice.of(one.known()) for one in read if one.parameters == mine)
    return next((one for one in kept if one != choice), None)


def left_with(session: Session, parameters: PlantParameters) -> TuningChoice | None:
    """Return what was in force last with these numbers of the plant; None where nothing was.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    mine = digest(parameters)
    read = (_read(one) for one in settings.history(session, NAME))
    return next((TuningChoice.of(one.known()) for one in read if one.parameters == mine), None)


def _read(kept: StoredSetting) -> KeptTuning:
    return KEPT.read(kept.value, f"the data folder, left by {kept.who}")


def digest(parameters: PlantParameters) -> str:
    """Tell one set of numbers from another, whatever it is called and wherever the numbers come from."""
    values = {
        section: {name: number.value for name, number in entries.items()}
        for section, entries in PLANT_NUMBERS.read(parameters.document(), parameters.name).items()
    }
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
