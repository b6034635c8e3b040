"""Tables, rows as dataclasses, and the errors of a database."""

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
from plant import FILE_NAME_MAX, NAME_MAX, ErrorCode, SinewError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


# Errors --------------------------------------------------------------------------------------------
#
# What goes wrong with a database, by what can be done about it.


class StorageError(SinewError):
    """The database cannot be reached, read or written, or refuses what breaks its rules; the message is its own."""

    category = ErrorCode.UNAVAILABLE


class UnfitError(StorageError):
    """What was to be stored breaks the database's rules: trying again will not help."""


class GoneError(StorageError):
    """The database's file is not where it was: what is written now would be kept nowhere."""


class DamagedError(StorageError):
    """The database's file is not whole; the message names the way back."""


# Schema --------------------------------------------------------------------------------------------
#
# The tables. Rows stay inside this package: its functions take and return plain dataclasses.
#
# Nothing is overwritten, but by a migration with the same in another form: models, banks, results and
# settings are added as new rows, and every gain can be walked back from ``bank_entry`` over
# ``identification`` to the run, its samples and the parameters it was recorded with.


Document = dict[str, Any]

METHOD_MAX = 200
"""Length of the estimators of both channels of an actuator, each with its noise model and weighting, and to spare."""


class UtcDateTime(TypeDecorator[datetime]):
    """An instant, kept as UTC without zone (SQLite has no zones) and handed out with its zone."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Refuse instants of unknown zone: they would silently shift."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"{value} has no time zone: use datetime.now(UTC)")
        return value.astimezone(UTC).replace(tzinfo=None)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Give the zone back."""
        return None if value is None else value.replace(tzinfo=UTC)


class Base(DeclarativeBase):
    """Common metadata; constraints carry names, so that later migrations can address them."""

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
    """Rows with a number of their own, which is never given out twice."""

    __table_args__: tuple[Any, ...] = ({"sqlite_autoincrement": True},)

    id: Mapped[int] = mapped_column(Integer, primary_key=True)


class OfStation:
    """Rows that belong to the station that wrote them: several may share one database."""

    station: Mapped[str] = mapped_column(String(STATION_NAME_LENGTH), index=True, server_default="")


