"""A tuning in force for a while only: the service puts the earlier one back, whatever has become of the page."""

import asyncio
from collections.abc import Awaitable, Callable

from backend.messages.state import TrialView
from backend.operating.tuning_in_use import TuningInUse, parts_of
from backend.supervision import KeptTask, Part, Supervision

_PART = Part("The clock of a tuning on trial", "The earlier tuning is put back at its time all the same.")


class Trial:
    """At most one trial at a time. ``put_back`` puts a tuning in force again, however often that takes."""

    def __init__(self, put_back: Callable[[TuningInUse], Awaitable[None]], supervision: Supervision) -> None:
        self._put_back = put_back
        self._supervision = supervision
        self._before: TuningInUse | None = None
        self._ends = 0.0
        self._duration_s = 0.0
        self._timer: KeptTask | None = None

    @property
    def before(self) -> TuningInUse | None:
        """What comes back at the end; None while nothing is tried."""
        return self._before

    def begin(self, before: TuningInUse, duration_s: float) -> None:
        """Count down from ``duration_s`` [s], then put ``before`` back."""
        self.forget()
        self._before, self._duration_s = before, duration_s
        self._ends = asyncio.get_running_loop().time() + duration_s
        self._timer = self._supervision.keep_task(_PART, lambda: self._count_down(before))

    def forget(self) -> None:
        """Let what is in force stay."""
        self._before = None
        if self._timer is not None and not self._timer.is_current:
            self._timer.cancel()
        self._timer = None

    def view(self) -> TrialView | None:
        """Return what the page shows of it."""
        if self._before is None:
            return None
        return TrialView(
            **parts_of(self._before.choice),
            remaining_s=max(0.0, self._ends - asyncio.get_running_loop().time()),
            duration_s=self._duration_s,
        )

    async def _count_down(self, before: TuningInUse) -> None:
        await asyncio.sleep(self._ends - asyncio.get_running_loop().time())
        await self._put_back(before)
