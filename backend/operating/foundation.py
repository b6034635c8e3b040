"""What the loop starts from: parameters, database, the tuning in force, what was brought up, whether hands are in."""

import logging
from contextlib import AsyncExitStack
from dataclasses import dataclass

from backend.archive.soundness import Soundness
from backend.commissioning.session import KeptHands
from backend.commissioning.steps import brought_up_of
from backend.experiments import applied_parameters
from backend.models.document import UnreadableDocumentError
from backend.operating.kept_figures import KeptFigures
from backend.operating.kept_tuning import KeptTuning
from backend.operating.tuning_in_use import TuningInUse
from backend.realtime.ipc import Setup
from backend.realtime.supervisor import Launched, Supervisor
from backend.settings import Settings
from backend.storage import runs
from backend.storage.claims import HeldClaim
from backend.storage.database import Database, database_file, open_database, recover
from backend.storage.stations import HeldStation
from backend.supervision import Part, Supervision
from plant.parameters import ParameterError, PlantParameters, load_parameters

SEED = 0
_CLAIM = Part("The sign of life on the database", "Another service may take the database over.")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Foundation:
    """What has to be known before the loop is told what to drive; ``said`` is a sentence on the tuning, or empty.

    ``base`` are the parameters of the file, ``parameters`` those in force.
    """

    base: PlantParameters
    parameters: PlantParameters
    database: Database
    claim: HeldClaim
    soundness: Soundness
    figures: KeptFigures
    kept: KeptTuning
    tuning: TuningInUse
    said: str
    hands: KeptHands
    supervisor: Supervisor


def lay_foundation(
    settings: Settings, launched: Launched, supervision: Supervision, stack: AsyncExitStack
) -> Foundation:
    """Open the database and read from it what the ``launched`` loop process is to be told; ``stack`` closes it again.

    Raises StorageError, StationTakenError, SchemaError, ParameterError and TuningError.
    """
    base = load_parameters(settings.params)
    file = database_file(settings.data, settings.database_url)
    for sentence in [] if file is None else recover(file):
        _log.warning("%s", sentence)
    database = open_database(settings.data, settings.database_url, settings.database_password(), settings.station)
    stack.callback(database.close)
    stack.callback(HeldStation(database.engine, settings.station).let_go)
    claim = HeldClaim(database.engine, settings.station)
    stack.callback(claim.let_go)
    supervision.keep_thread(_CLAIM, claim.run, claim.end)
    soundness = Soundness(database, settings.data)
    soundness.before_start()
    _close_interrupted(database)
    figures = KeptFigures()
    figures.restore()
    stack.callback(figures.keep)
    kept = KeptTuning(database)
    version, version_said = in_force(database, base)
    parameters, applied = version.parameters, version.applied
    tuning, said = kept.restore(parameters)
    said = "; ".join(part for part in (version_said, said) if part)
    brought_up = brought_up_of(database, settings.plant_choice)
    hands = KeptHands(database, settings.plant_choice)
    identified = {} if applied is None else applied_parameters.sections_of(applied)
    drives_off = hands.left is not None
    setup = Setup(settings.plant_choice, settings.params, SEED, tuning.command(), brought_up, drives_off, identified)
    supervisor = Supervisor(setup, supervision, launched)
    return Foundation(base, parameters, database, claim, soundness, figures, kept, tuning, said, hands, supervisor)


def in_force(database: Database, base: PlantParameters) -> tuple[applied_parameters.Version, str]:
    """Return the version of the parameters in force, and a sentence on it for the journal; empty for an untouched file.

    It is the file where what was applied is for another one, or cannot be had.
    """
    try:
        version = applied_parameters.versions(database, base)[0]
        last = applied_parameters.last_applied_by(database)
    except (UnreadableDocumentError, ParameterError) as error:
        _log.exception("what was applied to the parameters cannot be had any more")
        return applied_parameters.Version(0, base), f"the parameters are those of the file: {error}"
    if version.number:
        return (
            version,
            f"parameters in force again as {version.who} left them: version {version.number} over {base.name}",
        )
    other = f"the parameters are those of the file {base.name}: what {last} applied last was over other ones"
    return version, other if last else ""


def _close_interrupted(database: Database) -> None:
    with database.session() as session:
        interrupted = runs.close_interrupted(session)
    if interrupted:
        _log.warning("runs closed that the last service left open: %s", interrupted)
