"""The System page's view of machine and database, and copies of the database while it is in use."""

import asyncio
import platform
import shutil
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

from backend import __version__
from backend.realtime.supervisor import Supervisor
from backend.realtime.timing import LATENESS_EDGES_S, lateness_histogram
from backend.schemas.state import BackupView, DatabaseCheck, DatabaseView, GrantedView, LatenessClass, SystemView
from backend.storage import events
from backend.storage.database import Database, backup, check, next_copy, revision
from backend.storage.events import EventKind
from backend.storage.orm import StorageError

_PACKAGES = ("numpy", "scipy", "numba", "fastapi", "sqlalchemy", "viser")


class Maintenance:
    """Looks after the database of one data folder; the work is done in threads."""

    def __init__(self, database: Database, data: Path, supervisor: Supervisor) -> None:
        self._database = database
        self._data = data
        self._supervisor = supervisor

    async def view(self) -> SystemView:
        """Return what the System page shows beside the state."""
        return await asyncio.to_thread(self._view)

    async def check(self) -> DatabaseCheck:
        """Check the whole database."""
        return DatabaseCheck(problems=await asyncio.to_thread(check, self._database.engine))

    async def backup(self, who: str) -> BackupView:
        """Copy the database to the data folder. Raises BackupError."""
        return await asyncio.to_thread(self._backup, who)

    def _backup(self, who: str) -> BackupView:
        target = next_copy(self._data)
        backup(self._database.engine, target)
        # a database that takes nothing more is one to make copies of: the copy counts
        with suppress(StorageError), self._database.session() as session:
            events.add(session, EventKind.BACKUP, f"database copied to {target.name}", who=who)
        return _backup_view(target)

    def _view(self) -> SystemView:
        granted, ring = self._supervisor.granted, self._supervisor.ring
        edges_us = [1e6 * edge for edge in LATENESS_EDGES_S]
        copies = sorted(next_copy(self._data).parent.glob("*.db"), reverse=True)
        return SystemView(
            granted=None
            if granted is None
            else GrantedView(
                priority=granted.priority,
                memory_locked=granted.memory_locked,
                timer_slack_ns=granted.timer_slack_ns,
                refusals=list(granted.refusals),
            ),
            lateness=[
                LatenessClass(from_us=low, to_us=high if high < float("inf") else None, ticks=ticks)
                for (low, high), ticks in zip(pairwise(edges_us), lateness_histogram(ring), strict=True)
            ],
            versions=_versions(),
            database=self._database_view(),
            backups=[_backup_view(copy) for copy in copies],
        )

    def _database_view(self) -> DatabaseView:
        engine = self._database.engine
        file = engine.url.database if engine.dialect.name == "sqlite" else None
        return DatabaseView(
            kind=engine.dialect.name,
            schema_revision=revision(engine),
            size_bytes=_size_with_log(Path(file)) if file else None,
            disk_free_bytes=shutil.disk_usage(self._data).free,
        )


@cache
def _versions() -> dict[str, str]:
    own = {"Sinew": __version__, "Python": platform.python_version(), "Linux": platform.release()}
    return own | {name: version(name) for name in _PACKAGES}


def _size_with_log(file: Path) -> int:
    """Size of an SQLite file with what still stands in its write-ahead log."""
    log = file.with_name(f"{file.name}-wal")
    return file.stat().st_size + (log.stat().st_size if log.is_file() else 0)


def _backup_view(copy: Path) -> BackupView:
    known = copy.stat()
    return BackupView(name=copy.name, at=datetime.fromtimestamp(known.st_mtime, UTC), size_bytes=known.st_size)
