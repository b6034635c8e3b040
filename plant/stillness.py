"""For how long nothing has changed, on a machine that may itself stand still."""

import time
from collections.abc import Hashable


class Stillness:
    """For how long something has not changed, to one who looks every ``period_s`` [s].

    A longer time between two looks counts as two periods: the machine stood still then, and nobody could have moved.
    """

    def __init__(self, period_s: float) -> None:
        self._most_s = 2.0 * period_s
        self._seen: Hashable = None
        self._looked_s = 0.0
        self.still_s = 0.0

    def seen(self, value: Hashable, now_s: float | None = None) -> float:
        """Return how long ``value`` has been the same [s]; ``now_s`` is the monotonic clock."""
        now_s = time.monotonic() if now_s is None else now_s
        self.still_s = self.still_s + min(now_s - self._looked_s, self._most_s) if value == self._seen else 0.0
        self._seen, self._looked_s = value, now_s
        return self.still_s
