"""The tables. Rows stay inside this package: its functions take and return plain dataclasses.

Nothing is overwritten: models, banks, results and settings are added as new rows, and every gain can be walked back
from ``bank_entry`` over ``identification`` to the run, its samples and the parameters it was recorded with.
"""

from datetime import UTC, datetime
from typing import Any, ClassVar

from sqlalchemy import (
    JSON,
    BigInteger,
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
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from backend.errors import STATION_MAX
from plant.interface import FILE_NAME_MAX, NAME_MAX

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

    station: Mapped[str] = mapped_column(String(STATION_MAX), index=True, server_default="")


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
