"""How much the recordings take, and which of them nothing that is in use came from."""

from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import delete, exists, func, select
from sqlalchemy.orm import Session

from backend.storage.records import require
from backend.storage.runs import EndState
from backend.storage.schema import ChunkRow, IdentificationRow, RecordingRow, ReportRow, ResultRow, RunRow
from backend.storage.stations import station_of


@dataclass(frozen=True)
class Held:
    """The samples of one run. ``in_use``: the run is open, or a model, a result or a report was made from it."""

    run_id: int
    kind: str
    who: str
    note: str
    started_at: datetime
    size_bytes: int
    in_use: bool


def held(session: Session) -> list[Held]:
    """Return what is held of the station's runs, oldest first."""
    needs = [
        exists().where(table.run_id == RunRow.id).correlate(RunRow)
        for table in (IdentificationRow, ResultRow, ReportRow)
    ]
    in_use = (RunRow.end_state == EndState.RUNNING.value) | needs[0] | needs[1] | needs[2]
    columns = (RunRow.id, RunRow.kind, RunRow.who, RunRow.note, RunRow.started_at, RecordingRow.size_bytes, in_use)
    mine = (RecordingRow.size_bytes > 0, RunRow.station == station_of(session))
    query = select(*columns).join(RecordingRow).where(*mine).order_by(RunRow.id)
    return [Held(*row[:-1], bool(row[-1])) for row in session.execute(query)]


def mark_removed(session: Session, run_id: int, how: str) -> None:
    """Put on record that the samples of a run are deleted, before they are. Raises UnknownRecordError."""
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
