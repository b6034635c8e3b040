"""Stored runs as the page shows them, with their samples, flight records and results."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from backend import wire
from backend.archive import views
from backend.errors import Because, RefusalError
from backend.recording.reader import AT_HAND_SAMPLES, SampleEnvelope, read_envelope
from backend.sample import STORED_NAMES
from backend.schemas.experiment import ExperimentView
from backend.schemas.run import Evaluation, FlightList, RunList, RunView, SamplesView
from backend.schemas.state import TaskView
from backend.storage import flights, identifications, origins, recordings, results, runs, tags
from backend.storage import search as run_search
from backend.storage.database import Database, Session
from backend.storage.recordings import Extent, Recording
from backend.storage.runs import EndState, Run, RunKind
from backend.storage.search import All, Compare, Op, Query, QueryError, Value, Word, parse
from backend.workers import Offload


@dataclass(frozen=True)
class Excerpt:
    """What is asked of a recording: ``signals`` from ``from_s`` to ``to_s``, in about ``points`` buckets at most."""

    run: int
    from_s: float
    to_s: float
    points: int
    signals: Sequence[str]


@dataclass(frozen=True)
class Asked:
    """Which runs are asked for: of ``kinds`` (none: of all), with the words of ``search``, that fit all of ``where``.

    ``everywhere``: of all stations, not of this one only.
    """

    kinds: Sequence[str] = ()
    search: str = ""
    where: Sequence[str] = ()
    everywhere: bool = False
    limit: int = 100
    offset: int = 0

    def query(self) -> Query:
        """Return what is asked. Raises RefusalError for an unknown kind, QueryError."""
        for unknown in (one for one in self.kinds if one not in set(RunKind)):
            raise RefusalError(
                Because.BAD_VALUE, f"there is no kind {unknown!r} of runs", legal=[str(known) for known in RunKind]
            )
        of_kind = [Compare(Value("kind", 0), Op.EQUAL, tuple(Value(kind, 0) for kind in self.kinds))]
        words = [Word(Value(word, 0)) for word in self.search.split()]
        if not all(word.value.text.isprintable() for word in words):
            raise QueryError(0, "a character that cannot be printed stands in it: delete it")
        return All((*map(parse, self.where), *(of_kind if self.kinds else []), *words))


class StoredRuns:
    """Reads and writes the database in threads, so that the event loop never waits for the disk.

    ``task`` tells what the service is doing at present, ``is_evaluated`` whether a run's result is being computed.
    What reads very many samples is done in the process ``offload``, where there is one.
    """

    def __init__(
        self,
        database: Database,
        task: Callable[[], TaskView | None],
        is_evaluated: Callable[[int], bool],
        offload: Offload | None = None,
    ) -> None:
        self._database = database
        self._offload = offload
        self._task = task
        self._is_evaluated = is_evaluated

    async def runs(self, asked: Asked) -> RunList:
        """Return a page of runs, newest first. Raises RefusalError for an unknown kind, QueryError."""
        return await asyncio.to_thread(self.found, asked)

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
        envelope, raw = await self._envelope(asked)
        return await asyncio.to_thread(partial(views.samples_view, asked.run, envelope, raw=raw))

    async def packed_samples(self, asked: Excerpt) -> bytes:
        """Return the same, packed by ``backend.wire``. Raises UnknownRecordError, UnknownSignalError."""
        envelope, raw = await self._envelope(asked)
        return await asyncio.to_thread(_packed, envelope, raw, asked.signals)

    async def _envelope(self, asked: Excerpt) -> tuple[SampleEnvelope, bool]:
        if self._offload is not None and await asyncio.to_thread(self._reads, asked) > AT_HAND_SAMPLES:
            return await self._offload.run(envelope_of, self._database, asked)
        return await asyncio.to_thread(envelope_of, self._database, asked)

    async def experiment(self, run_id: int) -> ExperimentView:
        """Return one experiment run with its result. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._experiment, run_id)

    # In a thread --------------------------------------------------------------------------------------------

    def found(self, asked: Asked) -> RunList:
        """Return a page of runs, newest first. Raises RefusalError for an unknown kind, QueryError."""
        query = asked.query()
        with self._database.reading() as session:
            page = run_search.search(
                session, query, everywhere=asked.everywhere, limit=asked.limit, offset=asked.offset
            )
            views = self._views(session, runs.of_numbers(session, page.run_ids))
            return RunList(runs=views, total=page.total)

    def _run(self, run_id: int) -> RunView:
        with self._database.reading() as session:
            return self._views(session, [runs.get(session, run_id)])[0]

    def _flights(self) -> FlightList:
        with self._database.reading() as session:
            return FlightList(flights=[views.flight_view(flight) for flight in flights.find(session)])

    def _set_note(self, run_id: int, note: str) -> None:
        with self._database.session() as session:
            runs.set_note(session, run_id, note)

    def _reads(self, asked: Excerpt) -> float:
        """Return how many samples have to be read one by one: none where the stored summaries tell it."""
        if all(name in STORED_NAMES for name in asked.signals):
            return 0.0
        with self._database.reading() as session:
            recording, span = recordings.get(session, asked.run), recordings.span(session, asked.run)
        length_s = (span.end_tick - span.first_tick) * recording.period_s
        return (min(asked.to_s, length_s) - min(asked.from_s, length_s)) / recording.period_s

    def _experiment(self, run_id: int) -> ExperimentView:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            return views.experiment_view(run, results.newest(session, run_id), self.progress(run))

    def _views(self, session: Session, found: Sequence[Run]) -> list[RunView]:
        """Return runs with their tags and the extent of what was recorded of them."""
        numbers = [run.id for run in found]
        newest, tagged = results.newest_of(session, numbers), tags.of_runs(session, numbers)
        fits = identifications.fits_of_runs(session, numbers)
        recorded, imported = recordings.of_runs(session, numbers), origins.of_runs(session, numbers)

        def view_of(run: Run) -> RunView:
            origin = imported[run.id].sentence if run.id in imported else ""
            evaluation = self._evaluation(run, run.id in newest)
            tagged_with, result = tagged.get(run.id, []), newest.get(run.id)
            told = partial(views.run_view, tags=tagged_with, origin=origin, result=result, fits=fits.get(run.id))
            view = partial(told, run, evaluation)
            return _with_extent(view, recorded.get(run.id))

        return [view_of(run) for run in found]

    def _evaluation(self, run: Run, has_result: bool) -> Evaluation:
        task = self._task()
        if run.kind == RunKind.SESSION or run.end_state == EndState.RUNNING:
            return Evaluation.NONE
        if self._is_evaluated(run.id) or (task is not None and task.run == run.id):
            return Evaluation.UNDER_WAY
        return Evaluation.DONE if has_result else Evaluation.MISSING

    def progress(self, run: Run) -> float:
        """Return how far a run is, from 0 to 1."""
        task = self._task()
        if task is None or task.run != run.id:
            return 1.0
        return min(0.99, task.elapsed_s / task.duration_s)


