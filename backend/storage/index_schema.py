"""The tables that runs are searched by. They say nothing of their own: all of it is derived from the other tables.

Kept apart from the runs themselves, whose rows are long: to look through 20 000 of these takes some ten milliseconds.
Texts are casefolded, so that upper and lower case are one on each kind of database.
"""

from datetime import datetime

from sqlalchemy import Float, ForeignKey, Index, Integer, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from backend.errors import STATION_MAX
from backend.storage.schema import Base

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
    station: Mapped[str] = mapped_column(String(STATION_MAX))
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
