"""The log of the service: one handler, at a limited rate, without control codes.

The rate limit keeps clients from filling the disk with log lines.
"""

import logging
import time
from collections.abc import Callable
from threading import Lock
from typing import Literal

from backend.plain_text import escape_line, escape_lines
from backend.units import AngleUnit, format_text

LINES_PER_WINDOW = 5
WINDOW_S = 30.0
"""Of each kind of line, ``LINES_PER_WINDOW`` are written per window [s].

The first line of the next window gives the number of omitted ones.
"""

MAX_KINDS = 500
"""Number of kinds of lines that the rate limit remembers."""

Level = Literal["debug", "info", "warning", "error"]
"""Least level that is written."""

_ALWAYS = "always"
EVENT = {_ALWAYS: True}
"""``extra`` of a line that the rate limit never omits: an event of the service."""

_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


class RateLimit(logging.Filter):
    """Limits the rate of each kind of line.

    A kind is one place in the code with one type of exception.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._lock = Lock()
        self._kinds: dict[object, tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether to write ``record``; events of the service always are."""
        if record.__dict__.get(_ALWAYS, False):
            return True
        error = record.exc_info[0] if record.exc_info else None
        kind = (record.name, record.pathname, record.lineno, error)
        now = self._clock()
        with self._lock:
            window_start, count = self._kinds.pop(kind, (now, 0))
            if now - window_start >= WINDOW_S:
                if count > LINES_PER_WINDOW:
                    record.msg = f"{record.getMessage()} [{count - LINES_PER_WINDOW} similar messages were omitted]"
                    record.args = ()
                window_start, count = now, 0
            self._kinds[kind] = (window_start, count + 1)
            while len(self._kinds) > MAX_KINDS:
                del self._kinds[next(iter(self._kinds))]
        if count + 1 == LINES_PER_WINDOW:
            record.msg = f"{record.getMessage()} [similar messages are omitted for {WINDOW_S:.0f} s]"
            record.args = ()
        return count < LINES_PER_WINDOW


class _EscapingFormatter(logging.Formatter):
    """Writes each message on one line, with control characters as escapes."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # as its parent calls it
        """Return the line of a record, without its traceback."""
        record.message = escape_line(format_text(record.message, AngleUnit.RADIANS))
        return super().formatMessage(record)

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record with its traceback."""
        return escape_lines(super().format(record))


def configure_logging(level: Level = "warning") -> None:
    """Write records from ``level`` on to standard error, through the rate limit.

    Records below warning are written for Sinew's own packages only, not for libraries.
    """
    handler = logging.StreamHandler()
    handler.setLevel(level.upper())
    handler.addFilter(RateLimit())
    handler.setFormatter(_EscapingFormatter(_FORMAT))
    logging.basicConfig(level=logging.WARNING, handlers=[handler], force=True)
    for package in ("backend", "plant"):
        logging.getLogger(package).setLevel(level.upper())
