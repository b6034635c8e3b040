"""The residual tests and their plots agree: a point is outside what is drawn where the test fails, and only there."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from backend.analysis.identification_views import _build_correlation
from backend.identification.models import CorrelationTest
from backend.identification.validation import fit_autoregression, input_correlation, read_whiteness_test, whiteness
from backend.models.identification import ACTUATOR_QUALITY
from backend.models.upgrades import upgrade_quality
from tests.models.earlier_identifications import QUALITY

PERIOD_S = 1e-3
N = 4000


def made(seed: int, colour: float = 0.0, follows: float = 0.0) -> tuple[CorrelationTest, CorrelationTest]:
    random = np.random.default_rng(seed)
    u = np.repeat(random.choice([-1.0, 1.0], N // 20), 20)
    e = lfilter([1.0], [1.0, -colour], random.standard_normal(N)) + follows * u
    return whiteness(e, PERIOD_S), input_correlation(e, u, PERIOD_S, 0.05)


@pytest.mark.parametrize("colour", [0.0, 0.06])
def test_a_point_is_outside_the_drawn_bound_exactly_where_the_test_fails(colour: float) -> None:
    outcomes = set()
    for seed in range(60):
        for found in made(seed, colour, follows=0.04 * colour / 0.06):
            drawn = _build_correlation(found)
            inside = bool(np.all(np.abs(drawn["correlation"]) <= np.array(drawn["bound"])))
            assert inside is found.passed is drawn["passed"] is bool(drawn["statistic"] <= drawn["critical"])
            outcomes.add(inside)
    assert outcomes == ({True, False} if colour else {True})


def test_statistic_and_bound_are_in_standard_deviations_at_the_level_for_all_lags() -> None:
    found = made(3)[0]
    outcome = read_whiteness_test(found)
    # The autocorrelations of white noise have the standard deviation 1/sqrt(n).
    assert outcome.statistic == pytest.approx(np.max(np.abs(np.array(found.correlation, dtype=float))) * np.sqrt(N))
    assert outcome.critical == pytest.approx(norm.isf(0.005 / 25))
    np.testing.assert_allclose(outcome.bound, outcome.critical / np.sqrt(N))
    assert "largest of 25 correlations" in outcome.sentence
    assert f"bound {outcome.critical:.1f} at the 1 % level for all lags together" in outcome.sentence


@pytest.mark.parametrize("which", [0, 1])
def test_noise_fails_in_one_record_of_a_hundred(which: int) -> None:
    failed = sum(not made(seed)[which].passed for seed in range(1000, 1600))
    assert failed <= 14  # binomial, 600 trials of 1 %: more than 14 once in 1400


def test_a_test_that_was_stored_with_one_lags_band_gets_the_bound_of_the_whole_test() -> None:
    found = made(5, colour=0.2)[0]
    band = [norm.isf(0.005) / np.sqrt(N)] * 25
    old = {"lags_s": list(found.lags_s), "correlation": list(found.correlation), "band": band, "passed": found.passed}
    channel = QUALITY | {"residuals": {"whiteness": old, "input_correlation": old}}
    quality = upgrade_quality("actuator", {}, {"G_q": channel, "G_S": QUALITY})
    test = ACTUATOR_QUALITY.read(quality, "it").G_q.residuals.whiteness
    assert test.bound == pytest.approx(found.bound)
    assert read_whiteness_test(test).statistic == pytest.approx(read_whiteness_test(found).statistic)


@pytest.mark.parametrize("D", [[1.0], [1.0, -0.8], [1.0, -1.2, 0.7]])
def test_the_noise_model_is_the_polynomial_that_coloured_the_noise(D: list[float]) -> None:
    e = lfilter([1.0], D, np.random.default_rng(3).standard_normal(50 * N))
    found = fit_autoregression(e)
    assert found.size == len(D)
    assert found == pytest.approx(D, abs=5.0 / np.sqrt(e.size))
