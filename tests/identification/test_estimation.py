"""Estimates of models: consistency, dead times, standard errors."""

from dataclasses import replace
from typing import Unpack

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.signal import lfilter, lsim

from backend.identification.estimation import _shorten_lags, estimate_model
from backend.identification.fitting import Method, continuous_poles
from backend.identification.initialization import FitProblem, _lag_and_faster_poles
from backend.identification.models import KNOWN, Estimate, Grade, find_structure, simulate_response
from backend.identification.records import (
    Controller,
    IdentificationError,
    NotContinuousError,
    NotConvergedError,
    Record,
    StructureError,
)
from backend.identification.validation import sandwich
from tests.identification.closed_loop_records import (
    FIRST,
    K_I,
    K_P,
    ONE_HERTZ,
    PERIOD_S,
    THIRD,
    Disturbed,
    closed_loop_record,
    held_response,
)
from tests.identification.own_motor import Array, motor, noisy
from tests.identification.verdicts import find_reason, list_codes
from tests.reasons import assert_reason
from tests.refusals import refused

# Estimates of records with known parameters: consistent in closed loop, with correct standard errors.

CONTROLLER = Controller(K_P, K_I)
SUMMARY = [
    "parameters",
    "std_errors",
    "method",
    "fit_percent",
    "spread_percent",
    "friction",
    "input_offset",
    "hint",
    "grade",
    "verdict",
]
CASES = [pytest.param("first", FIRST, id="first"), pytest.param("third", THIRD, id="third")]


def record(truth: dict[str, float], snr_dB: float, seed: int, **options: Unpack[Disturbed]) -> Record:
    u, y, _ = closed_loop_record(truth, snr_dB, seed, **options)
    return Record(PERIOD_S, u, y, controller=CONTROLLER)


def errors_in_std(found: Estimate, truth: dict[str, float]) -> list[float]:
    return [(found.model.parameters[name] - truth[name]) / found.std_errors[name] for name in truth]


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_the_estimate_without_noise_equals_the_truth(name: str, truth: dict[str, float]) -> None:
    found = estimate_model(record(truth, 300.0, 0), name)
    assert found.model.parameters == pytest.approx(truth, rel=1e-6)
    assert found.fit_percent > 99.99


@pytest.mark.parametrize("method", [Method.DEFAULT, Method.OUTPUT_ERROR, Method.SRIVC])
@pytest.mark.parametrize(("name", "truth"), CASES)
def test_estimates_in_closed_loop_white_noise_are_within_their_standard_errors(
    name: str, truth: dict[str, float], method: Method
) -> None:
    found = estimate_model(record(truth, 20.0, 1), name, method)
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0
    assert all(found.std_errors[key] < 0.006 * truth[key] for key in truth)
    assert found.residuals.whiteness.passed
    assert found.residuals.input_correlation.passed


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e6])
def test_a_lightly_damped_resonance_in_noise_is_found_when_the_quick_starts_fail(unit: float) -> None:
    """A lag and a pole pair of damping 0.1 at 200 rad/s, few steps: least squares does not find the pair in the noise.

    The residual is not larger than that of the true response, computed by SciPy, and the estimate is within its errors,
    in any unit of the output.
    """
    truth = {"K": unit, "T": 0.4, "a2": 2.5e-5, "a1": 1e-3}
    random = np.random.default_rng(174)
    u = np.repeat(random.choice([-1.0, 1.0], 6), 400)
    clean = held_response(truth, u)
    y = clean + 0.2 * np.std(clean) * random.standard_normal(u.size)
    found = estimate_model(Record(PERIOD_S, u, y), "third")
    left = np.linalg.norm(y - clean) / np.linalg.norm(y - np.mean(y))
    assert found.fit_all_percent >= 100.0 * (1.0 - left)
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0
    assert found.residuals.whiteness.passed


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_the_fit_is_limited_only_by_the_noise(name: str, truth: dict[str, float]) -> None:
    """The reference is the response of the true system, computed by SciPy."""
    u, y, _ = closed_loop_record(truth, 20.0, 1)
    left = np.linalg.norm(y - held_response(truth, u)) / np.linalg.norm(y - np.mean(y))
    found = estimate_model(Record(PERIOD_S, u, y, controller=CONTROLLER), name)
    assert left > 0.05
    assert found.fit_all_percent == pytest.approx(100.0 * (1.0 - left), abs=0.2)


