"""Excitation of two channels: closed forms of the correlation between the inputs."""

import numpy as np
import pytest

from backend.identification import build_mls_pair, build_multisine_pair, correlate_inputs
from backend.identification.records import IdentificationError
from tests.refusals import refused


def circular(u: np.ndarray, lag: int) -> float:
    """Return the correlation over a period of the second input, later by the lag, with the first."""
    return float(np.mean(np.roll(u[:, 1], -lag) * u[:, 0]))


def triangle(lag_chips: float, N: int) -> float:
    """Return the autocorrelation of a maximum-length sequence of held chips, Godfrey (1993)."""
    near = abs((lag_chips + N / 2.0) % N - N / 2.0)
    return 1.0 - near * (1.0 + 1.0 / N) if near < 1.0 else -1.0 / N


@pytest.mark.parametrize(("bits", "chip"), [(4, 5), (5, 8), (7, 3)])
def test_the_correlation_of_both_sequences_is_the_closed_form(bits: int, chip: int) -> None:
    N = 2**bits - 1
    u = build_mls_pair(bits, chip, 1)
    delay = (N + 1) // 2
    assert u.shape == (N * chip, 2)
    for lag in range(-N * chip // 2, N * chip // 2 + 1):
        assert circular(u, lag) == pytest.approx(triangle(lag / chip - delay, N), abs=1e-12)


def test_a_sequence_of_7_bits_and_80_ms_is_late_by_half_of_10_s() -> None:
    u = build_mls_pair(7, 80, 2, (0.1, 2.0), memory_samples=2500)
    assert u.shape == (20320, 2)
    assert np.array_equal(u[5120:, 1], 20.0 * u[:-5120, 0])
    assert set(np.unique(u[:, 0])) == {-0.1, 0.1}
    assert set(np.unique(u[:, 1])) == {-2.0, 2.0}


def test_odd_and_even_lines_are_uncorrelated_at_every_lag() -> None:
    u = build_multisine_pair(40, 1000, 1, (0.5, 2.0))
    assert max(abs(circular(u, lag)) for lag in range(1000)) < 1e-12
    assert np.max(np.abs(u), axis=0) == pytest.approx([0.5, 2.0])
    power = np.abs(np.fft.rfft(u, axis=0)) ** 2
    excited = power > 1e-9 * power.max(axis=0)
    assert np.flatnonzero(excited[:, 0]).tolist() == list(range(1, 41, 2))
    assert np.flatnonzero(excited[:, 1]).tolist() == list(range(2, 41, 2))
    assert power[1:41:2, 0] == pytest.approx(power[1, 0])


def test_the_reported_correlation_covers_the_memory_and_finds_the_delay_beyond() -> None:
    N, chip = 127, 20
    u = build_mls_pair(7, chip, 2)
    within = correlate_inputs(u, 0.001, 1.0)
    assert within.at_zero == pytest.approx(-1.0 / N, abs=1e-3)
    assert abs(within.largest) < 0.1
    assert len(within.lags_s) == len(within.correlation) == 201
    assert within.lags_s[0] == -within.lags_s[-1] == pytest.approx(-1.0)
    beyond = correlate_inputs(u, 0.001, 1.4)
    assert beyond.largest == pytest.approx(1.0, abs=0.01)
    assert beyond.largest_lag_s == pytest.approx(64 * chip * 0.001)


def test_the_correlation_at_a_lag_is_that_of_the_samples_that_overlap() -> None:
    random = np.random.default_rng(3)
    u = random.standard_normal((300, 2)) + np.array([5.0, -2.0])
    found = correlate_inputs(u, 0.5, 10.0)
    x, y = (u - u.mean(axis=0)).T
    for lag_s, value in zip(found.lags_s, found.correlation, strict=True):
        lag = round(lag_s / 0.5)
        first, second = (x[: 300 - lag], y[lag:]) if lag >= 0 else (x[-lag:], y[: 300 + lag])
        assert value == pytest.approx(first @ second / np.sqrt(first @ first * (second @ second)))


def test_a_delay_within_the_memory_is_rejected() -> None:
    with refused(IdentificationError, "half_period_too_short", length=5040, memory=5100):
        build_mls_pair(7, 80, 1, memory_samples=5100)


@pytest.mark.parametrize("lines", [1, 50])
def test_lines_beyond_half_the_sampling_rate_are_rejected(lines: int) -> None:
    with refused(IdentificationError, "lines_not_resolved", lines=lines, maximum=49):
        build_multisine_pair(lines, 100, 1)
