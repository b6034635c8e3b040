"""Stations on one database, and the assignment of rows without a station."""

import hashlib
from contextlib import suppress

from sqlalchemy import Connection, Engine, func, select, text, update
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from backend.errors import RequestRejectedError
from backend.storage import messages
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
# Assignment of a database without stations to one, when a second rig joins it.


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
    """Assign all rows without a station to this one; return the number of runs.

    Raises RequestRejectedError if it has rows already. The search index is renewed at the next opening.
    """
    for table in _TABLES:
        taken = session.scalar(select(func.count()).select_from(table).where(table.station == station))
        if taken:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                messages.station_has_rows(station=station, rows=taken, table=table.__tablename__),
            )
    runs = session.scalar(select(func.count()).select_from(RunRow).where(RunRow.station == "")) or 0
    for table in _TABLES:
        session.execute(update(table).where(table.station == "").values(station=station))
    session.execute(update(RunIndexRow).where(RunIndexRow.station == "").values(station=station, version=0))
    return runs


# Stations ------------------------------------------------------------------------------------------
# Several rigs on one database, each a station with a name and its own data.
#
# A ``Database`` passes its station to each of its sessions. Written rows contain it; settings, banks, identifications,
# experiments, events, commissioning results and retention are limited to their station. Runs of all stations can be
# read by number.


_KEY = "sinew_station"


class StationTakenError(RequestRejectedError):
    """Another service uses this database under the same name."""

    def __init__(self, station: str, by: str = "another service") -> None:
        super().__init__(ErrorCode.NOT_NOW, messages.station_taken(service=by, station=station))


def make_session_info(station: str) -> dict[str, str]:
    """Return the session info that names its station."""
    return {_KEY: station}


def session_station(session: Session) -> str:
    """Return the station of a session."""
    return str(session.info.get(_KEY, ""))


class HeldStation:
    """Exclusive use of a station by this service, for a server with many stations.

    The lock is the server's own: it ends with the connection, so a killed service blocks nobody.
    ``backend.storage.claims`` has the claim that works in every database. Raises StationTakenError.
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

    def release(self) -> None:
        """Release the station."""
        if self._connection is not None:
            with suppress(DBAPIError):  # of a closed connection, whose lock is gone
                self._connection.execute(text("SELECT pg_advisory_unlock_all()"))
            self._connection.invalidate()  # the server notices the end of a connection a moment later
            self._connection.close()
            self._connection = None


def one_at_a_time(connection: Connection, what: str) -> None:
    """Wait until no other transaction of the database server does ``what``.

    Holds the lock until the end of this transaction.
    """
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _key("sinew", what)})


def _key(*words: str) -> int:
    digest = hashlib.sha256("\0".join(words).encode()).digest()
    return int.from_bytes(digest[:8], "big", signed=True)
