"""How often a wrong token may be tried from one address. Only wrong ones are slowed: the right one always opens."""

import time
from collections import deque
from collections.abc import Callable

from backend.refusal import Because, RefusalError

ATTEMPTS = 10
ATTEMPTS_WINDOW_S = 60.0
ADDRESSES = 1000


class Attempts:
    """Wrong tokens of the last minute, by address."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: dict[str, deque[float]] = {}

    def failed(self, address: str) -> None:
        """Count a wrong token. Raises RefusalError where there were too many of them."""
        failures = self._recent(address)
        if len(failures) >= ATTEMPTS:
            wait_s = int(failures[0] + ATTEMPTS_WINDOW_S - self._clock()) + 1
            raise RefusalError(
                Because.TOO_MANY, f"too many wrong tokens; try again in {wait_s} s", retry_after_s=wait_s
            )
        failures.append(self._clock())

    def _recent(self, address: str) -> deque[float]:
        oldest = self._clock() - ATTEMPTS_WINDOW_S
        for known in [key for key, times in self._failures.items() if not times or times[-1] < oldest]:
            del self._failures[known]
        while len(self._failures) >= ADDRESSES:
            del self._failures[next(iter(self._failures))]
        failures = self._failures.setdefault(address, deque(maxlen=ATTEMPTS))
        while failures and failures[0] < oldest:
            failures.popleft()
        return failures
