"""The tuning in force outlives the service: kept at each change, in force again at the next start."""

import logging
from dataclasses import replace

from backend.banks import tuning_settings
from backend.banks.tuning_settings import KeptChoice
from backend.errors import OutOfRangeError
from backend.models.document import UnreadableDocumentError
from backend.models.settings import SettingError
from backend.operating.tuning_in_use import Chosen, TuningInUse, by_default, initial
from backend.storage import banks
from backend.storage.database import Database
from backend.storage.orm import StorageError, UnknownRecordError
from backend.tuning.gains import TuningError
from plant.parameters import PlantParameters

_log = logging.getLogger(__name__)


class KeptTuning:
    """Writes and reads the tuning in force as a setting in the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def put(self, tuning: TuningInUse, who: str) -> None:
        """Keep a tuning that has come into force; where the disk refuses, the loop goes on and the log says so."""
        try:
            tuning_settings.store_tuning(self._database, tuning.choice, tuning.parameters, who)
        except StorageError:
            _log.exception("the tuning in force was not kept for the next start")

    def earlier(self, tuning: TuningInUse) -> Chosen | None:
        """Return what was in force before ``tuning`` came into force on this plant; None where nothing else was."""
        try:
            with self._database.reading() as session:
                choice = tuning_settings.earlier_tuning(session, tuning.choice, tuning.parameters)
                if choice is None:
                    return None
                return Chosen(choice, None if choice.bank == 0 else banks.own(session, choice.bank))
        except (SettingError, OutOfRangeError, UnknownRecordError, UnreadableDocumentError):
            _log.exception("what was in force before the present tuning cannot be had any more")
            return None

    def carried_over(self, now: TuningInUse, parameters: PlantParameters) -> TuningInUse:
        """Return what to go on with on other ``parameters``: what they were left with, else λ as it is, else defaults.

        A bank stays with the parameters that its models were made with. Raises TuningError where nothing is safe.
        """
        left = self._left_with(parameters)
        for choice in [*([left] if left else []), Chosen(replace(now.choice, bank=0), None)]:
            try:
                return initial(parameters, replace(choice.choice, k_ext=0.0), choice.bank)
            except (OutOfRangeError, TuningError) as error:
                _log.warning("a tuning is not carried over to other parameters: %s", error)
        return by_default(parameters)[0]

    def _left_with(self, parameters: PlantParameters) -> Chosen | None:
        try:
            with self._database.reading() as session:
                choice = tuning_settings.left_with(session, parameters)
                if choice is None:
                    return None
                return Chosen(choice, None if choice.bank == 0 else banks.own(session, choice.bank))
        except (SettingError, OutOfRangeError, UnknownRecordError, UnreadableDocumentError):
            _log.exception("what was in force with these parameters cannot be had any more")
            return None

    def restore(self, parameters: PlantParameters) -> tuple[TuningInUse, str]:
        """Return what to start with, and a sentence on it for the journal; mostly empty on a new data folder.

        What was kept for other parameters, or cannot be used any more, gives way to the defaults.
        """
        try:
            kept = tuning_settings.newest_tuning(self._database, parameters)
            if kept is None:
                return by_default(parameters)
            if not kept.same_plant:
                return _defaults(parameters, "the tuning of last time was for other parameters")
            with self._database.reading() as session:
                bank = None if kept.choice.bank == 0 else banks.own(session, kept.choice.bank)
            tuning = initial(parameters, replace(kept.choice, k_ext=0.0), bank)  # as nothing is learned yet
        except (SettingError, OutOfRangeError, TuningError, UnknownRecordError, UnreadableDocumentError) as error:
            return _defaults(parameters, f"the tuning of last time is refused, {error}")
        return tuning, _said(tuning, kept)


def _defaults(parameters: PlantParameters, why: str) -> tuple[TuningInUse, str]:
    tuning, moved = by_default(parameters)
    return tuning, f"defaults in force: {why}" + (f"; {moved}" if moved else "")


def _said(tuning: TuningInUse, kept: KeptChoice) -> str:
    bank = tuning.bank
    models = "gains from geometry" if bank is None else f"bank {bank.name}, version {bank.version}"
    said = f"in force again as {kept.who} left it: {models}, {tuning.choice.in_words()}"
    return said + (f"; {', '.join(kept.lacks)} was not kept at that time: its default" if kept.lacks else "")
