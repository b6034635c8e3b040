"""The tuning that each bank is meant to run with, saved by a person, as settings in the database."""

import asyncio

from backend.banks.tuning_settings import SAVED, SavedParts, TuningChoice, saved_for
from backend.operating.tuning_in_use import TuningInUse, parts_of
from backend.schemas.tuning import SavedTuning
from backend.storage import settings
from backend.storage.database import Database
from backend.storage.settings import StoredSetting


class SavedTunings:
    """Reads and writes settings in threads, so that the event loop never waits for the disk."""

    def __init__(self, database: Database) -> None:
        self._database = database

    async def of(self, tuning: TuningInUse) -> SavedTuning:
        """Return what was saved for the bank in use; the defaults on its models where nobody has saved."""
        stored = await asyncio.to_thread(self._newest, tuning)
        if stored is not None:
            return _saved(stored)
        default = await asyncio.to_thread(tuning.default)
        return SavedTuning(**parts_of(default.choice), who=None, at=None, moved=default.moved)

    async def save(self, tuning: TuningInUse, who: str) -> SavedTuning:
        """Save what is in force as what the bank in use is meant to run with; earlier values stay in the history."""
        return _saved(await asyncio.to_thread(self._put, tuning, who))

    def _newest(self, tuning: TuningInUse) -> StoredSetting | None:
        with self._database.reading() as session:
            return settings.newest(session, _setting_of(tuning))

    def _put(self, tuning: TuningInUse, who: str) -> StoredSetting:
        with self._database.session() as session:
            return settings.put(session, _setting_of(tuning), SAVED.write(SavedParts(**parts_of(tuning.choice))), who)


def _saved(stored: StoredSetting) -> SavedTuning:
    read = SAVED.read(stored.value, f"setting “{stored.name}”")
    return SavedTuning(**parts_of(TuningChoice.of(read.known())), who=stored.who, at=stored.at, moved="")


def _setting_of(tuning: TuningInUse) -> str:
    return saved_for(None if tuning.bank is None else tuning.bank.id)
