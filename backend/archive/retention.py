"""How much room recordings take, looked at now and then, and deleting the samples that a person names."""

import asyncio

from backend.recording.retention import Overview, Rule, overview, remove
from backend.schemas.state import HeldView, RecordingsView
from backend.storage.database import Database
from backend.storage.orm import StorageError
from backend.supervision import Part

PART = Part("The look at the room that recordings take", "Recordings may pass their limit unseen.")

LOOK_S = 600.0
"""How often the sizes are added up [s]: a recording grows by 80 MB an hour."""


class Retention:
    """Looks after the room that recordings take; ``problem`` says when it is too much. Deletes nothing by itself."""

    def __init__(self, database: Database, rule: Rule) -> None:
        self.problem = ""
        self._database = database
        self._rule = rule

    async def run(self) -> None:
        """Look from time to time until cancelled."""
        while True:
            try:
                await self.view()
            except StorageError as error:
                self.problem = f"the size of the recordings is not known: {error}"
            await asyncio.sleep(LOOK_S)

    async def view(self) -> RecordingsView:
        """Return what recordings take and which may go. Raises StorageError."""
        return self._seen(await asyncio.to_thread(overview, self._database, self._rule))

    async def remove(self, run_ids: list[int], who: str) -> RecordingsView:
        """Delete the samples of exactly these runs. Raises NotRemovableError, StorageError."""
        return self._seen(await asyncio.to_thread(remove, self._database, self._rule, run_ids, who))

    def _seen(self, found: Overview) -> RecordingsView:
        self.problem = found.says
        return RecordingsView(
            total_bytes=found.total_bytes,
            limit_bytes=found.rule.max_bytes,
            in_use_bytes=found.in_use_bytes,
            keep_days=found.rule.keep_days,
            may_go=[
                HeldView(
                    run=run.run_id,
                    kind=run.kind,
                    who=run.who,
                    note=run.note,
                    started=run.started_at,
                    size_bytes=run.size_bytes,
                )
                for run in found.may_go
            ],
            says=found.says,
        )
