"""Standard errors against closed forms: where the truth is known, and where the formula is written out lag by lag."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from backend.identification.estimation import estimate_model
from backend.identification.fitting import Method
from backend.identification.records import Record
from backend.identification.validation import sandwich
from tests.identification.closed_loop_records import FIRST, PERIOD_S, closed_loop_record, held_response

Array = NDArray[np.float64]


def coloured(pole: float, count: int, random: np.random.Generator) -> Array:
    """First-order autoregression of variance 1, shape (count,)."""
    return np.asarray(lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], random.standard_normal(count)))


@pytest.mark.parametrize(("pole", "tolerance"), [(0.0, 0.05), (0.6, 0.1)])
def test_least_squares_under_known_noise_has_its_exact_covariance(pole: float, tolerance: float) -> None:
    """Mean over seeds against (J'J)^-1 J' R J (J'J)^-1 with the noise's own R; a factor of two would be seen."""
    count, random = 1500, np.random.default_rng(4)
    J = np.column_stack([coloured(pole, count, random), coloured(0.8 * pole, count, random)])
    bread = np.linalg.inv(J.T @ J)
    exact = np.diag(bread @ J.T @ toeplitz(pole ** np.arange(count)) @ J @ bread)
    found = np.zeros(2)
    for _ in range(40):
        noise = coloured(pole, count, random)
        residuals = noise - J @ (bread @ (J.T @ noise))
        found += np.diag(sandwich(J, J, residuals)) / 40
    assert found == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize("pole", [0.2, 0.7, 0.95])
def test_the_middle_is_newey_and_wests_sum_over_andrews_bandwidth(pole: float) -> None:
    """The two papers' formulas, lag by lag: other weights or another bandwidth give another matrix."""
    count, random = 600, np.random.default_rng(9)
    Z = np.column_stack([coloured(pole, count, random), coloured(0.5, count, random)])
    J = Z + 0.3 * random.standard_normal(Z.shape)
    e = coloured(pole, count, random)
    moments = Z * e[:, np.newaxis]
    rho = np.sum(moments[1:] * moments[:-1], axis=0) / np.sum(moments**2, axis=0)
    alpha = np.mean(4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2))  # Andrews (6.4), moments weighted alike
    bandwidth = int(np.ceil(1.1447 * (alpha * count) ** (1.0 / 3.0)))  # Andrews (6.2), Bartlett
    assert 2 <= bandwidth < count / 10
    middle = moments.T @ moments
    for lag in range(1, bandwidth + 1):
        product = moments[lag:].T @ moments[:-lag]
        middle += (1.0 - lag / (bandwidth + 1)) * (product + product.T)  # Newey and West (5)
    bread = np.linalg.inv(Z.T @ J)
    assert sandwich(Z, J, e) == pytest.approx(bread @ middle @ bread.T, rel=1e-9)


@pytest.mark.parametrize("snr_dB", [20.0, 30.0])
def test_standard_errors_of_an_estimate_are_those_of_cramer_and_rao(snr_dB: float) -> None:
    """White noise on the output, the measured input given: the bound follows from the slope of the response alone."""
    u, y, _ = closed_loop_record(FIRST, snr_dB, 11)
    found = estimate_model(Record(PERIOD_S, u, y), "first", Method.OUTPUT_ERROR)
    slopes = [
        (held_response(FIRST | {name: 1.001 * value}, u) - held_response(FIRST | {name: 0.999 * value}, u))
        / (0.002 * value)
        for name, value in FIRST.items()
    ]
    nuisance = np.column_stack([np.ones(u.size), np.arange(u.size), np.exp(-np.arange(u.size) * PERIOD_S / FIRST["T"])])
    J = np.column_stack(slopes)
    J -= nuisance @ np.linalg.lstsq(nuisance, J)[0]
    sigma = np.std(y - held_response(FIRST, u))
    bound = sigma * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    assert [found.std_errors[name] for name in FIRST] == pytest.approx(bound, rel=0.1)