class RunRow(OfStation, Numbered, Base):
    """One stretch of the loop's life that somebody asked for."""

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
    """What the recorder kept of a run; ``fields`` names the columns of its chunks in order.

    ``size_bytes`` is what its chunks take; ``removed_at`` tells that a person had them deleted to make room.
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
    """Up to one second of consecutive samples; ``summary`` is read far more often than ``samples``.

    ``sha256`` is the digest of ``samples`` as they were recorded, "" of those from before it was kept.
    """

    __tablename__ = "chunk"

    run_id: Mapped[int] = mapped_column(ForeignKey("recording.run_id"), primary_key=True, autoincrement=False)
    first_tick: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    count: Mapped[int] = mapped_column(Integer)
    summary: Mapped[bytes] = mapped_column(LargeBinary)
    samples: Mapped[bytes] = mapped_column(LargeBinary)
    sha256: Mapped[str] = mapped_column(String(64), server_default="")


class IdentificationRow(OfStation, Numbered, Base):
    """One estimate made from data; estimating again adds a row."""

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
    """One version of a controller bank; a change makes the next version of the same name."""

    __tablename__ = "bank"
    __table_args__ = (UniqueConstraint("station", "name", "version"), *Numbered.__table_args__)

    name: Mapped[str] = mapped_column(String(200))
    version: Mapped[int] = mapped_column(Integer)
    note: Mapped[str] = mapped_column(Text)
    who: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[datetime]


class ExperimentRow(OfStation, Numbered, Base):
    """One version of an own experiment, as its text; a change makes the next version of the same name."""

    __tablename__ = "experiment"
    __table_args__ = (UniqueConstraint("station", "name", "version"), *Numbered.__table_args__)

    name: Mapped[str] = mapped_column(String(40))
    version: Mapped[int] = mapped_column(Integer)
    text: Mapped[str] = mapped_column(Text)
    who: Mapped[str] = mapped_column(String(200))
    created_at: Mapped[datetime]


class BankEntryRow(Base):
    """One nominal point of a bank with the identification it came from (none for an imported bank)."""

    __tablename__ = "bank_entry"

    bank_id: Mapped[int] = mapped_column(ForeignKey("bank.id"), primary_key=True, autoincrement=False)
    position: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=False)
    identification_id: Mapped[int | None] = mapped_column(ForeignKey("identification.id"), index=True)
    S_nominal: Mapped[float] = mapped_column(Float)
    model: Mapped[Document]


class ResultRow(Numbered, Base):
    """Metrics and criteria computed from a run; computing again adds a row."""

    __tablename__ = "result"

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), index=True)
    metrics: Mapped[Document]
    criteria: Mapped[list[Document]]
    software: Mapped[str] = mapped_column(String(40))
    created_at: Mapped[datetime]


class ReportRow(Numbered, Base):
    """A report as it was handed out."""

    __tablename__ = "report"

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), index=True)
    format: Mapped[str] = mapped_column(String(10))
    created_at: Mapped[datetime]
    content: Mapped[bytes] = mapped_column(LargeBinary)


class EventRow(OfStation, Numbered, Base):
    """What happened and who asked for it; ``tick`` places it on the time axis of a run."""

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
    """What a person says of an event: a note, and tags as single words between blanks."""

    __tablename__ = "event_remark"

    event_id: Mapped[int] = mapped_column(ForeignKey("event.id"), primary_key=True, autoincrement=False)
    note: Mapped[str] = mapped_column(Text)
    tags: Mapped[str] = mapped_column(Text)
    who: Mapped[str] = mapped_column(String(200))
    at: Mapped[datetime]


class FlightRow(Base):
    """The samples around a trip or a trigger, kept with its event."""

    __tablename__ = "flight_record"

    event_id: Mapped[int] = mapped_column(ForeignKey("event.id"), primary_key=True, autoincrement=False)
    fault: Mapped[str] = mapped_column(String(40))
    first_tick: Mapped[int] = mapped_column(BigInteger)
    trip_tick: Mapped[int] = mapped_column(BigInteger)
    count: Mapped[int] = mapped_column(Integer)
    fields: Mapped[list[str]]
    samples: Mapped[bytes] = mapped_column(LargeBinary)


class SettingRow(OfStation, Numbered, Base):
    """One value that a setting had; the newest row of a name counts."""

    __tablename__ = "setting"

    name: Mapped[str] = mapped_column(String(200), index=True)
    value: Mapped[Any] = mapped_column(JSON)
    who: Mapped[str] = mapped_column(String(200))
    at: Mapped[datetime]


class BringUpRow(OfStation, Numbered, Base):
    """What one step of bringing a rig up came to, with one wiring."""

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
    """Where a record was imported from: its number there, the file with its digest, and what came with it."""

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
#
# The tables that runs are searched by. They say nothing of their own: all of it is derived from the
# other tables.
#
# Kept apart from the runs themselves, whose rows are long: to look through 20 000 of these takes
# some ten milliseconds. Texts are casefolded, so that upper and lower case are one on each kind of
# database.


TAG_MAX = 40
VALUE_NAME_MAX = 200
"""A value with a longer name, which only a run imported from elsewhere can have, is not searched by."""


class RunIndexRow(Base):
    """What is asked of a run in words. ``version`` is that of the code that wrote the row: an older one is renewed.

    ``parameters_sha256`` is the digest of the plant's parameters, ``words`` all that a bare word is looked for in.
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
    """A name that values are found by: ``source`` says of what, a ``ValueSource``."""

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
    """A number of a set of parameters, which many runs have in common."""

    __tablename__ = "parameter_value"
    __table_args__ = (Index("ix_parameter_value_name_id", "name_id", "value"),)

    parameters_sha256: Mapped[str] = mapped_column(String(64), primary_key=True)
    name_id: Mapped[int] = mapped_column(ForeignKey("value_name.id"), primary_key=True, autoincrement=False)
    value: Mapped[float] = mapped_column(Float)


class RunTagRow(Base):
    """A tag that somebody put on a run; kept casefolded."""

    __tablename__ = "run_tag"
    __table_args__ = (Index("ix_run_tag_tag", "tag", "run_id"),)

    run_id: Mapped[int] = mapped_column(ForeignKey("run.id"), primary_key=True, autoincrement=False)
    tag: Mapped[str] = mapped_column(String(TAG_MAX), primary_key=True)


# Records -------------------------------------------------------------------------------------------
#
# Turn rows into the plain dataclasses that leave this package.


Record = TypeVar("Record", bound="DataclassInstance")
Row = TypeVar("Row", bound=Base)


class UnknownRecordError(SinewError, LookupError):
    """There is no such record; the message says which was asked for."""

    category = ErrorCode.UNKNOWN


