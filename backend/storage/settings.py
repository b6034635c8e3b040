"""Settings kept in the database (active bank, layouts ...): the newest value counts, earlier ones stay."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from backend.storage.records import to_record
from backend.storage.schema import SettingRow


@dataclass(frozen=True)
class StoredSetting:
    """One value a setting had, who chose it and when."""

    name: str
    value: Any
    who: str
    at: datetime


def put(session: Session, name: str, value: Any, who: str) -> StoredSetting:
    """Give a setting a new value (anything JSON can say)."""
    row = SettingRow(name=name, value=value, who=who, at=datetime.now(UTC))
    session.add(row)
    session.flush()
    return to_record(StoredSetting, row)


def newest(session: Session, name: str) -> StoredSetting | None:
    """Return the value in force, None when it was never set."""
    row = session.scalar(select(SettingRow).where(SettingRow.name == name).order_by(SettingRow.id.desc()).limit(1))
    return None if row is None else to_record(StoredSetting, row)


def history(session: Session, name: str) -> list[StoredSetting]:
    """Return all values the setting had, newest first."""
    query = select(SettingRow).where(SettingRow.name == name).order_by(SettingRow.id.desc())
    return [to_record(StoredSetting, row) for row in session.scalars(query)]
