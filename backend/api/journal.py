"""What happened and who asked for it: marks on the time axis at once, rows in the database as they can be written."""

import asyncio
import logging
from collections.abc import Callable
from typing import NamedTuple

from backend.api.schemas.live import EventMessage, MarkKind
from backend.storage import events
from backend.storage.database import Database
from backend.supervision import Part

PART = Part("The journal", "Events wait in memory meanwhile.")

_log = logging.getLogger(__name__)


class _Entry(NamedTuple):
    mark: EventMessage
    who: str
    run: int | None


class Journal:
    """Takes marks from the event loop; a task writes them, so that a slow disk delays nobody.

    ``problem`` says why nothing can be written at present.
    """

    def __init__(self, database: Database) -> None:
        self.problem = ""
        self._database = database
        self._waiting: asyncio.Queue[_Entry] = asyncio.Queue()
        self._announce: list[Callable[[EventMessage], None]] = []

    def on_mark(self, announce: Callable[[EventMessage], None]) -> None:
        """Call ``announce`` with every mark."""
        self._announce.append(announce)

    def note(self, kind: MarkKind, text: str, tick: int, who: str = "", run: int | None = None) -> None:
        """Put a mark at ``tick``; ``who`` is empty when nobody asked for what happened."""
        mark = EventMessage(tick=tick, kind=kind, text=f"{text} ({who})" if who else text)
        for announce in self._announce:
            announce(mark)
        self._waiting.put_nowait(_Entry(mark.model_copy(update={"text": text}), who, run))

    async def run(self) -> None:
        """Write until cancelled."""
        while True:
            entry = await self._waiting.get()
            await asyncio.to_thread(self._write, entry)

    def close(self) -> None:
        """Write what still waits."""
        while not self._waiting.empty():
            self._write(self._waiting.get_nowait())

    def _write(self, entry: _Entry) -> None:
        try:
            with self._database.session() as session:
                events.add(
                    session, entry.mark.kind, entry.mark.text, who=entry.who, run_id=entry.run, tick=entry.mark.tick
                )
            self.problem = ""
        except Exception as error:
            self.problem = f"events cannot be stored: {error}"
            # The actuator goes on without its journal; the log keeps what the database could not.
            _log.exception("event not stored: %s", entry.mark.text)
