"""Settings of a station (active bank, layouts ...); the newest value counts.

Earlier values remain.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from backend.storage.orm import SettingRow, to_record
from backend.storage.stations import session_station


@dataclass(frozen=True)
class StoredSetting:
    """One value of a setting, with its author and time."""

    name: str
    value: Any
    who: str
    at: datetime


def save(session: Session, name: str, value: Any, who: str) -> StoredSetting:
    """Save a new value of a setting, of any JSON type."""
    row = SettingRow(name=name, value=value, who=who, at=datetime.now(UTC), station=session_station(session))
    session.add(row)
    session.flush()
    return to_record(StoredSetting, row)


def newest(session: Session, name: str) -> StoredSetting | None:
    """Return the current value, None if it was never set."""
    row = session.scalar(_select_setting(session, name).limit(1))
    return None if row is None else to_record(StoredSetting, row)


def history(session: Session, name: str) -> list[StoredSetting]:
    """Return all values of the setting, newest first."""
    return [to_record(StoredSetting, row) for row in session.scalars(_select_setting(session, name))]


def newest_under(session: Session, prefix: str) -> list[StoredSetting]:
    """Return the current values of all settings with a name prefix, by name."""
    of_station = (SettingRow.station == session_station(session), SettingRow.name.startswith(prefix, autoescape=True))
    last = select(func.max(SettingRow.id)).where(*of_station).group_by(SettingRow.name)
    rows = session.scalars(select(SettingRow).where(SettingRow.id.in_(last)).order_by(SettingRow.name))
    return [to_record(StoredSetting, row) for row in rows]


def _select_setting(session: Session, name: str) -> Select[SettingRow]:
    of_station = SettingRow.station == session_station(session)
    return select(SettingRow).where(SettingRow.name == name, of_station).order_by(SettingRow.id.desc())
