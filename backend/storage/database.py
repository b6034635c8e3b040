"""Database: SQLite in the data folder or a URL.

Schema versions, copies, integrity.
"""

import io
import json
import logging
import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, inspect, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DatabaseError, DataError, IntegrityError, SQLAlchemyError
from sqlalchemy.orm import Session

import migrations
from backend import __version__
from backend.data_folder import FILE_MODE, FOLDER_MODE, make_private
from backend.storage import search_index
from backend.storage.claims import describe_claim
from backend.storage.orm import DamagedError, GoneError, StorageError, UnfitError, take_touched
from backend.storage.stations import make_session_info, one_at_a_time
from plant import ErrorCode, SinewError

if TYPE_CHECKING:
    from alembic.config import Config


# Migrate -------------------------------------------------------------------------------------------
# Schema versions: migration of a database to the newest, and its current revision.
#
# Alembic is imported only for a migration: a start on a database of this version needs none of it.


SCRIPTS = Path(migrations.__file__).parent
PRESENT_DOCUMENTS = "0016_current_documents"
"""Revision from which on stored documents have the form that this version reads."""


class SchemaError(SinewError):
    """The schema of the database is not supported; the message says what to do."""

    category = ErrorCode.UNAVAILABLE


class OutdatedError(SchemaError):
    """The database has an earlier schema, and the caller must not migrate it."""


def is_outdated(engine: Engine) -> bool:
    """Return whether the database has an earlier schema than the newest.

    Raises SchemaError for a later one.
    """
    found = read_revision(engine)
    if found is None or found == newest_revision():
        return False
    if found not in _revisions():
        raise SchemaError(
            f"the database has schema {found}, this version supports up to {newest_revision()}: "
            "it was written by a newer version; install that one, or choose another data folder"
        )
    return True


def can_read(engine: Engine) -> bool:
    """Return whether this version reads a database of an earlier schema unchanged.

    It must have every table and column that is read, and documents of the current form.
    """
    if (read_revision(engine) or "") < PRESENT_DOCUMENTS:
        return False
    from backend.storage.orm import Base, FormulaRow, QueuedRow, RunIndexRow, StudyRow

    # their tables count too
    assert all(row.metadata is Base.metadata for row in (RunIndexRow, QueuedRow, StudyRow, FormulaRow))
    found = inspect(engine)
    there = set(found.get_table_names())
    return all(
        table.name in there
        and {column.name for column in table.columns} <= {c["name"] for c in found.get_columns(table.name)}
        for table in Base.metadata.tables.values()
    )


def upgrade(engine: Engine) -> None:
    """Migrate to the newest schema in one transaction: completely or not at all."""
    if read_revision(engine) == newest_revision():
        return
    from alembic import command

    with engine.connect() as connection, _free_to_rebuild_tables(connection), connection.begin():
        one_at_a_time(connection, "migration")
        command.upgrade(_configuration(connection), "head")
        broken = broken_references(connection)
        if broken:
            raise SchemaError(f"the migration would break references in {', '.join(broken)}: nothing was changed")


def read_revision(engine: Engine) -> str | None:
    """Return the schema revision of the database, None if it is empty.

    Raises SchemaError.
    """
    with engine.connect() as connection:
        there = inspect(connection).get_table_names()
        if "alembic_version" not in there:
            return None
        found = connection.execute(text("SELECT version_num FROM alembic_version")).scalar_one_or_none()
        if found is None and len(there) > 1:
            raise SchemaError(
                "the database has tables, but the table alembic_version, which names their schema, is "
                "empty: restore a backup with `sinew db restore FILE`"
            )
        return found


def newest_revision() -> str:
    """Return the schema revision of this version of the program."""
    return _revisions()[-1]


def _revisions() -> list[str]:
    """Return all revisions in order; a migration's file has the name of its revision."""
    return sorted(script.stem for script in (SCRIPTS / "versions").glob("[0-9]*.py"))


def require_models_match(engine: Engine) -> None:
    """Compare the tables of the database with those of ``orm.py``.

    Raises alembic.util.AutogenerateDiffsDetected if they differ.
    """
    from alembic import command

    with engine.begin() as connection:
        command.check(_configuration(connection))


def broken_references(connection: Connection) -> list[str]:
    """Return the tables with references to missing rows.

    Only SQLite allows any.
    """
    if connection.dialect.name != "sqlite":
        return []
    return sorted({row[0] for row in connection.exec_driver_sql("PRAGMA foreign_key_check")})


