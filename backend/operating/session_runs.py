"""Runs of kind ``session``: what a person does by hand in run and compliance. The recorder closes them."""

import asyncio

from backend import __version__
from backend.models.run import SETTINGS, KeptLoop, RunSettings
from backend.operating.tuning_in_use import TuningInUse
from backend.realtime.program import Mode
from backend.storage import runs
from backend.storage.database import Database
from backend.storage.runs import EndState, NewRun, RunKind

RECORDED = (Mode.RUN, Mode.COMPLIANCE)


class SessionRuns:
    """Stores a run before the loop is told to move, so that no sample is without its run."""

    def __init__(self, database: Database, plant: str) -> None:
        self._database = database
        self._plant = plant

    async def begin(self, mode: Mode, tuning: TuningInUse, who: str) -> int:
        """Store a session run as running and return its number."""
        new = NewRun(
            kind=RunKind.SESSION,
            plant=self._plant,
            parameters_name=tuning.parameters.name,
            parameters=tuning.parameters.document(),
            who=who,
            software=__version__,
            settings=SETTINGS.write(RunSettings(mode=str(mode), loop=KeptLoop(**tuning.choice.document()))),
            bank_id=None if tuning.bank is None else tuning.bank.id,
        )
        return await asyncio.to_thread(self._create, new)

    async def abandon(self, run: int) -> None:
        """Close a run that the loop refused to begin."""
        await asyncio.to_thread(self._end, run)

    def _create(self, new: NewRun) -> int:
        with self._database.session() as session:
            return runs.create(session, new).id

    def _end(self, run: int) -> None:
        with self._database.session() as session:
            runs.end(session, run, EndState.STOPPED, "refused before it began")
