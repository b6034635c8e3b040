"""The database: SQLite in the data folder or a URL; schema versions, copies, soundness."""

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
#
# Schema versions: bring a database to the newest, say where it stands.
#
# Alembic is loaded where there is something to migrate: a start on a database of this version needs
# none of it.


SCRIPTS = Path(migrations.__file__).parent
PRESENT_DOCUMENTS = "0016_current_documents"
"""From this revision on, stored documents have the form that this version reads."""


class SchemaError(SinewError):
    """The schema of the database is not one this version can work with; the message says what to do."""

    category = ErrorCode.UNAVAILABLE


class OutdatedError(SchemaError):
    """The database has an earlier schema, and whoever opens it may not migrate it."""


def is_outdated(engine: Engine) -> bool:
    """Tell whether the database holds an earlier schema than the newest. Raises SchemaError for a later one."""
    found = read_revision(engine)
    if found is None or found == newest_revision():
        return False
    if found not in _revisions():
        raise SchemaError(
            f"the database has schema {found}, this version knows up to {newest_revision()}: "
            "it was written by a newer version; install that one, or choose another data folder"
        )
    return True


def can_read(engine: Engine) -> bool:
    """Tell whether this version reads a database of an earlier schema as it is.

    It has every table and column that is read, and its documents have the present form.
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
    """Migrate to the newest schema in one transaction: all of it or nothing."""
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
    """Return the schema revision the database is at, None for an empty database. Raises SchemaError."""
    with engine.connect() as connection:
        there = inspect(connection).get_table_names()
        if "alembic_version" not in there:
            return None
        found = connection.execute(text("SELECT version_num FROM alembic_version")).scalar_one_or_none()
        if found is None and len(there) > 1:
            raise SchemaError(
                "the database has tables, but the table alembic_version, which names their schema, is empty: bring a "
                "backup back with `sinew db restore FILE`"
            )
        return found


def newest_revision() -> str:
    """Return the revision that this version of the program works with."""
    return _revisions()[-1]


def _revisions() -> list[str]:
    """Return all of them in order: a migration's file is called as its revision, and begins with its number."""
    return sorted(script.stem for script in (SCRIPTS / "versions").glob("[0-9]*.py"))


def require_models_match(engine: Engine) -> None:
    """Compare the tables with ``schema.py``. Raises alembic.util.AutogenerateDiffsDetected when they differ."""
    from alembic import command

    with engine.begin() as connection:
        command.check(_configuration(connection))


def broken_references(connection: Connection) -> list[str]:
    """Return the tables with references to rows that are not there; other databases than SQLite do not allow any."""
    if connection.dialect.name != "sqlite":
        return []
    return sorted({row[0] for row in connection.exec_driver_sql("PRAGMA foreign_key_check")})


@contextmanager
def _free_to_rebuild_tables(connection: Connection) -> Iterator[None]:
    """Switch foreign keys off, outside any transaction: SQLite alters a table by dropping and making it anew."""
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

    configuration = Config(stdout=io.StringIO())  # Alembic prints what it finds; here it is returned or raised
    configuration.set_main_option("script_location", str(SCRIPTS).replace("%", "%%"))
    configuration.attributes["connection"] = connection
    return configuration


# Maintenance ---------------------------------------------------------------------------------------
#
# Keep a database sound: a copy while it is in use, and a check of all of it.


_RESTORING, _RESTORED, _UNFINISHED = ".restoring", ".restored", ".unfinished"
"""Ends of names: a copy that is being restored, one that is whole and to be the database, a backup being written."""

BEFORE_RESTORE = ".before-restore-"
IMPORTING = "importing-"
"""How the folder begins into which a bundle is unpacked."""


class BackupError(SinewError):
    """The copy was not made; the message says why, and nothing was left behind."""

    category = ErrorCode.UNAVAILABLE


def next_backup_path(data: Path) -> Path:
    """Return where the next copy of a data folder's database goes, named by the time."""
    return data / "backups" / f"{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db"