def test_a_pole_pair_near_the_real_axis_remains_a_pair() -> None:
    pair = np.array([-0.01 + 1e-9j, -0.01 - 1e-9j])
    np.testing.assert_allclose(np.exp(1e-3 * continuous_poles(pair, 1e-3)), pair, rtol=1e-12)
    with pytest.raises(NotContinuousError):
        continuous_poles(np.array([-0.01 + 0.0j]), 1e-3)


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_coloured_noise_is_modelled_and_does_not_bias_the_estimate(name: str, truth: dict[str, float]) -> None:
    found = estimate_model(record(truth, 20.0, 2, pole=ONE_HERTZ), name)
    assert found.noise[0] == pytest.approx(-ONE_HERTZ, abs=0.01)
    assert_reason(found.method, "refined_iv_in_closed_loop", noise_order=len(found.noise))
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0


@pytest.mark.parametrize(("name", "truth"), CASES)
def test_offset_drift_and_a_cut_start_do_not_bias_the_estimate(name: str, truth: dict[str, float]) -> None:
    found = estimate_model(record(truth, 40.0, 3, offset=2.0, drift=3.0, cut=777), name)
    assert np.max(np.abs(errors_in_std(found, truth))) < 4.0
    assert found.model.parameters == pytest.approx(truth, rel=4e-3)


def test_a_known_set_point_provides_instruments_when_the_controller_is_unknown() -> None:
    u, y, excitation = closed_loop_record(FIRST, 10.0, 4, pole=ONE_HERTZ)
    found = estimate_model(Record(PERIOD_S, u, y, r=excitation), "first")
    assert_reason(found.method, "refined_iv_in_closed_loop")
    assert np.max(np.abs(errors_in_std(found, FIRST))) < 4.0


def test_one_sample_of_misalignment_biases_the_fast_parameters() -> None:
    # Checks the convention that y[k] is sampled when u[k] is applied: others change a1 and a2 by some percent.
    whole = record(THIRD, 300.0, 0)
    late = replace(whole, u=whole.u[1:], y=whole.y[:-1], controller=None)
    found = estimate_model(late, "third", Method.OUTPUT_ERROR)
    assert abs(found.model.parameters["a1"] / THIRD["a1"] - 1.0) > 0.02


def test_scaling_input_and_output_scales_the_gain_only() -> None:
    u, y, _ = closed_loop_record(FIRST, 20.0, 5)
    plain = estimate_model(Record(PERIOD_S, u, y), "first", Method.OUTPUT_ERROR)
    scaled = estimate_model(Record(PERIOD_S, 10.0 * u + 3.0, -1e-3 * y + 7.0), "first", Method.OUTPUT_ERROR)
    assert scaled.model.parameters["T"] == pytest.approx(plain.model.parameters["T"], rel=1e-4)
    assert scaled.model.gain == pytest.approx(-1e-4 * plain.model.gain, rel=1e-4)
    assert scaled.std_errors["T"] == pytest.approx(plain.std_errors["T"], rel=1e-2)


def test_missing_dynamics_are_distinguished_from_noise() -> None:
    found = estimate_model(record(THIRD, 60.0, 6), "first")
    assert found.noise == ()
    assert not found.residuals.input_correlation.passed


def test_the_summary_contains_the_values_that_the_command_line_prints() -> None:
    found = estimate_model(record(THIRD, 30.0, 7), "third")
    summary = found.summary()
    assert list(summary) == SUMMARY
    assert set(summary["parameters"]) == {"K", "T", "a1", "a2"}
    assert found.verdict.grade is Grade.USABLE


def test_the_estimation_rejects_an_unknown_structure_and_lists_the_known_ones() -> None:
    with refused(StructureError, "unknown_structure", name="order:5", known=KNOWN):
        estimate_model(record(FIRST, 40.0, 0), "order:5")


# Dead times of integer and fractional samples with every structure, compared with SciPy on a finer grid.

PERIOD_S_DEAD_TIME = 1e-3
FINER = 20
TRUTHS = {
    "first+delay": {"K": 2.86, "T": 0.22},
    "third+delay": {"K": 2.0, "T": 0.22, "a2": 4e-4, "a1": 0.01},
    "lags3+delay": {"K": 2.0, "tau": 0.06},
    "order:2+delay": {"b0": 2.86, "a1": 0.27, "a2": 0.011},
}


