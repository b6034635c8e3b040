"""Experiment 2 of the paper (figure 8; method section 7): how stiff the joint feels to a hand."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from backend.controllers.limits import STIFFNESS_RANGE
from backend.documents.result import Phase
from backend.experiments.settings import choice, integer, number
from backend.loop.program import Law, Program, Segment, Shape

LEAD_IN_S = 6.0
"""Time for the stiffness to settle before the first push; its last second is what forces are counted from."""

_PIECE_S = 0.04
"""Smooth pushes are played as straight pieces of this length [s]."""


@dataclass(frozen=True)
class CompliancePlan:
    """Pushes on the joint at q_ref = 0 with the joint loop open and the stiffness in closed loop.

    ``steps`` pushes half and full both ways, ``ramp`` rises and falls slowly through both ends, ``hand`` pushes at
    random like a person: smooth, of different strength, length and direction.
    """

    kind: ClassVar[str] = "compliance"

    S_ref: float = number(10.0, *STIFFNESS_RANGE, "N·m/rad", "S_ref", "stiffness held in closed loop")
    profile: str = choice("hand", ("hand", "steps", "ramp"), "profile", "how the joint is pushed")
    F_push: float = number(20.0, 1.0, 25.0, "N", "F_push", "strongest push, tangential at the joint pulley")
    pushes: int = integer(8, 1, 100, "n", "number of pushes of the hand profile")
    hold_s: float = number(3.0, 0.5, 30.0, "s", "t_F", "time a step is held, a quarter of a ramp, a pause of the hand")
    push_seed: int = integer(0, 0, 2**31 - 1, "push seed", "seed of the hand profile: the same seed, the same pushes")

    def program(self) -> Program:
        """Return the pushes as a program under the compliance law."""
        segments = [Segment(LEAD_IN_S, 0.0, self.S_ref), *self._pushes(), Segment(self.hold_s, 0.0, self.S_ref)]
        return Program(Law.COMPLIANCE, tuple(segments))

    def phases(self) -> tuple[Phase, ...]:
        """Return lead-in and pushes."""
        return (
            Phase("lead_in", "Lead-in, no push", 0.0, LEAD_IN_S),
            Phase("pushes", "Pushes", LEAD_IN_S, self.program().duration_s),
        )

    def _pushes(self) -> Iterator[Segment]:
        F = self.F_push
        match self.profile:
            case "steps":
                for share in (0.5, 0.0, 1.0, 0.0, -0.5, 0.0, -1.0):
                    yield self._at(share * F, self.hold_s, Shape.STEP)
            case "ramp":
                for share, quarters in ((1.0, 1), (-1.0, 2), (0.0, 1)):
                    yield self._at(share * F, quarters * self.hold_s, Shape.RAMP)
            case _:
                yield from self._hand()

    def _hand(self) -> Iterator[Segment]:
        """Push like a hand: a smooth rise, a hold, a smooth release and a pause, each drawn anew."""
        random = np.random.default_rng(self.push_seed)
        for _ in range(self.pushes):
            peak = self.F_push * random.uniform(0.3, 1.0) * random.choice((-1.0, 1.0))
            rise_s, held_s, release_s = random.uniform(0.3, 0.9), random.uniform(0.2, 1.5), random.uniform(0.3, 0.9)
            yield from self._smooth(0.0, peak, rise_s)
            yield self._at(peak, held_s, Shape.STEP)
            yield from self._smooth(peak, 0.0, release_s)
            yield self._at(0.0, self.hold_s * random.uniform(0.3, 1.0), Shape.STEP)

    def _smooth(self, start: float, end: float, duration_s: float) -> Iterator[Segment]:
        """Go from start to end along half a cosine, in straight pieces."""
        pieces = max(round(duration_s / _PIECE_S), 1)
        for piece in range(1, pieces + 1):
            share = 0.5 - 0.5 * math.cos(math.pi * piece / pieces)
            yield self._at(start + share * (end - start), _PIECE_S, Shape.RAMP)

    def _at(self, F_push: float, duration_s: float, shape: Shape) -> Segment:
        return Segment(round(duration_s, 3), 0.0, self.S_ref, float(F_push), shape)
