"""Downloads and imports of runs: reports, exports, bundles. Uses worker processes."""

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
from backend.services import record_messages
from backend.services.comparison import compute_differences, count_samples, stream_curves_file, stream_table_file
from backend.storage import Database, EndState, Run, RunKind, results, runs
from backend.units import AngleUnit
from backend.workers import DRAWING_LIBRARIES, WorkerProcess, stream_from_process
from plant import ErrorCode

# Imports -------------------------------------------------------------------------------------------
# Imported files are checked as strictly as requests: characters, bounds, and the plan of the run.


_MAX_EXPERIMENT_CHARACTERS = 4 * parser.MAX_CHARACTERS
"""Longest stored experiment: its JSON is longer than the YAML that was sent."""


def import_run_file(database: Database, file: Path, who: str, folder: Path, name: str = "") -> ImportResult:
    """Import the run of a bundle (.zip) or an export, completely or not at all.

    ``name`` is the displayed file name; a bundle is unpacked in ``folder``. Raises ImportRefusedError, OSError.
    """
    shown_name = escape_line(name or file.name)
    if file.suffix.lower() == ".zip":
        return importer.import_bundle(
            database=database, file=file, who=who, folder=folder, name=shown_name, check_run=check_run_settings
        )
    return importer.import_export(database, file, who, shown_name, check_run_settings)


def check_run_settings(run: Run) -> None:
    """Raise ImportRefusedError unless a request could have started the run."""
    try:
        stored_settings = run.set_to
        if stored_settings.experiment is not None:
            _check_experiment(stored_settings.experiment)
        if stored_settings.plan is not None:
            parse_stored_plan(run.kind, stored_settings.plan)
        LoopSettings.from_values(stored_settings.loop.get_known_values())
    except (ExperimentError, SettingError, OutOfRangeError, UnreadableDocumentError, KeyError) as error:
        raise ImportRefusedError(
            record_messages.settings_not_usable(reason=str(error), software=run.software)
        ) from None


def _check_experiment(text: str) -> None:
    """Raise ExperimentError for an experiment that a request could not send."""
    if len(text) > _MAX_EXPERIMENT_CHARACTERS:
        raise ExperimentError(
            record_messages.experiment_too_long(characters=len(text), maximum=_MAX_EXPERIMENT_CHARACTERS)
        )
    try:
        parser.build_experiment(json.loads(text), {})
    except (ValueError, RecursionError) as error:
        if isinstance(error, ExperimentError):
            raise
        raise ExperimentError(record_messages.experiment_is_not_json(reason=str(error))) from None


# Bundles -------------------------------------------------------------------------------------------


