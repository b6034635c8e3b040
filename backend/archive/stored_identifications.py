"""Stored identifications as the page shows them: those of runs, and springs from tables measured elsewhere."""

import asyncio
import logging
from collections.abc import Callable

from backend.analysis.identification import curves_of, trend_of, unseen_of
from backend.archive import identification_views
from backend.archive.stored_banks import TuningInForce
from backend.models.document import UnreadableDocumentError
from backend.schemas.identification import IdentificationCurves, IdentificationView, SpringTableView, Trend, UnseenView
from backend.storage import identifications, results, runs
from backend.storage.database import Database
from backend.storage.identifications import Identification, NewIdentification
from backend.storage.orm import UnknownRecordError
from backend.storage.runs import Run, RunKind
from backend.workers import Offload

_log = logging.getLogger(__name__)

IDENTIFICATIONS = (
    RunKind.ACTUATOR_IDENTIFICATION,
    RunKind.MOTOR_IDENTIFICATION,
    RunKind.SPRING_IDENTIFICATION,
)


class StoredIdentifications:
    """Reads and writes the database in threads; what takes long is computed in the process for such work.

    ``progress`` tells how far a run is, from 0 to 1.
    """

    def __init__(
        self,
        database: Database,
        progress: Callable[[Run], float],
        offload: Offload,
        tuning: Callable[[], TuningInForce],
    ) -> None:
        self._database = database
        self._progress = progress
        self._offload = offload
        self._tuning = tuning

    async def unseen(self, run_id: int, of: int) -> UnseenView:
        """Set a model beside the record of the run ``of``. Raises UnknownRecordError, NotComparableError."""
        return UnseenView.model_validate(await self._offload.run(unseen_of, self._database, run_id, of))

    async def trend(self) -> Trend:
        """Return identified gains and lags over S beside what is predicted."""
        tuning = self._tuning()
        computed = self._offload.run(trend_of, self._database, tuning.parameters, tuning.lambdas.lam_motor)
        return Trend.model_validate(await computed)

    async def identifications(self) -> list[IdentificationView]:
        """Return all identification runs, newest first."""
        return await asyncio.to_thread(self._identifications)

    async def identification(self, run_id: int) -> IdentificationView:
        """Return one identification run. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._identification, run_id)

    async def curves(self, run_id: int) -> IdentificationCurves:
        """Return what can be drawn of the newest estimate of a run. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._curves, run_id)

    async def spring_tables(self) -> list[SpringTableView]:
        """Return springs identified from tables, newest first."""
        return await asyncio.to_thread(self._spring_tables)

    async def spring_table(self, number: int) -> SpringTableView:
        """Return one spring identified from a table. Raises UnknownRecordError."""
        return identification_views.spring_table_view(await asyncio.to_thread(self._spring_table, number))

    async def spring_table_curves(self, number: int) -> IdentificationCurves:
        """Return what can be drawn of a spring identified from a table. Raises UnknownRecordError."""
        found = await asyncio.to_thread(self._spring_table, number)
        return IdentificationCurves.model_validate(curves_of(found))

    async def add_spring_table(self, new: NewIdentification) -> SpringTableView:
        """Store a spring that was identified from a measured table."""
        return identification_views.spring_table_view(await asyncio.to_thread(self._add, new))

    # In a thread --------------------------------------------------------------------------------------------

    def _identifications(self) -> list[IdentificationView]:
        with self._database.reading() as session:
            estimates = {estimate.run_id: estimate for estimate in reversed(identifications.find(session))}
            found = runs.find(session, kinds=IDENTIFICATIONS, limit=500)
            return [self._listed(run, estimates.get(run.id)) for run in found]

    def _listed(self, run: Run, estimate: Identification | None) -> IdentificationView:
        """Return a run as the list shows it: one that cannot be read says so, and the others are there."""
        try:
            return identification_views.identification_view(run, estimate, self._progress(run))
        except UnreadableDocumentError as error:
            view = identification_views.identification_view(run, None, self._progress(run))
            return view.model_copy(update={"message": str(error)})

    def _identification(self, run_id: int) -> IdentificationView:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            if run.kind not in IDENTIFICATIONS:
                raise UnknownRecordError(f"run {run_id} is no identification but {run.kind}")
            estimates = identifications.find(session, run_id=run_id)
            result = results.newest(session, run_id)
        view = identification_views.identification_view(run, estimates[0] if estimates else None, self._progress(run))
        problem = "" if result is None else result.metrics.problem
        return view.model_copy(update={"message": problem}) if problem else view

    def _curves(self, run_id: int) -> IdentificationCurves:
        with self._database.reading() as session:
            found = identifications.of_run(session, run_id)
        return IdentificationCurves.model_validate(curves_of(found))

    def _spring_tables(self) -> list[SpringTableView]:
        with self._database.reading() as session:
            found = identifications.find(session, kind="spring")
        shown = []
        for table in found:
            try:
                shown += [identification_views.spring_table_view(table)] if table.run_id is None else []
            except UnreadableDocumentError as error:  # the others are there
                _log.warning("a spring is left out of the list of tables: %s", error)
        return shown

    def _spring_table(self, number: int) -> Identification:
        with self._database.reading() as session:
            found = identifications.get(session, number)
        if found.kind != "spring" or found.run_id is not None:
            raise UnknownRecordError(f"identification {number} was not made from a table of a spring")
        return found

    def _add(self, new: NewIdentification) -> Identification:
        with self._database.session() as session:
            return identifications.add(session, new)
