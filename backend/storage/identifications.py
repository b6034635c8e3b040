"""Identifications: what was estimated from which data, how, and whether it may be used for tuning."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from backend.storage.records import UnknownRecordError, require, to_record
from backend.storage.schema import Document, IdentificationRow


@dataclass(frozen=True)
class NewIdentification:
    """An estimate to store.

    ``run_id`` is the run whose samples were used, None for data from elsewhere; ``data`` says which part of them
    (signals, time span, or file name and digest); ``model`` and ``quality`` are the estimator's result, JSON.
    """

    kind: str
    run_id: int | None
    data: Document
    method: str
    options: Document
    model: Document
    quality: Document
    usable: bool
    verdict: str
    who: str
    software: str


@dataclass(frozen=True)
class Identification(NewIdentification):
    """A stored estimate."""

    id: int
    created_at: datetime


def add(session: Session, new: NewIdentification) -> Identification:
    """Store an estimate beside all earlier ones."""
    row = IdentificationRow(**asdict(new), created_at=datetime.now(UTC))
    session.add(row)
    session.flush()
    return to_record(Identification, row)


def get(session: Session, identification_id: int) -> Identification:
    """Return one estimate. Raises UnknownRecordError."""
    return to_record(Identification, require(session, IdentificationRow, identification_id, "identification"))


def of_run(session: Session, run_id: int) -> Identification:
    """Return the newest estimate made from a run. An identification goes by its run's number wherever people see it.

    Raises UnknownRecordError.
    """
    found = find(session, run_id=run_id)
    if not found:
        raise UnknownRecordError(f"there is no identification {run_id} with a model")
    return found[0]


def runs_of(session: Session) -> dict[int, int | None]:
    """Return by the number of each stored estimate that of the run it came from; None for data from elsewhere."""
    found = session.execute(select(IdentificationRow.id, IdentificationRow.run_id))
    return {row.id: row.run_id for row in found}


def joint_positions(session: Session, numbers: Iterable[int]) -> dict[int, float]:
    """Return the joint position [rad] at which each stored estimate of an actuator was made, where it says so."""
    query = select(IdentificationRow.id, IdentificationRow.model).where(IdentificationRow.id.in_(tuple(numbers)))
    return {row.id: row.model["q_nominal"] for row in session.execute(query) if "q_nominal" in row.model}


def find(session: Session, *, kind: str | None = None, run_id: int | None = None) -> list[Identification]:
    """Return estimates, newest first, of a kind or of a run."""
    query = select(IdentificationRow).order_by(IdentificationRow.id.desc())
    if kind is not None:
        query = query.where(IdentificationRow.kind == kind)
    if run_id is not None:
        query = query.where(IdentificationRow.run_id == run_id)
    return [to_record(Identification, row) for row in session.scalars(query)]
