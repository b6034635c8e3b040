"""Recordings in chunks, each committed completely, and their sizes."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import ColumnElement, and_, delete, exists, func, select, update
from sqlalchemy.orm import Session

from backend.storage import messages
from backend.storage.orm import (
    ChunkRow,
    IdentificationRow,
    RecordingRow,
    ReportRow,
    ResultRow,
    RunRow,
    UnknownRecordError,
    require,
    to_record,
)
from backend.storage.runs import EndState
from backend.storage.stations import session_station
from plant import SinewError

# Recordings ----------------------------------------------------------------------------------------
# Recordings: the samples of a run in chunks of up to one second, each committed completely.


@dataclass(frozen=True)
class Recording:
    """Recording of a run: ``fields`` names the columns.

    ``missed`` ticks are missing, ``problem`` says why. ``removed_at`` is the time at which samples were deleted to free
    space.
    """

    run_id: int
    fields: list[str]
    period_s: float
    missed: int
    problem: str
    size_bytes: int
    removed_at: datetime | None


@dataclass(frozen=True)
class Span:
    """Ticks ``first_tick`` to ``end_tick`` (exclusive)."""

    first_tick: int
    end_tick: int


@dataclass(frozen=True)
class Extent(Span):
    """A span, and the number of its recorded ticks."""

    count: int


@dataclass(frozen=True)
class Chunk:
    """Consecutive samples from ``first_tick`` on, and their summary.

    Both are packed by ``backend.recording.codec``.
    """

    first_tick: int
    count: int
    summary: bytes
    samples: bytes


@dataclass(frozen=True)
class Summary:
    """A chunk without its samples."""

    first_tick: int
    count: int
    summary: bytes


class NotRecordableError(SinewError, ValueError):
    """The run is over, or has a recording already."""


def begin(session: Session, run_id: int, fields: list[str], period_s: float) -> Recording:
    """Open the recording of a running run.

    A run whose end was only inferred, by a service that shut down before the first samples were read, counts as
    running: its samples determine its end. Raises UnknownRecordError, NotRecordableError.
    """
    run = require(session, RunRow, run_id, "run")
    over = run.end_state not in (EndState.RUNNING, EndState.SERVICE_DIED)
    if over or session.get(RecordingRow, run_id) is not None:
        raise NotRecordableError(messages.run_not_recordable(run_id=run_id))
    row = RecordingRow(
        run_id=run_id, fields=fields, period_s=period_s, missed=0, problem="", size_bytes=0, removed_at=None
    )
    session.add(row)
    session.flush()
    return to_record(Recording, row)


def begin_imported(
    session: Session, run_id: int, fields: list[str], period_s: float, missed: int, problem: str
) -> None:
    """Open the recording of a run that was recorded elsewhere.

    Raises UnknownRecordError.
    """
    require(session, RunRow, run_id, "run")
    values = {"missed": missed, "problem": problem, "size_bytes": 0, "removed_at": None}
    session.add(RecordingRow(run_id=run_id, fields=fields, period_s=period_s, **values))
    session.flush()


def is_begun(session: Session, run_id: int) -> bool:
    """Return whether the recording of a run has been opened."""
    return session.get(RecordingRow, run_id) is not None


def has_chunk(session: Session, run_id: int, first_tick: int) -> bool:
    """Return whether a recording has a chunk that begins here."""
    return session.get(ChunkRow, (run_id, first_tick)) is not None


def add_chunks(session: Session, run_id: int, chunks: Sequence[Chunk]) -> None:
    """Append chunks to an open recording."""
    session.add_all(
        ChunkRow(run_id=run_id, **vars(chunk), sha256=hashlib.sha256(chunk.samples).hexdigest()) for chunk in chunks
    )
    size = sum(len(chunk.samples) + len(chunk.summary) for chunk in chunks)
    longer = update(RecordingRow).where(RecordingRow.run_id == run_id)
    session.execute(longer.values(size_bytes=RecordingRow.size_bytes + size))
    session.flush()


def add_gap(session: Session, run_id: int, missed: int, problem: str) -> None:
    """Record that ticks are missing, and why. Raises UnknownRecordError."""
    row = require(session, RecordingRow, run_id, "recording of run")
    row.missed += missed
    row.problem = f"{row.problem}; {problem}" if row.problem else problem
    session.flush()


def get(session: Session, run_id: int) -> Recording:
    """Return the recording of a run. Raises UnknownRecordError if there is none."""
    return to_record(Recording, require(session, RecordingRow, run_id, "recording of run"))


def span(session: Session, run_id: int) -> Span:
    """Return the ticks that a recording spans, in constant time.

    Raises UnknownRecordError if the run has no samples.
    """
    chunks_of_run = select(ChunkRow.first_tick, ChunkRow.count).where(ChunkRow.run_id == run_id)
    first = session.execute(chunks_of_run.order_by(ChunkRow.first_tick).limit(1)).first()
    last = session.execute(chunks_of_run.order_by(ChunkRow.first_tick.desc()).limit(1)).first()
    if first is None or last is None:
        row = session.get(RecordingRow, run_id)
        if row is None or row.removed_at is None:
            raise UnknownRecordError(messages.record_not_found(record="recording of run", number=run_id))
        raise UnknownRecordError(messages.recording_removed(run_id=run_id, reason=row.problem))
    return Span(first.first_tick, last.first_tick + last.count)


def tick_before(session: Session, run_id: int, tick: int) -> int:
    """Return the last recorded tick at or before ``tick`` >= 0.

    Both count from the first sample of the run. Raises UnknownRecordError if the run has no samples.
    """
    first_tick = span(session, run_id).first_tick
    of_run = select(ChunkRow.first_tick, ChunkRow.count).where(ChunkRow.run_id == run_id)
    begun = of_run.where(ChunkRow.first_tick <= first_tick + tick).order_by(ChunkRow.first_tick.desc()).limit(1)
    begin, count = session.execute(begun).one()
    return min(tick, begin + count - 1 - first_tick)


def extent(session: Session, run_id: int) -> Extent:
    """Return the span of a recording and the number of its samples.

    Reads an index entry of each chunk. Raises UnknownRecordError if the run has no samples.
    """
    spanned = span(session, run_id)
    count = session.scalar(select(func.sum(ChunkRow.count)).where(ChunkRow.run_id == run_id))
    return Extent(spanned.first_tick, spanned.end_tick, int(count or 0))


def of_runs(session: Session, run_ids: Sequence[int]) -> dict[int, tuple[Recording, Extent | None]]:
    """Return the recordings of these runs; without an extent if there are no samples."""
    rows = {row.run_id: row for row in session.scalars(select(RecordingRow).where(RecordingRow.run_id.in_(run_ids)))}
    last, first = func.max(ChunkRow.first_tick + ChunkRow.count), func.min(ChunkRow.first_tick)
    spans = select(ChunkRow.run_id, first, last, func.sum(ChunkRow.count)).where(ChunkRow.run_id.in_(run_ids))
    found = session.execute(spans.group_by(ChunkRow.run_id))
    extents = {run_id: Extent(begin, end, int(count)) for run_id, begin, end, count in found}
    return {run_id: (to_record(Recording, row), extents.get(run_id)) for run_id, row in rows.items()}


def chunks(session: Session, run_id: int, from_tick: int, to_tick: int) -> Iterator[Chunk]:
    """Yield the chunks that have ticks in [from_tick, to_tick), in order."""
    columns = (ChunkRow.first_tick, ChunkRow.count, ChunkRow.summary, ChunkRow.samples)
    query = select(*columns).where(_within(run_id, from_tick, to_tick)).order_by(ChunkRow.first_tick)
    for row in session.execute(query.execution_options(yield_per=64)):
        yield Chunk(*row)


def recorded_digests(session: Session, run_id: int) -> dict[int, str]:
    """Return the SHA-256 of each chunk's packed samples as recorded, by first tick.

    "" if none was stored.
    """
    rows = select(ChunkRow.first_tick, ChunkRow.sha256).where(ChunkRow.run_id == run_id).order_by(ChunkRow.first_tick)
    return {row.first_tick: row.sha256 for row in session.execute(rows)}


def recorded_runs(session: Session) -> list[int]:
    """Return the numbers of all runs that have a recording."""
    return list(session.scalars(select(RecordingRow.run_id).order_by(RecordingRow.run_id)))


def summaries(session: Session, run_id: int, from_tick: int, to_tick: int) -> Iterator[Summary]:
    """Yield the summaries of the chunks that have ticks in [from_tick, to_tick).

    In order.
    """
    columns = (ChunkRow.first_tick, ChunkRow.count, ChunkRow.summary)
    query = select(*columns).where(_within(run_id, from_tick, to_tick)).order_by(ChunkRow.first_tick)
    for row in session.execute(query.execution_options(yield_per=1024)):
        yield Summary(*row)


def _within(run_id: int, from_tick: int, to_tick: int) -> ColumnElement[bool]:
    begun_before = select(func.max(ChunkRow.first_tick)).where(
        ChunkRow.run_id == run_id, ChunkRow.first_tick <= from_tick
    )
    return and_(
        ChunkRow.run_id == run_id,
        # The primary key finds the first possible chunk; only its end must be read.
        ChunkRow.first_tick >= func.coalesce(begun_before.scalar_subquery(), from_tick),
        ChunkRow.first_tick < to_tick,
        ChunkRow.first_tick + ChunkRow.count > from_tick,
    )


# Retention -----------------------------------------------------------------------------------------
# Sizes of recordings, and whether results that depend on them exist.


@dataclass(frozen=True)
class RetentionEntry:
    """The samples of one run.

    ``in_use``: the run is open, or has a model, a result or a report.
    """

    run_id: int
    kind: str
    who: str
    note: str
    started_at: datetime
    size_bytes: int
    in_use: bool


def load_held(session: Session) -> list[RetentionEntry]:
    """Return the recordings of the station's runs, oldest first."""
    needs = [
        exists().where(table.run_id == RunRow.id).correlate(RunRow)
        for table in (IdentificationRow, ResultRow, ReportRow)
    ]
    in_use = (RunRow.end_state == EndState.RUNNING.value) | needs[0] | needs[1] | needs[2]
    columns = (RunRow.id, RunRow.kind, RunRow.who, RunRow.note, RunRow.started_at, RecordingRow.size_bytes, in_use)
    mine = (RecordingRow.size_bytes > 0, RunRow.station == session_station(session))
    query = select(*columns).join(RecordingRow).where(*mine).order_by(RunRow.id)
    return [RetentionEntry(*row[:-1], bool(row[-1])) for row in session.execute(query)]


def mark_removed(session: Session, run_id: int, how: str) -> None:
    """Record that the samples of a run will be deleted. Raises UnknownRecordError."""
    row = require(session, RecordingRow, run_id, "recording of run")
    if row.removed_at is None:
        row.removed_at = datetime.now(UTC)
        row.problem = f"{row.problem}; {how}" if row.problem else how
        session.flush()


def remove_chunks(session: Session, run_id: int, at_most: int) -> bool:
    """Delete the oldest chunks of a run; return whether there are more."""
    recording = require(session, RecordingRow, run_id, "recording of run")
    sizes = select(ChunkRow.first_tick, func.length(ChunkRow.samples) + func.length(ChunkRow.summary))
    oldest = session.execute(sizes.where(ChunkRow.run_id == run_id).order_by(ChunkRow.first_tick).limit(at_most)).all()
    if oldest:
        last = oldest[-1][0]
        session.execute(delete(ChunkRow).where(ChunkRow.run_id == run_id, ChunkRow.first_tick <= last))
    recording.size_bytes = max(0, recording.size_bytes - sum(size for _, size in oldest)) if oldest else 0
    return len(oldest) == at_most
