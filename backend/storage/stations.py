"""Stations on one database, and how rows without a station get one."""

import hashlib
from contextlib import suppress

from sqlalchemy import Connection, Engine, func, select, text, update
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from backend.errors import RequestRejectedError
from backend.storage.orm import (
    BankRow,
    BringUpRow,
    EventRow,
    ExperimentRow,
    FormulaRow,
    IdentificationRow,
    QueuedRow,
    RunIndexRow,
    RunRow,
    SettingRow,
    StudyPointRow,
    StudyRow,
)
from plant import ErrorCode

# Station names -------------------------------------------------------------------------------------
#
# Give what a database without stations holds to one: for the day on which a second rig joins it.


_TABLES = (
    RunRow,
    IdentificationRow,
    BankRow,
    ExperimentRow,
    EventRow,
    SettingRow,
    BringUpRow,
    StudyRow,
    StudyPointRow,
    QueuedRow,
    FormulaRow,
)


def assign_unowned_rows(session: Session, station: str) -> int:
    """Give all rows that are of no station to this one; return how many runs.

    Raises RequestRejectedError where it has any. What runs are searched by is renewed at the next opening.
    """
    for table in _TABLES:
        taken = session.scalar(select(func.count()).select_from(table).where(table.station == station))
        if taken:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                f"station {station} has {taken} rows of table {table.__tablename__} already: choose a name that is new",
            )
    runs = session.scalar(select(func.count()).select_from(RunRow).where(RunRow.station == "")) or 0
    for table in _TABLES:
        session.execute(update(table).where(table.station == "").values(station=station))
    session.execute(update(RunIndexRow).where(RunIndexRow.station == "").values(station=station, version=0))
    return runs


# Stations ------------------------------------------------------------------------------------------
#
# Several rigs on one database, each a station with a name: what a station wrote is its own.
#
# A ``Database`` knows its station and tells it to each of its sessions. What is written carries it;
# settings, banks, identifications, experiments, events, steps of the bring-up and what keeps house
# see those of their station only. By its number every run can be read, whoever made it.


_KEY = "sinew_station"


class StationTakenError(RequestRejectedError):
    """Another service works on this database under the same name."""

    def __init__(self, station: str, by: str = "another service") -> None:
        named = f"as station {station}" if station else "without a station"
        super().__init__(
            ErrorCode.NOT_NOW,
            f"{by} works on this database {named}: end it, or give this one its own name with --station",
        )


def make_session_info(station: str) -> dict[str, str]:
    """Return the session info that names its station."""
    return {_KEY: station}


def session_station(session: Session) -> str:
    """Return the station that a session works for."""
    return str(session.info.get(_KEY, ""))


class HeldStation:
    """That this service alone works for its station, as long as it is held; for a server of many stations.

    The lock is the server's own: it is let go with the connection, so that a service that was killed is in nobody's
    way. ``backend.storage.claims`` has the claim that every database knows. Raises StationTakenError.
    """

    def __init__(self, engine: Engine, station: str) -> None:
        self._connection: Connection | None = None
        if engine.dialect.name != "postgresql":
            return
        connection = engine.connect().execution_options(isolation_level="AUTOCOMMIT")
        taken = connection.scalar(text("SELECT pg_try_advisory_lock(:key)"), {"key": _key("station", station)})
        if not taken:
            connection.close()
            raise StationTakenError(station)
        self._connection = connection

    def let_go(self) -> None:
        """Let another service work for the station."""
        if self._connection is not None:
            with suppress(DBAPIError):  # of a connection that is gone, and the lock with it
                self._connection.execute(text("SELECT pg_advisory_unlock_all()"))
            self._connection.invalidate()  # the server sees the end of a connection a moment later
            self._connection.close()
            self._connection = None


def one_at_a_time(connection: Connection, what: str) -> None:
    """Wait until no other transaction of the database server does the same; up to the end of this one."""
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _key("sinew", what)})


def _key(*words: str) -> int:
    digest = hashlib.sha256("\0".join(words).encode()).digest()
    return int.from_bytes(digest[:8], "big", signed=True)
