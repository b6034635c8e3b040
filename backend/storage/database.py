"""One database: SQLite in the data folder, or whatever SQLAlchemy URL is given."""

import json
import logging
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from backend.private import make_private
from backend.storage.maintenance import backup
from backend.storage.migrate import is_outdated, revision, upgrade

__all__ = ["Database", "Session", "StorageError", "connect", "open_database", "sqlite_url"]

FILE_NAME = "sinew.db"
_log = logging.getLogger(__name__)


class StorageError(Exception):
    """The database cannot be reached, read or written, or refuses what breaks its rules; the message is its own."""


class Database:
    """An engine and its transactions. Functions of this package take the ``Session`` that these hand out."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        # SQLite's snapshots are one by nature; the servers' default would show later commits midway.
        isolation = {} if engine.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}
        self._reading_engine = engine.execution_options(sinew_reading=True, **isolation)

    @contextmanager
    def session(self) -> Iterator[Session]:
        """One writing transaction: committed at the end of the block, rolled back whole on any exception.

        On SQLite it takes the write lock at once (waiting up to 5 s): a transaction that first reads and then writes
        would otherwise fail without waiting when another one wrote in between. Raises StorageError.
        """
        with _told(), Session(self.engine, expire_on_commit=False) as session, session.begin():
            yield session

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """One consistent snapshot to read from; waits for no writer and delays none. Raises StorageError."""
        with _told(), Session(self._reading_engine) as session:
            yield session

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    def __reduce__(self) -> tuple[Any, ...]:
        """Let another process work on the same database, with connections of its own."""
        return _reopened, (self.engine.url.render_as_string(hide_password=False),)


def open_database(data_dir: Path, url: str | None = None) -> Database:
    """Create the data folder and the database where missing, migrate to the newest schema, and open it.

    Before an SQLite database of an earlier schema is migrated, a copy goes to ``data_dir/backups``.
    ``url`` is an SQLAlchemy URL that replaces ``data_dir/sinew.db``. Raises ``SchemaError`` when the database was
    written by a newer version, ``StorageError`` when it cannot be reached, ``BackupError``.
    """
    make_private(data_dir)
    engine = connect(url or sqlite_url(data_dir))
    try:
        with _told():
            if is_outdated(engine) and engine.dialect.name == "sqlite":
                backup(engine, data_dir / "backups" / f"{revision(engine)}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.db")
            upgrade(engine)
        for sentence in make_private(data_dir):  # the file that was made just now
            _log.warning("%s", sentence)
    except BaseException:
        engine.dispose()
        raise
    return Database(engine)


def _reopened(url: str) -> Database:
    return Database(connect(url))


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except SQLAlchemyError as error:
        # The driver's sentence; SQLAlchemy's own carries the statement with all its values.
        raise StorageError(str(getattr(error, "orig", None) or error)) from error


def sqlite_url(data_dir: Path) -> str:
    """SQLAlchemy URL of the database file in a data folder."""
    return f"sqlite:///{(data_dir / FILE_NAME).resolve()}"


def connect(url: str) -> Engine:
    """Engine for ``url``; documents with nan or infinity are refused, as JSON has no such numbers."""
    engine = create_engine(url, json_serializer=partial(json.dumps, allow_nan=False, ensure_ascii=False))
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _prepare_sqlite(connection: sqlite3.Connection, _record: Any) -> None:
    # Transactions begin where _begin_sqlite says so: the driver on its own begins them late and commits before DDL.
    connection.isolation_level = None
    connection.execute("PRAGMA busy_timeout=5000")
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=FULL")
    connection.execute("PRAGMA foreign_keys=ON")


def _begin_sqlite(connection: Connection) -> None:
    reading = connection.get_execution_options().get("sinew_reading", False)
    connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")
