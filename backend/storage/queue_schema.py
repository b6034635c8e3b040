"""The table of the experiments that wait in a queue: rows that go when their experiment has started."""

from datetime import datetime

from sqlalchemy import Integer, String
from sqlalchemy.orm import Mapped, mapped_column

from backend.storage.schema import Base, Document, Numbered, OfStation


class QueuedRow(OfStation, Numbered, Base):
    """An experiment that waits; ``place`` orders those of a station."""

    __tablename__ = "queued_experiment"

    place: Mapped[int] = mapped_column(Integer)
    name: Mapped[str] = mapped_column(String(100))
    settings: Mapped[Document]
    who: Mapped[str] = mapped_column(String(200))
    added_at: Mapped[datetime]
