"""That hands may be at the rig: told to the loop, which keeps the drives off, and kept for the next start."""

import asyncio
import logging
from dataclasses import replace

from backend.realtime.commands import Accepted, Refused, SwitchDrives
from backend.realtime.supervisor import LoopDiedError, Supervisor
from backend.storage import settings
from backend.storage.database import Database
from backend.storage.orm import StorageError
from backend.storage.settings import StoredSetting
from plant.interface import PlantChoice, PlantKind

_log = logging.getLogger(__name__)


class KeptHands:
    """Keeps in the data folder whether hands may be at what is driven: a rig and a virtual card each by itself.

    ``left`` says who had the drives off and when, where that was before this start and nobody has switched them since.
    ``problem`` tells that it could not be kept.
    """

    def __init__(self, database: Database, plant: PlantChoice) -> None:
        self.problem = ""
        self._database = database
        self._turn = asyncio.Lock()
        self._name = f"hands at the {plant.name}"
        self.left: StoredSetting | None = None
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            with database.reading() as session:
                kept = settings.newest(session, self._name)
            self.left = kept if kept is not None and kept.value else None

    async def put(self, there: bool, who: str) -> None:
        """Keep it; where the disk refuses, what is driven is safe all the same, and the problem says so."""
        self.left = None
        try:
            async with self._turn:  # in the order in which the loop has obeyed
                await asyncio.to_thread(self._put, there, who)
        except StorageError as error:
            _log.exception("whether hands are at the rig was not kept")
            stays = "off" if there else "on"
            self.problem = f"That the drives are {stays} could not be kept for the next start of the service ({error})."
        else:
            self.problem = ""

    def _put(self, there: bool, who: str) -> None:
        with self._database.session() as session:
            settings.put(session, self._name, there, who)


async def switch_drives(supervisor: Supervisor, kept: KeptHands, on: bool, who: str) -> Accepted | Refused:
    """Take the drives away or give them back, and keep it. Raises LoopDiedError where they are to come on.

    Without a loop they are off already: the next one starts so. That they are to go off is kept whatever becomes of it.
    """
    try:
        answer = await supervisor.send(SwitchDrives(on))
    except LoopDiedError:
        if on:
            raise
        supervisor.setup = replace(supervisor.setup, drives_off=True)
        answer = Accepted(0, 0)
    finally:
        if not on:
            await kept.put(True, who)
    if on and isinstance(answer, Accepted):
        await kept.put(False, who)
    return answer
