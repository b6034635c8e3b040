"""Touch: what the estimate of the outside force has learned, and whether the joint gives way to a contact.

Both hold for one loop process and the zeros of its motors: what is learned is how springs and zeros differ from what
was identified. A new loop, or zeros found anew, begins with nothing learned and gives way to nothing.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable

import numpy as np

from backend.control import disturbance_observer
from backend.errors import Because, RefusalError, require_within
from backend.operating.journal import Journal
from backend.operating.present_state import PresentState
from backend.operating.touch_rest import LEARNED_TICKS, why_not
from backend.operating.touch_sweep import TouchSweep
from backend.realtime import commands
from backend.realtime.commands import Accepted, Command, Event, ModeChanged
from backend.realtime.program import CONTACT_MAX_N, CONTACT_MIN_N, NEIGHBOUR, SIGMAS, Cause, ContactFelt, TouchForgotten
from backend.realtime.supervisor import LoopDied, Supervisor
from backend.sample import INDEX
from backend.schemas.state import ContactView, MarkKind, TouchOrder, TouchPoint, TouchView
from backend.units import in_digits


class Touching:
    """Learns, arms and shows. Belongs to the service's event loop.

    ``changed`` is called when there is news, ``forgotten`` when the loop knows nothing any more.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        present: PresentState,
        journal: Journal,
        command: Callable[[Command], Awaitable[Accepted]],
        changed: Callable[[], None],
        starting: asyncio.Lock,
        forgotten: Callable[[], None],
    ) -> None:
        self.sweep = TouchSweep(supervisor, present, journal, command, self._learn_on, changed)
        self._supervisor = supervisor
        self._journal = journal
        self._command = command
        self._changed = changed
        self._forgotten = forgotten
        self._turn, self._starting = asyncio.Lock(), starting
        self._points: list[TouchPoint] = []
        self._contact_N = 0.0
        self._felt: ContactView | None = None
        self._since = 0
        supervisor.listen(self._hear)

    def view(self) -> TouchView:
        """Return what is learned and armed, and the contact that the joint gives way to."""
        sweep = self.sweep.view()
        return TouchView(contact_N=self._contact_N, learned=self._points, felt=self._felt, sweep=sweep)

    async def order(self, order: TouchOrder, who: str) -> TouchView:
        """Learn at the stiffness that is held now or over all of it, forget, or give way from another force on.

        An order of nothing returns what is. Raises RefusalError, OutOfRangeError; what was in force stays then.
        """
        if order == TouchOrder():
            return self.view()
        if order.sweep is not None:
            return await self._sweep(order, who)
        if self.sweep.under_way:
            raise RefusalError(
                Because.NOT_NOW, "the outside force is being learned over S: wait for its end or stop it"
            )
        async with self._turn:
            points = [] if order.forget else self._points
            if order.learn:
                points = _with(points, self._learned(self._since))
            contact_N = self._contact_N if order.contact_N is None else order.contact_N
            if contact_N != 0.0:
                require_within("contact_N", contact_N, CONTACT_MIN_N, CONTACT_MAX_N, "N", "0 N gives way to nothing")
                _require_learned(points, contact_N)
            tick = await self._put(points, contact_N)
        if order.forget:
            self.sweep.forget()
        for text in _said(order, points):
            self._journal.note(MarkKind.NOTE, text, tick, who)
        self._changed()
        return self.view()

    async def _sweep(self, order: TouchOrder, who: str) -> TouchView:
        if order.learn or order.forget or order.contact_N is not None:
            raise RefusalError(Because.BAD_VALUE, "learning over S is ordered alone: nothing else was done either")
        if order.sweep == "stop":
            await self.sweep.stop(who)
        else:
            async with self._starting, self._turn:
                await self.sweep.begin(who)
        return self.view()

    async def _learn_on(self, since: int) -> None:
        """Learn one more point, of samples from the tick ``since`` on."""
        async with self._turn:
            await self._put(_with(self._points, self._learned(max(since, self._since))), self._contact_N)
        self._changed()

    async def _put(self, points: list[TouchPoint], contact_N: float) -> int:
        """Put in force what is learned and armed; return the tick of it."""
        bias = tuple((point.S, point.F) for point in points)
        accepted = await self._command(commands.SetTouch(bias, contact_N))
        self._points, self._contact_N, self._since = points, contact_N, accepted.tick
        return accepted.tick

    def _learned(self, since: int) -> TouchPoint:
        """Return what is estimated at rest now. Raises RefusalError where the joint does not rest."""
        ring = self._supervisor.ring
        _, rows, _ = ring.read(max(ring.count - LEARNED_TICKS, 0), LEARNED_TICKS)
        why = why_not(rows, since)
        if why:
            raise RefusalError(Because.NOT_NOW, f"nothing was learned: {why}")
        S, F = float(rows[:, INDEX["S"]].mean()), rows[:, INDEX["F_ext_hat"]]
        bias = np.array([(point.S, point.F) for point in self._points], dtype=np.float64).reshape(-1, 2)
        return TouchPoint(S=S, F=float(F.mean()) + disturbance_observer.bias_at(bias, S), std_N=float(F.std()))

    def _hear(self, event: Event | LoopDied) -> None:
        match event:
            case ContactFelt(tick, F_ext_hat, contact_N):
                self._felt = ContactView(F_ext_hat=F_ext_hat, contact_N=contact_N, tick=tick)
            case ModeChanged(after=mode, cause=cause):
                self.sweep.break_off(f"the mode is {mode} now")
                self._felt = self._felt if cause is Cause.CONTACT else None
            case TouchForgotten():
                self.forget("the zeros were found anew")
            case LoopDied():
                self.forget("the control loop died")
            case _:
                return
        self._changed()

    def forget(self, why: str) -> None:
        """Begin with nothing learned, as a new loop does, and ``why``."""
        self.sweep.break_off(why)
        self._points, self._contact_N, self._felt, self._since = [], 0.0, None, 0
        self._forgotten()


def _with(points: list[TouchPoint], new: TouchPoint) -> list[TouchPoint]:
    others = [point for point in points if abs(point.S - new.S) >= NEIGHBOUR]
    return sorted([*others, new], key=lambda point: point.S)


def _require_learned(points: list[TouchPoint], contact_N: float) -> None:
    """Raise RefusalError for a threshold that what is not known of the bias could pass by itself."""
    if not points:
        raise RefusalError(
            Because.NOT_NOW, "what the estimate reads with nothing outside is not known: learn it at rest first"
        )
    noise = max(point.std_N for point in points)
    if not math.isfinite(noise) or contact_N < SIGMAS * noise:
        raise RefusalError(
            Because.NOT_NOW,
            f"a contact from {contact_N:g} N on is refused: the estimate itself moves by {noise:.4g} N (standard "
            f"deviation), and {SIGMAS:g} times that is the least",
        )


def _said(order: TouchOrder, points: list[TouchPoint]) -> list[str]:
    """Say what came into force."""
    said = ["what the outside force reads with nothing outside was forgotten"] if order.forget else []
    if order.learn:
        known = ", ".join(f"{in_digits(point.F)} N at {in_digits(point.S)} N·m/rad" for point in points)
        said.append(f"outside force learned: {known}")
    if order.contact_N is not None:
        said.append(
            f"gives way to contacts from {order.contact_N:g} N on" if order.contact_N else "gives way to no contact"
        )
    return said
