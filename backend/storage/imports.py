"""Records as documents for import elsewhere, without number and station.

Numbers of other records in them (``REFERENCES``) are those of the installation that wrote them.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Column, func, select
from sqlalchemy.orm import Session

from backend.models import remove_initial_bank, renumber_banks, upgrades
from backend.storage import messages, origins
from backend.storage.identifications import (
    UnfitDocumentError,
    require_entry,
    require_fit,
    require_lines,
    require_run,
)
from backend.storage.orm import (
    BankEntryRow,
    BankRow,
    Base,
    Document,
    IdentificationRow,
    OfStation,
    ResultRow,
    RunRow,
    UtcDateTime,
    mark_for_reindex,
    require,
)
from backend.storage.stations import one_at_a_time, session_station

RUN, IDENTIFICATION, BANK, RESULT = "run", "identification", "bank", "result"
_TABLES: dict[str, type[Base]] = {RUN: RunRow, IDENTIFICATION: IdentificationRow, BANK: BankRow, RESULT: ResultRow}
KINDS = tuple(_TABLES)
REFERENCES = {"run_id": RUN, "bank_id": BANK, "identification_id": IDENTIFICATION}
ENTRIES = "entries"
_OWN = ("id", "station")
_CHANGES = {RUN: ("note", "evaluation_problem"), BANK: ("version", ENTRIES)}
"""Columns that may change, or that refer to other records by number."""
_MADE = {RUN: "started_at"}
"""Column with the time that identifies a record; ``created_at`` by default."""


def build_record_document(session: Session, kind: str, number: int) -> Document:
    """Return a record as JSON: times in ISO 8601, a bank with its entries.

    Raises UnknownRecordError.
    """
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


def parse_required_record(kind: str, document: Any) -> Document:
    """Return a document that is a record of this kind, in the current form.

    Raises UnfitDocumentError.
    """
    if kind not in _TABLES:
        raise UnfitDocumentError(messages.unknown_record_kind(record=kind))
    columns = _columns(_TABLES[kind])
    parts = {column.name for column in columns} | ({ENTRIES} if kind == BANK else set())
    if not isinstance(document, Mapping) or set(document) != parts:
        raise UnfitDocumentError(messages.wrong_parts_of_record(record=kind, parts=sorted(parts)))
    for column in columns:
        require_fit(kind, column, document[column.name])
    record = upgrades.upgrade_record(kind, document)
    require_lines(record)
    if kind == RUN:
        require_run(record)
    if kind == BANK:
        _require_entries(record[ENTRIES])
    return record


def _require_entries(entries: Any) -> None:
    if not isinstance(entries, list) or not entries:
        raise UnfitDocumentError(
            messages.part_unfit(part="entries of the bank", value=entries, needed="a list of one or more")
        )
    for entry in entries:
        wanted = [column for column in _columns(BankEntryRow) if column.name not in ("bank_id", "position")]
        if not isinstance(entry, Mapping) or set(entry) != {column.name for column in wanted}:
            raise UnfitDocumentError(messages.wrong_parts_of_bank_entry(parts=[column.name for column in wanted]))
        for column in wanted:
            require_fit("bank entry", column, entry[column.name])
        require_entry(entry)


def exclude_other_imports(session: Session) -> None:
    """Wait until no other import is in progress on the database server.

    Two imports of one file would store it twice.
    """
    one_at_a_time(session.connection(), "import")


def find_same_record(session: Session, kind: str, document: Document) -> int | None:
    """Return the station's record made at the same time as the document, or None.

    A result must belong to the run of the document, by its number here. Raises UnfitDocumentError if record and
    document differ.
    """
    table: Any = _TABLES[kind]
    made = _MADE.get(kind, "created_at")
    query = select(table).where(getattr(table, made) == datetime.fromisoformat(document[made]))
    mine = (
        table.station == session_station(session)
        if issubclass(table, OfStation)
        else table.run_id == document["run_id"]
    )
    for row in session.scalars(query.where(mine)):
        here = build_record_document(session, kind, row.id)
        changing = (*_CHANGES.get(kind, ()), *REFERENCES)
        if all(
            _normalize_for_comparison(name, here) == _normalize_for_comparison(name, document)
            for name in here
            if name not in changing
        ):
            return int(row.id)
        raise UnfitDocumentError(messages.record_differs(record=kind, number=row.id))
    return None


def import_document(session: Session, kind: str, document: Document) -> int:
    """Store a document as a new record of the station and return its number.

    Its references are numbers here. A bank whose version exists becomes the next version of its name.
    """
    table = _TABLES[kind]
    values = {
        column.name: datetime.fromisoformat(document[column.name])
        if isinstance(column.type, UtcDateTime) and document[column.name] is not None
        else document[column.name]
        for column in _columns(table)
    }
    if issubclass(table, OfStation):
        values["station"] = session_station(session)
    if kind == BANK:
        of_name = (BankRow.name == document["name"], BankRow.station == session_station(session))
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
        mark_for_reindex(session, row.id if kind == RUN else document["run_id"])
    return int(row.id)


def connect_imported_bank(session: Session, run_id: int, document: Document) -> bool:
    """Assign the banks of a document to a run that was imported without them.

    Returns whether it was without them.
    """
    row = require(session, RunRow, run_id, RUN)
    has_more = row.bank_id is None and document["bank_id"] is not None
    if not origins.bring_banks(session, run_id, where_there_are=has_more):
        return False
    row.bank_id, row.settings = document["bank_id"], document["settings"]
    mark_for_reindex(session, run_id)
    return True


def _normalize_for_comparison(name: str, document: Document) -> Any:
    """Return a part of a record for comparison, without the numbers of banks."""
    part = document[name]
    return renumber_banks(remove_initial_bank(part), lambda _: 0) if name == "settings" else part


def _names(table: type[Base]) -> list[str]:
    return [column.name for column in table.__table__.columns]


def _columns(table: type[Base]) -> list[Column[Any]]:
    columns: list[Any] = list(table.__table__.columns)
    return [column for column in columns if column.name not in _OWN]


def _plain(value: Any) -> Any:
    return value.astimezone(UTC).isoformat() if isinstance(value, datetime) else value
