"""One log for the whole service, which nobody outside can make grow without end."""

import logging
import time
from collections.abc import Callable
from threading import Lock
from typing import Literal

from backend.plain_text import as_line, as_lines

LINES = 5
WINDOW_S = 30.0
"""Of one kind of line, ``LINES`` are written in each window; the next one after it says how many were left out."""

KINDS = 500
"""Kinds of lines that are remembered."""

Level = Literal["debug", "info", "warning", "error"]
"""Least level that is written."""

_ALWAYS = "always"
EVENT = {_ALWAYS: True}
"""``extra`` of a line that is written however many there are of its kind: an event of the service."""

_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


class RateLimit(logging.Filter):
    """Lets pass few lines of each kind: those of one place in the code, about one type of exception."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._lock = Lock()
        self._kinds: dict[object, tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether to write ``record``; an event of the service is written always."""
        if record.__dict__.get(_ALWAYS, False):
            return True
        error = record.exc_info[0] if record.exc_info else None
        kind = (record.name, record.pathname, record.lineno, error)
        now = self._clock()
        with self._lock:
            begun, count = self._kinds.pop(kind, (now, 0))
            if now - begun >= WINDOW_S:
                if count > LINES:
                    record.msg = f"{record.getMessage()} [{count - LINES} more like this were left out]"
                    record.args = ()
                begun, count = now, 0
            self._kinds[kind] = (begun, count + 1)
            while len(self._kinds) > KINDS:
                del self._kinds[next(iter(self._kinds))]
        if count + 1 == LINES:
            record.msg = f"{record.getMessage()} [more like this are left out for {WINDOW_S:.0f} s]"
            record.args = ()
        return count < LINES


class _Lines(logging.Formatter):
    """Writes each message on one line; what a terminal would obey, there and in a traceback, as an escape."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # as its parent calls it
        """Return the line of a record."""
        record.message = as_line(record.message)
        return super().formatMessage(record)

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record, and its traceback."""
        return as_lines(super().format(record))


def begin(level: Level = "warning") -> None:
    """Write ``level`` and above to standard error, through one handler with the limit.

    Below warning, lines of Sinew alone: those of libraries say nothing of the service.
    """
    handler = logging.StreamHandler()
    handler.setLevel(level.upper())
    handler.addFilter(RateLimit())
    handler.setFormatter(_Lines(_FORMAT))
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)
    for package in ("backend", "plant"):
        logging.getLogger(package).setLevel(level.upper())
