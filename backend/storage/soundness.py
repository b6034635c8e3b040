"""The file under an SQLite database: whether it is there, is still the one that was opened, and is whole.

SQLite would make a new file in place of one that is gone or empty, and goes on writing to one that was deleted.
"""

import os
import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import quote

from sqlalchemy import Engine

from backend.storage.errors import DamagedError, GoneError
from backend.storage.maintenance import BEFORE_RESTORE

CHECKED_AT_START_BYTES = 64 * 1024**2
"""Up to here a start waits until the whole file was looked at: seconds from a slow disk, 0.1 s where it is cached."""

NEWEST_BACKUPS = 3

Identity = tuple[int, int]


def file_of(engine: Engine) -> Path | None:
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
        raise GoneError(_gone(file, error.strerror or str(error))) from None
    return known.st_dev, known.st_ino


def require_in_place(file: Path, opened: Identity) -> None:
    """Raise GoneError unless ``file`` is still the one that was opened, with the log that SQLite keeps beside it."""
    if identity(file) != opened:
        raise GoneError(_gone(file, "another file stands in its place"))
    log = _log_of(file)
    if not log.exists() and _is_open_though_deleted(log):
        raise GoneError(_gone(log, "it was deleted"))


def require_usable(file: Path, backups: Path) -> bool:
    """Return whether a database is there. Raises DamagedError for what would silently be replaced by an empty one."""
    if file.is_file():
        if file.stat().st_size == 0:
            raise DamagedError(f"{file} is empty (0 bytes): something cut it off; {way_back(file, backups)}")
        return True
    if _log_of(file).is_file() and _log_of(file).stat().st_size:
        raise DamagedError(
            f"{file} is gone, but the log beside it ({_log_of(file).name}) is still there: "
            f"put the database back; or {way_back(file, backups)}"
        )
    if traces := traces_of(file, backups):
        named = ", ".join(trace.name for trace in sorted(traces)[-NEWEST_BACKUPS:])
        raise DamagedError(
            f"{file} is gone, but copies of it are still there ({named}): no empty database is made in its place. "
            f"Put the database back; or {way_back(file, backups)}; or choose another --data to begin with an empty one"
        )
    return file.exists()


def traces_of(file: Path, backups: Path) -> list[Path]:
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
        raise DamagedError(f"{file} is damaged ({' '.join(found[0].split())}): {way_back(file, backups)}")


def is_small(file: Path) -> bool:
    """Return whether a check of the whole file may hold up the start."""
    return file.stat().st_size <= CHECKED_AT_START_BYTES


def way_back(file: Path, backups: Path) -> str:
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


def _log_of(file: Path) -> Path:
    return file.with_name(f"{file.name}-wal")


def _gone(file: Path, why: str) -> str:
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