@contextmanager
def _free_to_rebuild_tables(connection: Connection) -> Iterator[None]:
    """Disable foreign keys, outside any transaction.

    SQLite alters a table by recreating it.
    """
    driver = connection.connection.dbapi_connection
    if connection.dialect.name != "sqlite" or driver is None:
        yield
        return
    driver.cursor().execute("PRAGMA foreign_keys=OFF")
    try:
        yield
    finally:
        driver.cursor().execute("PRAGMA foreign_keys=ON")


def _configuration(connection: Connection) -> "Config":
    from alembic.config import Config

    configuration = Config(stdout=io.StringIO())  # Alembic prints its results; here they are returned or raised
    configuration.set_main_option("script_location", str(SCRIPTS).replace("%", "%%"))
    configuration.attributes["connection"] = connection
    return configuration


# Maintenance ---------------------------------------------------------------------------------------
# Maintenance of a database: a copy while it is in use, and a complete check.


_RESTORING, _RESTORED, _UNFINISHED = ".restoring", ".restored", ".unfinished"
"""Suffixes: a copy being restored, a complete copy about to become the database, a backup being written."""

BEFORE_RESTORE = ".before-restore-"
IMPORTING = "importing-"
"""Prefix of the folder into which a bundle is unpacked."""


class BackupError(SinewError):
    """The copy was not made; the message says why, and no partial copy remains."""

    category = ErrorCode.UNAVAILABLE


def next_backup_path(data: Path) -> Path:
    """Return the path of the next backup of a data folder's database, named by time."""
    return data / "backups" / f"{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db"


def backup_database(engine: Engine, target: Path) -> None:
    """Copy an SQLite database to a new file while it is in use. Raises BackupError."""
    if engine.dialect.name != "sqlite":
        raise BackupError(f"a {engine.dialect.name} database is backed up with its own tools (pg_dump)")
    if target.exists():
        raise BackupError(f"{target} exists already: choose another name")
    unfinished = target.with_name(f"{target.name}{_UNFINISHED}")
    try:
        target.parent.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        unfinished.touch(mode=FILE_MODE)
        with closing(engine.raw_connection()) as source, closing(sqlite3.connect(unfinished)) as copy:
            original = source.driver_connection
            if not isinstance(original, sqlite3.Connection):
                raise BackupError("only connections of the standard library's sqlite3 can be copied")
            original.backup(copy)
        os.replace(unfinished, target)
    except (sqlite3.Error, OSError) as error:
        with suppress(OSError):
            _remove_with_logs(unfinished)
        raise BackupError(f"{target} could not be written: {error}") from error


def restore_database(copy: Path, target: Path) -> None:
    """Replace the SQLite database ``target``, which must not be in use, by a backup.

    The copy is checked first. The previous database is renamed with ``.before-restore`` in its name.
    ``recover_database`` reverts or completes a restore that was killed: it counts once its copy is named ``.restored``.
    Raises BackupError.
    """
    if not copy.is_file():
        raise BackupError(f"{copy} does not exist: choose a file from DATA/backups")
    recover_database(target)
    unfinished = target.with_name(f"{target.name}{_RESTORING}")
    try:
        # A copy without a log is opened as immutable: SQLite would create a log, which a kill would leave behind.
        alone = "" if copy.with_name(f"{copy.name}-wal").exists() else "&immutable=1"
        with closing(sqlite3.connect(f"file:{quote(str(copy))}?mode=ro{alone}", uri=True)) as source:
            _require_ours(source, copy)
            unfinished.touch(mode=FILE_MODE)
            with closing(sqlite3.connect(unfinished)) as made:
                source.backup(made)
        _sync(unfinished)
        os.replace(unfinished, target.with_name(f"{target.name}{_RESTORED}"))
        _complete_restore(target)
    except (sqlite3.Error, OSError) as error:
        begun = target.with_name(f"{target.name}{_RESTORED}").exists()
        outcome = "the next start completes it" if begun else "nothing was changed"
        raise BackupError(f"{copy} cannot be restored: {error}; {outcome}") from error
    finally:
        with suppress(OSError):
            _remove_with_logs(unfinished)


