"""Touch: what the estimate of the outside force has learned, and whether the joint gives way to a contact.

Both hold for one loop process and the zeros of its motors: what is learned is how springs and zeros differ from what
was identified. A new loop, or zeros found anew, begins with nothing learned and gives way to nothing.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable

import numpy as np
from numpy.typing import NDArray

from backend.controllers import touch
from backend.loop import commands
from backend.loop.access import LoopDied
from backend.loop.causes import Cause
from backend.loop.commands import Accepted, Command, ContactFelt, Event, ModeChanged, TouchForgotten
from backend.loop.contact import CONTACT_MAX_N, CONTACT_MIN_N
from backend.loop.mode import MODES, Mode
from backend.loop.supervisor import Supervisor
from backend.messages.live import MarkKind
from backend.messages.touch import ContactView, TouchOrder, TouchPoint, TouchView
from backend.operating.journal import Journal
from backend.reading import in_digits
from backend.refusal import Because, RefusalError, require_within
from backend.sample import INDEX

LEARNED_TICKS = 1000
"""Samples at rest that a point is learned from: 1 s."""

NEIGHBOUR = 0.25
"""Points nearer to each other than this [N·m/rad] are one, and the newer counts."""

_MOVING_RAD, _MOVING_S = 0.01, 0.1
"""At rest, the joint stays within so much, and its stiffness [N·m/rad]."""


class Touching:
    """Learns, arms and shows. Belongs to the service's event loop; ``changed`` is called when there is news."""

    def __init__(
        self,
        supervisor: Supervisor,
        journal: Journal,
        command: Callable[[Command], Awaitable[Accepted]],
        changed: Callable[[], None],
    ) -> None:
        self._supervisor = supervisor
        self._journal = journal
        self._command = command
        self._changed = changed
        self._turn = asyncio.Lock()
        self._points: list[TouchPoint] = []
        self._contact_N = 0.0
        self._felt: ContactView | None = None
        self._since = 0
        supervisor.listen(self._hear)

    def view(self) -> TouchView:
        """Return what is learned and armed, and the contact that the joint gives way to."""
        return TouchView(contact_N=self._contact_N, learned=self._points, felt=self._felt)

    async def order(self, order: TouchOrder, who: str) -> TouchView:
        """Learn at the stiffness that is held now, forget what was learned, or give way from another force on.

        Raises RefusalError, OutOfRangeError; what was in force stays then.
        """
        async with self._turn:
            points = [] if order.forget else self._points
            if order.learn:
                points = _with(points, self._learned())
            contact_N = self._contact_N if order.contact_N is None else order.contact_N
            if contact_N != 0.0:
                require_within("contact_N", contact_N, CONTACT_MIN_N, CONTACT_MAX_N, "N", "0 N gives way to nothing")
                _require_learned(points, contact_N)
            bias = tuple((point.S, point.F) for point in points)
            accepted = await self._command(commands.SetTouch(bias, contact_N))
            self._points, self._contact_N, self._since = points, contact_N, accepted.tick
        for text in _said(order, points):
            self._journal.note(MarkKind.NOTE, text, accepted.tick, who)
        self._changed()
        return self.view()

    def _learned(self) -> TouchPoint:
        """Return what is estimated at rest now. Raises RefusalError where the joint does not rest."""
        ring = self._supervisor.ring
        _, rows, _ = ring.read(max(ring.count - LEARNED_TICKS, 0), LEARNED_TICKS)
        why = _why_not(rows, self._since)
        if why:
            raise RefusalError(Because.NOT_NOW, f"nothing was learned: {why}")
        S, F = float(rows[:, INDEX["S"]].mean()), rows[:, INDEX["F_ext_hat"]]
        bias = np.array([(point.S, point.F) for point in self._points], dtype=np.float64).reshape(-1, 2)
        return TouchPoint(S=S, F=float(F.mean()) + touch.bias_at(bias, S), std_N=float(F.std()))

    def _hear(self, event: Event | LoopDied) -> None:
        match event:
            case ContactFelt(tick, F_ext_hat, contact_N):
                self._felt = ContactView(F_ext_hat=F_ext_hat, contact_N=contact_N, tick=tick)
            case ModeChanged(cause=cause) if cause is not Cause.CONTACT:
                self._felt = None
            case TouchForgotten() | LoopDied():
                self.forget()
            case _:
                return
        self._changed()

    def forget(self) -> None:
        """Begin with nothing learned, as a new loop does."""
        self._points, self._contact_N, self._felt, self._since = [], 0.0, None, 0


def _with(points: list[TouchPoint], new: TouchPoint) -> list[TouchPoint]:
    others = [point for point in points if abs(point.S - new.S) >= NEIGHBOUR]
    return sorted([*others, new], key=lambda point: point.S)


def _why_not(rows: NDArray[np.float64], since: int) -> str:
    """Why nothing can be learned from these samples, of one bias from the tick ``since`` on; empty where it can."""
    if len(rows) < LEARNED_TICKS or not np.all(np.isfinite(rows[:, INDEX["F_ext_hat"]])):
        return "the outside force is not known yet, the motors' zeros come with pretension"
    column = {name: rows[:, INDEX[name]] for name in ("mode", "q", "S", "F_push", "F_wall")}
    if set(column["mode"].astype(int)) != {MODES.index(Mode.RUN)}:
        return f"the joint has to be held in run for {LEARNED_TICKS / 1000:g} s"
    if rows[0, INDEX["tick"]] < since:
        return f"something else was put into force less than {LEARNED_TICKS / 1000:g} s ago"
    if np.any(column["F_push"] != 0.0):
        return "the joint is pushed"
    if np.any(np.nan_to_num(column["F_wall"]) != 0.0):  # nan on a rig, where nobody simulates one
        return "the joint presses on a wall"
    if np.ptp(column["q"]) > _MOVING_RAD or np.ptp(column["S"]) > _MOVING_S:
        return f"joint and stiffness have to be at rest for {LEARNED_TICKS / 1000:g} s"
    return ""


def _require_learned(points: list[TouchPoint], contact_N: float) -> None:
    """Raise RefusalError for a threshold that what is not known of the bias could pass by itself."""
    if not points:
        raise RefusalError(
            Because.NOT_NOW, "what the estimate reads with nothing outside is not known: learn it at rest first"
        )
    noise = max(point.std_N for point in points)
    if not math.isfinite(noise) or contact_N < 6.0 * noise:
        raise RefusalError(
            Because.NOT_NOW,
            f"a contact from {contact_N:g} N on is refused: the estimate itself moves by {noise:.2f} N (standard "
            f"deviation), and 6 times that is the least",
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
