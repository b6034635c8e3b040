"""Pushes like a person's: a smooth rise, a hold, a smooth release and a pause, each drawn anew. Pure."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from backend.realtime.program import Shape

PIECE_S = 0.04
"""Smooth pushes are played as straight pieces of this length [s]."""

_LONGEST_S = 3.3
"""Longest push of a hand, its pause left out [s]."""


class PushPiece(NamedTuple):
    """A piece of a push: how long [s], to which force [N], and how."""

    duration_s: float
    F_push: float
    shape: Shape


def smooth(start: float, end: float, duration_s: float, *, evenly: bool = False) -> Iterator[PushPiece]:
    """Go from start to end [N] along half a cosine, in straight pieces of PIECE_S, or ``evenly`` in just this time."""
    pieces = max(round(duration_s / PIECE_S), 1)
    ends = [round(duration_s * piece / pieces, 3) for piece in range(pieces + 1)]
    for piece in range(1, pieces + 1):
        share = 0.5 - 0.5 * math.cos(math.pi * piece / pieces)
        lasts = ends[piece] - ends[piece - 1] if evenly else PIECE_S
        yield PushPiece(lasts, start + share * (end - start), Shape.RAMP)


def pushes_of_a_hand(F_push: float, pushes: int, pause_s: float, seed: int) -> Iterator[PushPiece]:
    """Push ``pushes`` times with up to ``F_push`` [N]; the same seed gives the same pushes."""
    random = np.random.default_rng(seed)
    for _ in range(pushes):
        peak = F_push * random.uniform(0.3, 1.0) * random.choice((-1.0, 1.0))
        rise_s, held_s, release_s = random.uniform(0.3, 0.9), random.uniform(0.2, 1.5), random.uniform(0.3, 0.9)
        yield from smooth(0.0, peak, rise_s)
        yield PushPiece(held_s, peak, Shape.STEP)
        yield from smooth(peak, 0.0, release_s)
        yield PushPiece(pause_s * random.uniform(0.3, 1.0), 0.0, Shape.STEP)
