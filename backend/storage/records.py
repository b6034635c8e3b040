"""Turn rows into the plain dataclasses that leave this package."""

from collections.abc import Iterable
from dataclasses import fields
from typing import TYPE_CHECKING, TypeVar

from sqlalchemy.orm import Session

from backend.errors import Because, RefusalError
from backend.plain_text import as_folded
from backend.storage.schema import Base

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record", bound="DataclassInstance")
Row = TypeVar("Row", bound=Base)


class UnknownRecordError(LookupError):
    """There is no such record; the message says which was asked for."""


def to_record(record_class: type[Record], row: Base) -> Record:
    """Copy the columns of the same name into a frozen dataclass."""
    return record_class(**{field.name: getattr(row, field.name) for field in fields(record_class)})


def require(session: Session, row_class: type[Row], identifier: int, what: str) -> Row:
    """Load the row with this identifier. Raises UnknownRecordError."""
    row = session.get(row_class, identifier)
    if row is None:
        raise UnknownRecordError(f"there is no {what} {identifier}")
    return row


def require_distinct(what: str, name: str, others: Iterable[str]) -> None:
    """Raise RefusalError for a new name that people take for one of the others: "Brief" beside "brief"."""
    folded = as_folded(name)
    for other in others:
        if other != name and as_folded(other) == folded:
            raise RefusalError(
                Because.BAD_VALUE,
                f"there is {what} {other!r} already, which reads like {name!r}: write that name, or choose another one",
                code="name_taken",
            )