def chips(count: int = 5000, chip: int = 100, seed: int = 0) -> Array:
    return np.repeat(np.random.default_rng(seed).choice([-5.0, 5.0], count // chip), chip)


def delayed(name: str, u: Array, delay_s: float) -> Array:
    """Return the response of SciPy from rest, on a grid of a twentieth of a sample."""
    truth = TRUTHS[name]
    shape = find_structure(name.removesuffix("+delay"))
    values = np.array(list(truth.values()))
    late = round(FINER * delay_s / PERIOD_S_DEAD_TIME)
    held = np.concatenate((np.zeros(late), np.repeat(u, FINER)))[: FINER * u.size]
    t = np.arange(held.size) * PERIOD_S_DEAD_TIME / FINER
    return np.asarray(lsim(([values[0]], shape.denominator(values)[::-1]), held, t, interp=False)[1][::FINER])


def errors(found: Estimate, truth: dict[str, float]) -> list[float]:
    return [abs(found.model.parameters[name] - value) / found.std_errors[name] for name, value in truth.items()]


@pytest.mark.parametrize("delay_s", [0.0, 0.0004, 0.003, 0.0371])
@pytest.mark.parametrize("name", TRUTHS)
def test_the_simulation_is_exact_between_samples(name: str, delay_s: float) -> None:
    u = chips(1000, 25)
    shape, values = find_structure(name), np.array([*TRUTHS[name].values(), delay_s])
    y = values[0] * simulate_response(shape.poles(values), PERIOD_S_DEAD_TIME, u, dead_time_s=shape.dead_time(values))
    np.testing.assert_allclose(y, delayed(name, u, delay_s), atol=1e-7)


@pytest.mark.parametrize("delay_s", [0.003, 0.0371, 0.15])
@pytest.mark.parametrize("name", TRUTHS)
def test_a_dead_time_is_estimated_with_the_other_parameters(name: str, delay_s: float) -> None:
    u = chips()
    found = estimate_model(Record(PERIOD_S_DEAD_TIME, u, noisy(delayed(name, u, delay_s), 0.005)), name)
    truth = {**TRUTHS[name], "t_d": delay_s}
    assert max(errors(found, truth)) < 4.0
    assert found.model.sum_of_lags == pytest.approx(found.first_order.T)
    if found.std_errors["t_d"] < 0.1 * delay_s:
        assert found.verdict.grade is Grade.USABLE
        assert found.residuals.whiteness.passed


def test_a_record_cut_out_of_a_longer_one_gives_the_same_dead_time() -> None:
    u = chips(6000)
    y = 40.0 + noisy(delayed("first+delay", u, 0.0371), 0.005)
    found = estimate_model(Record(PERIOD_S_DEAD_TIME, u[1234:], y[1234:]), "first+delay")
    assert max(errors(found, {**TRUTHS["first+delay"], "t_d": 0.0371})) < 4.0
    assert found.verdict.grade is Grade.USABLE


def test_a_model_with_a_nonexistent_dead_time_is_not_usable() -> None:
    u = chips()
    record = Record(PERIOD_S_DEAD_TIME, u, noisy(delayed("first+delay", u, 0.0), 0.01))
    try:
        found = estimate_model(record, "first+delay")
    except NotConvergedError:
        return
    assert found.verdict.grade is not Grade.USABLE
    simpler = {"structure_parameter_uncertain", "structure_parameter_undetermined"}
    assert simpler.intersection(list_codes(found.verdict))


@pytest.mark.parametrize("u_c", [0.2, 1.0])
def test_coulomb_friction_is_not_mistaken_for_a_dead_time(u_c: float) -> None:
    u = np.repeat(np.random.default_rng(3).uniform(-5.0, 5.0, 20), 300)
    found = estimate_model(Record(PERIOD_S_DEAD_TIME, u, noisy(motor(u, u_c, 0.03)[0], 0.01)), "first+delay")
    friction = found.friction
    assert found.verdict.grade is not Grade.USABLE
    assert friction is not None
    assert friction.found
    assert abs(friction.u_c - u_c) < 4.0 * friction.u_c_std
    assert abs(friction.T - 0.22) < 4.0 * friction.T_std
    assert friction.t_d > 0.0
    assert find_reason(found.verdict, "friction_in_record")["t_d"] == friction.t_d


@pytest.mark.parametrize("name", ["first+delay", "third+delay", "order:4+delay"])
def test_a_record_with_hardly_any_motion_is_rejected_or_not_usable(name: str) -> None:
    u = np.repeat(np.linspace(-2.0, 2.0, 9), 300)
    y = np.zeros(u.size)
    y[1000:1005] = -1.0
    try:
        found = estimate_model(Record(0.01, u, y), name)
    except IdentificationError:
        return
    assert found.verdict.grade is Grade.UNUSABLE


def test_methods_without_dead_time_reject_a_structure_with_dead_time() -> None:
    u = chips()
    y = delayed("first+delay", u, 0.003)
    with refused(StructureError, "dead_time_with_arx", structure="first+delay"):
        estimate_model(Record(PERIOD_S_DEAD_TIME, u, y), "first+delay", Method.ARX)
    with refused(StructureError, "dead_time_with_controller", structure="first+delay"):
        estimate_model(Record(PERIOD_S_DEAD_TIME, u, y, controller=Controller(1.0, 1.0)), "first+delay")
    with refused(StructureError, "unknown_structure", name="first+delay+delay", known=KNOWN):
        find_structure("first+delay+delay")


# Standard errors, compared with closed forms and with formulas computed lag by lag.

ArrayUncertainty = NDArray[np.float64]


def coloured(pole: float, count: int, random: np.random.Generator) -> ArrayUncertainty:
    """Return a first-order autoregression of variance 1, shape (count,)."""
    return np.asarray(lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], random.standard_normal(count)))


