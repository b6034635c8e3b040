"""Excitation of two inputs in one run, and the correlation between them."""

from dataclasses import dataclass

import numpy as np

from backend.identification import messages
from backend.identification.excitation import correlation
from backend.identification.records import IdentificationError, Signal

# Sequences -----------------------------------------------------------------------------------------
# Inputs that excite both channels at once, and that are uncorrelated over the memory of the loop.


def build_mls_pair(
    bits: int,
    chip_samples: int,
    periods: int,
    amplitudes: tuple[float, float] = (1.0, 1.0),
    *,
    memory_samples: int = 0,
) -> Signal:
    """Return a maximum-length sequence and the same one half a period later; shape (n, 2).

    A period has N = 2^bits - 1 chips, an odd number. The second input is late by (N + 1)/2 chips, so that the chips of
    both inputs begin at the same samples. Over a whole period the correlation of the inputs at a lag of k chips is 1 at
    the delay and -1/N at every other k, with straight lines in between (Godfrey 1993, chapter 1). Raises
    IdentificationError if the delay or the rest of the period is not longer than the memory of the loop.
    """
    from scipy.signal import max_len_seq

    register = 2.0 * np.asarray(max_len_seq(bits)[0], dtype=np.float64) - 1.0
    delay = (register.size + 1) // 2
    shortest = (register.size - delay) * chip_samples
    if not shortest > memory_samples:
        raise IdentificationError(messages.half_period_too_short(length=shortest, memory=memory_samples))
    chips = np.column_stack((register, np.roll(register, delay)))
    return np.asarray(np.tile(np.repeat(chips, chip_samples, axis=0), (periods, 1)) * amplitudes)


def build_multisine_pair(
    lines: int, period_samples: int, periods: int, amplitudes: tuple[float, float] = (1.0, 1.0)
) -> Signal:
    """Return multisines of the odd lines, and of the even lines; shape (n, 2).

    ``lines`` is the highest harmonic of the period. All lines of an input have the same amplitude and the phases of
    Schroeder (1970), and its largest value is its amplitude. Over whole periods the inputs are uncorrelated at every
    lag. Raises IdentificationError for lines beyond half the sampling rate.
    """
    if not 2 <= lines < period_samples / 2:
        raise IdentificationError(messages.lines_not_resolved(lines=lines, maximum=(period_samples - 1) // 2))
    turn = 2.0 * np.pi * np.arange(period_samples) / period_samples
    inputs = []
    for first in (1, 2):
        harmonics = np.arange(first, lines + 1, 2)
        order = np.arange(1, harmonics.size + 1)
        phases = -np.pi * order * (order - 1) / harmonics.size
        wave = np.sum(np.cos(np.outer(turn, harmonics) + phases), axis=1)
        inputs.append(wave / np.max(np.abs(wave)))
    return np.asarray(np.tile(np.column_stack(inputs), (periods, 1)) * amplitudes)


# Correlation ---------------------------------------------------------------------------------------


_SHOWN_LAGS = 201


@dataclass(frozen=True)
class InputCorrelation:
    """Correlation of both inputs over the memory of the loop, -1 to 1.

    ``correlation`` at ``lags_s`` [s]: the second input, later by the lag, with the first. ``largest`` has the largest
    magnitude of all lags up to ``memory_s``, and is at ``largest_lag_s``; ``at_zero`` is that without lag.
    """

    lags_s: tuple[float, ...]
    correlation: tuple[float, ...]
    memory_s: float
    largest: float
    largest_lag_s: float
    at_zero: float


def correlate_inputs(u: Signal, period_s: float, memory_s: float) -> InputCorrelation:
    """Return the correlation of two inputs (n, 2), means removed, at lags up to the memory.

    Each lag uses the samples that overlap, and is relative to their energy: an input that repeats the other one later
    has a correlation of 1 at that lag.
    """
    centred = u - np.mean(u, axis=0)
    reach = min(round(memory_s / period_s), u.shape[0] // 2)
    later = _overlap_correlation(centred[:, 1], centred[:, 0], reach)
    earlier = _overlap_correlation(centred[:, 0], centred[:, 1], reach)
    values = np.concatenate((earlier[:0:-1], later))
    lags_s = np.arange(-reach, reach + 1) * period_s
    at = int(np.argmax(np.abs(values)))
    shown = np.unique(np.linspace(0, values.size - 1, _SHOWN_LAGS).round().astype(int))
    return InputCorrelation(
        lags_s=tuple(lags_s[shown].tolist()),
        correlation=tuple(values[shown].tolist()),
        memory_s=memory_s,
        largest=float(values[at]),
        largest_lag_s=float(lags_s[at]),
        at_zero=float(values[reach]),
    )


def _overlap_correlation(later: Signal, earlier: Signal, reach: int) -> Signal:
    """Return the normalized correlation at lags 0 .. reach, shape (reach + 1,)."""
    lags = np.arange(reach + 1)
    energy_later = np.cumsum(later[::-1] ** 2)[::-1][lags]
    energy_earlier = np.cumsum(earlier**2)[later.size - 1 - lags]
    size = np.sqrt(np.maximum(energy_later * energy_earlier, np.finfo(float).tiny))
    return np.asarray(correlation(later, earlier)[: reach + 1] / size)
