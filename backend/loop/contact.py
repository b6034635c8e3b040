"""What comes of an outside force that is a contact: the joint gives way, until somebody says otherwise.

The reaction is the loop's own and takes one tick: position loop open, reference where the joint is. Once it stands it
goes to the lowest stiffness. A program is played no further; TAIL_S of what follows still belong to its run. It stays
so until an operator chooses a mode again.

A program may have contacts of its own (``Touch``): they end a part of it, for the rest of whose time the joint gives
way, and then the program goes on, no later than without. What the operator gives way to goes before that.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import decoupler
from backend.control.cascade import CascadeTuning
from backend.control.decoupler import Bounds
from backend.control.motion_types import Carry
from backend.errors import require_within
from backend.loop.commands import Event
from backend.loop.mode import Mode, RefusedError
from backend.loop.motion import Tracking
from backend.loop.program import MAX_TOUCHES, Law, Program, Segment, Touch
from backend.loop.set_touch import (
    CONTACT_MAX_N,
    CONTACT_MIN_N,
    NEIGHBOUR,
    SIGMAS,
    ContactFelt,
    SetTouch,
    TouchForgotten,
)
from backend.loop.tick_desk import TickDesk
from backend.loop.tunings import Tunings
from plant.interface import NO_LOAD, Measurement, ShaftLoad, T_s

STAND_S = 0.15
"""How long the motors have to themselves for bringing the joint to a stand [s], before it gets soft."""

TAIL_S = 0.5
"""How long a program's run goes on after a contact [s], so that it holds what came of it."""

STAND_TICKS, TAIL_TICKS = round(STAND_S / T_s), round(TAIL_S / T_s)

MAX_POINTS = 64


class Acting(NamedTuple):
    """Push [N], loads [N·m] and numbers of tuning, wall and touch as a program has them in force, if any."""

    F_push: float
    load: ShaftLoad
    tuning: int
    wall: int
    touch: int


NOTHING = Acting(0.0, NO_LOAD, 0, 0, 0)


