"""Polynomials of a load sweep: exact for polynomial springs, with the order that fits the points."""

from collections.abc import Callable

import numpy as np
import pytest

from backend.identification.records import RecordError, Signal
from backend.identification.spring import identify_spring
from tests.refusals import refused

STEPS = np.linspace(0.0, 0.04, 25)
TREMOR = 0.02 * np.sin(1e3 * np.arange(STEPS.size) ** 2)
"""An error of measurement [N] that no polynomial follows."""


def quadratic(x: Signal) -> Signal:
    return np.asarray(100.0 * x + 15_000.0 * x**2)


def cubic(x: Signal) -> Signal:
    return np.asarray(200.0 * x + 500_000.0 * x**3)


def test_a_quadratic_spring_is_found_exactly_with_the_lowest_order() -> None:
    found = identify_spring(STEPS, quadratic(STEPS))
    assert found.best.k == pytest.approx((0.0, 100.0, 15_000.0), abs=1e-6)
    assert (found.recommended, found.best.rising) == (2, True)
    assert found.reason.code == "lowest_order_suffices"


@pytest.mark.parametrize("spring", [quadratic, cubic])
def test_the_fitted_force_matches_the_spring_between_and_beyond_its_points(
    spring: Callable[[Signal], Signal],
) -> None:
    x = np.array([[-0.001, 0.0, 0.0123], [0.0271, 0.04, 0.045]])
    for fit in identify_spring(STEPS, spring(STEPS)).fits[0 if spring is quadratic else 1 :]:
        np.testing.assert_allclose(fit.force(x), spring(x), atol=1e-6)


def test_the_recommended_order_for_a_cubic_spring_is_the_one_that_predicts_its_points() -> None:
    found = identify_spring(STEPS, cubic(STEPS) + TREMOR)
    second, third, fifth = found.fits
    assert (found.recommended, found.reason.code) == (3, "higher_order_is_better")
    assert third.cross_validation_N < 0.8 * second.cross_validation_N
    assert fifth.cross_validation_N > 0.8 * third.cross_validation_N
    assert third.k[3] == pytest.approx(500_000.0, rel=0.05)


def test_cross_validation_equals_fits_without_one_point_each() -> None:
    F = cubic(STEPS) + TREMOR
    missed = []
    for left_out in range(STEPS.size):
        rest = np.arange(STEPS.size) != left_out
        coefficients = np.polyfit(STEPS[rest], F[rest], 2)
        missed.append(F[left_out] - np.polyval(coefficients, STEPS[left_out]))
    assert identify_spring(STEPS, F).fits[0].cross_validation_N == pytest.approx(np.sqrt(np.mean(np.square(missed))))


@pytest.mark.parametrize(("softest", "rises"), [(0.3, True), (-0.3, False)])
def test_a_spring_with_a_small_positive_slope_counts_as_rising(softest: float, rises: bool) -> None:
    """Slopes are in N/m; the smallest is at the beginning."""
    x = np.linspace(0.0, 1.0, 25)
    assert identify_spring(x, 0.02 + softest * x + 2.0 * x**2).fits[0].rising is rises


def test_a_higher_order_with_a_falling_force_is_not_recommended() -> None:
    """Beyond its maximum, a cubic assigns a lower force to a larger elongation."""
    x = np.linspace(0.0, 1.0, 25)
    F = 3.0 * x - 2.0 * x**3
    found = identify_spring(x, F)
    assert found.fits[1].cross_validation_N < 0.1 * found.fits[0].cross_validation_N
    assert (found.fits[1].rising, found.recommended) == (False, 2)


def test_spring_data_of_a_pushing_tendon_are_rejected() -> None:
    with refused(RecordError, "tendon_pushes", force_N=pytest.approx(-2.0)):
        identify_spring(STEPS, quadratic(STEPS) - 2.0)
