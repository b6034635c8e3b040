"""A tuning in force for a while only: the service puts the earlier one back, whatever has become of the page.

A trial ends at its time, or earlier when the mode or the person in control changes: nobody watches it any more then.
"""

import asyncio
from collections.abc import Awaitable, Callable

from backend.operating.tuning_in_use import TuningInUse, parts_of
from backend.schemas.state import TrialView
from backend.supervision import KeptTask, Part, Supervision

_PART = Part("The clock of a tuning on trial", "The earlier tuning is put back at its time all the same.")


class Trial:
    """At most one trial at a time. ``put_back`` gets a tuning to put in force again and why the trial ends."""

    def __init__(self, put_back: Callable[[TuningInUse, str], Awaitable[None]], supervision: Supervision) -> None:
        self._put_back = put_back
        self._supervision = supervision
        self._before: TuningInUse | None = None
        self._ends = 0.0
        self._duration_s = 0.0
        self._timer: KeptTask | None = None
        self._cause: asyncio.Future[str] | None = None

    @property
    def before(self) -> TuningInUse | None:
        """What comes back at the end; None while nothing is tried."""
        return self._before

    def begin(self, before: TuningInUse, duration_s: float) -> None:
        """Count down from ``duration_s`` [s], then put ``before`` back."""
        self.forget()
        self._before, self._duration_s = before, duration_s
        self._ends = asyncio.get_running_loop().time() + duration_s
        self._cause = asyncio.get_running_loop().create_future()
        self._timer = self._supervision.keep_task(_PART, lambda: self._count_down(before))

    def forget(self) -> None:
        """Let what is in force stay."""
        self._before = self._cause = None
        if self._timer is not None and not self._timer.is_current:
            self._timer.cancel()
        self._timer = None

    def end(self, cause: str) -> None:
        """Put back what was before at once, because of ``cause``; nothing happens where nothing is on trial."""
        if self._cause is not None and not self._cause.done():
            self._cause.set_result(cause)

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
        """Wait for the time or for a cause; a task that is started again after it died finds what is left of both."""
        cause = self._cause
        if cause is None:
            return
        await asyncio.wait([cause], timeout=max(0.0, self._ends - asyncio.get_running_loop().time()))
        await self._put_back(before, cause.result() if cause.done() else "")
