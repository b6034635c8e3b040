"""The table of derived signals: each change is one more row, and the newest of a name counts."""

from datetime import datetime

from sqlalchemy import String, Text
from sqlalchemy.orm import Mapped, mapped_column

from backend.storage.schema import Base, Document, Numbered, OfStation


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