def envelope_of(database: Database, asked: Excerpt) -> tuple[SampleEnvelope, bool]:
    """Return what is asked of a recording, and whether its buckets are single samples. Raises like ``samples``."""
    with database.reading() as session:
        period_s = recordings.get(session, asked.run).period_s
        envelope = read_envelope(session, asked.run, asked.points, asked.signals, asked.from_s, asked.to_s)
    return envelope, envelope.width_s <= 1.5 * period_s


def _packed(envelope: SampleEnvelope, raw: bool, signals: Sequence[str]) -> bytes:
    first = round(float(envelope.t[0]) / envelope.width_s) if envelope.t.size else 0
    extremes = (envelope.minimum,) if raw else (envelope.minimum, envelope.maximum)
    return wire.pack_curves(first, envelope.width_s, [[part[name] for part in extremes] for name in signals])


def _with_extent(view: Callable[..., RunView], recorded: tuple[Recording, Extent | None] | None) -> RunView:
    """Return the view of a run with the extent of its recording."""
    if recorded is None:
        return view(samples=0, duration_s=0.0, missed=0)
    recording, extent = recorded
    if extent is None:
        return view(0, 0.0, recording.missed, recording.removed_at)
    duration_s = (extent.end_tick - extent.first_tick) * recording.period_s
    return view(extent.count, duration_s, recording.missed, recording.removed_at)
