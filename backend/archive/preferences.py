"""How each person likes the page, as settings in the database."""

import asyncio

from backend.auth.authentication import Person
from backend.plain_text import STORED
from backend.schemas.preferences import NEW_HERE, Preferences, look_over
from backend.schemas.state import Role
from backend.storage import formulas, settings
from backend.storage.database import Database
from backend.storage.settings import StoredSetting


class StoredPreferences:
    """Reads and writes settings in threads, so that the event loop never waits for the disk."""

    def __init__(self, database: Database) -> None:
        self._database = database

    async def of(self, person: Person) -> Preferences:
        """Return how ``person`` likes the page; defaults for somebody new."""
        stored = await asyncio.to_thread(self._newest, _setting_of(person))
        # what was stored before a preference existed lacks it
        return NEW_HERE if stored is None else _read(stored)

    async def put(self, person: Person, preferences: Preferences) -> Preferences:
        """Remember how ``person`` likes the page. Raises RefusalError for a layout that cannot be drawn."""
        look_over(preferences.layouts, await asyncio.to_thread(self._formulas))
        await asyncio.to_thread(self._put, person, preferences)
        return preferences

    def _formulas(self) -> set[str]:
        with self._database.reading() as session:
            return formulas.ever(session)

    def _newest(self, name: str) -> StoredSetting | None:
        with self._database.reading() as session:
            return settings.newest(session, name)

    def _put(self, person: Person, preferences: Preferences) -> None:
        with self._database.session() as session:
            settings.put(session, _setting_of(person), preferences.model_dump(), person.name)


def _read(stored: StoredSetting) -> Preferences:
    return Preferences.model_validate({**NEW_HERE.model_dump(), **stored.value}, context=STORED)


def _setting_of(person: Person) -> str:
    # By name and role: whoever holds the viewers' token may give any name, and must not change an operator's page.
    name = person.called or person.name
    return f"preferences/{name}" if person.role is Role.OPERATOR else f"viewer-preferences/{name}"
