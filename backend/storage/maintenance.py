"""Keep a database sound: a copy while it is in use, and a check of all of it."""

import os
import shutil
import sqlite3
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DatabaseError

from backend.data_folder import FILE, FOLDER
from backend.storage.migrate import broken_references, newest_revision, require_models_match, revision

_RESTORING, _RESTORED, _UNFINISHED = ".restoring", ".restored", ".unfinished"
"""Ends of names: a copy that is being restored, one that is whole and to be the database, a backup being written."""

BEFORE_RESTORE = ".before-restore-"
IMPORTING = "importing-"
"""How the folder begins into which a bundle is unpacked."""


class BackupError(Exception):
    """The copy was not made; the message says why, and nothing was left behind."""


def next_copy(data: Path) -> Path:
    """Return where the next copy of a data folder's database goes, named by the time."""
    return data / "backups" / f"{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db"


def backup(engine: Engine, target: Path) -> None:
    """Copy an SQLite database to a new file while others read and write it. Raises BackupError."""
    if engine.dialect.name != "sqlite":
        raise BackupError(f"a {engine.dialect.name} database is backed up with its own tools (pg_dump)")
    if target.exists():
        raise BackupError(f"{target} exists already: choose another name")
    unfinished = target.with_name(f"{target.name}{_UNFINISHED}")
    try:
        target.parent.mkdir(mode=FOLDER, parents=True, exist_ok=True)
        unfinished.touch(mode=FILE)
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


def restore(copy: Path, target: Path) -> None:
    """Put a backup in the place of the SQLite database ``target``; nothing may use it meanwhile. Raises BackupError.

    The copy is checked first. What was there before stays beside it, with ``.before-restore`` in its name. ``recover``
    takes back a restore that was killed, or completes it: it counts once its copy is called ``.restored``.
    """
    if not copy.is_file():
        raise BackupError(f"{copy} is not there: choose a file of DATA/backups")
    recover(target)
    unfinished = target.with_name(f"{target.name}{_RESTORING}")
    try:
        # A copy without a log is read as it is: SQLite would write a log beside it, which a kill would leave there.
        alone = "" if copy.with_name(f"{copy.name}-wal").exists() else "&immutable=1"
        with closing(sqlite3.connect(f"file:{quote(str(copy))}?mode=ro{alone}", uri=True)) as source:
            _require_ours(source, copy)
            unfinished.touch(mode=FILE)
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


def recover(file: Path) -> list[str]:
    """Complete or take back what killed commands began at an SQLite database; return a sentence for each.

    For whoever has the data folder for itself. Leftovers of copies, new databases and imports are removed.
    """
    said = []
    if file.with_name(f"{file.name}{_RESTORED}").exists():
        _complete_restore(file)
        said.append("a restore that was cut short has been completed: the database is the backup now")
    unfinished = file.with_name(f"{file.name}{_RESTORING}")
    if unfinished.exists():
        _remove_with_logs(unfinished)
        said.append("a restore that was cut short has been taken back: the database is as it was before")
    backups = file.parent / "backups"
    leftovers = [*backups.glob(f"*{_UNFINISHED}"), *file.parent.glob(f"{file.name}.*.creating")]
    for leftover in leftovers:
        _remove_with_logs(leftover)
        said.append(f"{leftover.name} was removed: the command that wrote it was killed")
    for folder in file.parent.glob(f"{IMPORTING}*"):
        shutil.rmtree(folder, ignore_errors=True)
        said.append(f"{folder.name} was removed: the import that unpacked it was killed, and stored nothing")
    return said


def is_cut_short(file: Path) -> bool:
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
    kept = file.with_name(f"{file.stem}{BEFORE_RESTORE}{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}.db")
    for end in ("", "-wal", "-shm"):
        part = file.with_name(file.name + end)
        if part.exists():
            os.replace(part, kept.with_name(kept.name + end))


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


def check(engine: Engine) -> list[str]:
    """Return all that is wrong with a database, one sentence each; empty when it is sound."""
    found, newest = revision(engine), newest_revision()
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