def recover_database(file: Path) -> list[str]:
    """Complete or revert interrupted commands on an SQLite database.

    Returns a sentence for each. The caller must have exclusive access to the data folder. Remainders of copies, new
    databases and imports are removed.
    """
    messages = []
    if file.with_name(f"{file.name}{_RESTORED}").exists():
        _complete_restore(file)
        messages.append("an interrupted restore has been completed: the database now has the content of the backup")
    unfinished = file.with_name(f"{file.name}{_RESTORING}")
    if unfinished.exists():
        _remove_with_logs(unfinished)
        messages.append("an interrupted restore has been rolled back: the database is in its earlier state")
    backups = file.parent / "backups"
    leftovers = [*backups.glob(f"*{_UNFINISHED}"), *file.parent.glob(f"{file.name}.*.creating")]
    for leftover in leftovers:
        _remove_with_logs(leftover)
        messages.append(f"{leftover.name} was removed: the command that wrote it was killed")
    for folder in file.parent.glob(f"{IMPORTING}*"):
        shutil.rmtree(folder, ignore_errors=True)
        messages.append(f"{folder.name} was removed: the import that unpacked it was killed, and stored nothing")
    return messages


def is_restore_incomplete(file: Path) -> bool:
    """Return whether a restore was interrupted or is in progress."""
    return any(file.with_name(f"{file.name}{end}").exists() for end in (_RESTORING, _RESTORED))


def _complete_restore(file: Path) -> None:
    """Rename the restored copy to the database; the previous one keeps its log."""
    if file.exists():
        _fold_in_log(file)
    _move_aside(file)
    os.replace(file.with_name(f"{file.name}{_RESTORED}"), file)
    _sync(file.parent)


def _fold_in_log(file: Path) -> None:
    """Write SQLite's log into the database file, if the file is readable."""
    with suppress(sqlite3.DatabaseError), closing(sqlite3.connect(file)) as present:
        present.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _move_aside(file: Path) -> None:
    """Rename a database with its log: SQLite would apply the log to the next file."""
    backup = file.with_name(f"{file.stem}{BEFORE_RESTORE}{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db")
    for end in ("", "-wal", "-shm"):
        part = file.with_name(file.name + end)
        if part.exists():
            os.replace(part, backup.with_name(backup.name + end))


def _remove_with_logs(file: Path) -> None:
    for end in ("", "-journal", "-wal", "-shm"):
        file.with_name(file.name + end).unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Wait until a file, or the entries of a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _require_ours(connection: sqlite3.Connection, copy: Path) -> None:
    damages = [line for (line,) in connection.execute("PRAGMA integrity_check") if line != "ok"]
    if damages:
        raise BackupError(f"{copy} is damaged: {damages[0]}; nothing was changed")
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {"alembic_version", "run"} <= tables:
        raise BackupError(f"{copy} is not a database of Sinew; nothing was changed")


def find_database_errors(engine: Engine) -> list[str]:
    """Return all errors of a database, one sentence each; empty if there is none."""
    found, newest = read_revision(engine), newest_revision()
    if found != newest:
        return [f"the schema is {found or 'empty'}, this version requires {newest}: run `sinew db upgrade`"]
    from alembic.util import AutogenerateDiffsDetected

    problems = []
    try:
        require_models_match(engine)
    except AutogenerateDiffsDetected as error:
        problems.append(f"the tables are not those of schema {newest}: {error}")
    try:
        with engine.connect() as connection:
            problems += [f"the file is damaged: {damage}" for damage in _damages(connection)]
            problems += [f"table {table} refers to rows that do not exist" for table in broken_references(connection)]
    except DatabaseError as error:
        problems.append(f"the file is damaged: {error.orig}")
    return problems


def _damages(connection: Connection) -> list[str]:
    if connection.dialect.name != "sqlite":
        return []
    return [str(line) for line in connection.exec_driver_sql("PRAGMA integrity_check").scalars() if line != "ok"]


# File checks ---------------------------------------------------------------------------------------
# The file of an SQLite database: whether it exists, is still the opened one, and is complete.
#
# SQLite would create a new file in place of a missing or empty one, and continues to write to a deleted one.


CHECKED_AT_START_BYTES = 64 * 1024**2
"""Largest file that is checked completely during a start: seconds from a slow disk, 0.1 s if it is cached."""

NEWEST_BACKUPS = 3

Identity = tuple[int, int]


def get_database_file(engine: Engine) -> Path | None:
    """Return the file of an SQLite database, None for others and for one in memory."""
    name = engine.url.database
    if engine.dialect.name != "sqlite" or name in (None, "", ":memory:") or name.startswith("file:"):
        return None
    return Path(name)