def to_record(record_class: type[Record], row: Base) -> Record:
    """Copy the columns of the same name into a frozen dataclass."""
    return record_class(**{field.name: getattr(row, field.name) for field in fields(record_class)})


def require(session: Session, row_class: type[Row], identifier: int, what: str) -> Row:
    """Load the row with this identifier. Raises UnknownRecordError."""
    row = session.get(row_class, identifier)
    if row is None:
        raise UnknownRecordError(f"there is no {what} {identifier}")
    return row


def require_distinct_name(what: str, name: str, others: Iterable[str]) -> None:
    """Raise RequestRejectedError for a new name that people take for one of the others: "Brief" beside "brief"."""
    folded = fold_name(name)
    for other in others:
        if other != name and fold_name(other) == folded:
            raise RequestRejectedError(
                ErrorCode.BAD_VALUE,
                f"there is {what} {other!r} already, which reads like {name!r}: write that name, or choose another one",
                code="name_taken",
            )


# Study schema --------------------------------------------------------------------------------------
#
# The tables of studies: what one asks for and how it stands, and a row for each run that it has
# computed.


class StudyRow(OfStation, Numbered, Base):
    """A study. ``text`` and ``base`` decide its points; what follows ``created_at`` is of who computes it at present.

    ``begun_at`` and ``begun_with`` tell when that was begun, with how many points there already; ``seen_at`` when it
    was last heard of.
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
    """A computed run of a study; ``values`` are what was varied, ``figures`` what came of it, in SI."""

    __tablename__ = "study_point"

    study_id: Mapped[int] = mapped_column(ForeignKey("study.id"), primary_key=True, autoincrement=False)
    number: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=False)
    state: Mapped[str] = mapped_column(String(20))
    detail: Mapped[str] = mapped_column(Text)
    passed: Mapped[bool | None]
    values: Mapped[Document]
    figures: Mapped[Document]


# Touched -------------------------------------------------------------------------------------------
#
# Which runs a transaction has changed something of that they are searched by; the index is renewed
# at its end.


_KEY = "sinew_touched_runs"


def mark_for_reindex(session: Session, *run_ids: int) -> None:
    """Have what these runs are searched by written anew before the transaction is committed."""
    session.info.setdefault(_KEY, set()).update(run_ids)


def take_touched(session: Session) -> list[int]:
    """Return the runs that were touched, in order, and begin anew."""
    return sorted(session.info.pop(_KEY, ()))


# Formula schema ------------------------------------------------------------------------------------
#
# The table of derived signals: each change is one more row, and the newest of a name counts.


class FormulaRow(OfStation, Numbered, Base):
    """What a formula of this name was from a time on, as written and as ``steps``; ``removed`` ends it."""

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
#
# The table of the experiments that wait in a queue: rows that go when their experiment has started.


class QueuedRow(OfStation, Numbered, Base):
    """An experiment that waits; ``place`` orders those of a station."""

    __tablename__ = "queued_experiment"

    place: Mapped[int] = mapped_column(Integer)
    name: Mapped[str] = mapped_column(String(100))
    settings: Mapped[Document]
    who: Mapped[str] = mapped_column(String(200))
    added_at: Mapped[datetime]


# Lengths -------------------------------------------------------------------------------------------
#
# No row is written with a text that is longer than its column.
#
# PostgreSQL refuses such a text, SQLite stores it. Checked here, both refuse it, before anything is
# sent.


def require_lengths(table: Any, values: Mapping[str, Any]) -> None:
    """Raise UnfitError for the first of ``values``, by column, that is a text longer than its column of ``table``."""
    for column in inspect(table).local_table.columns:
        value = values.get(column.name)
        length = column.type.length if isinstance(column.type, String) else None
        if length is not None and isinstance(value, str) and len(value) > length:
            raise UnfitError(
                f"{column} cannot be {value[:40]!r}...: the text has {len(value)} characters, "
                f"{length} are the most: shorten it"
            )


@event.listens_for(Base, "before_insert", propagate=True)
def _check_new(mapper: Mapper[Any], _connection: object, row: Any) -> None:
    require_lengths(mapper, {column.key: getattr(row, column.key) for column in mapper.column_attrs})


@event.listens_for(Base, "before_update", propagate=True)
def _check_changed(mapper: Mapper[Any], _connection: object, row: Any) -> None:
    """Check what changes: a row that an earlier version wrote may hold a longer text elsewhere."""
    changed = (column.key for column in mapper.column_attrs if inspect(row).attrs[column.key].history.has_changes())
    require_lengths(mapper, {key: getattr(row, key) for key in changed})
