"""Standard errors that stay honest when the residuals are coloured: the sandwich formula with a HAC middle."""

import numpy as np

from backend.identification.record import Signal


def sandwich(instruments: Signal, sensitivities: Signal, residuals: Signal) -> Signal:
    """Covariance of the solution of instruments' residuals = 0, shape (p, p).

    ``instruments`` Z and ``sensitivities`` J, shape (n, p); ``residuals`` shape (n,). NaN for
    parameters without effect.
    (Z'J)^-1 M (Z'J)^-T, where M is the long-run covariance of Z_t e_t: sum over lags of their covariances with
    Bartlett weights (Newey and West 1987), over a bandwidth chosen from the data (Andrews 1991).
    """
    scale = np.linalg.norm(instruments, axis=0), np.linalg.norm(sensitivities, axis=0)
    unknown = ~(np.all(np.isfinite(instruments), axis=0) & np.all(np.isfinite(sensitivities), axis=0))
    unknown |= ~((scale[0] > 0.0) & (scale[1] > 0.0))
    if np.any(unknown):
        # What has no effect on the record, or none that numbers can hold, is not determined by it.
        known = ~unknown
        covariance = np.full((known.size, known.size), np.nan)
        if np.any(known):
            covariance[np.ix_(known, known)] = sandwich(instruments[:, known], sensitivities[:, known], residuals)
        return covariance
    bread = np.linalg.inv((instruments / scale[0]).T @ (sensitivities / scale[1]))
    moments = instruments / scale[0] * residuals[:, np.newaxis]
    middle = _long_run(moments)
    covariance = bread @ middle @ bread.T / np.outer(scale[1], scale[1])
    return np.asarray((covariance + covariance.T) / 2.0)


def _long_run(moments: Signal) -> Signal:
    """Sum over lags of Bartlett weight times covariance, evaluated in the frequency domain, shape (p, p)."""
    from scipy.fft import next_fast_len, rfft

    bandwidth = _bandwidth(moments)
    size = next_fast_len(moments.shape[0] + bandwidth, real=True)
    weights = np.zeros(size)
    weights[: bandwidth + 1] = 1.0 - np.arange(bandwidth + 1) / (bandwidth + 1.0)
    weights[size - bandwidth :] = weights[bandwidth:0:-1]
    spectrum = rfft(moments, size, axis=0)
    window = rfft(weights).real
    window[1 : (size + 1) // 2] *= 2.0
    return np.asarray((spectrum.conj().T @ (window[:, np.newaxis] * spectrum)).real / size)


def _bandwidth(moments: Signal) -> int:
    """Andrews' bandwidth for Bartlett weights, from a first-order autoregression of each column."""
    count = moments.shape[0]
    past, now = moments[:-1], moments[1:]
    power = np.maximum(np.sum(moments**2, axis=0), np.finfo(float).tiny)  # a perfect fit leaves nothing
    rho = np.clip(np.sum(past * now, axis=0) / power, -0.97, 0.9999)
    spread = 4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
    return int(min(np.ceil(1.1447 * (np.mean(spread) * count) ** (1.0 / 3.0)), count // 10))
