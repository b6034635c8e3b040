"""Conditions of the dynamic decoupling: examples that violate one, models of the literature, and their uncertainty."""

import math

import numpy as np
import pytest

from backend.tuning.coupled_model import CoupledModel
from backend.tuning.decoupling import (
    DecouplingCondition,
    DecouplingConditionKind,
    check_conditions,
    design_decoupling,
    estimate_static_coupling,
)
from backend.tuning.gains import TuningError
from tests.refusals import refused

Kind = DecouplingConditionKind
LAGS = (1.0, 3.0, 3.0, 1.0)
"""(s + 1)³."""


def model_of(
    B_11: tuple[float, ...], B_12: tuple[float, ...], B_21: tuple[float, ...], B_22: tuple[float, ...]
) -> CoupledModel:
    """Return a model with numerators in descending powers."""
    numerators = ((B_11[::-1], B_12[::-1]), (B_21[::-1], B_22[::-1]))
    return CoupledModel(((1.0, 5.0, 10.0, 10.0, 5.0, 1.0),) * 2, numerators)


def with_errors(model: CoupledModel, **errors: tuple[float, ...]) -> CoupledModel:
    """Return the model with independent standard errors of the named numerators, in descending powers."""
    deviations: list[float] = []
    for i in (0, 1):
        for j in (0, 1):
            deviations += errors.get(f"B_{i + 1}{j + 1}", (0.0,) * len(model.numerators[i][j]))[::-1]
    return CoupledModel(model.denominators, model.numerators, np.diag(np.square(deviations)))


def failed(model: CoupledModel) -> set[DecouplingConditionKind]:
    return {condition.kind for condition in design_decoupling(model).failed}


def find(
    conditions: tuple[DecouplingCondition, ...], kind: DecouplingConditionKind, element: str = ""
) -> DecouplingCondition:
    [found] = [c for c in conditions if c.kind == kind and element in ("", c.element)]
    return found


# Examples ------------------------------------------------------------------------------------------


def test_a_coupling_of_smaller_relative_degree_than_the_diagonal_fails() -> None:
    model = model_of((1.0,), (0.1, 0.0), (0.1,), (1.0, 1.0))
    design = design_decoupling(model)
    assert design.decoupler is None
    assert failed(model) == {Kind.RELATIVE_DEGREE}
    [condition] = design.failed
    assert (condition.element, condition.figure) == ("g_12", -1.0)
    assert condition.text.code == "relative_degree_condition"
    assert condition.text.values == {"element": "g_12", "reference": "g_11", "difference": -1.0}


def test_a_right_half_plane_zero_of_the_diagonal_fails() -> None:
    """By Rouché's theorem det G then has one too, as long as the coupling is weak."""
    model = model_of((-1.0, 2.0), (0.1, 0.0), (0.1, 0.0), (1.0, 1.0))
    assert failed(model) == {Kind.DIAGONAL_ZEROS, Kind.DETERMINANT_ZEROS, Kind.INTERCONNECTION}
    assert find(check_conditions(model), Kind.DIAGONAL_ZEROS, "g_11").figure == pytest.approx(2.0)


def test_a_right_half_plane_zero_that_a_whole_row_shares_is_cancelled() -> None:
    """The output then has inverse response whatever the inputs are, but the filter does not need its inverse."""
    model = model_of((-1.0, 1.0, 2.0), (-0.2, 0.4, 0.0), (0.1, 0.0), (1.0, 1.0))
    assert failed(model) == set()
    assert find(check_conditions(model), Kind.DIAGONAL_ZEROS, "g_11").figure == pytest.approx(-1.0)
    uncertain = with_errors(model, B_11=(1e-6, 0.0, 0.0))
    assert find(design_decoupling(uncertain).uncertain, Kind.DIAGONAL_ZEROS, "g_11").distance == 0.0


def test_a_right_half_plane_zero_of_the_determinant_fails() -> None:
    """1 − κ = 1 − 2/(s + 1)² has the zero √2 − 1, for filters that are stable themselves."""
    model = model_of((1.0, 1.0), (2.0,), (1.0,), (1.0, 1.0))
    assert failed(model) == {Kind.DETERMINANT_ZEROS, Kind.SAMPLED_GAIN, Kind.ALGEBRAIC_LOOP, Kind.INTERCONNECTION}
    assert find(check_conditions(model), Kind.DETERMINANT_ZEROS).figure == pytest.approx(math.sqrt(2.0) - 1.0)


