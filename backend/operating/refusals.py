"""Refused commands in the log: who asked for what, and why it was refused; a flood of them is counted."""

from collections import Counter
from collections.abc import Callable
from typing import Protocol

from backend.operating.journal import Journal
from backend.plain_text import as_line
from backend.storage.events import EventKind

MOST = 10
"""Different refusals that get an entry of their own in a window; what repeats one of them is counted beside it."""

WINDOW_S, LONGEST_WINDOW_S = 10.0, 600.0
"""A window [s] doubles as long as one follows the other with something that was only counted: at most some
thousand entries come of a day of refused commands."""

TEXT_MAX = 500
"""Longest entry [characters]: the reason may repeat what was asked for."""


class Clock(Protocol):
    """What calls later: an event loop."""

    def __call__(self, delay: float, callback: Callable[[], None], /) -> object:
        """Call ``callback`` after ``delay`` [s]."""
        ...


class Refusals:
    """Writes refusals into the journal; ``call_later`` ends a window."""

    def __init__(self, journal: Journal, call_later: Clock) -> None:
        self._journal, self._call_later = journal, call_later
        self._window_s = WINDOW_S
        self._told: set[tuple[str, str]] = set()
        self._again: Counter[tuple[str, str]] = Counter()
        self._others = 0

    def note(self, what: str, reason: str, who: str) -> None:
        """Keep that ``what`` was refused to ``who``; the reason has angles in SI, as all texts of the log."""
        text = as_line(f"{what} refused: {reason}")
        entry = (text if len(text) <= TEXT_MAX else f"{text[: TEXT_MAX - 1]}…", who)
        if entry in self._told:
            self._again[entry] += 1
        elif len(self._told) == MOST:
            self._others += 1
        else:
            if not self._told:
                self._call_later(self._window_s, self.close)
            self._told.add(entry)
            self._record(*entry)

    def close(self) -> None:
        """End the window: tell how often each of its refusals came again, and how many others came."""
        for (text, who), count in self._again.items():
            self._record(f"{text} ({_times(count)} more in {self._window_s:g} s)", who)
        if self._others:
            commands = "command was" if self._others == 1 else "commands were"
            self._record(f"{self._others} further {commands} refused in {self._window_s:g} s", "")
        flooded = bool(self._again or self._others)
        self._window_s = min(2.0 * self._window_s, LONGEST_WINDOW_S) if flooded else WINDOW_S
        self._told.clear()
        self._again.clear()
        self._others = 0

    def _record(self, text: str, who: str) -> None:
        self._journal.record(EventKind.REFUSAL, text, who)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