def backup_database(engine: Engine, target: Path) -> None:
    """Copy an SQLite database to a new file while others read and write it. Raises BackupError."""
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
    """Put a backup in the place of the SQLite database ``target``; nothing may use it meanwhile. Raises BackupError.

    The copy is checked first. What was there before stays beside it, with ``.before-restore`` in its name. ``recover``
    takes back a restore that was killed, or completes it: it counts once its copy is called ``.restored``.
    """
    if not copy.is_file():
        raise BackupError(f"{copy} is not there: choose a file of DATA/backups")
    recover_database(target)
    unfinished = target.with_name(f"{target.name}{_RESTORING}")
    try:
        # A copy without a log is read as it is: SQLite would write a log beside it, which a kill would leave there.
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
    """Complete or take back what killed commands began at an SQLite database; return a sentence for each.

    For whoever has the data folder for itself. Leftovers of copies, new databases and imports are removed.
    """
    messages = []
    if file.with_name(f"{file.name}{_RESTORED}").exists():
        _complete_restore(file)
        messages.append("a restore that was cut short has been completed: the database is the backup now")
    unfinished = file.with_name(f"{file.name}{_RESTORING}")
    if unfinished.exists():
        _remove_with_logs(unfinished)
        messages.append("a restore that was cut short has been taken back: the database is as it was before")
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
    """Return whether a restore was killed in the middle of it, or is under way."""
    return any(file.with_name(f"{file.name}{end}").exists() for end in (_RESTORING, _RESTORED))


def _complete_restore(file: Path) -> None:
    """Give the restored copy the database's name; what was there before keeps its log beside it under another name."""
    if file.exists():
        _fold_in_log(file)
    _move_aside(file)
    os.replace(file.with_name(f"{file.name}{_RESTORED}"), file)
    _sync(file.parent)


def _fold_in_log(file: Path) -> None:
    """Write what stands in SQLite's log into the file itself, where the file is one that SQLite can read."""
    with suppress(sqlite3.DatabaseError), closing(sqlite3.connect(file)) as present:
        present.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _move_aside(file: Path) -> None:
    """Give a database another name, with the log that is left of a damaged one: SQLite would play it into the next."""
    backup = file.with_name(f"{file.stem}{BEFORE_RESTORE}{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db")
    for end in ("", "-wal", "-shm"):
        part = file.with_name(file.name + end)
        if part.exists():
            os.replace(part, backup.with_name(backup.name + end))


def _remove_with_logs(file: Path) -> None:
    for end in ("", "-journal", "-wal", "-shm"):
        file.with_name(file.name + end).unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
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
        raise BackupError(f"{copy} is no database of Sinew; nothing was changed")


def find_database_errors(engine: Engine) -> list[str]:
    """Return all that is wrong with a database, one sentence each; empty when it is sound."""
    found, newest = read_revision(engine), newest_revision()
    if found != newest:
        return [f"the schema is {found or 'empty'}, this version works with {newest}: run `sinew db upgrade`"]
    from alembic.util import AutogenerateDiffsDetected

    problems = []
    try:
        require_models_match(engine)
    except AutogenerateDiffsDetected as error:
        problems.append(f"the tables are not those of schema {newest}: {error}")
    try:
        with engine.connect() as connection:
            problems += [f"the file is damaged: {damage}" for damage in _damages(connection)]
            problems += [f"table {table} refers to rows that are not there" for table in broken_references(connection)]
    except DatabaseError as error:
        problems.append(f"the file is damaged: {error.orig}")
    return problems


def _damages(connection: Connection) -> list[str]:
    if connection.dialect.name != "sqlite":
        return []
    return [str(line) for line in connection.exec_driver_sql("PRAGMA integrity_check").scalars() if line != "ok"]


# Soundness -----------------------------------------------------------------------------------------
#
# The file under an SQLite database: whether it is there, is still the one that was opened, and is
# whole.
#
# SQLite would make a new file in place of one that is gone or empty, and goes on writing to one
# that was deleted.


