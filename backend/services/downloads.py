"""Downloads and imports of runs: reports, exports and bundles, computed in worker processes."""

import asyncio
import json
import logging
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator, Sequence
from contextlib import aclosing
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from backend.analysis import evaluate_pending_runs, find_pending_runs
from backend.errors import OutOfRangeError, RequestRejectedError
from backend.experiments import ExperimentError, LoopSettings, parse_stored_plan, parser
from backend.exports import (
    DataFormat,
    ExportError,
    ImportRefusedError,
    ImportResult,
    bundle,
    export_columns,
    export_run,
    importer,
    stream_export,
)
from backend.models import SettingError, UnreadableDocumentError
from backend.plain_text import escape_line
from backend.recording import AT_HAND_SAMPLES, read_flight_columns
from backend.reports import RunData, load_series, load_source, render_report, render_series_report
from backend.schemas import Differences, DifferencesRequest
from backend.services.comparison import compute_differences, count_samples, stream_curves_file, stream_table_file
from backend.storage import Database, EndState, Run, RunKind, results, runs
from backend.units import AngleUnit
from backend.workers import DRAWING_LIBRARIES, WorkerProcess, stream_from_process
from plant import ErrorCode

# Imports -------------------------------------------------------------------------------------------
#
# Files of runs taken in, each checked as strictly as what comes by a request: characters, bounds,
# the plan itself.


_LONGEST_EXPERIMENT = 4 * parser.MAX_CHARACTERS
"""Characters of an experiment as a run keeps it: its JSON has more of them than the YAML that was sent."""


def import_run_file(database: Database, file: Path, who: str, folder: Path, name: str = "") -> ImportResult:
    """Store the run of a file, a bundle (.zip) or an export, whole or not at all; ``name`` is what it is called.

    ``folder`` has room for a bundle unpacked. Raises ImportRefusedError, OSError.
    """
    called = escape_line(name or file.name)
    if file.suffix.lower() == ".zip":
        return importer.import_bundle(
            database=database, file=file, who=who, folder=folder, name=called, check_run=check_run_settings
        )
    return importer.import_export(database, file, who, called, check_run_settings)


def check_run_settings(run: Run) -> None:
    """Raise ImportRefusedError for a run whose plan or tuning no request could have ordered."""
    try:
        kept = run.set_to
        if kept.experiment is not None:
            _check_experiment(kept.experiment)
        if kept.plan is not None:
            parse_stored_plan(run.kind, kept.plan)
        LoopSettings.from_values(kept.loop.get_known_values())
    except (ExperimentError, SettingError, OutOfRangeError, UnreadableDocumentError, KeyError) as error:
        raise ImportRefusedError(
            f"its plan: {escape_line(error)}; correct the experiment and run it again, or export the run with "
            f"Sinew {escape_line(run.software)}, which recorded it, and read the samples from the file"
        ) from None


def _check_experiment(kept: str) -> None:
    """Raise ExperimentError for an experiment that would not be accepted if somebody sent it now."""
    if len(kept) > _LONGEST_EXPERIMENT:
        raise ExperimentError(f"the experiment has {len(kept)} characters, at most {_LONGEST_EXPERIMENT} are accepted")
    try:
        parser.build_experiment(json.loads(kept), {})
    except (ValueError, RecursionError) as error:
        if isinstance(error, ExperimentError):
            raise
        raise ExperimentError(f"the experiment is not JSON: {error}") from None


# Bundling ------------------------------------------------------------------------------------------
#
# A run's bundle with its report, made where none was handed out yet.


