"""Tables, conversion of rows to dataclasses, and errors of a database."""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    DateTime,
    Dialect,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Text,
    TypeDecorator,
    UniqueConstraint,
    event,
    inspect,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, Mapper, Session, mapped_column

from backend.errors import STATION_NAME_LENGTH, RequestRejectedError
from backend.plain_text import fold_name
from backend.storage import messages
from plant import FILE_NAME_MAX, NAME_MAX, ErrorCode, SinewError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


# Errors --------------------------------------------------------------------------------------------
# Errors of a database, by their remedies.


class StorageError(SinewError):
    """The database cannot be reached, read or written, or rejects a statement.

    The message is its own.
    """

    category = ErrorCode.UNAVAILABLE


class UnfitError(StorageError):
    """The data violate the database's constraints: a retry will not help."""


class GoneError(StorageError):
    """The database's file was moved or deleted: new data would be lost."""


class DamagedError(StorageError):
    """The database's file is damaged; the message names the remedy."""


# Schema --------------------------------------------------------------------------------------------
# The tables. Rows stay inside this package: its functions take and return plain dataclasses.
#
# Nothing is overwritten, except by a migration to an equivalent form: models, banks, results and settings are added as
# new rows, and every gain can be traced from ``bank_entry`` via ``identification`` to the run, its samples and its
# parameters.


Document = dict[str, Any]

METHOD_MAX = 200
"""Length of the names of both channels' estimators, each with noise model and weighting, with a reserve."""


class UtcDateTime(TypeDecorator[datetime]):
    """A time, stored as UTC without zone (SQLite has no zones) and returned with it."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the stored form; reject times without zone, which would silently shift."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"{value} has no time zone: use datetime.now(UTC)")
        return value.astimezone(UTC).replace(tzinfo=None)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the time with its zone."""
        return None if value is None else value.replace(tzinfo=UTC)


