"""Maintenance: database, backups, disk space of recordings, view of the machine."""

import asyncio
import logging
import os
import platform
import shutil
import threading
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

from backend import __version__
from backend.realtime import LATENESS_EDGES_S, Supervisor, count_lateness
from backend.recording import Overview, RetentionRule, delete_recordings, summarize_retention
from backend.schemas import (
    BackupView,
    DatabaseCheck,
    DatabaseView,
    DeletableRun,
    LatenessClass,
    RecordingsView,
    SystemView,
)
from backend.services import record_messages
from backend.storage import (
    DamagedError,
    Database,
    EventKind,
    StorageError,
    backup_database,
    events,
    find_database_errors,
    is_quick_to_check,
    next_backup_path,
    read_revision,
    require_intact_database,
)
from backend.supervision import Part

# Maintenance ---------------------------------------------------------------------------------------


_PACKAGES = ("numpy", "scipy", "numba", "fastapi", "sqlalchemy", "viser")


class Maintenance:
    """Checks and copies the database of one data folder, for the page System.

    All methods wait for the disk: the event loop calls them in a thread.
    """

    def __init__(self, database: Database, data: Path, supervisor: Supervisor) -> None:
        self._database = database
        self._data = data
        self._supervisor = supervisor

    def describe_system(self) -> SystemView:
        """Return machine, software versions, database and backups."""
        ring = self._supervisor.ring
        edges_us = [1e6 * edge for edge in LATENESS_EDGES_S]
        copies = sorted(next_backup_path(self._data).parent.glob("*.db"), reverse=True)
        return SystemView(
            granted=self._supervisor.granted,
            lateness=[
                LatenessClass(from_us=low, to_us=high if high < float("inf") else None, ticks=ticks)
                for (low, high), ticks in zip(pairwise(edges_us), count_lateness(ring), strict=True)
            ],
            versions=_list_versions(),
            database=self._build_database_view(),
            backups=[_build_backup_view(copy) for copy in copies],
        )

    def check_database(self) -> DatabaseCheck:
        """Check the whole database."""
        return DatabaseCheck(problems=find_database_errors(self._database.engine))

    def back_up_database(self, who: str) -> BackupView:
        """Copy the database to the data folder. Raises BackupError."""
        target = next_backup_path(self._data)
        backup_database(self._database.engine, target)
        # a database that cannot be written to still needs a copy: the missing log entry is no error
        with suppress(StorageError), self._database.session() as session:
            events.add(session, EventKind.BACKUP, record_messages.database_copied(name=target.name), who=who)
        return _build_backup_view(target)

    def _build_database_view(self) -> DatabaseView:
        engine = self._database.engine
        file = engine.url.database if engine.dialect.name == "sqlite" else None
        return DatabaseView(
            kind=engine.dialect.name,
            schema_revision=read_revision(engine),
            size_bytes=_measure_database_size(Path(file)) if file else None,
            disk_free_bytes=shutil.disk_usage(self._data).free,
        )


@cache
def _list_versions() -> dict[str, str]:
    own = {"Sinew": __version__, "Python": platform.python_version(), "Linux": platform.release()}
    return own | {name: version(name) for name in _PACKAGES}


def _measure_database_size(file: Path) -> int:
    """Return the size of an SQLite file with its write-ahead log [bytes]."""
    log = file.with_name(f"{file.name}-wal")
    return file.stat().st_size + (log.stat().st_size if log.is_file() else 0)


def _build_backup_view(copy: Path) -> BackupView:
    known = copy.stat()
    return BackupView(name=copy.name, at=datetime.fromtimestamp(known.st_mtime, UTC), size_bytes=known.st_size)


# Retention -----------------------------------------------------------------------------------------


MAINTENANCE_PART = Part("The disk-space check for recordings", "Recordings may exceed their limit unnoticed.")

CHECK_PERIOD_S = 600.0
"""Period of the check of the sizes [s]; a recording grows by 80 MB an hour."""


class Retention:
    """Monitors the size of the recordings; ``problem`` is set above the limit.

    Deletes the samples of runs only when a person names the runs.
    """

    def __init__(self, database: Database, rule: RetentionRule) -> None:
        self.problem = ""
        self._database = database
        self._rule = rule

    async def run(self) -> None:
        """Check periodically until cancelled."""
        while True:
            try:
                await asyncio.to_thread(self.summarize_recordings)
            except StorageError as error:
                self.problem = record_messages.size_of_recordings_unknown(reason=error.message)
            await asyncio.sleep(CHECK_PERIOD_S)

    def summarize_recordings(self) -> RecordingsView:
        """Return the size of the recordings and which may be deleted. Raises StorageError."""
        return self._build_view(summarize_retention(self._database, self._rule))

    def delete_samples(self, run_ids: list[int], who: str) -> RecordingsView:
        """Delete the samples of exactly these runs.

        Raises NotRemovableError, StorageError.
        """
        return self._build_view(delete_recordings(self._database, self._rule, run_ids, who))

    def _build_view(self, found: Overview) -> RecordingsView:
        self.problem = found.describe
        return RecordingsView(
            total_bytes=found.total_bytes,
            limit_bytes=found.rule.max_bytes,
            in_use_bytes=found.in_use_bytes,
            keep_days=found.rule.keep_days,
            may_go=[
                DeletableRun(
                    run=run.run_id,
                    kind=run.kind,
                    who=run.who,
                    note=run.note,
                    started=run.started_at,
                    size_bytes=run.size_bytes,
                )
                for run in found.may_go
            ],
            says=found.describe,
        )


# Database monitor ----------------------------------------------------------------------------------


NICENESS = 10
_log = logging.getLogger(__name__)


class DatabaseMonitor:
    """Checks that the database is intact and in its place; ``problem`` is a message.

    A small database is checked before the start, a large one in a thread while the service runs.
    """

    def __init__(self, database: Database, data: Path) -> None:
        self.problem = ""
        self._database = database
        self._data = data
        self._is_due = database.file is not None
        self._thread: threading.Thread | None = None

    def check_small_database(self) -> None:
        """Check the whole database if it is small.

        Raises DamagedError, whose message describes the recovery.
        """
        if self._database.file is not None and is_quick_to_check(self._database.file):
            require_intact_database(self._database, self._data)
            self._is_due = False

    def start_check(self) -> None:
        """Start the check of a large database."""
        if self._is_due:
            # A thread of its own, which keeps its niceness; the end of the service does not wait for it.
            self._thread = threading.Thread(target=self._check_database, name="database check", daemon=True)
            self._thread.start()

    def wait_for_check(self, timeout_s: float) -> None:
        """Wait for the check of a large database."""
        if self._thread is not None:
            self._thread.join(timeout_s)

    def describe_displacement(self) -> str:
        """Return why the database file was moved or replaced, "" if it is in its place."""
        try:
            self._database.require_in_place()
        except StorageError as error:
            return str(error)
        return ""

    def _check_database(self) -> None:
        with suppress(PermissionError):  # for this thread only: the recorder has priority
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        try:
            require_intact_database(self._database, self._data)
        except DamagedError as error:
            self.problem = record_messages.damaged_database(reason=error.message)
            _log.error(self.problem)
        except Exception as error:
            self.problem = record_messages.database_not_checked(reason=str(error))
            _log.exception("The check of the database failed.")
