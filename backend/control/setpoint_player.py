"""Setpoints of a program at each tick, with the waveforms of its excitations."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control.motion_types import Setpoint
from plant import ShaftLoad, T_s, compiled

# Waveforms -----------------------------------------------------------------------------------------
# Periodic excitations of a reference, relative to their amplitude, within ±1.


INITIAL_REGISTER = 1
"""Initial content of the shift register; any number except 0 is possible."""

TAPS = {4: 0xC, 5: 0x14, 6: 0x30, 7: 0x60, 8: 0xB8, 9: 0x110, 10: 0x240, 11: 0x500, 12: 0xE08}
"""Feedback taps by number of bits, for the longest sequence: primitive polynomials over GF(2)."""

MIN_BITS, MAX_BITS = min(TAPS), max(TAPS)
MAX_LINES = 40
"""Most harmonics of a multisine: each is a cosine in each tick."""


@compiled
def sine(t: float, period_s: float) -> float:
    """Return the sine at time ``t`` [s]."""
    return math.sin(2.0 * math.pi * t / period_s)


@compiled
def sweep(t: float, period_s: float, period_end_s: float, duration_s: float) -> float:
    """Return a sine with exponentially changing frequency.

    The frequency changes from 1/period_s to 1/period_end_s, by the same factor in equal times.
    """
    growth = math.log(period_s / period_end_s)
    if abs(growth) < 1e-9:
        return math.sin(2.0 * math.pi * t / period_s)
    turns = duration_s / (period_s * growth) * math.expm1(growth * t / duration_s)
    return math.sin(2.0 * math.pi * turns)


@compiled
def multisine(t: float, period_s: float, lines: int, peak: float) -> float:
    """Return the sum of the first ``lines`` harmonics, divided by ``peak``.

    The phases are Schroeder's, −π k (k − 1)/N.
    """
    total = 0.0
    for k in range(1, lines + 1):
        total += math.cos(2.0 * math.pi * k * t / period_s - math.pi * k * (k - 1) / lines)
    return min(max(total / peak, -1.0), 1.0)


@compiled
def next_register(register: int, bits: int) -> int:
    """Return a linear feedback shift register after one chip (Galois form, ``TAPS``)."""
    taps = (0xC, 0x14, 0x30, 0x60, 0xB8, 0x110, 0x240, 0x500, 0xE08)[bits - 4]
    return (register >> 1) ^ (taps if register & 1 else 0)


@compiled
def chip_level(register: int) -> float:
    """Return the level of a register's chip, 1 or −1."""
    return 1.0 if register & 1 else -1.0


# Player --------------------------------------------------------------------------------------------
# Plays the segments of a program tick by tick, in constant time for any length of the program.


COLUMNS = 15
_SHAPE, _TICKS, _DURATION, _Q, _S, _PUSH, _PERIOD, _LOAD_A, _LOAD_B, _PERIOD_END, _COUNT, _PEAK = range(12)
_TUNING, _OBSTACLE, _CONTACT_DETECTION = range(12, COLUMNS)
STEP, RAMP, SINE, SWEEP, PRBS, MULTISINE = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
"""Shapes of a segment, in its first column."""


class SetpointPlayer(NamedTuple):
    """Segments of a program and the position in them.

    ``segments`` (n, COLUMNS): shape, ticks, duration [s], q_ref [rad], S_ref [N·m/rad], F_push [N], period [s] of a
    sine, of a chip or at the start of a sweep, loads of shafts A and B [N·m], period [s] at the end of a sweep, bits of
    a register or harmonics of a multisine, its largest value, and the numbers of tuning, obstacle and contact detection
    from here on, 0 for no change. ``position`` is the current segment, ``elapsed`` its number of ticks so far,
    ``register`` its shift register and ``start`` the setpoint before it.
    """

    segments: NDArray[np.float64]
    position: int
    elapsed: int
    register: int
    start: Setpoint


@compiled
def step_setpoint_player(player: SetpointPlayer, previous: Setpoint) -> tuple[bool, Setpoint, SetpointPlayer]:
    """Return whether the program has ended, the setpoint, and the next player.

    After the end the setpoint is ``previous``.
    """
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
                register = next_register(register, int(segment[_COUNT]))
            elapsed += 1
            setpoint = compute_setpoint(segment, start, elapsed * T_s, register)
            return False, setpoint, SetpointPlayer(segments, position, elapsed, register, start)
        start = compute_final_setpoint(segment, start)
        position += 1
        elapsed, register = 0, INITIAL_REGISTER
    return True, previous, SetpointPlayer(segments, position, elapsed, register, start)


@compiled
def find_ramp_end(player: SetpointPlayer) -> tuple[float, float]:
    """Return the end of the current ramp, q_ref [rad] and S_ref [N·m/rad], else NaN.

    Only for a reference that is constant in the next segment.
    """
    if player.position >= player.segments.shape[0]:
        return math.nan, math.nan
    segment = player.segments[player.position]
    if segment[_SHAPE] != RAMP:
        return math.nan, math.nan
    q_end, S_end = segment[_Q], segment[_S]
    if player.position + 1 < player.segments.shape[0]:
        next_segment = player.segments[player.position + 1]
        q_end = q_end if next_segment[_Q] == q_end else math.nan
        S_end = S_end if next_segment[_S] == S_end else math.nan
    return q_end, S_end


@compiled
def compute_setpoint(segment: NDArray[np.float64], start: Setpoint, time_s: float, register: int) -> Setpoint:
    """Return the setpoint ``time_s`` [s] into a segment that began at ``start``.

    ``register`` is that of a PRBS.
    """
    share = 1.0
    if segment[_SHAPE] == RAMP:
        share = min(time_s / segment[_DURATION], 1.0)
    elif segment[_SHAPE] == SINE:
        share = sine(time_s, segment[_PERIOD])
    elif segment[_SHAPE] == SWEEP:
        share = sweep(time_s, segment[_PERIOD], segment[_PERIOD_END], segment[_DURATION])
    elif segment[_SHAPE] == PRBS:
        share = chip_level(register)
    elif segment[_SHAPE] == MULTISINE:
        share = multisine(time_s, segment[_PERIOD], int(segment[_COUNT]), segment[_PEAK])
    return _interpolate_setpoint(segment, start, share)


@compiled
def compute_final_setpoint(segment: NDArray[np.float64], start: Setpoint) -> Setpoint:
    """Return the setpoint after a segment.

    After an excitation except a sine the references are those before it.
    """
    if segment[_SHAPE] == SINE:
        return _interpolate_setpoint(segment, start, sine(segment[_DURATION], segment[_PERIOD]))
    return _interpolate_setpoint(segment, start, 1.0 if segment[_SHAPE] <= RAMP else 0.0)


@compiled
def _interpolate_setpoint(segment: NDArray[np.float64], start: Setpoint, share: float) -> Setpoint:
    return Setpoint(
        q_ref=start.q_ref + share * (segment[_Q] - start.q_ref),
        S_ref=start.S_ref + share * (segment[_S] - start.S_ref),
        F_push=start.F_push + share * (segment[_PUSH] - start.F_push),
        load=ShaftLoad(segment[_LOAD_A], segment[_LOAD_B]),
        tuning=int(segment[_TUNING]) if segment[_TUNING] > 0.0 else start.tuning,
        obstacle=int(segment[_OBSTACLE]) if segment[_OBSTACLE] > 0.0 else start.obstacle,
        contact_detection=int(segment[_CONTACT_DETECTION])
        if segment[_CONTACT_DETECTION] > 0.0
        else start.contact_detection,
    )
