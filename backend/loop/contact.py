"""What comes of an outside force that is a contact: the joint gives way, until somebody says otherwise.

The reaction is the loop's own and takes one tick: position loop open, reference where the joint is. Once it stands it
goes to the lowest stiffness. A program is played no further; TAIL_S of what follows still belong to its run. It stays
so until an operator chooses a mode again.
"""

import math
from typing import NamedTuple

import numpy as np

from backend.controllers import decoupler
from backend.controllers.cascade import Tuning
from backend.controllers.limits import Bounds
from backend.loop.commands import ContactFelt, Event, SetTouch, TouchForgotten
from backend.loop.mode import Mode, RefusedError
from backend.loop.motion import Tracking
from backend.loop.program import Law, Program, Segment
from backend.loop.tick_desk import TickDesk
from backend.refusal import require_within
from backend.tick.decision import Carry
from plant.interface import NO_LOAD, Measurement, ShaftLoad

CONTACT_MIN_N, CONTACT_MAX_N = 1.0, 30.0
"""Force that may count as a contact [N]: with less, the estimate's own error in a fast move could."""

STAND_S = 0.15
"""How long the motors have to themselves for bringing the joint to a stand [s], before it gets soft."""

TAIL_S = 0.5
"""How long a program's run goes on after a contact [s], so that it holds what came of it."""

MAX_POINTS = 64


class Acting(NamedTuple):
    """Push [N], loads [N·m] and numbers of tuning and wall as a program has them in force, if any."""

    F_push: float
    load: ShaftLoad
    tuning: int
    wall: int


NOTHING = Acting(0.0, NO_LOAD, 0, 0)


class Contact:
    """Whether contacts are reacted to, from what force on [N], and whether one has been felt."""

    def __init__(self, desk: TickDesk, events: list[Event]) -> None:
        self.felt = False
        self._from_N = math.inf
        self._desk = desk
        self._events = events

    def put(self, command: SetTouch) -> None:
        """Use another bias and threshold. Raises OutOfRangeError, ValueError; nothing has changed then."""
        require_within("points", len(command.bias), 0, MAX_POINTS, "1", words="number of points of the bias")
        bias = np.array(command.bias, dtype=np.float64).reshape(-1, 2)
        if not np.all(np.isfinite(bias)) or np.any(np.diff(bias[:, 0]) <= 0.0):
            raise ValueError("the bias of the outside force is to rise in S from point to point: it was left as it is")
        if command.contact_N != 0.0:
            require_within("contact_N", command.contact_N, CONTACT_MIN_N, CONTACT_MAX_N, "N", "0 N reacts to nothing")
        self._desk.take_off(bias)
        self._from_N = command.contact_N or math.inf

    def forget(self, tick: int) -> None:
        """Begin with nothing learned and give way to nothing: the zeros are others now."""
        learned = self._desk.take_off(np.zeros((0, 2)))
        if len(learned) or self._from_N != math.inf:
            self._from_N = math.inf
            self._events.append(TouchForgotten(tick))

    def felt_from(self, motion: object) -> float:
        """Force [N] from which on a contact counts now; inf where none does, or one is being reacted to."""
        return self._from_N if isinstance(motion, Tracking) and not self.felt else math.inf

    def require_none(self, legal: tuple[Mode, ...]) -> None:
        """Raise RefusedError while one is being reacted to."""
        if self.felt:
            raise RefusedError("the joint gives way to a contact: choose a mode to go on, then move it", legal)

    def feel(self, tick: int) -> bool:
        """Take note of a contact and tell of it, where it is not known yet; whether it was not."""
        begins, self.felt = not self.felt, True
        if begins:
            self._events.append(ContactFelt(tick, self._desk.F_ext_hat, self._from_N))
        return begins


def giving_way(tuning: Tuning, carry: Carry, m: Measurement, bounds: Bounds, acting: Acting) -> Tracking:
    """Return the motion of a joint that gives way where it is, under what is ``acting``; it is done after TAIL_S.

    First the joint stands, then it gets soft: with both at once the motors would share their voltage between them.
    """
    F_push, (load_A, load_B), number, wall = acting
    q = min(max(m.q, bounds.q_min), bounds.q_max)
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    as_it_is = min(max(S, bounds.S_min), bounds.S_max)
    parts = tuple(
        Segment(duration_s, q, S_ref, F_push, load_A=load_A, load_B=load_B, tuning=number, wall=wall)
        for duration_s, S_ref in ((STAND_S, as_it_is), (TAIL_S - STAND_S, bounds.S_min))
    )
    return Tracking(tuning, carry, m, bounds, False, Program(Law.COMPLIANCE, parts))
