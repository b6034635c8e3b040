"""What is stored, as the interface shows it: runs with their samples, identifications, experiments."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from backend import __version__, wire
from backend.api import stored
from backend.api.errors import ApiError
from backend.api.schemas.curves import IdentificationCurves
from backend.api.schemas.experiment import ExperimentView
from backend.api.schemas.flight import FlightList
from backend.api.schemas.identification import IdentificationView, SpringTableView
from backend.api.schemas.run import Evaluation, RunList, RunView, SamplesView
from backend.api.schemas.state import TaskView
from backend.experiments.identification_curves import curves_of
from backend.experiments.spring_identification import from_table
from backend.recording.reader import Envelope, read_envelope
from backend.storage import Database, Session, flights, identifications, recordings, results, runs
from backend.storage.identifications import Identification
from backend.storage.records import UnknownRecordError
from backend.storage.runs import EndState, Run, RunKind

IDENTIFICATIONS = (
    RunKind.ACTUATOR_IDENTIFICATION,
    RunKind.MOTOR_IDENTIFICATION,
    RunKind.SPRING_IDENTIFICATION,
)


@dataclass(frozen=True)
class Excerpt:
    """What is asked of a recording: ``signals`` from ``from_s`` to ``to_s``, in about ``points`` buckets at most."""

    run: int
    from_s: float
    to_s: float
    points: int
    signals: Sequence[str]


class Library:
    """Reads and writes the database in threads, so that the event loop never waits for the disk.

    ``task`` tells what the service is doing at present, ``is_evaluated`` whether a run's result is being computed.
    """

    def __init__(
        self, database: Database, task: Callable[[], TaskView | None], is_evaluated: Callable[[int], bool]
    ) -> None:
        self._database = database
        self._task = task
        self._is_evaluated = is_evaluated

    # Runs ---------------------------------------------------------------------------------------------------

    async def runs(self, kind: str | None, search: str, limit: int, offset: int) -> RunList:
        """Return a page of runs, newest first. Raises ApiError for an unknown kind."""
        wanted = kind.split(",") if kind else []
        for unknown in (one for one in wanted if one not in set(RunKind)):
            raise ApiError(422, f"there is no kind {unknown!r} of runs", legal=[str(known) for known in RunKind])
        kinds = [RunKind(one) for one in wanted]
        return await asyncio.to_thread(self._runs, kinds, search, limit, offset)

    async def run(self, run_id: int) -> RunView:
        """Return one run. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._run, run_id)

    async def set_note(self, run_id: int, note: str) -> RunView:
        """Write the note of a run. Raises UnknownRecordError."""
        await asyncio.to_thread(self._set_note, run_id, note)
        return await self.run(run_id)

    async def flights(self) -> FlightList:
        """Return the newest flight records."""
        return await asyncio.to_thread(self._flights)

    async def samples(self, asked: Excerpt) -> SamplesView:
        """Return samples or their envelope. Raises UnknownRecordError, UnknownSignalError."""
        return await asyncio.to_thread(self._samples, asked)

    async def packed_samples(self, asked: Excerpt) -> bytes:
        """Return the same, packed by ``backend.wire``. Raises UnknownRecordError, UnknownSignalError."""
        return await asyncio.to_thread(self._packed_samples, asked)

    # Identifications ------------------------------------------------------------------------------------

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
        return stored.spring_table_view(await asyncio.to_thread(self._spring_table, number))

    async def spring_table_curves(self, number: int) -> IdentificationCurves:
        """Return what can be drawn of a spring identified from a table. Raises UnknownRecordError."""
        found = await asyncio.to_thread(self._spring_table, number)
        return IdentificationCurves.model_validate(curves_of(found))

    async def add_spring_table(self, name: str, table: str, who: str) -> SpringTableView:
        """Identify a spring from a measured table and store it. Raises IdentificationError."""
        return stored.spring_table_view(await asyncio.to_thread(self._add_spring_table, name, table, who))

    # Experiments --------------------------------------------------------------------------------------------

    async def experiment(self, run_id: int) -> ExperimentView:
        """Return one experiment run with its result. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._experiment, run_id)

    # In a thread --------------------------------------------------------------------------------------------

    def _runs(self, kinds: Sequence[RunKind], search: str, limit: int, offset: int) -> RunList:
        with self._database.reading() as session:
            found = runs.find(session, kinds=kinds, search=search, limit=limit, offset=offset)
            with_result = results.present(session, [run.id for run in found])
            views = [self._view(session, run, run.id in with_result) for run in found]
            return RunList(runs=views, total=runs.count(session, kinds=kinds, search=search))

    def _run(self, run_id: int) -> RunView:
        with self._database.reading() as session:
            return self._view(session, runs.get(session, run_id), bool(results.present(session, [run_id])))

    def _flights(self) -> FlightList:
        with self._database.reading() as session:
            return FlightList(flights=[stored.flight_view(flight) for flight in flights.find(session)])

    def _set_note(self, run_id: int, note: str) -> None:
        with self._database.session() as session:
            runs.set_note(session, run_id, note)

    def _samples(self, asked: Excerpt) -> SamplesView:
        envelope, raw = self._envelope(asked)
        return stored.samples_view(asked.run, envelope, raw=raw)

    def _packed_samples(self, asked: Excerpt) -> bytes:
        envelope, raw = self._envelope(asked)
        first = round(float(envelope.t[0]) / envelope.width_s) if envelope.t.size else 0
        extremes = (envelope.minimum,) if raw else (envelope.minimum, envelope.maximum)
        return wire.pack_curves(first, envelope.width_s, [[part[name] for part in extremes] for name in asked.signals])

    def _envelope(self, asked: Excerpt) -> tuple[Envelope, bool]:
        """Return the envelope and whether its buckets are single samples."""
        with self._database.reading() as session:
            period_s = recordings.get(session, asked.run).period_s
            envelope = read_envelope(session, asked.run, asked.points, asked.signals, asked.from_s, asked.to_s)
        return envelope, envelope.width_s <= 1.5 * period_s

    def _identifications(self) -> list[IdentificationView]:
        with self._database.reading() as session:
            estimates = {estimate.run_id: estimate for estimate in reversed(identifications.find(session))}
            found = runs.find(session, kinds=IDENTIFICATIONS, limit=500)
            return [stored.identification_view(run, estimates.get(run.id), self._progress(run)) for run in found]

    def _identification(self, run_id: int) -> IdentificationView:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            if run.kind not in IDENTIFICATIONS:
                raise UnknownRecordError(f"run {run_id} is no identification but {run.kind}")
            estimates = identifications.find(session, run_id=run_id)
            result = results.newest(session, run_id)
        view = stored.identification_view(run, estimates[0] if estimates else None, self._progress(run))
        problem = "" if result is None else str(result.metrics.get("problem", ""))
        return view.model_copy(update={"message": problem}) if problem else view

    def _curves(self, run_id: int) -> IdentificationCurves:
        with self._database.reading() as session:
            found = identifications.of_run(session, run_id)
        return IdentificationCurves.model_validate(curves_of(found))

    def _spring_tables(self) -> list[SpringTableView]:
        with self._database.reading() as session:
            found = identifications.find(session, kind="spring")
        return [stored.spring_table_view(table) for table in found if table.run_id is None]

    def _spring_table(self, number: int) -> Identification:
        with self._database.reading() as session:
            found = identifications.get(session, number)
        if found.kind != "spring" or found.run_id is not None:
            raise UnknownRecordError(f"identification {number} was not made from a table of a spring")
        return found

    def _add_spring_table(self, name: str, table: str, who: str) -> Identification:
        new = from_table(name, table, who, __version__)
        with self._database.session() as session:
            return identifications.add(session, new)

    def _experiment(self, run_id: int) -> ExperimentView:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            return stored.experiment_view(run, results.newest(session, run_id), self._progress(run))

    def _view(self, session: Session, run: Run, has_result: bool) -> RunView:
        """Return a run with the extent of what was recorded of it."""
        view = partial(stored.run_view, run, self._evaluation(run, has_result))
        try:
            recording = recordings.get(session, run.id)
        except UnknownRecordError:
            return view(samples=0, duration_s=0.0, missed=0)
        try:
            extent = recordings.extent(session, run.id)
        except UnknownRecordError:
            return view(0, 0.0, recording.missed, recording.removed_at)
        duration_s = (extent.end_tick - extent.first_tick) * recording.period_s
        return view(extent.count, duration_s, recording.missed, recording.removed_at)

    def _evaluation(self, run: Run, has_result: bool) -> Evaluation:
        task = self._task()
        if run.kind == RunKind.SESSION or run.end_state == EndState.RUNNING:
            return Evaluation.NONE
        if self._is_evaluated(run.id) or (task is not None and task.run == run.id):
            return Evaluation.UNDER_WAY
        return Evaluation.DONE if has_result else Evaluation.MISSING

    def _progress(self, run: Run) -> float:
        task = self._task()
        if task is None or task.run != run.id:
            return 1.0
        return min(0.99, task.elapsed_s / task.duration_s)