CHECKED_AT_START_BYTES = 64 * 1024**2
"""Up to here a start waits until the whole file was looked at: seconds from a slow disk, 0.1 s where it is cached."""

NEWEST_BACKUPS = 3

Identity = tuple[int, int]


def get_database_file(engine: Engine) -> Path | None:
    """Return the file of an SQLite database, None for any other and for one in memory."""
    name = engine.url.database
    if engine.dialect.name != "sqlite" or name in (None, "", ":memory:") or name.startswith("file:"):
        return None
    return Path(name)


def identity(file: Path) -> Identity:
    """Return device and inode of a file. Raises GoneError when it is not there."""
    try:
        known = file.stat()
    except OSError as error:
        raise GoneError(_describe_replaced_file(file, error.strerror or str(error))) from None
    return known.st_dev, known.st_ino


def require_in_place(file: Path, opened: Identity) -> None:
    """Raise GoneError unless ``file`` is still the one that was opened, with the log that SQLite keeps beside it."""
    if identity(file) != opened:
        raise GoneError(_describe_replaced_file(file, "another file stands in its place"))
    log = _get_wal_file(file)
    if not log.exists() and _is_open_though_deleted(log):
        raise GoneError(_describe_replaced_file(log, "it was deleted"))


def is_usable(file: Path, backups: Path) -> bool:
    """Return whether a database is there. Raises DamagedError for what would silently be replaced by an empty one."""
    if file.is_file():
        if file.stat().st_size == 0:
            raise DamagedError(f"{file} is empty (0 bytes): something cut it off; {describe_recovery(file, backups)}")
        return True
    if _get_wal_file(file).is_file() and _get_wal_file(file).stat().st_size:
        raise DamagedError(
            f"{file} is gone, but the log beside it ({_get_wal_file(file).name}) is still there: "
            f"put the database back; or {describe_recovery(file, backups)}"
        )
    if traces := find_database_traces(file, backups):
        named = ", ".join(trace.name for trace in sorted(traces)[-NEWEST_BACKUPS:])
        raise DamagedError(
            f"{file} is gone, but copies of it are still there ({named}): no empty database is made in its place. "
            f"Put the database back; or {describe_recovery(file, backups)}; "
            "or choose another --data to begin with an empty one"
        )
    return file.exists()


def find_database_traces(file: Path, backups: Path) -> list[Path]:
    """Return the copies that show that there was a database where there is none any more."""
    return [*file.parent.glob(f"{file.stem}{BEFORE_RESTORE}*.db"), *backups.glob("*.db")]


def quick_check(file: Path, backups: Path) -> None:
    """Read all pages of an SQLite file and raise DamagedError where they contradict each other.

    Writers may go on meanwhile. It takes 2 s per GB that is cached, else as long as the disk takes to read the file.
    Flipped bits inside stored samples are found when these are unpacked, not here.
    """
    try:
        with closing(sqlite3.connect(f"file:{quote(str(file))}?mode=ro", uri=True)) as connection:
            found = [str(line) for (line,) in connection.execute("PRAGMA quick_check(1)") if line != "ok"]
    except sqlite3.DatabaseError as error:
        found = [str(error)]
    if found:
        raise DamagedError(f"{file} is damaged ({' '.join(found[0].split())}): {describe_recovery(file, backups)}")


def is_quick_to_check(file: Path) -> bool:
    """Return whether a check of the whole file may hold up the start."""
    return file.stat().st_size <= CHECKED_AT_START_BYTES


def describe_recovery(file: Path, backups: Path) -> str:
    """Return what to do when ``file`` cannot be used: which backups there are, and the command for them."""
    with suppress(OSError):
        copies = sorted(backups.glob("*.db"), key=lambda copy: copy.stat().st_mtime, reverse=True)
        if copies:
            named = ", ".join(copy.name for copy in copies[:NEWEST_BACKUPS])
            return (
                f"bring a backup back with `sinew db restore FILE --data {file.parent}`; "
                f"in {backups}, newest first: {named}"
            )
    return (
        f"there is no backup in {backups}; bring one from elsewhere back with "
        f"`sinew db restore FILE --data {file.parent}`, or move {file.name} away to begin with an empty database"
    )


