"""Correlations of long signals through the FFT."""

import numpy as np

from backend.identification.record import Signal


def correlation(later: Signal, earlier: Signal) -> Signal:
    """Sum over k of later[k + lag] earlier[k], for lag = 0 .. n-1; shape (n,)."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * later.size)
    return np.asarray(irfft(rfft(later, size) * np.conj(rfft(earlier, size)), size)[: later.size])