def stream_bundle(database: Database, run_id: int, folder: Path) -> Iterator[bytes]:
    """Return the chunks of a run's bundle with its newest report.

    The report is rendered if none is stored; sessions have none. Raises UnknownRecordError, and ExportError for a run
    that no installation would import.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
        try:
            check_run_settings(run)
        except ImportRefusedError as error:
            raise ExportError(record_messages.run_not_exportable(run=run_id, reason=error.message)) from None
        settings = results.newest_report(session, run_id, "html")
    report = None if settings is None else settings.content
    if report is None:
        evaluate_pending_runs(database, [run_id])
        source = load_source(database, run_id)
        if source.run.kind != RunKind.SESSION and source.run.end_state != EndState.RUNNING:
            report = render_report(source, "html")
    return bundle.write_bundle(database, run_id, report, folder)


# Downloads -----------------------------------------------------------------------------------------
# Computed in worker processes, so that the live stream is not delayed.


RESULT_TIMEOUT_S = 60.0
"""Time after the end of a run [s] until its report no longer waits for a result."""
MAX_DOWNLOADS = 6
"""Downloads of samples at the same time, each with a process of its own."""

_log = logging.getLogger(__name__)
_REPORTS = "backend.reports.build", "backend.reports.model", "backend.reports.pdf"


class Downloads:
    """Renders reports and streams exports; ``folder`` holds temporary files.

    ``evaluate`` computes the result of a run, or stores the reason why it has none and raises.
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
        """Import the libraries of reports before the first one."""
        self._worker.preload(render_report, *DRAWING_LIBRARIES, *_REPORTS)

    async def render_html_report(self, run_id: int, angles: AngleUnit) -> bytes:
        """Return the report as one self-contained HTML page.

        Raises UnknownRecordError, RequestRejectedError.
        """
        return await self._render_report(run_id, "html", angles)

    async def render_pdf_report(self, run_id: int, angles: AngleUnit) -> bytes:
        """Return the report as PDF. Raises UnknownRecordError, RequestRejectedError."""
        return await self._render_report(run_id, "pdf", angles)

    async def render_series(self, run_ids: Sequence[int], kind: str, angles: AngleUnit) -> bytes:
        """Return a report of many runs as "html" or "pdf"; it is not stored.

        Raises UnknownRecordError, RequestRejectedError.
        """
        await self._evaluate_pending(run_ids)
        sources = await asyncio.to_thread(load_series, self._database, run_ids, angles)
        return await self._worker.run(render_series_report, sources, kind)

    async def stream_run(self, run_id: int, kind: DataFormat, derived: Sequence[str] = ()) -> AsyncGenerator[bytes]:
        """Return all samples in a format, ``derived`` signals after the recorded ones.

        Raises UnknownRecordError, ExportError, RequestRejectedError.
        """
        return await self._start_stream(_stream_run, run_id, derived, self._folder, kind)

    async def stream_flight_record(self, event_id: int, kind: DataFormat) -> AsyncGenerator[bytes]:
        """Return a flight record in a format.

        Raises UnknownRecordError, RequestRejectedError.
        """
        return await self._start_stream(_stream_flight, event_id, self._folder, kind)

    async def stream_bundle(self, run_id: int) -> AsyncGenerator[bytes]:
        """Return a run with everything that it refers to.

        Raises UnknownRecordError, ExportError, RequestRejectedError.
        """
        return await self._start_stream(stream_bundle, run_id, self._folder)

    async def compute_differences(self, arguments: DifferencesRequest) -> Differences:
        """Return the differences of runs to a reference run.

        Raises RequestRejectedError, UnknownRecordError, UnknownSignalError.
        """
        if await asyncio.to_thread(count_samples, self._database, arguments.run) <= AT_HAND_SAMPLES:
            return await asyncio.to_thread(compute_differences, self._database, arguments)
        return await self._worker.run(compute_differences, self._database, arguments)

    async def stream_comparison(
        self, content: Literal["curves", "table"], arguments: DifferencesRequest
    ) -> AsyncGenerator[bytes]:
        """Return a comparison as CSV text. Raises as ``compute_differences`` does."""
        return await self._start_stream(stream_curves_file if content == "curves" else stream_table_file, arguments)

    async def _start_stream(self, work: Callable[..., Iterator[bytes]], *arguments: object) -> AsyncGenerator[bytes]:
        if self._active_count >= MAX_DOWNLOADS:
            raise RequestRejectedError(
                ErrorCode.TOO_MANY,
                record_messages.too_many_downloads(maximum=MAX_DOWNLOADS),
                retry_after_s=5,
            )
        stream = self._count_stream(stream_from_process(work, self._database, *arguments))
        await anext(stream)
        return stream

    async def _count_stream(self, stream: AsyncGenerator[bytes]) -> AsyncGenerator[bytes]:
        """Yield an empty chunk once the first chunk is there, then all chunks.

        All errors of the request are raised before the empty chunk.
        """
        self._active_count += 1
        try:
            async with aclosing(stream):
                first = await anext(stream, b"")
                yield b""
                yield first
                async for chunk in stream:
                    yield chunk
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
            except RequestRejectedError:  # an evaluation is running
                raise
            except Exception as error:
                _log.info("Run %d has no result: %s", run_id, error)  # stored with the run, shown in the report

    def _load_source(self, run_id: int, angles: AngleUnit) -> RunData:
        source = load_source(self._database, run_id, angles)
        if source.run.end_state == EndState.RUNNING:
            raise RequestRejectedError(ErrorCode.NOT_NOW, record_messages.run_has_no_report_yet(run=run_id))
        if source.result is None and source.run.kind != RunKind.SESSION and _is_result_pending(source):
            raise RequestRejectedError(ErrorCode.NOT_NOW, record_messages.result_is_being_computed(run=run_id))
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
        export_columns(read_flight_columns(database, event_id), record_messages.flight_record(event=event_id)),
        kind,
        folder,
    )