def test_a_strong_coupling_in_the_sampled_range_fails_alone_if_its_loop_is_stable() -> None:
    """1 − κ = 1 + 2/(s + 1)² is stable, but not with every smaller phase of κ."""
    model = model_of((1.0, 1.0), (2.0,), (-1.0,), (1.0, 1.0))
    assert failed(model) == {Kind.SAMPLED_GAIN}
    assert find(check_conditions(model), Kind.SAMPLED_GAIN).figure == pytest.approx(2.0)
    resonant = model_of((1.0, 0.02, 1.0), (0.3, 0.0), (-0.1, 0.0), (1.0, 0.4, 1.0))
    expected = 0.03 / (0.02 * 0.4)  # at ω = 1
    assert find(check_conditions(resonant), Kind.SAMPLED_GAIN).figure == pytest.approx(expected, rel=1e-4)


def test_a_strong_coupling_at_high_frequency_fails() -> None:
    model = model_of((1.0, 1.0), (2.0, 0.0), (-1.0, 0.0), (1.0, 1.0))
    assert failed(model) == {Kind.HIGH_FREQUENCY_GAIN, Kind.SAMPLED_GAIN}
    assert find(check_conditions(model), Kind.HIGH_FREQUENCY_GAIN).figure == pytest.approx(2.0)


def test_an_algebraic_loop_without_a_unique_solution_fails() -> None:
    model = model_of((1.0, 1.0), (2.0, 0.0), (1.0, 0.0), (1.0, 1.0))
    conditions = check_conditions(model)
    assert Kind.ALGEBRAIC_LOOP in failed(model)
    s = 2000.0  # where the bilinear transform puts z = ∞
    assert find(conditions, Kind.ALGEBRAIC_LOOP).figure == pytest.approx(1.0 - 2.0 * (s / (s + 1.0)) ** 2, rel=1e-9)


def test_an_unstable_interconnection_fails_with_its_pole() -> None:
    model = model_of((1.0, 1.0), (2.0,), (1.0,), (1.0, 1.0))
    s = math.sqrt(2.0) - 1.0
    pole = (1.0 + 0.5e-3 * s) / (1.0 - 0.5e-3 * s)
    assert find(check_conditions(model), Kind.INTERCONNECTION).figure == pytest.approx(pole, rel=1e-12)


def test_a_zero_that_is_too_fast_for_the_sampling_fails() -> None:
    model = model_of((1e-4, 1.0), (1e-5, 0.0), (0.1, 0.0), (1.0, 1.0))
    assert failed(model) == {Kind.FAST_ZEROS}
    assert find(check_conditions(model), Kind.FAST_ZEROS, "g_11").figure == pytest.approx(1e4)


def test_a_filter_of_too_high_an_order_fails() -> None:
    model = model_of((1.0, 5.0, 10.0, 10.0, 5.0, 1.0), (0.1, 0.0), (0.1, 0.0), (1.0, 1.0))
    assert failed(model) == {Kind.FILTER_ORDER}


def test_the_other_pairing_is_checked_too() -> None:
    crossed = model_of((0.1, 0.0), (1.0, 1.0), (1.0, 1.0), (0.1, 0.0))
    design = design_decoupling(crossed)
    assert design.failed
    assert design.can_swap
    assert design.describe().values["can_swap"] is True
    assert design_decoupling(crossed.swap_inputs()).decoupler is not None


def test_without_coupling_the_other_pairing_has_no_diagonal() -> None:
    design = design_decoupling(model_of((1.0, 1.0), (0.0,), (0.0,), (1.0, 2.0)))
    assert design.decoupler is not None
    assert not design.can_swap
    assert {condition.kind for condition in design.swapped} == {Kind.RELATIVE_DEGREE}


def test_a_lever_at_rest_needs_one_filter() -> None:
    """Motor 2 of a lever type does not move the joint at rest: g_21 = 0, and any g_22 is permitted."""
    model = model_of((1.0, 1.0), (0.2, 0.0), (0.0,), (-1.0, 3.0))
    assert failed(model) == set()


# Models of the literature --------------------------------------------------------------------------


def wood_berry() -> CoupledModel:
    """Return the distillation column of Wood and Berry (1973) without its dead times; time in minutes."""
    T = ((16.7, 21.0), (10.9, 14.4))
    K = ((12.8, -18.9), (6.6, -19.4))
    denominators = tuple((1.0, a + b, a * b) for a, b in T)
    numerators = tuple(((k_1, k_1 * b), (k_2, k_2 * a)) for (k_1, k_2), (a, b) in zip(K, T, strict=True))
    # built by comprehensions, whose tuples have any length for mypy
    return CoupledModel(denominators, numerators)  # type: ignore[arg-type]


