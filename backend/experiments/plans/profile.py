"""The references and the push of a program over its whole length, as the loop will play them; for pictures. Pure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import setpoint_player
from backend.control.motion_types import Target
from backend.realtime.motions import player_of
from backend.realtime.program import Program, Shape
from plant.interface import T_s

Array = NDArray[np.float64]

POINTS = 400
"""So many over the whole, besides begin and end of each segment."""


class Profile(NamedTuple):
    """Times since the program began (n,) [s], q_ref (n,) [rad], S_ref (n,) [N·m/rad], F_push (n,) [N].

    n is 0 without segments.
    """

    t: Array
    q_ref: Array
    S_ref: Array
    F_push: Array


def profile(program: Program, q_ref: float, S_ref: float) -> Profile:
    """Return what a program asks for that begins at these references. Each segment is there from its first tick on."""
    whole = sum(round(segment.duration_s / T_s) for segment in program.segments)
    every = max(1, round(whole / POINTS))
    start, begun = Target(q_ref, S_ref, 0.0), 0
    points = []
    for segment, row in zip(program.segments, player_of(program.segments, start).segments, strict=True):
        ticks = round(segment.duration_s / T_s)
        chip = max(1, round(segment.period_s / T_s)) if segment.shape is Shape.PRBS else ticks + 1
        register, advanced = setpoint_player.FIRST, 0
        for tick in sorted({1, *range(every, ticks, every), ticks}):
            while advanced < (tick - 1) // chip:
                register, advanced = setpoint_player.next_register(register, segment.count), advanced + 1
            target = setpoint_player.within(row, start, tick * T_s, register)
            points.append(((begun + tick) * T_s, target.q_ref, target.S_ref, target.F_push))
        start, begun = setpoint_player.after(row, start), begun + ticks
    return Profile(*np.array(points, dtype=np.float64).reshape(-1, 4).T)