def _get_wal_file(file: Path) -> Path:
    return file.with_name(f"{file.name}-wal")


def _describe_replaced_file(file: Path, why: str) -> str:
    return (
        f"{file} is not the file any more that this service opened: {why}. Put it back where it was, "
        "or stop the service and start it again"
    )


def _is_open_though_deleted(file: Path) -> bool:
    """Whether this process holds a file open that has no name any more."""
    deleted = f"{file.parent.resolve() / file.name} (deleted)"
    with os.scandir("/proc/self/fd") as descriptors:
        for descriptor in descriptors:
            with suppress(OSError):
                if os.readlink(descriptor.path) == deleted:
                    return True
    return False


# Database ------------------------------------------------------------------------------------------
#
# One database: SQLite in the data folder, or whatever SQLAlchemy URL is given.


__all__ = ["Database", "Session", "StorageError", "connect_database", "open_database", "sqlite_url"]

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
        self.file = get_database_file(engine)
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
        info = make_session_info(self.station)
        with _translate_errors(), Session(self.engine, expire_on_commit=False, info=info) as session, session.begin():
            yield session
            search_index.update(session, take_touched(session))

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """One consistent snapshot to read from; waits for no writer and delays none. Raises StorageError."""
        with _translate_errors(), Session(self._reading_engine, info=make_session_info(self.station)) as session:
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
        return _reopen, (self.engine.url, self._opened, self.station)


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
        hint = f"; {describe_recovery(file, backups)}" if _is_none_of_sqlites(error) else ""
        raise StorageError(f"{file}: {error}{hint}") from error
    except BaseException:
        engine.dispose()
        raise


def _require_no_restore(file: Path) -> None:
    """Raise StorageError while a restore is under way, or was killed and nobody could complete it yet."""
    if is_restore_incomplete(file):
        raise StorageError("a restore is under way, or was killed while a service works on the folder: try it again")


def _require_migratable(engine: Engine, data_dir: Path, outdated: Outdated) -> None:
    """Raise SchemaError while a service works on the database, OutdatedError where it is not to be migrated."""
    found = f"the database has schema {read_revision(engine)}, version {__version__} works with {newest_revision()}"
    if by := describe_claim(engine):
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
            behind = search_index.is_behind(session)
        while behind:
            with database.session() as session:
                behind = search_index.renew(session) > 0
    except StorageError as error:  # of a damaged file as much is opened as can be read
        _log.warning("The search index does not have all runs: %s", error)


def require_intact_database(database: Database, data_dir: Path) -> None:
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
    engine = connect_database(_make_url(fresh))
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


def _reopen(url: URL, opened: Identity | None, station: str) -> Database:
    return Database(connect_database(url), opened, station)


@contextmanager
def _translate_errors() -> Iterator[None]:
    try:
        yield
    except (IntegrityError, DataError) as error:
        raise UnfitError(str(error.orig or error)) from error
    except SQLAlchemyError as error:
        # The driver's sentence; SQLAlchemy's own carries the statement with all its values.
        raise StorageError(str(getattr(error, "orig", None) or error)) from error


def sqlite_url(data_dir: Path) -> URL:
    """SQLAlchemy URL of the database file in a data folder."""
    return _make_url((data_dir / FILE_NAME).resolve())


def find_database_file(data_dir: Path, url: str | None = None) -> Path | None:
    """Return the file of the SQLite database that a data folder or a URL names; None for any other database."""
    if url is None:
        return (data_dir / FILE_NAME).resolve()
    engine = connect_database(url)
    found = get_database_file(engine)
    engine.dispose()
    return None if found is None else found.resolve()


def _make_url(file: Path) -> URL:
    """Return the URL of a file whose path may hold what means something in the text of a URL, such as a ?."""
    return URL.create("sqlite", database=str(file))


def connect_database(url: str | URL, password: str | None = None) -> Engine:
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