def identity(file: Path) -> Identity:
    """Return device and inode of a file. Raises GoneError if it does not exist."""
    try:
        known = file.stat()
    except OSError as error:
        raise GoneError(_describe_replaced_file(file, error.strerror or str(error))) from None
    return known.st_dev, known.st_ino


def require_in_place(file: Path, opened: Identity) -> None:
    """Raise GoneError unless ``file`` and its log are still the opened ones."""
    if identity(file) != opened:
        raise GoneError(_describe_replaced_file(file, "another file has replaced it"))
    log = _get_wal_file(file)
    if not log.exists() and _is_open_though_deleted(log):
        raise GoneError(_describe_replaced_file(log, "it was deleted"))


def is_usable(file: Path, backups: Path) -> bool:
    """Return whether a database exists.

    Raises DamagedError if it would silently be replaced by an empty one.
    """
    if file.is_file():
        if file.stat().st_size == 0:
            raise DamagedError(f"{file} is empty (0 bytes): it was truncated; {describe_recovery(file, backups)}")
        return True
    if _get_wal_file(file).is_file() and _get_wal_file(file).stat().st_size:
        raise DamagedError(
            f"{file} is missing, but its log ({_get_wal_file(file).name}) still exists: put the database "
            f"back; or {describe_recovery(file, backups)}"
        )
    if traces := find_database_traces(file, backups):
        named = ", ".join(trace.name for trace in sorted(traces)[-NEWEST_BACKUPS:])
        raise DamagedError(
            f"{file} is missing, but copies of it exist ({named}): Sinew creates no empty database in its place. "
            f"Put the database back; or {describe_recovery(file, backups)}; "
            "or choose another --data to begin with an empty one"
        )
    return file.exists()


def find_database_traces(file: Path, backups: Path) -> list[Path]:
    """Return the copies that prove that a missing database existed."""
    return [*file.parent.glob(f"{file.stem}{BEFORE_RESTORE}*.db"), *backups.glob("*.db")]


def quick_check(file: Path, backups: Path) -> None:
    """Read all pages of an SQLite file; raise DamagedError if they are inconsistent.

    Writers may continue. It takes 2 s per GB if the file is cached, else as long as the disk takes to read it. Flipped
    bits inside stored samples are detected when these are unpacked, not here.
    """
    try:
        with closing(sqlite3.connect(f"file:{quote(str(file))}?mode=ro", uri=True)) as connection:
            found = [str(line) for (line,) in connection.execute("PRAGMA quick_check(1)") if line != "ok"]
    except sqlite3.DatabaseError as error:
        found = [str(error)]
    if found:
        raise DamagedError(f"{file} is damaged ({' '.join(found[0].split())}): {describe_recovery(file, backups)}")


def is_quick_to_check(file: Path) -> bool:
    """Return whether the whole file may be checked during the start."""
    return file.stat().st_size <= CHECKED_AT_START_BYTES


def describe_recovery(file: Path, backups: Path) -> str:
    """Return the remedy for an unusable ``file``: its backups and the command."""
    with suppress(OSError):
        copies = sorted(backups.glob("*.db"), key=lambda copy: copy.stat().st_mtime, reverse=True)
        if copies:
            named = ", ".join(copy.name for copy in copies[:NEWEST_BACKUPS])
            return (
                f"restore a backup with `sinew db restore FILE --data {file.parent}`; "
                f"in {backups}, newest first: {named}"
            )
    return (
        f"there is no backup in {backups}; restore one from elsewhere with "
        f"`sinew db restore FILE --data {file.parent}`, or move {file.name} away to begin with an empty database"
    )


def _get_wal_file(file: Path) -> Path:
    return file.with_name(f"{file.name}-wal")


def _describe_replaced_file(file: Path, why: str) -> str:
    return (
        f"{file} is no longer the file that this service opened: {why}. Put it back where it was, "
        "or stop the service and start it again"
    )


def _is_open_though_deleted(file: Path) -> bool:
    """Return whether this process has an open file without a name."""
    deleted = f"{file.parent.resolve() / file.name} (deleted)"
    with os.scandir("/proc/self/fd") as descriptors:
        for descriptor in descriptors:
            with suppress(OSError):
                if os.readlink(descriptor.path) == deleted:
                    return True
    return False


# Database ------------------------------------------------------------------------------------------
# One database: SQLite in the data folder, or any SQLAlchemy URL.


__all__ = ["Database", "Session", "StorageError", "connect_database", "open_database", "sqlite_url"]

FILE_NAME = "sinew.db"
_log = logging.getLogger(__name__)


