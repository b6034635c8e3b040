"""Results of commissioning steps: a row per attempt, the newest of a step counts."""

from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from backend.storage.orm import BringUpRow, to_record
from backend.storage.stations import session_station


@dataclass(frozen=True)
class NewStepResult:
    """Result of a step with the wiring ``wiring``, identified by ``fingerprint``.

    ``figures`` are (text, value, unit) by name, ``calibrations`` the values that apply, by name too.
    """

    step: str
    wiring: str
    fingerprint: str
    passed: bool
    text: str
    who: str
    figures: list[dict[str, Any]] = field(default_factory=list)
    calibrations: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class StoredStepResult(NewStepResult):
    """A stored result."""

    id: int = 0
    at: datetime = datetime.min


def add(session: Session, new: NewStepResult) -> StoredStepResult:
    """Store a result."""
    row = BringUpRow(at=datetime.now(UTC), station=session_station(session), **asdict(new))
    session.add(row)
    session.flush()
    return to_record(StoredStepResult, row)


def newest(session: Session) -> dict[str, StoredStepResult]:
    """Return the newest result of each step at the station."""
    last = (
        select(func.max(BringUpRow.id)).where(BringUpRow.station == session_station(session)).group_by(BringUpRow.step)
    )
    rows = session.scalars(select(BringUpRow).where(BringUpRow.id.in_(last)))
    return {row.step: to_record(StoredStepResult, row) for row in rows}


def calibrations(session: Session, station: str) -> list[StoredStepResult]:
    """Return all calibrations at a station, oldest first."""
    query = select(BringUpRow).where(BringUpRow.station == station, BringUpRow.passed).order_by(BringUpRow.id)
    return [to_record(StoredStepResult, row) for row in session.scalars(query) if row.calibrations]


def held_at(session: Session, station: str, at: datetime) -> list[StoredStepResult]:
    """Return the newest calibration of each step at a station up to a time."""
    return list({one.step: one for one in calibrations(session, station) if one.at <= at}.values())


def describe_calibration(result: StoredStepResult) -> dict[str, Any]:
    """Return the data of a calibration for a lineage."""
    return {"step": result.step, "fingerprint": result.fingerprint, "calibrations": result.calibrations}


def last_failure(session: Session, step: str) -> int:
    """Return the number of the newest failed result of a step, 0 for none.

    With any wiring.
    """
    failed = (BringUpRow.step == step, BringUpRow.passed.is_(False), BringUpRow.station == session_station(session))
    query = select(func.max(BringUpRow.id)).where(*failed)
    return session.scalar(query) or 0


def passed_with(session: Session, fingerprint: str) -> list[StoredStepResult]:
    """Return all passed results with one wiring, oldest first."""
    passed = (BringUpRow.fingerprint == fingerprint, BringUpRow.passed, BringUpRow.station == session_station(session))
    query = select(BringUpRow).where(*passed).order_by(BringUpRow.id)
    return [to_record(StoredStepResult, row) for row in session.scalars(query)]