@pytest.mark.parametrize(("pole", "tolerance"), [(0.0, 0.05), (0.6, 0.1)])
def test_least_squares_under_known_noise_has_its_exact_covariance(pole: float, tolerance: float) -> None:
    """The mean over seeds is compared with (J'J)^-1 J' R J (J'J)^-1 for the R of the noise."""
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
def test_the_central_matrix_is_the_newey_west_sum_over_the_andrews_bandwidth(pole: float) -> None:
    """The formulas of both papers are computed lag by lag; other weights or bandwidths give another matrix."""
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
def test_standard_errors_of_an_estimate_equal_the_cramer_rao_bound(snr_dB: float) -> None:
    """For white output noise and a known input, the bound follows only from the sensitivity of the response."""
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


@pytest.mark.parametrize("name", ["lags2", "lags3", "order:2", "order:3"])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_shortened_lags_are_the_previous_lags_times_the_factor(name: str, share: float) -> None:
    order = int(name[-1])
    shape, lags = (
        find_structure(name),
        np.full(order, 0.2) if name.startswith("lags") else np.geomspace(0.4, 0.02, order),
    )
    ascending = np.poly(-1.0 / lags)[::-1] / np.poly(-1.0 / lags)[-1]
    shortened = _shorten_lags(shape, shape.from_denominator(3.0, ascending), share)
    assert shortened[0] == pytest.approx(3.0)
    np.testing.assert_allclose(np.sort(-1.0 / shape.poles(shortened).real), np.sort(share * lags), rtol=1e-3)


@pytest.mark.parametrize("order", [3, 4])
def test_every_start_for_a_lag_is_stable_and_contains_the_lag(order: int) -> None:
    """Each start contains the lag of 0.2 s of the record and faster, stable poles."""
    u = np.repeat(np.random.default_rng(2).choice([-5.0, 5.0], 100), 20)
    y = lfilter([0.0, 1.0 - np.exp(-PERIOD_S / 0.2)], [1.0, -np.exp(-PERIOD_S / 0.2)], u)
    problem = FitProblem(Record(PERIOD_S, u, y), find_structure(f"order:{order}"), np.ones(1))
    starts = _lag_and_faster_poles(problem)
    assert starts
    for start in starts:
        poles = problem.structure.poles(start)
        assert poles.size == order
        assert np.all(poles.real < 0.0)
        assert -1.0 / poles[np.argmin(np.abs(poles))].real == pytest.approx(0.2, rel=0.4)
