"""Plays a program's segments tick by tick, in constant time whatever the length of the program."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.tick import waveforms
from backend.tick.decision import Target
from plant.compiled import compiled
from plant.interface import ShaftLoad, T_s

COLUMNS = 15
_SHAPE, _TICKS, _DURATION, _Q, _S, _PUSH, _PERIOD, _LOAD_A, _LOAD_B, _PERIOD_END, _COUNT, _PEAK = range(12)
_TUNING, _WALL, _TOUCH = range(12, COLUMNS)
STEP, RAMP, SINE, SWEEP, PRBS, MULTISINE = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
"""Shapes of a segment, as its first column has them."""


class Player(NamedTuple):
    """``segments``, the one that is played and how many of its ticks were, its shift register, the target before it.

    ``segments`` (n, COLUMNS): shape, ticks, duration [s], q_ref [rad], S_ref [N·m/rad], F_push [N], period [s] of a
    sine, of a chip or at the start of a sweep, loads of shafts A and B [N·m], period [s] at a sweep's end, bits of a
    register or lines of a multisine, its largest value, and the numbers of the tuning, the obstacle and the touch
    to be used from here on.
    """

    segments: NDArray[np.float64]
    position: int
    elapsed: int
    register: int
    start: Target


@compiled
def play(player: Player, last: Target) -> tuple[bool, Target, Player]:
    """Return whether the last segment has ended, the target, which is ``last`` then, and the player after it."""
    segments, position, elapsed, register, start = (
        player.segments,
        player.position,
        player.elapsed,
        player.register,
        player.start,
    )
    while position < segments.shape[0]:
        segment = segments[position]
        if elapsed < segment[_TICKS]:
            if segment[_SHAPE] == PRBS and elapsed > 0 and elapsed % round(segment[_PERIOD] / T_s) == 0:
                register = waveforms.next_register(register, int(segment[_COUNT]))
            elapsed += 1
            target = within(segment, start, elapsed * T_s, register)
            return False, target, Player(segments, position, elapsed, register, start)
        start = after(segment, start)
        position += 1
        elapsed, register = 0, waveforms.FIRST
    return True, last, Player(segments, position, elapsed, register, start)


@compiled
def announced(player: Player) -> tuple[float, float]:
    """Return where a ramp that is played ends and stays, q_ref [rad] and S_ref [N·m/rad]: nan where that is not known.

    A ramp that the next segment takes further does not end there, nor is one that is over announced any more.
    """
    if player.position >= player.segments.shape[0]:
        return math.nan, math.nan
    segment = player.segments[player.position]
    if segment[_SHAPE] != RAMP:
        return math.nan, math.nan
    q_end, S_end = segment[_Q], segment[_S]
    if player.position + 1 < player.segments.shape[0]:
        after = player.segments[player.position + 1]
        q_end = q_end if after[_Q] == q_end else math.nan
        S_end = S_end if after[_S] == S_end else math.nan
    return q_end, S_end


@compiled
def within(segment: NDArray[np.float64], start: Target, time_s: float, register: int) -> Target:
    """Return the target ``time_s`` [s] into a segment that began at ``start``; ``register`` is that of a PRBS."""
    share = 1.0
    if segment[_SHAPE] == RAMP:
        share = min(time_s / segment[_DURATION], 1.0)
    elif segment[_SHAPE] == SINE:
        share = waveforms.sine(time_s, segment[_PERIOD])
    elif segment[_SHAPE] == SWEEP:
        share = waveforms.sweep(time_s, segment[_PERIOD], segment[_PERIOD_END], segment[_DURATION])
    elif segment[_SHAPE] == PRBS:
        share = waveforms.level(register)
    elif segment[_SHAPE] == MULTISINE:
        share = waveforms.multisine(time_s, segment[_PERIOD], int(segment[_COUNT]), segment[_PEAK])
    return _at(segment, start, share)


@compiled
def after(segment: NDArray[np.float64], start: Target) -> Target:
    """Return what is left when a segment is over: an excitation leaves the references where they were."""
    if segment[_SHAPE] == SINE:
        return _at(segment, start, waveforms.sine(segment[_DURATION], segment[_PERIOD]))
    return _at(segment, start, 1.0 if segment[_SHAPE] <= RAMP else 0.0)


@compiled
def _at(segment: NDArray[np.float64], start: Target, share: float) -> Target:
    return Target(
        start.q_ref + share * (segment[_Q] - start.q_ref),
        start.S_ref + share * (segment[_S] - start.S_ref),
        start.F_push + share * (segment[_PUSH] - start.F_push),
        ShaftLoad(segment[_LOAD_A], segment[_LOAD_B]),
        int(segment[_TUNING]) if segment[_TUNING] > 0.0 else start.tuning,
        int(segment[_WALL]) if segment[_WALL] > 0.0 else start.wall,
        int(segment[_TOUCH]) if segment[_TOUCH] > 0.0 else start.touch,
    )