class Contact:
    """Whether contacts are reacted to, from what force on [N], and whether one has been felt.

    ``paused`` is what of a program is still to be played, where one of its own contacts has ended a part of it.
    """

    def __init__(self, desk: TickDesk, events: list[Event], tunings: Tunings) -> None:
        self.felt = False
        self.paused: Program | None = None
        self._tunings = tunings
        self._from_N = self._own_N = math.inf
        self._operators: NDArray[np.float64] = np.zeros((0, 2))
        self._own: list[tuple[float, float]] = []
        self._noise_N = math.inf
        self._touches: tuple[Touch, ...] = ()
        self._desk = desk
        self._events = events

    def put(self, command: SetTouch) -> None:
        """Use another bias and threshold. Raises OutOfRangeError, ValueError, RefusedError: nothing has changed."""
        require_within("points", len(command.bias), 0, MAX_POINTS, "1", words="number of points of the bias")
        bias = np.array(command.bias, dtype=np.float64).reshape(-1, 2)
        if not np.all(np.isfinite(bias)) or np.any(np.diff(bias[:, 0]) <= 0.0):
            raise ValueError("the bias of the outside force is to rise in S from point to point: it was left as it is")
        if len(bias) == 0 and self._tunings.gains.rejection.k_ext > 0.0:
            raise RefusedError("pushes are rejected by what was learned: set k_ext to 0 before it is forgotten")
        if command.contact_N != 0.0:
            require_within("contact_N", command.contact_N, CONTACT_MIN_N, CONTACT_MAX_N, "N", "0 N reacts to nothing")
        self._operators, self._from_N = bias, command.contact_N or math.inf
        self._take_off()

    def forget(self, tick: int) -> None:
        """Begin with nothing learned and give way to nothing: the zeros are others now."""
        self._tunings.reject_nothing()
        if len(self._operators) or self._from_N != math.inf:
            self._operators, self._from_N = np.zeros((0, 2)), math.inf
            self._events.append(TouchForgotten(tick))
        self.end()

    def require(self, program: Program) -> None:
        """Raise RefusedError or OutOfRangeError for a program's own contacts that cannot be given way to."""
        touches = program.touches
        words = "number of changes of what is given way to"
        require_within("touches", len(touches), None, MAX_TOUCHES, "1", words=words)
        for segment in program.segments:
            if not 0 <= segment.touch <= len(touches):
                raise RefusedError(f"a segment wants touch {segment.touch} of the program's {len(touches)}")
        for touch in touches:
            if touch.contact_N != 0.0:
                require_within("contact_N", touch.contact_N, CONTACT_MIN_N, CONTACT_MAX_N, "N", "0 N reacts to nothing")
        if touches and program.law is not Law.CASCADE:
            raise RefusedError(f"a {program.law} program gives way to nothing: play it by the cascade")
        if self._from_N != math.inf and any(touch.contact_N for touch in touches):
            raise RefusedError(
                f"the joint gives way to contacts from {self._from_N:g} N on, and stays so: that would end this "
                "program at its first contact. Have it give way to none first, the program gives way by itself"
            )

    def begin(self, program: Program) -> None:
        """Be ready for a program's touches, numbered from 1 on."""
        self._touches = program.touches

    def use(self, number: int) -> None:
        """Give way to what a program's touch says from now on; where nothing was learned, to nothing."""
        touch = self._touches[number - 1] if number else Touch()
        if touch.learns:
            self._learn()
        quiet = bool(self._own) and touch.contact_N >= SIGMAS * self._noise_N
        self._own_N = touch.contact_N if quiet and touch.contact_N else math.inf

    def end(self) -> None:
        """Forget what a program has learned and given way to: what the operator did is in force."""
        self.paused, self._own_N, self._own, self._noise_N, self._touches = None, math.inf, [], math.inf, ()
        self._take_off()

    def _learn(self) -> None:
        S, F, std = self._desk.rested
        if not math.isfinite(F + std):
            return
        self._noise_N = std if not self._own else max(std, self._noise_N)
        self._own = sorted([*(point for point in self._own if abs(point[0] - S) >= NEIGHBOUR), (S, F)])
        self._take_off()

    def _take_off(self) -> None:
        """Take off what a program has learned itself, else what the operator has."""
        self._desk.take_off(np.array(self._own).reshape(-1, 2) if self._own else self._operators)

    def felt_from(self, motion: object) -> float:
        """Force [N] from which on a contact counts now; inf where none does, or one is being reacted to."""
        return min(self._from_N, self._own_N) if isinstance(motion, Tracking) and not self.felt else math.inf

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

    def pause(self, program: Program | None, motion: object) -> int:
        """Take note of a contact that a program gives way to itself; for how many ticks, 0 where it is none."""
        own = abs(self._desk.F_ext_hat) <= self._from_N
        if program is None or not own or self.felt or not isinstance(motion, Tracking):
            return 0
        played = motion.now.state.player
        ticks, self.paused = _after(program, played.position, played.elapsed)
        self.felt = True
        return max(ticks - 1, 1)  # in one more it is told that they are over

    def go_on(self, paused: Program) -> Program:
        """Return what of a program is still to be played, now that the joint has given way."""
        self.paused, self.felt, self._own_N = None, False, math.inf
        return paused


def _after(program: Program, position: int, elapsed: int) -> tuple[int, Program]:
    """Return how many ticks are left up to the next touch, behind ``elapsed`` of a segment, and the rest from there.

    The rest begins with the tuning and the wall that would be in force there.
    """
    segments = program.segments
    ends = range(position + 1, len(segments))
    end = next((place for place in ends if segments[place].touch), len(segments))
    ticks = sum(round(segment.duration_s / T_s) for segment in segments[position:end]) - elapsed
    rest = segments[end:]
    if rest:
        before = segments[end::-1]
        tuning = next((segment.tuning for segment in before if segment.tuning), 0)
        wall = next((segment.wall for segment in before if segment.wall), 0)
        rest = (replace(rest[0], tuning=tuning, wall=wall), *rest[1:])
    return ticks, replace(program, segments=rest)


def giving_way(
    tuning: CascadeTuning,
    carry: Carry,
    m: Measurement,
    bounds: Bounds,
    acting: Acting,
    ticks: int = TAIL_TICKS,
) -> Tracking:
    """Return the motion of a joint that gives way where it is, under what is ``acting``; it is done after ``ticks``.

    First the joint stands, then it gets soft: with both at once the motors would share their voltage between them.
    """
    F_push, (load_A, load_B), number, wall, touch = acting
    q = min(max(m.q, bounds.q_min), bounds.q_max)
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    as_it_is = min(max(S, bounds.S_min), bounds.S_max)
    parts = tuple(
        Segment(T_s * span, q, S_ref, F_push, load_A=load_A, load_B=load_B, tuning=number, wall=wall, touch=touch)
        for span, S_ref in ((min(STAND_TICKS, ticks), as_it_is), (max(ticks - STAND_TICKS, 0), bounds.S_min))
    )
    return Tracking(tuning, carry, m, bounds, False, Program(Law.COMPLIANCE, parts), gives_way=True)
