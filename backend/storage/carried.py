"""Records as documents that another installation takes in: all their columns, but for number and station.

Numbers of other records in them (``REFERENCES``) are those of the installation that wrote them.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, Boolean, Column, Float, LargeBinary, String, func, select
from sqlalchemy.orm import Session
from sqlalchemy.types import Integer

from backend.storage.records import require
from backend.storage.schema import (
    BankEntryRow,
    BankRow,
    Base,
    Document,
    IdentificationRow,
    OfStation,
    ResultRow,
    RunRow,
    UtcDateTime,
)
from backend.storage.stations import station_of
from backend.storage.touched import touch

RUN, IDENTIFICATION, BANK, RESULT = "run", "identification", "bank", "result"
_TABLES: dict[str, type[Base]] = {RUN: RunRow, IDENTIFICATION: IdentificationRow, BANK: BankRow, RESULT: ResultRow}
KINDS = tuple(_TABLES)
REFERENCES = {"run_id": RUN, "bank_id": BANK, "identification_id": IDENTIFICATION}
ENTRIES = "entries"
_OWN = ("id", "station")
_CHANGES = {RUN: ("note", "evaluation_problem"), BANK: ("version", ENTRIES)}
"""What may change of a record where it lies, or names others by their numbers."""
_MADE = {RUN: "started_at"}
"""The moment that tells a record from all others; ``created_at`` where nothing is said."""


class UnfitDocumentError(ValueError):
    """A document that is no record of its kind; the message says which part of it is wrong."""


def document_of(session: Session, kind: str, number: int) -> Document:
    """Return a record as JSON: instants in ISO 8601, a bank with its entries. Raises UnknownRecordError."""
    row = require(session, _TABLES[kind], number, kind)
    document = {column.name: _plain(getattr(row, column.name)) for column in _columns(_TABLES[kind])}
    if kind == BANK:
        query = select(BankEntryRow).where(BankEntryRow.bank_id == number).order_by(BankEntryRow.position)
        own = ("bank_id", "position")
        document[ENTRIES] = [
            {name: _plain(getattr(entry, name)) for name in _names(BankEntryRow) if name not in own}
            for entry in session.scalars(query)
        ]
    return document


def required(kind: str, document: Any) -> Document:
    """Return a document that is a record of this kind. Raises UnfitDocumentError."""
    if kind not in _TABLES:
        raise UnfitDocumentError(f"there are no records of kind {str(kind)[:40]!r}")
    columns = _columns(_TABLES[kind])
    parts = {column.name for column in columns} | ({ENTRIES} if kind == BANK else set())
    if not isinstance(document, Mapping) or set(document) != parts:
        raise UnfitDocumentError(f"a {kind} has the parts {', '.join(sorted(parts))}")
    for column in columns:
        _require_fit(kind, column, document[column.name])
    for entry in document.get(ENTRIES, []):
        wanted = [column for column in _columns(BankEntryRow) if column.name not in ("bank_id", "position")]
        if not isinstance(entry, Mapping) or set(entry) != {column.name for column in wanted}:
            raise UnfitDocumentError(f"an entry of a bank has the parts {', '.join(column.name for column in wanted)}")
        for column in wanted:
            _require_fit("bank entry", column, entry[column.name])
    return dict(document)


def find_same(session: Session, kind: str, document: Document) -> int | None:
    """Return the number of the record that was made at the same moment here, None where there is none.

    Raises UnfitDocumentError where it says something else than the document.
    """
    table: Any = _TABLES[kind]
    made = _MADE.get(kind, "created_at")
    found = session.scalars(select(table).where(getattr(table, made) == datetime.fromisoformat(document[made])))
    for row in found:
        here = document_of(session, kind, row.id)
        changing = (*_CHANGES.get(kind, ()), *REFERENCES)
        if all(_without_bank(here[name]) == _without_bank(document[name]) for name in here if name not in changing):
            return int(row.id)
        raise UnfitDocumentError(f"{kind} {row.id} was made at the same moment here, and says something else")
    return None


def put(session: Session, kind: str, document: Document) -> int:
    """Store a document as a new record of the station and return its number; its references are those of here.

    A bank whose version is taken becomes the next of its name.
    """
    table = _TABLES[kind]
    values = {
        column.name: datetime.fromisoformat(document[column.name])
        if isinstance(column.type, UtcDateTime) and document[column.name] is not None
        else document[column.name]
        for column in _columns(table)
    }
    if issubclass(table, OfStation):
        values["station"] = station_of(session)
    if kind == BANK:
        of_name = (BankRow.name == document["name"], BankRow.station == station_of(session))
        taken = set(session.scalars(select(BankRow.version).where(*of_name)))
        newest = session.scalar(select(func.max(BankRow.version)).where(*of_name)) or 0
        values["version"] = newest + 1 if document["version"] in taken else document["version"]
    row: Any = table(**values)
    session.add(row)
    session.flush()
    for position, entry in enumerate(document.get(ENTRIES, [])):
        session.add(BankEntryRow(bank_id=row.id, position=position, **entry))
    session.flush()
    if kind == RUN or document.get("run_id") is not None:
        touch(session, row.id if kind == RUN else document["run_id"])
    return int(row.id)


def _without_bank(part: Any) -> Any:
    """Return what is compared of a part of a record: settings name the bank by its number."""
    loop = part.get("loop") if isinstance(part, Mapping) else None
    return part if not isinstance(loop, Mapping) else {**part, "loop": {**loop, "bank": None}}


def _names(table: type[Base]) -> list[str]:
    return [column.name for column in table.__table__.columns]


def _columns(table: type[Base]) -> list[Column[Any]]:
    columns: list[Any] = list(table.__table__.columns)
    return [column for column in columns if column.name not in _OWN]


def _plain(value: Any) -> Any:
    return value.astimezone(UTC).isoformat() if isinstance(value, datetime) else value


def _require_fit(kind: str, column: Any, value: Any) -> None:
    """Raise UnfitDocumentError for what the column cannot hold."""
    if value is None and column.nullable:
        return
    if isinstance(column.type, UtcDateTime):
        try:
            fits = isinstance(value, str) and datetime.fromisoformat(value).tzinfo is not None
        except ValueError:
            fits = False
    elif isinstance(column.type, JSON):
        fits = isinstance(value, dict | list)
    elif isinstance(column.type, String):  # Text too
        fits = isinstance(value, str) and len(value) <= (column.type.length or len(value))
    elif isinstance(column.type, Boolean):
        fits = isinstance(value, bool)
    else:
        wanted = int | float if isinstance(column.type, Float) else int
        fits = isinstance(value, wanted) and not isinstance(value, bool) and abs(value) < 2**31
    assert isinstance(column.type, UtcDateTime | JSON | String | Boolean | Float | Integer | LargeBinary)
    if not fits:
        raise UnfitDocumentError(f"{column.name} of a {kind} cannot be {str(value)[:40]!r}")
