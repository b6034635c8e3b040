"""Excitations and the frequency response without a model."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import coherence, cont2discrete, csd, detrend, dlsim, tf2ss

from backend.experiments import ActuatorIdentificationPlan
from backend.identification.excitation import SEGMENTS, check_frequency_response, welch_response
from backend.identification.models import FrequencyCheck, Model
from backend.identification.records import Record
from tests.identification.closed_loop_records import FIRST, Array, closed_loop_record

# The frequency response without a model: exact for periodic signals, equal to Welch's method of SciPy.

PERIOD_S = 1e-3
LENGTH = 2000
"""Samples of a segment; half of it is how far one lies behind the other."""
GAIN, TAU = 2.0, 2e-3
FOUR_LAGS = tf2ss([GAIN], np.poly(np.full(4, -1.0 / TAU)) * TAU**4)


def lines(check: FrequencyCheck) -> NDArray[np.int64]:
    """Return the numbers of the compared lines: periods per segment."""
    return np.round(np.array(check.omega) * LENGTH * PERIOD_S / (2.0 * np.pi)).astype(int)


def noise(seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal(SEGMENTS * LENGTH)


@pytest.fixture(scope="module")
def excited() -> NDArray[np.int64]:
    """Return the compared lines that are periodic in each segment and far enough apart for the window.

    They end at a tenth of the sampling rate; four lags reduce the steps of the input above by a factor of 1e-5.
    """
    compared = lines(
        check_frequency_response(Model("first", {"K": 1.0, "T": 1.0}), Record(PERIOD_S, noise(0), noise(1)))
    )
    return np.asarray(compared[(compared % 2 == 0) & (compared >= 40) & (compared <= 200)])


@pytest.fixture(scope="module")
def periodic(excited: NDArray[np.int64]) -> Record:
    """Return cosines at these lines filtered by four lags in SciPy, in the steady state."""
    k = np.arange((SEGMENTS + 1) * LENGTH)
    u = np.sum([np.cos(2.0 * np.pi * line * k / LENGTH + 0.1 * line**2) for line in excited], axis=0)
    y = dlsim(cont2discrete(FOUR_LAGS, PERIOD_S), u)[1][:, 0]
    return Record(PERIOD_S, u[LENGTH:], y[LENGTH:])


def test_the_response_to_periodic_signals_is_that_of_the_sampled_system(
    excited: NDArray[np.int64], periodic: Record
) -> None:
    found = welch_response(periodic)
    A, B, C = cont2discrete(FOUR_LAGS, PERIOD_S)[:3]
    around = np.exp(2j * np.pi * excited / LENGTH)
    truth = [(C @ np.linalg.solve(z * np.eye(4) - A, B)).item() for z in around]
    assert excited.size >= 5
    np.testing.assert_allclose(found.response[excited - 1], truth, rtol=1e-5)
    np.testing.assert_allclose(found.coherence[excited - 1], 1.0, rtol=1e-9)
    np.testing.assert_allclose(found.excitation[excited - 1], 1.0, rtol=1e-2)


@pytest.mark.parametrize(("gain", "lag"), [(1.0, 1.0), (1.1, 1.0), (0.95, 1.0), (1.0, 0.5)])
def test_the_deviation_of_a_model_from_the_response_equals_its_true_error(
    excited: NDArray[np.int64], periodic: Record, gain: float, lag: float
) -> None:
    """The gain and the time constant of the model are scaled; the reference is the closed form of four lags."""
    turned = 2.0 * np.pi * excited / (LENGTH * PERIOD_S) * TAU
    ratio = gain * ((1.0 + turned**2) / (1.0 + (lag * turned) ** 2)) ** 2
    phase_deg = 4.0 * np.degrees(np.arctan(turned) - np.arctan(lag * turned))
    check = check_frequency_response(Model("lags4", {"K": gain * GAIN, "tau": lag * TAU}), periodic)
    assert check.trusted_lines == excited.size
    assert check.worst_gain_percent == pytest.approx(100.0 * np.max(np.abs(ratio - 1.0)), abs=0.01)
    assert check.worst_phase_deg == pytest.approx(np.max(np.abs(phase_deg)), abs=0.01)


def test_response_and_coherence_in_noise_match_scipy() -> None:
    u = noise(2)
    y = dlsim(cont2discrete(FOUR_LAGS, PERIOD_S), u)[1][:, 0] + 0.2 * noise(3)
    found = welch_response(Record(PERIOD_S, u, y))
    told = coherence(detrend(u), detrend(y), nperseg=LENGTH)[1][1:]
    np.testing.assert_allclose(found.coherence, told, rtol=1e-9, atol=1e-12)
    assert 0.0 < np.min(told) < 0.1 < 0.9 < np.max(told) < 1.0
    u_y, u_u = (csd(detrend(u), detrend(other), nperseg=LENGTH)[1][1:] for other in (y, u))
    np.testing.assert_allclose(found.response, u_y / u_u, rtol=1e-9)
    np.testing.assert_allclose(found.excitation[:-1], u_u[:-1] / np.max(u_u[:-1]), rtol=1e-9)


def test_both_cross_spectra_in_closed_loop_use_the_set_point() -> None:
    u, y, r = closed_loop_record(FIRST, 10.0, 1, samples=SEGMENTS * LENGTH)
    found = welch_response(Record(PERIOD_S, u, y, r=r))
    r_y, r_u = (csd(detrend(r), detrend(other), nperseg=LENGTH)[1][1:] for other in (y, u))
    np.testing.assert_allclose(found.response, r_y / r_u, rtol=1e-6)


# The maximum-length sequence of the identification.


@pytest.mark.parametrize("bits", range(4, 13))
def test_the_autocorrelation_of_the_prbs_is_flat(bits: int) -> None:
    """A maximum-length sequence has an autocorrelation of -1 at every shift within its period."""
    levels = ActuatorIdentificationPlan(bits=bits, chip_s=0.01).excitation().levels
    sequence = np.array([1.0 if level == "+" else -1.0 for level in levels])
    assert sequence.size == 2**bits - 1
    spectrum = np.abs(np.fft.fft(sequence)) ** 2
    correlation = np.fft.ifft(spectrum).real
    assert correlation[0] == pytest.approx(sequence.size)
    np.testing.assert_allclose(correlation[1:], -1.0, atol=1e-6)
