"""One database: SQLite in the data folder, or whatever SQLAlchemy URL is given."""

import json
import logging
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal

from sqlalchemy import URL, Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DataError, IntegrityError, SQLAlchemyError
from sqlalchemy.orm import Session

from backend import __version__
from backend.data_folder import make_private
from backend.storage import run_index
from backend.storage.claims import claimed_by
from backend.storage.errors import DamagedError, StorageError, UnfitError
from backend.storage.maintenance import backup, is_cut_short
from backend.storage.migrate import (
    OutdatedError,
    SchemaError,
    can_read,
    is_outdated,
    newest_revision,
    revision,
    upgrade,
)
from backend.storage.soundness import (
    Identity,
    file_of,
    identity,
    quick_check,
    require_in_place,
    require_usable,
    way_back,
)
from backend.storage.stations import info_of
from backend.storage.touched import take_touched

__all__ = ["Database", "Session", "StorageError", "connect", "open_database", "sqlite_url"]

FILE_NAME = "sinew.db"
_log = logging.getLogger(__name__)


class Database:
    """An engine and its transactions. Functions of this package take the ``Session`` that these hand out.

    ``file`` is that of an SQLite database, None for any other; ``opened`` tells it from one put in its place.
    ``station`` is whose rows are written and, where they are a station's own, read.
    """

    def __init__(self, engine: Engine, opened: Identity | None = None, station: str = "") -> None:
        self.engine = engine
        self.station = station
        self.file = file_of(engine)
        self._opened = opened or (identity(self.file) if self.file else None)
        # SQLite's snapshots are one by nature; the servers' default would show later commits midway.
        isolation = {} if engine.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}
        self._reading_engine = engine.execution_options(sinew_reading=True, **isolation)

    @contextmanager
    def session(self) -> Iterator[Session]:
        """One writing transaction: committed at the end of the block, rolled back whole on any exception.

        On SQLite it takes the write lock at once (waiting up to 5 s): a transaction that first reads and then writes
        would otherwise fail without waiting when another one wrote in between. Raises StorageError; GoneError when
        the file was deleted or replaced, as SQLite would go on writing to where nobody finds it.
        """
        self.require_in_place()
        told = info_of(self.station)
        with _told(), Session(self.engine, expire_on_commit=False, info=told) as session, session.begin():
            yield session
            run_index.update(session, take_touched(session))

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """One consistent snapshot to read from; waits for no writer and delays none. Raises StorageError."""
        with _told(), Session(self._reading_engine, info=info_of(self.station)) as session:
            yield session

    def require_in_place(self) -> None:
        """Raise GoneError unless the database's file is still the one that was opened."""
        if self.file is not None and self._opened is not None:
            require_in_place(self.file, self._opened)

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    def __reduce__(self) -> tuple[Any, ...]:
        """Let another process work on the same database, with connections of its own."""
        return _reopened, (self.engine.url, self._opened, self.station)


Outdated = Literal["migrate", "refuse", "read"]
"""What to do with a database of an earlier schema; ``read`` opens it as it is, where this version can read it."""


def open_database(
    data_dir: Path,
    url: str | None = None,
    password: str | None = None,
    station: str = "",
    *,
    outdated: Outdated = "migrate",
) -> Database:
    """Create the data folder and the database where missing, migrate to the newest schema, and open it.

    Before an SQLite database of an earlier schema is migrated, a copy goes to ``data_dir/backups``. No database is
    migrated while a service works on it. Raises ``OutdatedError`` where ``outdated`` does not let it be migrated.
    ``url`` is an SQLAlchemy URL that replaces ``data_dir/sinew.db``, ``password`` goes into it. Raises ``SchemaError``
    when the database was written by a newer version, ``StorageError`` when it cannot be reached, ``DamagedError`` when
    the file was emptied or is none of SQLite's, ``BackupError``.
    """
    _require_writable(data_dir)
    engine = connect(url or sqlite_url(data_dir), password)
    file, backups = file_of(engine), data_dir / "backups"
    try:
        with _told():
            if file is not None:
                _require_no_restore(file)
                if not require_usable(file, backups):
                    _create(file)
            if is_outdated(engine):
                if outdated == "read" and can_read(engine):
                    return Database(engine, station=station)
                _require_migratable(engine, data_dir, outdated)
                if engine.dialect.name == "sqlite":
                    backup(engine, backups / f"{revision(engine)}-{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db")
            upgrade(engine)
        for sentence in make_private(data_dir):  # the file that was made just now
            _log.warning("%s", sentence)
        database = Database(engine, station=station)
        _renew_index(database)
        return database
    except DamagedError:
        engine.dispose()
        raise
    except StorageError as error:
        engine.dispose()
        if file is None:
            raise
        hint = f"; {way_back(file, backups)}" if _is_none_of_sqlites(error) else ""
        raise StorageError(f"{file}: {error}{hint}") from error
    except BaseException:
        engine.dispose()
        raise


