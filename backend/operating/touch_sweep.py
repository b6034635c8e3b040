"""Learning what the outside force reads with nothing outside, over all of the stiffness by itself.

In run, with nobody at the joint: S_ref goes through SWEEP_POINTS, waits at each until joint, stiffness and estimate
are at rest, learns there, and is then put back. Whatever else moves the joint ends it; what was learned so far stays.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from backend.errors import Because, RefusalError
from backend.operating.journal import Journal
from backend.operating.present_state import PresentState
from backend.operating.touch_rest import DRIFT_N, LEARNED_TICKS, drift, touched_by, why_not
from backend.realtime.commands import Accepted, Command, SetReferences
from backend.realtime.program import Mode
from backend.realtime.supervisor import LoopDiedError, Supervisor
from backend.sample import INDEX
from backend.schemas.state import MarkKind, SweepView
from backend.units import in_digits
from plant.interface import T_s

SWEEP_POINTS = 5
"""From the least to the largest S_ref; on ``lab`` straight lines between them are within 0.01 N of the bias."""

LONGEST_S = 20.0
"""How long a point may take to come to rest [s]; the slowest λ_S that is usual takes half of it."""

_LOOK_S = 0.1
_NEAR_S = 0.2
"""So near to what was asked for [N·m/rad] the stiffness has to come."""

_LOG = logging.getLogger(__name__)


class TouchSweep:
    """Belongs to the service's event loop. ``learn`` learns at the stiffness that is held, of samples since a tick.

    ``problem`` says that the last one died, until another is begun.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        present: PresentState,
        journal: Journal,
        command: Callable[[Command], Awaitable[Accepted]],
        learn: Callable[[int], Awaitable[None]],
        changed: Callable[[], None],
    ) -> None:
        self._supervisor, self._present, self._journal = supervisor, present, journal
        self._command, self._learn, self._changed = command, learn, changed
        self._view: SweepView | None = None
        self._task: asyncio.Task[None] | None = None
        self._held = (0.0, 0.0)
        self.problem = ""

    @property
    def under_way(self) -> bool:
        """Whether it goes on at present."""
        return self._view is not None and self._view.under_way

    def view(self) -> SweepView | None:
        """Return how far it is or how the last one ended, None where there was none."""
        return self._view

    def forget(self) -> None:
        """Say no more of the last one, which has ended."""
        self._view, self.problem = None, ""

    async def begin(self, who: str) -> None:
        """Go to the first point and on from there. Raises RefusalError where the joint is not held untouched in run."""
        _, rows, _ = self._supervisor.ring.read(max(self._supervisor.ring.count - 1, 0), 1)
        why = self._why_not_now(rows)
        if why:
            raise RefusalError(Because.NOT_NOW, f"nothing is learned over S: {why}")
        bounds = self._present.bounds
        points = np.linspace(bounds.S_min, bounds.S_max, SWEEP_POINTS).tolist()
        q_ref, S_ref = (float(rows[-1, INDEX[name]]) for name in ("q_ref", "S_ref"))
        self._held, self.problem = (q_ref, S_ref), ""
        self._show(1, points[0])
        try:
            accepted = await self._go(points[0], who)
        except BaseException:
            self._view = None
            raise
        if self.under_way:  # nobody has done something else meanwhile
            self._task = asyncio.create_task(self._walk(points, accepted.tick, who), name="learning over S")

    async def stop(self, who: str) -> None:
        """Break off and put S_ref back. Raises RefusalError where there is nothing to stop."""
        if not self.under_way:
            raise RefusalError(Because.NOT_NOW, "nothing is being learned over S: there is nothing to stop")
        self.break_off("it was stopped", who)
        await self._put_back()

    def break_off(self, why: str, who: str = "") -> None:
        """End it at once and say why, where it goes on; S_ref stays as it is."""
        if not self.under_way:
            return
        self._end(why, who)
        if self._task is not None:
            self._task.cancel()

    async def _walk(self, points: list[float], since: int, who: str) -> None:
        why = ""
        try:
            for number, S_ref in enumerate(points, 1):
                if number > 1:
                    self._show(number, S_ref)
                    since = (await self._go(S_ref, who)).tick
                await self._rest(S_ref, since)
                # a reference that ends it meanwhile leaves loop and service of one mind about what is learned
                await asyncio.shield(self._learn(since))
        except asyncio.CancelledError:
            if not self.under_way:  # who ended it has said so
                raise
            why = self._died("its task was cancelled")
        except (RefusalError, LoopDiedError) as error:
            why = str(error)
        except Exception as error:
            _LOG.exception("learning over S died")
            why = self._died(f"{type(error).__name__}: {error}")
        try:
            await self._put_back()
        finally:  # whatever becomes of that, it is not shown as going on
            self._end(why)

    def _died(self, cause: str) -> str:
        self.problem = f"Learning over S died ({cause}): what was learned until then stays. Begin it again."
        return f"it died ({cause})"

    async def _rest(self, S_ref: float, since: int) -> None:
        """Wait until there is something to learn from. Raises RefusalError for what acts, or after LONGEST_S."""
        ring, why = self._supervisor.ring, ""
        end = ring.count + round(LONGEST_S / T_s)
        while ring.count < end:
            await self._supervisor.advance(_LOOK_S)
            _, rows, _ = ring.read(max(ring.count - LEARNED_TICKS, 0), LEARNED_TICKS)
            touched = touched_by(rows[-round(_LOOK_S / T_s) :])
            if touched:
                raise RefusalError(Because.NOT_NOW, touched)
            why = why_not(rows, since) or _restless(rows, S_ref)
            if not why:
                return
        raise RefusalError(
            Because.NOT_NOW,
            f"at {in_digits(S_ref)} N·m/rad nothing could be learned within {LONGEST_S:g} s: {why}",
        )

    async def _go(self, S_ref: float, who: str = "", why: str = "to learn the outside force") -> Accepted:
        accepted = await self._command(SetReferences(self._held[0], S_ref))
        self._journal.note(MarkKind.REFERENCES, f"S_ref {in_digits(S_ref, 4)} N·m/rad, {why}", accepted.tick, who)
        return accepted

    async def _put_back(self) -> None:
        """Hold S as it was before, where the joint is still held for it."""
        if self._present.mode is Mode.RUN and self._supervisor.alive:
            with suppress(RefusalError, LoopDiedError):
                await self._go(self._held[1], why="as before learning")

    def _show(self, point: int, S_ref: float) -> None:
        self._view = SweepView(under_way=True, point=point, points=SWEEP_POINTS, S_ref=S_ref, why="")
        self._changed()

    def _end(self, why: str, who: str = "") -> None:
        view = self._view
        if view is None or not view.under_way:
            return
        self._view = view.model_copy(update={"under_way": False, "why": why})
        at = f"at point {view.point} of {view.points}, {in_digits(view.S_ref)} N·m/rad"
        text = f"learning over S ended {at}: {why}" if why else f"learned over S at {view.points} points"
        self._journal.note(MarkKind.FAULT if self.problem else MarkKind.NOTE, text, self._present.tick, who)
        self._changed()

    def _why_not_now(self, rows: NDArray[np.float64]) -> str:
        """Why it cannot begin; ``rows`` is the newest sample."""
        task = self._present.task
        if self.under_way:
            return "that is under way already"
        if task is not None:
            return f"run {task.run}, {task.kind}, is under way: wait for its end or stop it"
        if self._present.mode is not Mode.RUN:
            return f"the joint has to be held in run, and the mode is {self._present.mode}"
        if self._present.touch().contact_N:
            return "the joint gives way to contacts: let it hold on first"
        if not np.all(np.isfinite(rows[-1:, INDEX["F_ext_hat"]])):
            return "the outside force is not known yet, the motors' zeros come with pretension"
        return touched_by(rows)


def _restless(rows: NDArray[np.float64], S_ref: float) -> str:
    """Why the estimate is not at rest at ``S_ref`` [N·m/rad], though joint and stiffness are; empty where it is."""
    S, moved = float(rows[:, INDEX["S"]].mean()), drift(rows)
    if not abs(S - S_ref) <= _NEAR_S:
        return f"the stiffness stands at {S:.2f} N·m/rad"
    if not moved <= DRIFT_N:
        return f"the estimate moves by {moved:.2f} N in half a second, {DRIFT_N:g} N is at rest"
    return ""
