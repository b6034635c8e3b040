"""Power spectral density of samples by Welch's method. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_SAMPLES = 64
"""Fewest consecutive samples of which a spectrum is computed."""

USUAL_SEGMENT, LONGEST_SEGMENT = 8192, 32768
"""Longest segments [samples]: usual, and of stretches so long that ``MANY`` of them lie end to end."""

_LEAST_SEGMENTS, _MANY = 2, 8
_AT_ONCE = 32
"""Segments that are transformed together."""


@dataclass(frozen=True)
class Spectrum:
    """One-sided ``density`` [unit²/Hz] at 1, 2, ... times ``step_Hz``, without half the sampling rate.

    ``segment`` is the length of a segment [samples], ``segments`` their number, ``used`` the samples that lie in at
    least one. The amplitude of a sine is sqrt(2 density ``noise_bandwidth_Hz``).
    """

    step_Hz: float
    noise_bandwidth_Hz: float
    segment: int
    segments: int
    used: int
    density: Array


def welch(values: Array, period_s: float) -> Spectrum | None:
    """Return the spectrum of samples of which some may be missing (nan), None without LEAST_SAMPLES consecutive ones.

    Hann windows that overlap by half; the mean of each segment is removed. No segment contains a missing sample.
    """
    stretches = list(_unbroken(values))
    longest = max((end - begin for begin, end in stretches), default=0)
    if longest < LEAST_SAMPLES:
        return None
    segment = segment_of(longest)
    hop = segment // 2
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
    squares, segments, used = np.zeros(hop - 1), 0, 0
    for begin, end in stretches:
        if end - begin < segment:
            continue
        frames = sliding_window_view(values[begin:end], segment)[::hop]
        segments += len(frames)
        used += (len(frames) - 1) * hop + segment
        for first in range(0, len(frames), _AT_ONCE):
            some = frames[first : first + _AT_ONCE]
            lines = np.fft.rfft((some - some.mean(axis=1, keepdims=True)) * window, axis=1)[:, 1:hop]
            squares += np.sum(lines.real**2 + lines.imag**2, axis=0)
    power = float(np.sum(window**2))
    return Spectrum(
        step_Hz=1.0 / (segment * period_s),
        noise_bandwidth_Hz=power / (float(np.sum(window)) ** 2 * period_s),
        segment=segment,
        segments=segments,
        used=used,
        density=2.0 * period_s / power * squares / segments,
    )


def segment_of(samples: int) -> int:
    """Return the length of the segments that so many consecutive samples are cut into."""

    def largest(most: int, least: int) -> int:
        return min(most, 1 << (samples // least).bit_length() - 1)

    return max(largest(USUAL_SEGMENT, _LEAST_SEGMENTS), largest(LONGEST_SEGMENT, _MANY))


def _unbroken(values: Array) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.isfinite(values).astype(np.int8), prepend=0, append=0))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