class Database:
    """An engine and its transactions.

    Functions of this package take a ``Session`` of them. ``file`` is that of an SQLite database, None for others;
    ``opened`` identifies it, in case another one replaces it. ``station`` owns the rows that are written and, if rows
    belong to stations, read.
    """

    def __init__(self, engine: Engine, opened: Identity | None = None, station: str = "") -> None:
        self.engine = engine
        self.station = station
        self.file = get_database_file(engine)
        self._opened = opened or (identity(self.file) if self.file else None)
        # SQLite's snapshots are repeatable; the servers' default would show later commits within one.
        isolation = {} if engine.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}
        self._reading_engine = engine.execution_options(sinew_reading=True, **isolation)

    @contextmanager
    def session(self) -> Iterator[Session]:
        """Begin a writing transaction: committed at the end, rolled back on any exception.

        On SQLite it takes the write lock at once (waiting up to 5 s): a transaction that reads before it writes would
        otherwise fail without waiting if another one wrote in between. Raises StorageError; GoneError if the file was
        deleted or replaced, as SQLite would continue to write to the deleted file.
        """
        self.require_in_place()
        info = make_session_info(self.station)
        with _translate_errors(), Session(self.engine, expire_on_commit=False, info=info) as session, session.begin():
            yield session
            search_index.update(session, take_touched(session))

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Begin a consistent snapshot for reading, which neither waits nor blocks.

        Raises StorageError.
        """
        with _translate_errors(), Session(self._reading_engine, info=make_session_info(self.station)) as session:
            yield session

    def require_in_place(self) -> None:
        """Raise GoneError unless the database's file is still the opened one."""
        if self.file is not None and self._opened is not None:
            require_in_place(self.file, self._opened)

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the URL, so that another process opens its own connections."""
        return _reopen, (self.engine.url, self._opened, self.station)


Outdated = Literal["migrate", "refuse", "read"]
"""Treatment of a database of an earlier schema; ``read`` opens it unchanged if this version can read it."""


def open_database(
    data_dir: Path,
    url: str | None = None,
    password: str | None = None,
    station: str = "",
    *,
    outdated: Outdated = "migrate",
) -> Database:
    """Open the database; create data folder and database, and migrate, if needed.

    Before an SQLite database of an earlier schema is migrated, a copy is stored in ``data_dir/backups``. No database is
    migrated while a service uses it. ``url`` is an SQLAlchemy URL that replaces ``data_dir/sinew.db``, ``password`` is
    inserted into it.

    Raises ``OutdatedError`` if ``outdated`` forbids a migration, ``SchemaError`` if the database was written by a newer
    version, ``StorageError`` if it cannot be reached, ``DamagedError`` if the file was truncated or is not SQLite's,
    ``BackupError``.
    """
    _require_writable(data_dir)
    engine = connect_database(url or sqlite_url(data_dir), password)
    file, backups = get_database_file(engine), data_dir / "backups"
    try:
        with _translate_errors():
            if file is not None:
                _require_no_restore(file)
                if not is_usable(file, backups):
                    _create(file)
            if is_outdated(engine):
                if outdated == "read" and can_read(engine):
                    return Database(engine, station=station)
                _require_migratable(engine, data_dir, outdated)
                if engine.dialect.name == "sqlite":
                    backup_database(
                        engine, backups / f"{read_revision(engine)}-{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db"
                    )
            upgrade(engine)
        for sentence in make_private(data_dir):  # the file that was just created
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
        hint = f"; {describe_recovery(file, backups)}" if _is_none_of_sqlites(error) else ""
        raise StorageError(f"{file}: {error}{hint}") from error
    except BaseException:
        engine.dispose()
        raise


def _require_no_restore(file: Path) -> None:
    """Raise StorageError during a restore, or after one that was killed."""
    if is_restore_incomplete(file):
        raise StorageError(
            "a restore is in progress, or was killed while a service used the folder: wait until it ends, or repeat it"
        )


def _require_migratable(engine: Engine, data_dir: Path, outdated: Outdated) -> None:
    """Raise SchemaError while a service uses the database, else OutdatedError.

    The latter unless ``outdated`` permits a migration.
    """
    found = f"the database has schema {read_revision(engine)}, version {__version__} works with {newest_revision()}"
    if by := describe_claim(engine):
        raise SchemaError(
            f"{by} uses this database, and {found}: stop that service first, or use the commands of its version"
        )
    if outdated != "migrate":
        raise OutdatedError(
            f"{found}: `sinew db upgrade --data {data_dir}` migrates it and keeps a copy of its present state"
        )


def _require_writable(data_dir: Path) -> None:
    """Create the data folder if missing. Raises StorageError if it is not writable."""
    try:
        make_private(data_dir)
        writable = os.access(data_dir, os.W_OK | os.X_OK, effective_ids=True)
        refused = "" if writable else "this account may only read it"
    except OSError as error:
        refused = str(error.strerror or error)
    if refused:
        raise StorageError(
            f"the data folder {data_dir} cannot be written: {refused}. Sinew must write to the folder "
            "even to read from it: change its owner or mode, mount it writable, or copy it and name the "
            "copy with --data"
        )


def _renew_index(database: Database) -> None:
    """Update the search index of runs, after a migration or with a newer version."""
    try:
        with database.reading() as session:
            behind = search_index.is_behind(session)
        while behind:
            with database.session() as session:
                behind = search_index.renew(session) > 0
    except StorageError as error:  # of a damaged file, as much is opened as is readable
        _log.warning("The search index is incomplete: %s", error)


def require_intact_database(database: Database, data_dir: Path) -> None:
    """Read all of an SQLite database.

    Raises DamagedError, with the remedy, if its pages are inconsistent.
    """
    if database.file is not None:
        quick_check(database.file, data_dir / "backups")


def _is_none_of_sqlites(error: StorageError) -> bool:
    cause = getattr(error.__cause__, "orig", None)
    return isinstance(cause, sqlite3.DatabaseError) and not isinstance(cause, sqlite3.OperationalError)


def _create(file: Path) -> None:
    """Create an empty database under a temporary name, and rename it when complete.

    An empty file is therefore never the result of an interrupted start.
    """
    fresh = file.with_name(f"{file.name}.{os.getpid()}.creating")
    leftovers = [fresh, *(fresh.with_name(fresh.name + end) for end in ("-wal", "-shm"))]
    for leftover in leftovers:
        leftover.unlink(missing_ok=True)
    engine = connect_database(_make_url(fresh))
    try:
        upgrade(engine)
        engine.dispose()
        with suppress(FileExistsError):  # another command was faster
            os.link(fresh, file)
    except PermissionError:  # a file system without hard links
        os.rename(fresh, file)
    finally:
        engine.dispose()
        for leftover in leftovers:
            leftover.unlink(missing_ok=True)


def _reopen(url: URL, opened: Identity | None, station: str) -> Database:
    return Database(connect_database(url), opened, station)


@contextmanager
def _translate_errors() -> Iterator[None]:
    try:
        yield
    except (IntegrityError, DataError) as error:
        raise UnfitError(str(error.orig or error)) from error
    except SQLAlchemyError as error:
        # The driver's message; SQLAlchemy's contains the statement with all its values.
        raise StorageError(str(getattr(error, "orig", None) or error)) from error


def sqlite_url(data_dir: Path) -> URL:
    """Return the SQLAlchemy URL of the database file in a data folder."""
    return _make_url((data_dir / FILE_NAME).resolve())


def find_database_file(data_dir: Path, url: str | None = None) -> Path | None:
    """Return the file of the SQLite database of a data folder or a URL, else None."""
    if url is None:
        return (data_dir / FILE_NAME).resolve()
    engine = connect_database(url)
    found = get_database_file(engine)
    engine.dispose()
    return None if found is None else found.resolve()


def _make_url(file: Path) -> URL:
    """Return the URL of a file whose path may contain URL syntax, such as a ?."""
    return URL.create("sqlite", database=str(file))


def connect_database(url: str | URL, password: str | None = None) -> Engine:
    """Return the engine of ``url``; documents with NaN or infinity are rejected.

    JSON has no such numbers. Raises StorageError for an invalid URL; the message does not contain it, as it may have a
    password.
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
            f"SINEW_DATABASE_URL is not the address of a database: {error}; "
            "write it as postgresql+psycopg://user@host:port/database"
        ) from None
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _prepare_sqlite(connection: sqlite3.Connection, _record: Any) -> None:
    # Transactions begin in _begin_sqlite: the driver alone begins them late and commits before DDL.
    connection.isolation_level = None
    connection.execute("PRAGMA busy_timeout=5000")
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=FULL")
    connection.execute("PRAGMA foreign_keys=ON")


def _begin_sqlite(connection: Connection) -> None:
    reading = connection.get_execution_options().get("sinew_reading", False)
    connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")