def _require_no_restore(file: Path) -> None:
    """Raise StorageError while a restore is under way, or was killed and nobody could complete it yet."""
    if is_cut_short(file):
        raise StorageError("a restore is under way, or was killed while a service works on the folder: try it again")


def _require_migratable(engine: Engine, data_dir: Path, outdated: Outdated) -> None:
    """Raise SchemaError while a service works on the database, OutdatedError where it is not to be migrated."""
    found = f"the database has schema {revision(engine)}, version {__version__} works with {newest_revision()}"
    if by := claimed_by(engine):
        raise SchemaError(
            f"{by} works on this database and {found}: stop that service first, or use the commands of its version"
        )
    if outdated != "migrate":
        raise OutdatedError(
            f"{found}: `sinew db upgrade --data {data_dir}` migrates it and keeps a copy of it as it is"
        )


def _require_writable(data_dir: Path) -> None:
    """Create the data folder where it is missing. Raises StorageError where nothing can be written into it."""
    try:
        make_private(data_dir)
        writable = os.access(data_dir, os.W_OK | os.X_OK, effective_ids=True)
        refused = "" if writable else "it is read-only for this account"
    except OSError as error:
        refused = str(error.strerror or error)
    if refused:
        raise StorageError(
            f"the data folder {data_dir} cannot be written: {refused}. Reading from it takes writing too: change its "
            "owner or mode, mount it for writing, or copy it and name the copy with --data"
        )


def _renew_index(database: Database) -> None:
    """Bring what runs are searched by up to date: after a migration, or with a newer version."""
    try:
        with database.reading() as session:
            behind = run_index.is_behind(session)
        while behind:
            with database.session() as session:
                behind = run_index.renew(session) > 0
    except StorageError as error:  # of a damaged file as much is opened as can be read
        _log.warning("not all runs can be searched for: %s", error)


def require_whole(database: Database, data_dir: Path) -> None:
    """Read all of an SQLite database. Raises DamagedError, with the way back, where its pages do not fit together."""
    if database.file is not None:
        quick_check(database.file, data_dir / "backups")


def _is_none_of_sqlites(error: StorageError) -> bool:
    cause = getattr(error.__cause__, "orig", None)
    return isinstance(cause, sqlite3.DatabaseError) and not isinstance(cause, sqlite3.OperationalError)


def _create(file: Path) -> None:
    """Make an empty database under another name and give it its own only when it is whole.

    So an empty file is never one that a start cut short has left behind.
    """
    fresh = file.with_name(f"{file.name}.{os.getpid()}.creating")
    leftovers = [fresh, *(fresh.with_name(fresh.name + end) for end in ("-wal", "-shm"))]
    for leftover in leftovers:
        leftover.unlink(missing_ok=True)
    engine = connect(_url_of(fresh))
    try:
        upgrade(engine)
        engine.dispose()
        with suppress(FileExistsError):  # another command was quicker
            os.link(fresh, file)
    except PermissionError:  # a file system without hard links
        os.rename(fresh, file)
    finally:
        engine.dispose()
        for leftover in leftovers:
            leftover.unlink(missing_ok=True)


def _reopened(url: URL, opened: Identity | None, station: str) -> Database:
    return Database(connect(url), opened, station)


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except (IntegrityError, DataError) as error:
        raise UnfitError(str(error.orig or error)) from error
    except SQLAlchemyError as error:
        # The driver's sentence; SQLAlchemy's own carries the statement with all its values.
        raise StorageError(str(getattr(error, "orig", None) or error)) from error


def sqlite_url(data_dir: Path) -> URL:
    """SQLAlchemy URL of the database file in a data folder."""
    return _url_of((data_dir / FILE_NAME).resolve())


def database_file(data_dir: Path, url: str | None = None) -> Path | None:
    """Return the file of the SQLite database that a data folder or a URL names; None for any other database."""
    if url is None:
        return (data_dir / FILE_NAME).resolve()
    engine = connect(url)
    found = file_of(engine)
    engine.dispose()
    return None if found is None else found.resolve()


def _url_of(file: Path) -> URL:
    """Return the URL of a file whose path may hold what means something in the text of a URL, such as a ?."""
    return URL.create("sqlite", database=str(file))


def connect(url: str | URL, password: str | None = None) -> Engine:
    """Engine for ``url``; documents with nan or infinity are refused, as JSON has no such numbers.

    Raises StorageError when nothing can be made of the URL; the message does not carry it, as it may hold a password.
    """
    try:
        parsed = make_url(url)
        if password is not None:
            parsed = parsed.set(password=password)
        engine = create_engine(parsed, json_serializer=partial(json.dumps, allow_nan=False, ensure_ascii=False))
    except ModuleNotFoundError as error:
        raise StorageError(
            f"SINEW_DATABASE_URL needs the Python package {error.name}, which is not installed"
        ) from None
    except (ArgumentError, ValueError) as error:
        raise StorageError(
            f"SINEW_DATABASE_URL is no address of a database: {error}; "
            "write it as postgresql+psycopg://user@host:port/database"
        ) from None
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
