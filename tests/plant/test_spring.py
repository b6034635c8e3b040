"""The spring against the paper's figures, against numpy's polynomials and SciPy's interpolation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from plant.dynamics import (
    Spring,
    polynomial_spring,
    require_stiffening,
    spring_curvature,
    spring_elongation,
    spring_polynomial,
    spring_slope,
    tabulated_spring,
    tendon_tension,
    tendon_tension_slope,
)
from plant.parameters import PlantParameters, load_parameters

K = (-2.498, 331.49, 8543.8)
CUBIC = (-2.0, 300.0, 7000.0, 40_000.0)
PAPER = polynomial_spring(K, 0.06135, 1e5)
r_j = 75e-3


def table_of(k: tuple[float, ...], rows: int) -> tuple[np.ndarray, np.ndarray]:
    curve = np.polynomial.Polynomial(k)
    x = np.linspace(max(curve.roots().real), 0.062, rows)
    F = curve(x)
    F[0] = 0.0
    return x, F


def test_force_and_root_are_the_papers() -> None:
    assert tendon_tension(PAPER, 0.06135) == pytest.approx(50.0, abs=0.01)
    assert pytest.approx(6.46e-3, abs=5e-6) == PAPER.x_slack


@pytest.mark.parametrize(("F", "S"), [(10.0, 8.24), (20.0, 10.55), (30.0, 12.43), (40.0, 14.06)])
def test_stiffness_at_the_nominal_tensions(F: float, S: float) -> None:
    x = spring_elongation(PAPER, F)
    assert tendon_tension(PAPER, x) == pytest.approx(F, abs=1e-9)
    assert 2.0 * r_j**2 * tendon_tension_slope(PAPER, x) == pytest.approx(S, abs=0.006)


def test_least_stiffness_under_the_pulling_constraint_is_that_of_erratum_E8() -> None:
    assert 2.0 * r_j**2 * spring_slope(PAPER, PAPER.x_slack) == pytest.approx(4.97, abs=0.005)


@pytest.mark.parametrize("k", [K, CUBIC, (-2.0, 300.0, 7000.0, 4e4, 1e5, 2e6)])
def test_polynomials_of_order_2_to_5_and_their_derivatives(k: tuple[float, ...]) -> None:
    spring, curve = polynomial_spring(k, 0.05, 1e5), np.polynomial.Polynomial(k)
    for x in np.linspace(0.008, 0.0499, 17):
        assert tendon_tension(spring, x) == pytest.approx(curve(x), rel=1e-12)
        assert tendon_tension_slope(spring, x) == pytest.approx(curve.deriv()(x), rel=1e-12)
        assert spring_curvature(spring, x) == pytest.approx(curve.deriv(2)(x), rel=1e-12)


@pytest.mark.parametrize("k", [K, CUBIC])
def test_table_is_the_monotone_cubic_of_scipy(k: tuple[float, ...]) -> None:
    x, F = table_of(k, 12)
    spring, reference = tabulated_spring(x, F, 0.06, 1e5), PchipInterpolator(x, F)
    for value in np.linspace(x[0] + 1e-6, 0.06, 97):
        assert tendon_tension(spring, value) == pytest.approx(reference(value), abs=1e-10)
        assert tendon_tension_slope(spring, value) == pytest.approx(reference(value, 1), abs=1e-8)
    assert pytest.approx(reference(0.06), abs=1e-10) == spring.F_solid


@pytest.fixture(params=["polynomial", "table"])
def spring(request: pytest.FixtureRequest) -> Spring:
    return PAPER if request.param == "polynomial" else tabulated_spring(*table_of(CUBIC, 9), 0.06, 1e5)


def test_tendon_never_pushes_and_never_pulls_less_when_stretched_further(spring: Spring) -> None:
    forces = np.array([tendon_tension(spring, x) for x in np.linspace(-0.2, 0.2, 2001)])
    assert forces[0] == 0.0
    assert np.all(np.diff(forces) >= 0.0)
    assert tendon_tension_slope(spring, spring.x_slack - 1e-9) == 0.0


def test_coils_on_coils_are_steep_and_join_without_a_jump(spring: Spring) -> None:
    beyond, before = tendon_tension(spring, spring.x_solid + 1e-9), tendon_tension(spring, spring.x_solid - 1e-9)
    assert beyond == pytest.approx(before, abs=1e-3)
    assert tendon_tension(spring, spring.x_solid + 1e-3) == pytest.approx(spring.F_solid + 100.0)
    assert tendon_tension_slope(spring, spring.x_solid + 1e-6) > 50.0 * spring_slope(spring, spring.x_solid)


@given(st.floats(0.1, 49.9))
def test_elongation_inverts_tension(F: float) -> None:
    assert tendon_tension(PAPER, spring_elongation(PAPER, F)) == pytest.approx(F, rel=1e-12)


@pytest.mark.parametrize("F", [-1.0, 0.0, 51.0])
def test_elongation_refuses_what_the_spring_cannot_carry(F: float) -> None:
    with pytest.raises(ValueError, match=rf"{F:g} N is outside 0-50\.0 N"):
        spring_elongation(PAPER, F)


def test_curves_that_do_not_rise_are_refused() -> None:
    with pytest.raises(ValueError, match=r"no zero-force root below x_solid = 0\.06 m"):
        polynomial_spring((3.0, 300.0, 8000.0), 0.06, 1e5)
    with pytest.raises(ValueError, match=r"falls at x = 0\.05"):
        polynomial_spring((-2.0, 400.0, 5000.0, -1e5), 0.06, 1e5)
    x, F = table_of(K, 8)
    F[4] = F[3]
    with pytest.raises(ValueError, match="do not after row 4"):
        tabulated_spring(x, F, 0.06, 1e5)


def test_what_a_curve_does_below_its_root_is_of_no_concern() -> None:
    """Its lowest point may lie right below the root, where the tendon is slack."""
    k2, lowest, depth = 8000.0, 6e-3, 8e-7
    spring = polynomial_spring((k2 * lowest**2 - depth, -2.0 * k2 * lowest, k2), 0.06, 1e5)
    assert spring.x_slack == pytest.approx(lowest + (depth / k2) ** 0.5)


def test_tables_that_cannot_be_used_are_refused() -> None:
    x, F = table_of(K, 8)
    with pytest.raises(ValueError, match="3 rows or more"):
        tabulated_spring(x[:2], F[:2], 0.06, 1e5)
    with pytest.raises(ValueError, match="not finite"):
        tabulated_spring(x, np.where(F > 30.0, np.nan, F), 0.06, 1e5)
    with pytest.raises(ValueError, match="begin at zero force"):
        tabulated_spring(x, F + 1.0, 0.06, 1e5)
    with pytest.raises(ValueError, match=r"x_solid = 0\.07 m lies outside the spring table"):
        tabulated_spring(x, F, 0.07, 1e5)


def test_a_spring_that_does_not_stiffen_cannot_set_stiffness() -> None:
    require_stiffening(PAPER)
    require_stiffening(tabulated_spring(*table_of(CUBIC, 9), 0.06, 1e5))
    with pytest.raises(ValueError, match="does not stiffen at x = "):
        require_stiffening(polynomial_spring((-2.0, 300.0, 0.0), 0.06, 1e5))
    x, F = table_of(K, 9)
    F[4] += 1.0
    with pytest.raises(ValueError, match="fewer and smoother points"):
        require_stiffening(tabulated_spring(x, F, 0.06, 1e5))


def test_the_curve_goes_on_where_the_tendon_is_slack(ideal: PlantParameters) -> None:
    assert spring_polynomial(ideal.make_identified_spring("A"), 0.0) == pytest.approx(K[0])
    assert load_parameters("lab").make_dynamics().spring_A.k == pytest.approx([0.985 * k for k in K])


def test_a_table_with_uneven_steps_is_that_of_scipy_too() -> None:
    x = np.array([0.0, 0.004, 0.006, 0.02, 0.023, 0.05, 0.062])
    F = np.array([0.0, 1.0, 2.5, 9.0, 12.0, 40.0, 60.0])
    spring, reference = tabulated_spring(x, F, 0.06, 1e5), PchipInterpolator(x, F)
    for value in np.linspace(1e-6, 0.06, 211):
        assert tendon_tension(spring, value) == pytest.approx(reference(value), abs=1e-10)
        assert tendon_tension_slope(spring, value) == pytest.approx(reference(value, 1), abs=1e-8)