def stream_bundle(database: Database, run_id: int, folder: Path) -> Iterator[bytes]:
    """Return the bundle of a run, piece by piece; sessions have no report.

    Raises UnknownRecordError, and ExportError for what no installation would take in.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
        try:
            check_run_settings(run)
        except ImportRefusedError as error:
            raise ExportError(f"run {run_id}: {error}") from None
        kept = results.newest_report(session, run_id, "html")
    report = None if kept is None else kept.content
    if report is None:
        evaluate_pending_runs(database, [run_id])
        source = load_source(database, run_id)
        if source.run.kind != RunKind.SESSION and source.run.end_state != EndState.RUNNING:
            report = render_report(source, "html")
    return bundle.write_bundle(database, run_id, report, folder)


# Downloads -----------------------------------------------------------------------------------------
#
# Reports and exports of runs, made in processes of their own so that the live stream does not
# stutter.


RESULT_TIMEOUT_S = 60.0
"""A run that ended longer ago [s] and has no result will not get one: its report says so."""
MAX_DOWNLOADS = 6
"""Downloads of samples under way at a time, each with a process of its own."""

_log = logging.getLogger(__name__)
_REPORTS = "backend.reports.build", "backend.reports.model", "backend.reports.pdf"


class Downloads:
    """Makes what is downloaded; ``folder`` has room for what a format has to turn.

    ``evaluate_finished_run`` gives a run its result, or keeps with the run why it has none, and raises.
    """

    def __init__(
        self, database: Database, worker: WorkerProcess, folder: Path, evaluate: Callable[[int], Awaitable[None]]
    ) -> None:
        self._database = database
        self._evaluate = evaluate
        self._worker = worker
        self._folder = folder
        self._active_count = 0

    def preload(self) -> None:
        """Load what reports need ahead of the first one."""
        self._worker.preload(render_report, *DRAWING_LIBRARIES, *_REPORTS)

    async def render_html_report(self, run_id: int, angles: AngleUnit) -> bytes:
        """Return the report as one self-contained page. Raises UnknownRecordError, RequestRejectedError."""
        return await self._render_report(run_id, "html", angles)

    async def render_pdf_report(self, run_id: int, angles: AngleUnit) -> bytes:
        """Return the report as PDF. Raises UnknownRecordError, RequestRejectedError."""
        return await self._render_report(run_id, "pdf", angles)

    async def render_series(self, run_ids: Sequence[int], kind: str, angles: AngleUnit) -> bytes:
        """Return a report of many runs as "html" or "pdf"; it is not kept.

        Raises UnknownRecordError, RequestRejectedError.
        """
        await self._evaluate_pending(run_ids)
        sources = await asyncio.to_thread(load_series, self._database, run_ids, angles)
        return await self._worker.run(render_series_report, sources, kind)

    async def stream_run(self, run_id: int, kind: DataFormat, derived: Sequence[str] = ()) -> AsyncGenerator[bytes]:
        """Return all samples in a format, piece by piece, those of ``derived`` signals behind the recorded ones.

        Raises UnknownRecordError, ExportError, RequestRejectedError.
        """
        return await self._start_stream(_stream_run, run_id, derived, self._folder, kind)

    async def stream_flight_record(self, event_id: int, kind: DataFormat) -> AsyncGenerator[bytes]:
        """Return a flight record in a format, piece by piece. Raises UnknownRecordError, RequestRejectedError."""
        return await self._start_stream(_stream_flight, event_id, self._folder, kind)

    async def stream_bundle(self, run_id: int) -> AsyncGenerator[bytes]:
        """Return a run with all that it came from. Raises UnknownRecordError, ExportError, RequestRejectedError."""
        return await self._start_stream(stream_bundle, run_id, self._folder)

    async def compute_differences(self, asked: DifferencesRequest) -> Differences:
        """Return the differences of runs to one.

        Raises RequestRejectedError, UnknownRecordError, UnknownSignalError.
        """
        if await asyncio.to_thread(count_samples, self._database, asked.run) <= AT_HAND_SAMPLES:
            return await asyncio.to_thread(compute_differences, self._database, asked)
        return await self._worker.run(compute_differences, self._database, asked)

    async def stream_comparison(
        self, content: Literal["curves", "table"], asked: DifferencesRequest
    ) -> AsyncGenerator[bytes]:
        """Return a comparison as text, piece by piece. Raises as ``differences`` does."""
        return await self._start_stream(stream_curves_file if content == "curves" else stream_table_file, asked)

    async def _start_stream(self, work: Callable[..., Iterator[bytes]], *asked: object) -> AsyncGenerator[bytes]:
        if self._active_count >= MAX_DOWNLOADS:
            raise RequestRejectedError(
                ErrorCode.TOO_MANY, f"{MAX_DOWNLOADS} downloads are under way: wait for one of them", retry_after_s=5
            )
        stream = self._count_stream(stream_from_process(work, self._database, *asked))
        await anext(stream)
        return stream

    async def _count_stream(self, stream: AsyncGenerator[bytes]) -> AsyncGenerator[bytes]:
        """Yield nothing when the first piece is there: all that can be refused has been by then; then the pieces."""
        self._active_count += 1
        try:
            async with aclosing(stream):
                first = await anext(stream, b"")
                yield b""
                yield first
                async for piece in stream:
                    yield piece
        finally:
            self._active_count -= 1

    async def _render_report(self, run_id: int, kind: str, angles: AngleUnit) -> bytes:
        await self._evaluate_pending([run_id])
        source = await asyncio.to_thread(self._load_source, run_id, angles)
        content = await self._worker.run(render_report, source, kind)
        await asyncio.to_thread(self._store_report, run_id, kind, content)
        return content

    async def _evaluate_pending(self, run_ids: Sequence[int]) -> None:
        for run_id in await asyncio.to_thread(find_pending_runs, self._database, run_ids):
            try:
                await self._evaluate(run_id)
            except RequestRejectedError:  # it is under way
                raise
            except Exception as error:
                _log.info("Run %d has no result: %s", run_id, error)  # kept with the run: the report says so

    def _load_source(self, run_id: int, angles: AngleUnit) -> RunData:
        source = load_source(self._database, run_id, angles)
        if source.run.end_state == EndState.RUNNING:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, f"run {run_id} is not over yet: its report follows when it is"
            )
        if source.result is None and source.run.kind != RunKind.SESSION and _is_result_pending(source):
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, f"the result of run {run_id} is being computed: its report follows in a moment"
            )
        return source

    def _store_report(self, run_id: int, kind: str, content: bytes) -> None:
        with self._database.session() as session:
            newest = results.newest_report(session, run_id, kind)
            if newest is None or newest.content != content:
                results.add_report(session, run_id, kind, content)


def _is_result_pending(source: RunData) -> bool:
    ended = source.run.ended_at
    return (
        source.run.evaluation_problem == ""
        and source.run.end_state != EndState.SERVICE_DIED
        and ended is not None
        and (datetime.now(UTC) - ended).total_seconds() < RESULT_TIMEOUT_S
    )


def _stream_run(
    database: Database, run_id: int, derived: Sequence[str], folder: Path, kind: DataFormat
) -> Iterator[bytes]:
    return stream_export(export_run(database, run_id, derived), kind, folder)


def _stream_flight(database: Database, event_id: int, folder: Path, kind: DataFormat) -> Iterator[bytes]:
    return stream_export(
        export_columns(read_flight_columns(database, event_id), f"flight record {event_id}"), kind, folder
    )
