"""Everything that happened, read from the database in threads."""

import asyncio
from collections.abc import Sequence

from backend.schemas.run import Remark, Timeline, TimelineEntry
from backend.storage import timeline
from backend.storage.database import Database
from backend.storage.timeline import Asked, Happening


class StoredTimeline:
    """Looks in the database of one station."""

    def __init__(self, database: Database) -> None:
        self._database = database

    async def page(self, asked: Asked, limit: int) -> Timeline:
        """Return the newest of what is asked for."""
        return await asyncio.to_thread(self._page, asked, limit)

    async def remark(self, event_id: int, said: Remark, who: str) -> None:
        """Put a note and tags on an event. Raises UnknownRecordError, TagError, RefusalError."""
        await asyncio.to_thread(self._remark, event_id, said.note.strip(), said.tags, who)

    def _page(self, asked: Asked, limit: int) -> Timeline:
        with self._database.reading() as session:
            found, more_before = timeline.find(session, asked, limit)
            total = len(found) if more_before is None else timeline.count(session, asked)
        return Timeline(entries=[_entry(one) for one in found], total=total, more_before=more_before)

    def _remark(self, event_id: int, note: str, tags: Sequence[str], who: str) -> None:
        with self._database.session() as session:
            timeline.remark(session, event_id, note, tags, who)


def _entry(one: Happening) -> TimelineEntry:
    return TimelineEntry(
        at=one.at,
        kind=one.kind,
        who=one.who,
        text=one.text,
        event=one.event_id,
        run=one.run_id,
        t=one.t,
        flight=one.flight,
        note=one.note,
        tags=list(one.tags),
        remark_by=one.remark_by,
    )
