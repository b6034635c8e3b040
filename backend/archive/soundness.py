"""Whether the database of this service is whole and in its place; looked at from the start on."""

import logging
import os
import threading
from contextlib import suppress
from pathlib import Path

from backend.storage.database import Database, is_small, require_whole
from backend.storage.orm import DamagedError, StorageError

NICENESS = 10
_log = logging.getLogger(__name__)


class Soundness:
    """Looks after the database of one data folder. ``problem`` says what is wrong with its pages."""

    def __init__(self, database: Database, data: Path) -> None:
        self.problem = ""
        self._database = database
        self._data = data
        self._is_due = database.file is not None
        self._thread: threading.Thread | None = None

    def before_start(self) -> None:
        """Check all of a small database. Raises DamagedError, with the way back."""
        if self._database.file is not None and is_small(self._database.file):
            require_whole(self._database, self._data)
            self._is_due = False

    def start(self) -> None:
        """Check all of a large database while the service works."""
        if self._is_due:
            # A thread of its own, as its niceness stays with it; nobody waits for it when the service ends.
            self._thread = threading.Thread(target=self._look, name="database check", daemon=True)
            self._thread.start()

    def wait(self, timeout_s: float) -> None:
        """Wait for the check of a large database."""
        if self._thread is not None:
            self._thread.join(timeout_s)

    def displaced(self) -> str:
        """Return why what is written is not kept where anybody finds it, "" while all is well."""
        try:
            self._database.require_in_place()
        except StorageError as error:
            return str(error)
        return ""

    def _look(self) -> None:
        with suppress(PermissionError):  # of this thread alone: the recorder comes first
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        try:
            require_whole(self._database, self._data)
        except DamagedError as error:
            self.problem = f"{error}. Stop the service first"
            _log.error(self.problem)
        except Exception as error:
            self.problem = f"the database could not be checked: {error}"
            _log.exception("the check of the database failed")
