"""Reports and exports of runs, made in a process of their own so that the live stream does not stutter."""

import asyncio
from datetime import UTC, datetime

from backend.libraries import DRAWING
from backend.offload import Offload
from backend.reading import Angles
from backend.recording.columns import columns_of_run
from backend.recording.flight import flight_columns
from backend.refusal import Because, RefusalError
from backend.reports.rendering import export, render
from backend.reports.source import Source, load_source
from backend.storage import Database, results
from backend.storage.runs import EndState, RunKind

COMPUTING_S = 60.0
"""A run that ended longer ago [s] and has no result will not get one: its report says so."""

_REPORTS = "backend.reports.build", "backend.reports.html", "backend.reports.pdf"


class Downloads:
    """Makes what is downloaded."""

    def __init__(self, database: Database, offload: Offload) -> None:
        self._database = database
        self._offload = offload

    def prepare(self) -> None:
        """Load what reports need ahead of the first one."""
        self._offload.prepare(render, *DRAWING, *_REPORTS)

    async def report_html(self, run_id: int, angles: Angles) -> bytes:
        """Return the report as one self-contained page. Raises UnknownRecordError, RefusalError."""
        return await self._report(run_id, "html", angles)

    async def report_pdf(self, run_id: int, angles: Angles) -> bytes:
        """Return the report as PDF. Raises UnknownRecordError, RefusalError."""
        return await self._report(run_id, "pdf", angles)

    async def data(self, run_id: int, kind: str) -> bytes:
        """Return all samples as "csv", "parquet" or "mat". Raises UnknownRecordError."""
        columns = await asyncio.to_thread(columns_of_run, self._database, run_id)
        return await self._offload.run(export, columns, kind)

    async def flight(self, event_id: int, kind: str) -> bytes:
        """Return a flight record as "csv", "parquet" or "mat". Raises UnknownRecordError."""
        columns = await asyncio.to_thread(flight_columns, self._database, event_id)
        return await self._offload.run(export, columns, kind)

    async def _report(self, run_id: int, kind: str, angles: Angles) -> bytes:
        source = await asyncio.to_thread(self._source, run_id, angles)
        content = await self._offload.run(render, source, kind)
        await asyncio.to_thread(self._keep, run_id, kind, content)
        return content

    def _source(self, run_id: int, angles: Angles) -> Source:
        source = load_source(self._database, run_id, angles)
        if source.run.end_state == EndState.RUNNING:
            raise RefusalError(Because.NOT_NOW, f"run {run_id} is not over yet: its report follows when it is")
        if source.result is None and source.run.kind != RunKind.SESSION and _is_awaited(source):
            raise RefusalError(
                Because.NOT_NOW, f"the result of run {run_id} is being computed: its report follows in a moment"
            )
        return source

    def _keep(self, run_id: int, kind: str, content: bytes) -> None:
        with self._database.session() as session:
            newest = results.newest_report(session, run_id, kind)
            if newest is None or newest.content != content:
                results.add_report(session, run_id, kind, content)


def _is_awaited(source: Source) -> bool:
    ended = source.run.ended_at
    return (
        source.run.evaluation_problem == ""
        and ended is not None
        and (datetime.now(UTC) - ended).total_seconds() < COMPUTING_S
    )
