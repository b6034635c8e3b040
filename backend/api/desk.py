"""What is remembered for persons and for the tuning of each bank, as settings in the database."""

import asyncio
from typing import Any

from backend.api.people import Person
from backend.api.schemas.preferences import NEW_HERE, Preferences
from backend.api.schemas.session import Role
from backend.api.schemas.tuning import SavedTuning
from backend.api.tuning_in_use import TuningInUse, parts_of
from backend.experiments.tuning_choice import TuningChoice
from backend.storage import Database, settings
from backend.storage.settings import StoredSetting


class Desk:
    """Reads and writes settings in threads, so that the event loop never waits for the disk."""

    def __init__(self, database: Database) -> None:
        self._database = database

    async def preferences(self, person: Person) -> Preferences:
        """Return how ``person`` likes the page; defaults for somebody new."""
        stored = await asyncio.to_thread(self._newest, _preferences_of(person))
        # what was stored before a preference existed lacks it
        return NEW_HERE if stored is None else Preferences.model_validate({**NEW_HERE.model_dump(), **stored.value})

    async def set_preferences(self, person: Person, preferences: Preferences) -> Preferences:
        """Remember how ``person`` likes the page."""
        await asyncio.to_thread(self._put, _preferences_of(person), preferences.model_dump(), person.name)
        return preferences

    async def saved_tuning(self, tuning: TuningInUse) -> SavedTuning:
        """Return what was saved for the bank in use; the defaults on its models where nobody has saved."""
        stored = await asyncio.to_thread(self._newest, _tuning_of(tuning))
        if stored is not None:
            return _saved(stored)
        default = await asyncio.to_thread(tuning.default)
        return SavedTuning(**parts_of(default.choice), who=None, at=None, moved=default.moved)

    async def save_tuning(self, tuning: TuningInUse, who: str) -> SavedTuning:
        """Save what is in force as what the bank in use is meant to run with; earlier values stay in the history."""
        return _saved(await asyncio.to_thread(self._put, _tuning_of(tuning), parts_of(tuning.choice), who))

    def _newest(self, name: str) -> StoredSetting | None:
        with self._database.reading() as session:
            return settings.newest(session, name)

    def _put(self, name: str, value: dict[str, Any], who: str) -> StoredSetting:
        with self._database.session() as session:
            return settings.put(session, name, value, who)


def _preferences_of(person: Person) -> str:
    # By name and role: whoever holds the viewers' token may give any name, and must not change an operator's page.
    name = person.called or person.name
    return f"preferences/{name}" if person.role is Role.OPERATOR else f"viewer-preferences/{name}"


def _saved(stored: StoredSetting) -> SavedTuning:
    return SavedTuning(**parts_of(TuningChoice.of(stored.value)), who=stored.who, at=stored.at, moved="")


def _tuning_of(tuning: TuningInUse) -> str:
    return f"tuning/{'geometry' if tuning.bank is None else tuning.bank.id}"