class Base(DeclarativeBase):
    """Base class with common metadata; constraints have names for later migrations."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_name)s",
            "uq": "uq_%(table_name)s_%(column_0_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map: ClassVar[dict[Any, Any]] = {
        datetime: UtcDateTime(),
        Document: JSON(),
        list[str]: JSON(),
        list[Document]: JSON(),
    }


class Numbered:
    """Rows with a number that is never reused."""

    __table_args__: tuple[Any, ...] = ({"sqlite_autoincrement": True},)

    id: Mapped[int] = mapped_column(Integer, primary_key=True)


class OfStation:
    """Rows that belong to the station that wrote them; several may share a database."""

    station: Mapped[str] = mapped_column(String(STATION_NAME_LENGTH), index=True, server_default="")


class RunRow(OfStation, Numbered, Base):
    """One run of the loop that a person requested."""

    __tablename__ = "run"

    kind: Mapped[str] = mapped_column(String(40), index=True)
    plant: Mapped[str] = mapped_column(String(NAME_MAX))
    parameters_name: Mapped[str] = mapped_column(String(FILE_NAME_MAX))
    parameters: Mapped[Document]
    settings: Mapped[Document]
    bank_id: Mapped[int | None] = mapped_column(ForeignKey("bank.id"))
    who: Mapped[str] = mapped_column(String(200))
    software: Mapped[str] = mapped_column(String(40))
    started_at: Mapped[datetime] = mapped_column(index=True)
    ended_at: Mapped[datetime | None]
    end_state: Mapped[str] = mapped_column(String(20), index=True)
    end_detail: Mapped[str] = mapped_column(Text)
    note: Mapped[str] = mapped_column(Text)
    evaluation_problem: Mapped[str] = mapped_column(Text)


class RecordingRow(Base):
    """Recording of a run; ``fields`` names the columns of its chunks in order.

    ``size_bytes`` is the size of its chunks; ``removed_at`` the time at which a person deleted them to free space.
    """

    __tablename__ = "recording"

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), primary_key=True, autoincrement=False)
    fields: Mapped[list[str]]
    period_s: Mapped[float] = mapped_column(Float)
    missed: Mapped[int] = mapped_column(BigInteger)
    problem: Mapped[str] = mapped_column(Text)
    size_bytes: Mapped[int] = mapped_column(BigInteger)
    removed_at: Mapped[datetime | None]


class ChunkRow(Base):
    """Up to one second of consecutive samples.

    ``summary`` is read far more often than ``samples``. ``sha256`` is the digest of ``samples`` as recorded, "" for
    chunks from before it was stored.
    """

    __tablename__ = "chunk"

    run_id: Mapped[int] = mapped_column(ForeignKey("recording.run_id"), primary_key=True, autoincrement=False)
    first_tick: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    count: Mapped[int] = mapped_column(Integer)
    summary: Mapped[bytes] = mapped_column(LargeBinary)
    samples: Mapped[bytes] = mapped_column(LargeBinary)
    sha256: Mapped[str] = mapped_column(String(64), server_default="")


class IdentificationRow(OfStation, Numbered, Base):
    """One estimate from data; another estimate adds a row."""

    __tablename__ = "identification"

    run_id: Mapped[int | None] = mapped_column(ForeignKey("run.id"), index=True)
    kind: Mapped[str] = mapped_column(String(40), index=True)
    data: Mapped[Document]
    method: Mapped[str] = mapped_column(String(METHOD_MAX))
    options: Mapped[Document]
    model: Mapped[Document]
    quality: Mapped[Document]
    usable: Mapped[bool]
    verdict: Mapped[str] = mapped_column(Text)
    who: Mapped[str] = mapped_column(String(200))
    software: Mapped[str] = mapped_column(String(40))
    created_at: Mapped[datetime]


class BankRow(OfStation, Numbered, Base):
    """One version of a controller bank; a change adds the next version."""

    __tablename__ = "bank"
    __table_args__ = (UniqueConstraint("station", "name", "version"), *Numbered.__table_args__)

    name: Mapped[str] = mapped_column(String(200))
    version: Mapped[int] = mapped_column(Integer)
    note: Mapped[str] = mapped_column(Text)
    who: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[datetime]


class ExperimentRow(OfStation, Numbered, Base):
    """One version of an own experiment, as its text; a change adds the next version."""

    __tablename__ = "experiment"
    __table_args__ = (UniqueConstraint("station", "name", "version"), *Numbered.__table_args__)

    name: Mapped[str] = mapped_column(String(40))
    version: Mapped[int] = mapped_column(Integer)
    text: Mapped[str] = mapped_column(Text)
    who: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[datetime]


class BankEntryRow(Base):
    """One operating point of a bank with its identification (none if imported)."""

    __tablename__ = "bank_entry"

    bank_id: Mapped[int] = mapped_column(ForeignKey("bank.id"), primary_key=True, autoincrement=False)
    position: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=False)
    identification_id: Mapped[int | None] = mapped_column(ForeignKey("identification.id"), index=True)
    S_nominal: Mapped[float] = mapped_column(Float)
    model: Mapped[Document]


class ResultRow(Numbered, Base):
    """Metrics and criteria computed from a run; another computation adds a row."""

    __tablename__ = "result"

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), index=True)
    metrics: Mapped[Document]
    criteria: Mapped[list[Document]]
    software: Mapped[str] = mapped_column(String(40))
    created_at: Mapped[datetime]


class ReportRow(Numbered, Base):
    """A report as it was issued."""

    __tablename__ = "report"

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), index=True)
    format: Mapped[str] = mapped_column(String(10))
    created_at: Mapped[datetime]
    content: Mapped[bytes] = mapped_column(LargeBinary)


class EventRow(OfStation, Numbered, Base):
    """An event and the person who caused it; ``tick`` is its time in a run."""

    __tablename__ = "event"
    __table_args__ = (Index("ix_event_station_at", "station", "at"), *Numbered.__table_args__)

    at: Mapped[datetime] = mapped_column(index=True)
    kind: Mapped[str] = mapped_column(String(40))
    who: Mapped[str] = mapped_column(String(200))
    text: Mapped[str] = mapped_column(Text)
    run_id: Mapped[int | None] = mapped_column(ForeignKey("run.id"), index=True)
    tick: Mapped[int | None] = mapped_column(BigInteger)
    detail: Mapped[Document]


class RemarkRow(Base):
    """Note and tags of an event; tags are single words separated by spaces."""

    __tablename__ = "event_remark"

    event_id: Mapped[int] = mapped_column(ForeignKey("event.id"), primary_key=True, autoincrement=False)
    note: Mapped[str] = mapped_column(Text)
    tags: Mapped[str] = mapped_column(Text)
    who: Mapped[str] = mapped_column(String(200))
    at: Mapped[datetime]


class FlightRow(Base):
    """The samples around a trip or a trigger, stored with its event."""

    __tablename__ = "flight_record"

    event_id: Mapped[int] = mapped_column(ForeignKey("event.id"), primary_key=True, autoincrement=False)
    fault: Mapped[str] = mapped_column(String(40))
    first_tick: Mapped[int] = mapped_column(BigInteger)
    trip_tick: Mapped[int] = mapped_column(BigInteger)
    count: Mapped[int] = mapped_column(Integer)
    fields: Mapped[list[str]]
    samples: Mapped[bytes] = mapped_column(LargeBinary)


class SettingRow(OfStation, Numbered, Base):
    """One value of a setting; the newest row of a name counts."""

    __tablename__ = "setting"

    name: Mapped[str] = mapped_column(String(200), index=True)
    value: Mapped[Any] = mapped_column(JSON)
    who: Mapped[str] = mapped_column(String(200))
    at: Mapped[datetime]


class BringUpRow(OfStation, Numbered, Base):
    """Result of one commissioning step with one wiring."""

    __tablename__ = "bring_up"

    step: Mapped[str] = mapped_column(String(40), index=True)
    wiring: Mapped[str] = mapped_column(String(FILE_NAME_MAX))
    fingerprint: Mapped[str] = mapped_column(String(64), index=True)
    passed: Mapped[bool]
    text: Mapped[str] = mapped_column(Text)
    figures: Mapped[list[Document]]
    calibrations: Mapped[list[Document]]
    who: Mapped[str] = mapped_column(String(200))
    at: Mapped[datetime]


class OriginRow(Base):
    """Origin of an imported record: its number there, its file, accompanying data."""

    __tablename__ = "origin"

    kind: Mapped[str] = mapped_column(String(20), primary_key=True)
    number: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=False)
    was: Mapped[int] = mapped_column(Integer)
    file: Mapped[str] = mapped_column(Text)
    sha256: Mapped[str] = mapped_column(String(64))
    carried: Mapped[Document]
    who: Mapped[str] = mapped_column(String(200))
    at: Mapped[datetime]


# Index schema --------------------------------------------------------------------------------------
# The tables for the search of runs, derived from the other tables.
#
# They are separate from the runs, whose rows are long: searching 20 000 of these takes some ten milliseconds. Texts are
# casefolded, so that the search ignores case on each kind of database.


TAG_MAX = 40
VALUE_NAME_MAX = 200
"""Longest name of a searchable value; only imported runs can have longer ones."""


class RunIndexRow(Base):
    """Searchable texts of a run; a row of an older ``version`` is renewed.

    ``parameters_sha256`` is the digest of the plant's parameters, ``words`` all texts that a bare word is searched in.
    """

    __tablename__ = "run_index"

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), primary_key=True, autoincrement=False)
    version: Mapped[int] = mapped_column(Integer)
    station: Mapped[str] = mapped_column(String(STATION_NAME_LENGTH))
    kind: Mapped[str] = mapped_column(String(40))
    experiment: Mapped[str] = mapped_column(Text)
    title: Mapped[str] = mapped_column(Text)
    bank_name: Mapped[str] = mapped_column(Text)
    bank: Mapped[str] = mapped_column(Text)
    plant: Mapped[str] = mapped_column(Text)
    parameters: Mapped[str] = mapped_column(Text)
    parameters_sha256: Mapped[str] = mapped_column(String(64))
    who: Mapped[str] = mapped_column(Text)
    started_at: Mapped[datetime]
    lasted_s: Mapped[float | None] = mapped_column(Float)
    end_state: Mapped[str] = mapped_column(String(20))
    outcome: Mapped[str] = mapped_column(String(20))
    note: Mapped[str] = mapped_column(Text)
    words: Mapped[str] = mapped_column(Text)


class ValueNameRow(Base):
    """A name of searchable values; ``source`` is a ``ValueSource``."""

    __tablename__ = "value_name"
    __table_args__ = (UniqueConstraint("source", "name"),)

    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    source: Mapped[str] = mapped_column(String(12))
    name: Mapped[str] = mapped_column(String(VALUE_NAME_MAX))


class RunValueRow(Base):
    """A setting or a metric of a run: a finite number, or a word."""

    __tablename__ = "run_value"
    __table_args__ = (Index("ix_run_value_name_id", "name_id", "value", "run_id"),)

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), primary_key=True, autoincrement=False)
    name_id: Mapped[int] = mapped_column(ForeignKey("value_name.id"), primary_key=True, autoincrement=False)
    value: Mapped[float | None] = mapped_column(Float)
    word: Mapped[str | None] = mapped_column(Text)


class ParameterValueRow(Base):
    """A number of a parameter set, which many runs share."""

    __tablename__ = "parameter_value"
    __table_args__ = (Index("ix_parameter_value_name_id", "name_id", "value"),)

    parameters_sha256: Mapped[str] = mapped_column(String(64), primary_key=True)
    name_id: Mapped[int] = mapped_column(ForeignKey("value_name.id"), primary_key=True, autoincrement=False)
    value: Mapped[float] = mapped_column(Float)


class RunTagRow(Base):
    """A tag of a run, casefolded."""

    __tablename__ = "run_tag"
    __table_args__ = (Index("ix_run_tag_tag", "tag", "run_id"),)

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), primary_key=True, autoincrement=False)
    tag: Mapped[str] = mapped_column(String(TAG_MAX), primary_key=True)


# Records -------------------------------------------------------------------------------------------
# Conversion of rows to the plain dataclasses that leave this package.


Record = TypeVar("Record", bound="DataclassInstance")
Row = TypeVar("Row", bound=Base)


class UnknownRecordError(SinewError, LookupError):
    """There is no such record; the message names it."""

    category = ErrorCode.UNKNOWN


def to_record(record_class: type[Record], row: Base) -> Record:
    """Copy the columns of the same name into a frozen dataclass."""
    return record_class(**{field.name: getattr(row, field.name) for field in fields(record_class)})


def require(session: Session, row_class: type[Row], identifier: int, what: str) -> Row:
    """Return the row with this identifier. Raises UnknownRecordError."""
    row = session.get(row_class, identifier)
    if row is None:
        raise build_unknown_record_error(what, identifier)
    return row


def build_unknown_record_error(what: str, identifier: int) -> UnknownRecordError:
    """Return the error for a record that does not exist; ``what`` names its kind."""
    return UnknownRecordError(messages.record_not_found(record=what, number=identifier))


def require_distinct_name(what: str, name: str, others: Iterable[str]) -> None:
    """Raise RequestRejectedError for a new name that resembles another one.

    Such as "Brief" and "brief".
    """
    folded = fold_name(name)
    for other in others:
        if other != name and fold_name(other) == folded:
            raise RequestRejectedError(
                ErrorCode.BAD_VALUE,
                messages.name_too_similar(record=what, existing=other, name=name),
                code="name_taken",
            )


# Study schema --------------------------------------------------------------------------------------
# The tables of studies: their definition and state, and a row for each computed run.


class StudyRow(OfStation, Numbered, Base):
    """A study. ``text`` and ``base`` determine its points.

    The columns after ``created_at`` describe its current computation: ``begun_at`` and ``begun_with`` are its start and
    the number of points at that time, ``seen_at`` its last sign of life.
    """

    __tablename__ = "study"

    name: Mapped[str] = mapped_column(String(40), index=True)
    title: Mapped[str] = mapped_column(String(100))
    text: Mapped[str] = mapped_column(Text)
    base: Mapped[Document]
    points: Mapped[int] = mapped_column(Integer)
    who: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[datetime]
    runner: Mapped[str] = mapped_column(String(200))
    seen_at: Mapped[datetime | None]
    begun_at: Mapped[datetime | None]
    begun_with: Mapped[int] = mapped_column(Integer)
    stop_asked: Mapped[bool] = mapped_column(Boolean)
    problem: Mapped[str] = mapped_column(Text)


class StudyPointRow(OfStation, Base):
    """A computed run of a study: varied ``values`` and resulting ``figures``, in SI."""

    __tablename__ = "study_point"

    study_id: Mapped[int] = mapped_column(ForeignKey("study.id"), primary_key=True, autoincrement=False)
    number: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=False)
    state: Mapped[str] = mapped_column(String(20))
    detail: Mapped[str] = mapped_column(Text)
    passed: Mapped[bool | None]
    values: Mapped[Document]
    figures: Mapped[Document]


# Changed runs --------------------------------------------------------------------------------------
# Runs whose searchable data a transaction has changed; the index is renewed at its end.


_KEY = "sinew_touched_runs"


def mark_for_reindex(session: Session, *run_ids: int) -> None:
    """Mark runs whose search entries are rewritten before the commit."""
    session.info.setdefault(_KEY, set()).update(run_ids)


def take_touched(session: Session) -> list[int]:
    """Return the marked runs in order, and clear the marks."""
    return sorted(session.info.pop(_KEY, ()))


# Formula schema ------------------------------------------------------------------------------------
# The table of derived signals: each change is a new row, and the newest of a name counts.


class FormulaRow(OfStation, Numbered, Base):
    """A formula from a time on, as written and as ``steps``; ``removed`` ends it."""

    __tablename__ = "formula"

    name: Mapped[str] = mapped_column(String(20), index=True)
    expression: Mapped[str] = mapped_column(Text)
    steps: Mapped[list[Document]]
    unit: Mapped[str] = mapped_column(String(20))
    meaning: Mapped[str] = mapped_column(Text)
    removed: Mapped[bool]
    who: Mapped[str] = mapped_column(String(200))
    at: Mapped[datetime]


# Queue schema --------------------------------------------------------------------------------------
# The table of queued experiments: rows are deleted when their experiment starts.


class QueuedRow(OfStation, Numbered, Base):
    """A queued experiment; ``place`` orders those of a station."""

    __tablename__ = "queued_experiment"

    place: Mapped[int] = mapped_column(Integer)
    name: Mapped[str] = mapped_column(String(100))
    settings: Mapped[Document]
    who: Mapped[str] = mapped_column(String(200))
    added_at: Mapped[datetime]


# Text lengths --------------------------------------------------------------------------------------
# Limits of texts by the lengths of their columns.
#
# PostgreSQL rejects longer texts, SQLite stores them. With this check both reject them before anything is sent.


def require_lengths(table: Any, values: Mapping[str, Any]) -> None:
    """Raise UnfitError for the first text in ``values`` longer than its column."""
    for column in inspect(table).local_table.columns:
        value = values.get(column.name)
        length = column.type.length if isinstance(column.type, String) else None
        if length is not None and isinstance(value, str) and len(value) > length:
            raise UnfitError(messages.text_too_long(column=str(column), text=value, maximum=length))


@event.listens_for(Base, "before_insert", propagate=True)
def _check_new(mapper: Mapper[Any], _connection: object, row: Any) -> None:
    require_lengths(mapper, {column.key: getattr(row, column.key) for column in mapper.column_attrs})


@event.listens_for(Base, "before_update", propagate=True)
def _check_changed(mapper: Mapper[Any], _connection: object, row: Any) -> None:
    """Check changed columns only: rows of earlier versions may have longer texts."""
    changed = (column.key for column in mapper.column_attrs if inspect(row).attrs[column.key].history.has_changes())
    require_lengths(mapper, {key: getattr(row, key) for key in changed})
