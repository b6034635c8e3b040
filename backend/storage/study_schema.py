"""The tables of studies: what one asks for and how it stands, and a row for each run that it has computed."""

from datetime import datetime

from sqlalchemy import Boolean, ForeignKey, Integer, String, Text
from sqlalchemy.orm import Mapped, mapped_column

from backend.storage.schema import Base, Document, Numbered, OfStation


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
