"""Whether an input reacts to the noise of its output: a record of a closed loop that does not say so."""

import numpy as np

from backend.identification.errors import UnstableModelError
from backend.identification.linearisation import least_squares
from backend.identification.record import Signal

LEVEL = 1e-6
MIN_EXPLAINED = 0.1
_OWN_LAGS = 25
_LAGS = 3
_USUAL = 4.0
_EXACT = 1e-9


def reacts_to_noise(u: Signal, residuals: Signal, gain: float) -> bool:
    """Whether u, shape (n,), acts against a model's residuals up to its own instant, beyond what its past tells.

    In open loop the noise of the output says nothing about the input to come. Samples at which the input takes an
    unusual step, as at the edges of a sequence, are left out: between them a controller shows best. The regression
    on the residuals has to be significant (F test) and to explain a tenth of what the past leaves open. With the
    model's ``gain``, the reaction has to be a negative feedback: an output that shows its input at once, which no
    model here does, goes the other way.
    """
    from scipy.stats import f as fisher

    if np.mean(np.diff(u) == 0.0) > 0.5:
        return False  # held, as no controller does at this rate
    past = np.column_stack([np.ones(u.size - _OWN_LAGS), *_lagged(u, range(1, _OWN_LAGS + 1))])
    noise = np.column_stack(_lagged(residuals, range(_LAGS)))
    now = u[_OWN_LAGS:]
    try:
        open_ = np.abs(now - past @ least_squares(past, now))
        usual = float(np.median(open_))
        if not usual > _EXACT * float(np.std(u)):
            return False  # its past tells it exactly
        kept = open_ <= _USUAL * usual
        past, both, now = past[kept], np.column_stack((past, noise))[kept], now[kept]
        open_ = now - past @ least_squares(past, now)
        left = [float(np.sum(error**2)) for error in (open_, now - both @ least_squares(both, now))]
    except (UnstableModelError, np.linalg.LinAlgError):
        return False
    spare = now.size - both.shape[1]
    explained = 1.0 - left[1] / left[0]
    against = gain * float(open_ @ noise[kept, 0]) < 0.0
    if not (against and spare > 0 and explained > MIN_EXPLAINED):
        return False
    return bool(fisher.sf(explained / (1.0 - explained) * spare / _LAGS, _LAGS, spare) < LEVEL)


def _lagged(signal: Signal, lags: range) -> list[Signal]:
    return [signal[_OWN_LAGS - lag : signal.size - lag] for lag in lags]