def test_the_wood_berry_column_is_decoupled_with_its_pairing_only() -> None:
    design = design_decoupling(wood_berry(), period_s=0.1)
    assert design.decoupler is not None
    assert not design.can_swap
    relative_gain = 1.0 / (1.0 - find(design.conditions, Kind.SAMPLED_GAIN).figure)
    kappa_0 = 18.9 * 6.6 / (12.8 * 19.4)
    kappa_high = kappa_0 * 16.7 * 14.4 / (21.0 * 10.9)
    assert 1.0 / (1.0 - kappa_0) == pytest.approx(2.009, abs=5e-4)  # the published relative gain
    assert find(design.conditions, Kind.HIGH_FREQUENCY_GAIN).figure == pytest.approx(kappa_high)
    assert relative_gain == pytest.approx(1.0 / (1.0 - kappa_high), rel=1e-6)
    zeros = np.roots(
        np.polyadd(
            -12.8 * 19.4 * np.polymul([21.0, 1.0], [10.9, 1.0]), 18.9 * 6.6 * np.polymul([16.7, 1.0], [14.4, 1.0])
        )
    )
    assert find(design.conditions, Kind.DETERMINANT_ZEROS).figure == pytest.approx(np.max(zeros.real))
    assert design.static is not None
    assert (design.static.d_12, design.static.d_21) == pytest.approx((18.9 / 12.8, 6.6 / 19.4))


def skogestad(relative_error: float) -> CoupledModel:
    """Return the high-purity column of Skogestad and Morari (1988), relative gain 35, with errors of its gains."""
    K = ((87.8, -86.4), (108.2, -109.6))
    errors = [relative_error * abs(k) for row in K for k in row]
    numerators = tuple(((k_1,), (k_2,)) for k_1, k_2 in K)
    # a repeated tuple has any length for mypy
    return CoupledModel(((1.0, 75.0),) * 2, numerators, np.diag(np.square(errors)))  # type: ignore[arg-type]


def test_an_ill_conditioned_column_is_decoupled_but_states_its_uncertainty() -> None:
    """1 % of each gain is enough: the distance of det G to 0 has a closed form."""
    p, q = 87.8 * 109.6, 86.4 * 108.2
    distance = (p - q) / (0.01 * math.sqrt(2.0 * (p**2 + q**2)))
    design = design_decoupling(skogestad(0.01))
    assert design.decoupler is not None
    assert 1.0 / (1.0 - find(design.conditions, Kind.SAMPLED_GAIN).figure) == pytest.approx(35.07, abs=0.01)
    uncertain = find(design.uncertain, Kind.DETERMINANT_ZEROS)
    assert uncertain.distance == pytest.approx(distance, rel=1e-6) == pytest.approx(1.446, abs=1e-3)
    gain_error = q / p * 0.01 * 2.0
    gain = find(design.uncertain, Kind.SAMPLED_GAIN)
    assert gain.distance == pytest.approx((1.0 - q / p) / gain_error, rel=1e-6)
    assert uncertain.describe() in design.describe()
    assert design_decoupling(skogestad(0.003)).uncertain == ()


# Uncertainty ---------------------------------------------------------------------------------------


def test_the_distance_of_one_zero_is_that_of_the_nearest_coefficient() -> None:
    base = model_of((1.0, 2.0), (0.1, 0.0), (0.1, 0.0), (1.0, 1.0))
    for errors, distance in (((0.1, 0.5), 4.0), ((0.5, 0.1), 2.0)):
        conditions = check_conditions(with_errors(base, B_11=errors))
        assert find(conditions, Kind.DIAGONAL_ZEROS, "g_11").distance == pytest.approx(distance, rel=1e-6)


def test_no_model_within_the_distance_has_an_unstable_zero_and_some_beyond_have() -> None:
    rng = np.random.default_rng(11)
    B_11, root = np.array([1.0, 0.5, 2.0, 0.4]), rng.standard_normal((4, 4)) * 0.05
    exact = model_of(tuple(B_11), (0.1, 0.0, 0.0, 0.0), (0.1, 0.0), (1.0, 1.0))
    covariance = np.zeros((12, 12))
    covariance[:4, :4] = (root @ root.T)[::-1, ::-1]
    model = CoupledModel(exact.denominators, exact.numerators, covariance)
    distance = find(check_conditions(model), Kind.DIAGONAL_ZEROS, "g_11").distance
    assert 0.1 < distance < 50.0
    directions = rng.standard_normal((20_000, 4))
    directions /= np.linalg.norm(directions, axis=1)[:, None]

    def unstable(radius: float) -> int:
        polynomials = B_11 + radius * directions @ root.T
        return sum(bool(np.max(np.roots(p).real) > 0.0) for p in polynomials)

    assert unstable(0.995 * distance) == 0
    assert unstable(1.1 * distance) > 0


