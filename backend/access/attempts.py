"""How often one address may try a wrong token, and how often it may begin a session with a right one.

A request with a right token is always answered, and who holds a viewer's token slows no operator down.
"""

import time
from collections import deque
from collections.abc import Callable

from backend.errors import Because, RefusalError

ATTEMPTS = 10
SIGN_INS = 60
"""Sessions that one address may begin in a minute with the token of one role: a class of students at one machine."""

ATTEMPTS_WINDOW_S = 60.0
ADDRESSES = 1000


class Attempts:
    """What was tried within the last minute, by address; ``of`` says of what there were too many."""

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, *, most: int = ATTEMPTS, of: str = "wrong tokens"
    ) -> None:
        self._clock, self._most, self._of = clock, most, of
        self._tried: dict[str, deque[float]] = {}

    def count(self, address: str) -> None:
        """Count one more. Raises RefusalError where there were too many of them."""
        tried = self._recent(address)
        if len(tried) >= self._most:
            wait_s = int(tried[0] + ATTEMPTS_WINDOW_S - self._clock()) + 1
            raise RefusalError(Because.TOO_MANY, f"too many {self._of}; try again in {wait_s} s", retry_after_s=wait_s)
        tried.append(self._clock())

    def _recent(self, address: str) -> deque[float]:
        oldest = self._clock() - ATTEMPTS_WINDOW_S
        for known in [key for key, times in self._tried.items() if not times or times[-1] < oldest]:
            del self._tried[known]
        while len(self._tried) >= ADDRESSES:
            del self._tried[next(iter(self._tried))]
        tried = self._tried.setdefault(address, deque(maxlen=self._most))
        while tried and tried[0] < oldest:
            tried.popleft()
        return tried
