"""The tuning in force outlives the service: kept at each change, in force again at the next start."""

import hashlib
import json
import logging

from backend.api.tuning_in_use import TuningInUse, initial
from backend.refusal import OutOfRangeError
from backend.storage import Database, StorageError, banks, settings
from backend.storage.records import UnknownRecordError
from backend.tuning.formulas import TuningError
from backend.tuning.models import Lambdas
from plant.parameters import PlantParameters

NAME = "tuning in force"
_log = logging.getLogger(__name__)


class KeptTuning:
    """Writes and reads the tuning in force as a setting in the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def put(self, tuning: TuningInUse, who: str) -> None:
        """Keep a tuning that has come into force; where the disk refuses, the loop goes on and the log says so."""
        value = {**tuning.document(), "parameters": _digest(tuning.parameters)}
        try:
            with self._database.session() as session:
                settings.put(session, NAME, value, who)
        except StorageError:
            _log.exception("the tuning in force was not kept for the next start")

    def restore(self, parameters: PlantParameters) -> tuple[TuningInUse, str]:
        """Return what to start with, and a sentence on it for the journal, empty on a new data folder.

        What was kept for other parameters, or cannot be used any more, gives way to the defaults.
        """
        with self._database.reading() as session:
            kept = settings.newest(session, NAME)
        if kept is None:
            return initial(parameters), ""
        value = kept.value
        if value["parameters"] != _digest(parameters):
            return initial(parameters), "defaults in force: the tuning of last time was for other parameters"
        try:
            with self._database.reading() as session:
                bank = None if value["bank"] is None else banks.get(session, value["bank"])
            lambdas = Lambdas(value["lam_q"], value["lam_S"], value["lam_motor"])
            tuning = initial(parameters, lambdas, bank, value["interpolate"])
        except (OutOfRangeError, TuningError, UnknownRecordError) as error:
            return initial(parameters), f"defaults in force: the tuning of last time is refused, {error}"
        models = "gains from geometry" if bank is None else f"bank {bank.name}, version {bank.version}"
        lams = f"λ_q {lambdas.lam_q:.3f} s, λ_S {lambdas.lam_S:.3f} s"
        return tuning, f"in force again as {kept.who} left it: {models}, {lams}"


def _digest(parameters: PlantParameters) -> str:
    """Tell one set of numbers from another, whatever it is called and wherever the numbers come from."""
    values = {
        section: {name: entry["value"] for name, entry in entries.items()}
        for section, entries in parameters.document().items()
    }
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