def test_a_relative_degree_of_insignificant_coefficients_is_uncertain() -> None:
    base = model_of((0.1, 1.0), (0.1, 0.0), (0.1, 0.0), (1.0, 1.0))
    condition = find(check_conditions(with_errors(base, B_11=(0.08, 0.0))), Kind.RELATIVE_DEGREE, "g_12")
    assert condition.holds
    assert condition.distance == pytest.approx(1.25, rel=1e-6)
    assert not condition.is_certain
    improper = model_of((1.0,), (0.1, 0.5), (0.1, 0.0), (1.0, 1.0))
    condition = find(check_conditions(with_errors(improper, B_12=(0.2, 0.1))), Kind.RELATIVE_DEGREE, "g_12")
    assert not condition.holds
    assert condition.distance == pytest.approx(0.5, rel=1e-6)
    assert condition.describe().code == "within_standard_errors"


def test_an_exact_model_is_certain() -> None:
    assert {c.distance for c in check_conditions(wood_berry(), 0.1)} == {math.inf}
    assert all(c.is_certain for c in check_conditions(wood_berry(), 0.1))


def test_standard_errors_of_the_static_coupling_match_sampled_models() -> None:
    base = model_of((1.0, 2.0), (0.3, 0.5), (0.2, -0.4), (1.0, 4.0))
    coupling = estimate_static_coupling(
        with_errors(base, B_11=(0.0, 0.02), B_12=(0.0, 0.01), B_21=(0.0, 0.02), B_22=(0.0, 0.05))
    )
    assert coupling is not None
    assert (coupling.d_12, coupling.d_21) == pytest.approx((-0.25, 0.1))
    assert coupling.is_significant
    noise = np.random.default_rng(12).standard_normal((4, 40_000))
    d_12 = -(0.5 + 0.01 * noise[0]) / (2.0 + 0.02 * noise[1])
    d_21 = (0.4 + 0.02 * noise[2]) / (4.0 + 0.05 * noise[3])
    assert (coupling.error_12, coupling.error_21) == pytest.approx((d_12.std(), d_21.std()), rel=0.02)


def test_a_diagonal_without_static_gain_has_no_static_part() -> None:
    design = design_decoupling(model_of((1.0, 0.0), (0.1, 0.2), (0.1, 0.0), (1.0, 1.0)))
    assert design.static is None
    assert find(design.failed, Kind.DIAGONAL_ZEROS).figure == 0.0


# Refusals ------------------------------------------------------------------------------------------


def test_a_model_that_is_not_finite_is_refused() -> None:
    with refused(TuningError, "coefficient_not_finite", name="B_12", power=1):
        model_of((1.0, 1.0), (math.nan, 0.0), (0.0,), (1.0,))
    with refused(TuningError, "coefficient_not_finite", name="A_2", power=1, value=math.inf):
        CoupledModel(((1.0, 1.0), (1.0, math.inf)), (((1.0,), (0.0,)), ((0.0,), (1.0,))))
    with refused(TuningError, "polynomial_without_coefficients", name="B_21"):
        model_of((1.0,), (0.0,), (), (1.0,))
    with refused(TuningError, "denominator_not_normalized", name="A_1", constant=0.0):
        CoupledModel(((0.0, 1.0), (1.0, 1.0)), (((1.0,), (0.0,)), ((0.0,), (1.0,))))


def test_a_covariance_that_is_none_is_refused() -> None:
    numerators = (((1.0, 0.5), (0.0,)), ((0.0, 0.1), (1.0,)))
    denominators = ((1.0, 1.0), (1.0, 1.0))
    with refused(TuningError, "covariance_of_wrong_shape", shape=(5, 5), count=6):
        CoupledModel(denominators, numerators, np.eye(5))
    with refused(TuningError, "covariance_not_finite", count=1):
        CoupledModel(denominators, numerators, np.diag([1.0, 1.0, math.nan, 1.0, 1.0, 1.0]))
    lopsided = np.eye(6)
    lopsided[0, 1] = 0.5
    with refused(TuningError, "covariance_not_symmetric"):
        CoupledModel(denominators, numerators, lopsided)
    lopsided[0, 1] = lopsided[1, 0] = 1.5
    with refused(TuningError, "covariance_not_positive", eigenvalue=pytest.approx(-0.5)):
        CoupledModel(denominators, numerators, lopsided)


def test_swapping_the_inputs_twice_is_the_same_model() -> None:
    model = with_errors(wood_berry(), B_11=(1.0, 2.0), B_12=(3.0, 4.0), B_21=(5.0, 6.0), B_22=(7.0, 8.0))
    swapped = model.swap_inputs()
    assert swapped.numerators[0] == model.numerators[0][::-1]
    assert np.diag(swapped.numerator_covariance()) == pytest.approx(np.square([3, 4, 1, 2, 7, 8, 5, 6]))
    again = swapped.swap_inputs()
    assert again.numerators == model.numerators
    assert model.covariance is not None
    assert np.array_equal(again.covariance, model.covariance)  # type: ignore[arg-type]  # both are given here
