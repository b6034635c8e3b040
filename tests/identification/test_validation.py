"""Validation of models: residuals, validation data, verdicts."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, lfilter, lsim, tf2ss
from scipy.stats import norm

from backend.analysis.identification_views import _build_correlation
from backend.identification.estimation import ModelComparison, estimate_model, validate_held_out, validate_on_record
from backend.identification.fitting import Method, fit_parameters
from backend.identification.friction import SIGNIFICANT_STD, fit_friction
from backend.identification.models import (
    CorrelationTest,
    DryFriction,
    Estimate,
    FirstOrder,
    Grade,
    Model,
    Residuals,
    find_structure,
)
from backend.identification.motor import VoltageStepRecord, identify_motor_record, validate_motor_step
from backend.identification.records import IdentificationError, NotConvergedError, Record, Signal, UnstableModelError
from backend.identification.validation import (
    ValidationData,
    fit_autoregression,
    has_noise_feedback,
    input_correlation,
    joint_sandwich,
    judge,
    read_whiteness_test,
    sandwich,
    whiteness,
)
from backend.models.identification import ACTUATOR_QUALITY
from backend.models.upgrades import upgrade_quality
from plant import Message
from tests.identification.own_motor import K_M, PERIOD_S, T_M, Array, motor, noisy, voltages
from tests.identification.record_generator import FAULTY, GOOD, Provoked, each, provoked, without_lag
from tests.identification.verdicts import find_reason, list_codes
from tests.models.earlier_identifications import QUALITY
from tests.reasons import assert_reason
from tests.refusals import refused

# The residual tests and their plots agree: a point is outside the drawn bound exactly if the test fails.

PERIOD_S_RESIDUALS = 1e-3
N = 4000


def made(seed: int, colour: float = 0.0, follows: float = 0.0) -> tuple[CorrelationTest, CorrelationTest]:
    random = np.random.default_rng(seed)
    u = np.repeat(random.choice([-1.0, 1.0], N // 20), 20)
    e = lfilter([1.0], [1.0, -colour], random.standard_normal(N)) + follows * u
    return whiteness(e, PERIOD_S_RESIDUALS), input_correlation(e, u, PERIOD_S_RESIDUALS, 0.05)


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


def test_statistic_and_bound_are_in_standard_deviations_for_the_level_over_all_lags() -> None:
    found = made(3)[0]
    outcome = read_whiteness_test(found)
    # The autocorrelations of white noise have the standard deviation 1/sqrt(n).
    assert outcome.statistic == pytest.approx(np.max(np.abs(np.array(found.correlation, dtype=float))) * np.sqrt(N))
    assert outcome.critical == pytest.approx(norm.isf(0.005 / 25))
    np.testing.assert_allclose(outcome.bound, outcome.critical / np.sqrt(N))
    shown = {"lags": 25, "deviations": outcome.statistic, "critical": outcome.critical}
    assert_reason(outcome.sentence, "largest_correlation", level_percent=pytest.approx(1.0), **shown)


@pytest.mark.parametrize("which", [0, 1])
def test_the_residual_tests_reject_white_noise_in_one_record_of_a_hundred(which: int) -> None:
    failed = sum(not made(seed)[which].passed for seed in range(1000, 1600))
    assert failed <= 14  # binomial, 600 trials of 1 %: more than 14 once in 1400


def test_a_stored_residual_test_with_a_band_for_one_lag_is_upgraded_to_the_bound_for_all() -> None:
    found = made(5, colour=0.2)[0]
    band = [norm.isf(0.005) / np.sqrt(N)] * 25
    old = {"lags_s": list(found.lags_s), "correlation": list(found.correlation), "band": band, "passed": found.passed}
    channel = QUALITY | {"residuals": {"whiteness": old, "input_correlation": old}}
    quality = upgrade_quality("actuator", {}, {"G_q": channel, "G_S": QUALITY})
    test = ACTUATOR_QUALITY.read(quality, "it").G_q.residuals.whiteness
    assert test.bound == pytest.approx(found.bound)
    assert read_whiteness_test(test).statistic == pytest.approx(read_whiteness_test(found).statistic)


@pytest.mark.parametrize("D", [[1.0], [1.0, -0.8], [1.0, -1.2, 0.7]])
def test_the_noise_model_recovers_the_polynomial_of_the_coloured_noise(D: list[float]) -> None:
    e = lfilter([1.0], D, np.random.default_rng(3).standard_normal(50 * N))
    found = fit_autoregression(e)
    assert found.size == len(D)
    assert found == pytest.approx(D, abs=5.0 / np.sqrt(e.size))


# Predictions of validation data, compared with the simulation of SciPy and ordinary least squares.

K, T, A2, A1 = 0.05, 0.3, 0.004, 0.05
TRUE = ([K], np.polymul([T, 1.0], [A2, A1, 1.0]).astype(np.float64))


def excitation(count: int, seed: int) -> Signal:
    return np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], count // 80 + 1), 80)[:count]


def by_scipy(system: tuple[list[float], Signal], u: Signal) -> Signal:
    """Return the response from rest to an input held between samples."""
    return np.asarray(dlsim(cont2discrete(tf2ss(*system), PERIOD_S_RESIDUALS, method="zoh"), u)[1][:, 0])


def test_the_true_model_explains_all_of_a_cut_record_with_an_offset() -> None:
    u = excitation(12_000, 1)
    y = 0.3 + by_scipy(TRUE, u)
    found = validate_on_record(
        Model("third", {"K": K, "T": T, "a2": A2, "a1": A1}), Record(PERIOD_S_RESIDUALS, u[5_000:], y[5_000:])
    )
    assert found.measured == pytest.approx(y[5_000:])
    assert found.predicted == pytest.approx(y[5_000:], abs=1e-7)
    assert found.fit_percent == pytest.approx(100.0, abs=1e-3)


def test_fit_and_residual_of_a_wrong_model_match_a_simulation_by_scipy() -> None:
    """SciPy simulates from rest; the initial state is fitted to the difference by ordinary least squares."""
    other = Model("first", {"K": 0.9 * K, "T": 0.35})
    u, noise = excitation(9_000, 2), np.random.default_rng(3).normal(0.0, 1e-3, 9_000)
    y = by_scipy(TRUE, u) + noise
    simulated = by_scipy(([0.9 * K], np.array([0.35, 1.0])), u)
    t = np.arange(9_000) * PERIOD_S_RESIDUALS
    unknown = np.column_stack((np.exp(-t / 0.35), np.ones(9_000), t))
    error = y - simulated
    error = error - unknown @ np.linalg.lstsq(unknown, error, rcond=None)[0]

    found = validate_on_record(other, Record(PERIOD_S_RESIDUALS, u, y))

    assert found.measured - found.predicted == pytest.approx(error, abs=1e-9)
    assert found.rms == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=1e-9)
    assert found.fit_percent == pytest.approx(100.0 * (1.0 - np.std(error) / np.std(y)), abs=1e-6)
    assert 20.0 < found.fit_percent < 80.0


def test_validation_data_do_not_affect_their_prediction() -> None:
    """With a falsified end of the record, the prediction equals that of a model of the beginning only."""
    u, noise = excitation(9_000, 4), np.random.default_rng(5).normal(0.0, 1e-3, 9_000)
    y = by_scipy(TRUE, u) + noise
    spoiled = np.concatenate((y[:6_000], 3.0 * y[6_000:]))
    shape = find_structure("first")
    trained = fit_parameters(Record(PERIOD_S_RESIDUALS, u[:6_000], y[:6_000]), shape, Method.OUTPUT_ERROR).parameters
    alone = validate_on_record(
        Model("first", dict(zip(shape.names, trained, strict=True))),
        Record(PERIOD_S_RESIDUALS, u, spoiled).part(6_000, 9_000),
    )
    found = validate_held_out(fit_parameters(Record(PERIOD_S_RESIDUALS, u, spoiled), shape, Method.OUTPUT_ERROR))
    assert found.measured == pytest.approx(spoiled[6_000:])
    assert found.predicted == pytest.approx(alone.predicted, abs=2e-5)
    assert found.fit_percent == pytest.approx(alone.fit_percent, abs=0.1)
    assert found.fit_percent < 50.0


def test_the_predicted_step_of_a_motor_matches_the_integration_by_scipy() -> None:
    K_m, T_m, u_c, voltage = 2.86, 0.22, 0.07, -4.0
    t = np.arange(1_200) * PERIOD_S_RESIDUALS
    drive = voltage + u_c
    _, turn, _ = lsim(([K_m], [T_m, 1.0, 0.0]), np.full(t.size, drive), t)
    u = np.concatenate((np.zeros(50), np.full(t.size, voltage)))
    theta = np.concatenate((np.full(50, 0.7), 0.7 + turn))
    found = validate_motor_step(
        VoltageStepRecord(PERIOD_S_RESIDUALS, u, theta, 10.0, 2.0 * np.pi / 8000), K_m, T_m, u_c
    )
    assert (found.first, found.measured.size) == (50, t.size)
    assert found.predicted == pytest.approx(0.7 + turn, abs=1e-9)
    slower = validate_motor_step(
        VoltageStepRecord(PERIOD_S_RESIDUALS, u, theta, 10.0, 2.0 * np.pi / 8000), 0.9 * K_m, T_m, u_c
    )
    left = 0.1 * (turn - np.mean(turn))
    assert slower.measured - slower.predicted == pytest.approx(left, abs=1e-9)
    assert slower.fit_percent == pytest.approx(90.0, abs=1e-6)


def test_a_constant_output_has_no_fit() -> None:
    stuck = ModelComparison(0, np.full(50, 0.25), np.full(50, 0.26))
    assert stuck.rms == pytest.approx(0.01)
    with refused(IdentificationError, "comparison_output_constant"):
        _ = stuck.fit_percent


# Verdicts on good and bad records with known parameters: no grade "usable" is wrong.

KINDS = ("binary", "levels", "sines")


@cache
def motor_found(kind: str, u_c: float, noise: float) -> Estimate:
    """Return the estimate of a motor with this friction from seven seconds, more than twenty time constants."""
    u = voltages(kind, 7000)
    return estimate_model(Record(PERIOD_S, u, noisy(motor(u, u_c)[0], noise)), "first")


def claimed(found: Estimate) -> float:
    """Return the errors of K and T in multiples of their stated errors."""
    errors = found.first_order.K / K_M - 1.0, found.first_order.T / T_M - 1.0
    return 100.0 * float(np.max(np.abs(errors))) / found.spread_percent


@pytest.mark.parametrize("noise", [0.01, 0.1])
@pytest.mark.parametrize("u_c", [0.0, 0.05, 0.2, 1.0, 3.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_motor_with_coulomb_friction_is_accurate_or_its_friction_is_reported(
    kind: str, u_c: float, noise: float
) -> None:
    found = motor_found(kind, u_c, noise)
    friction = found.friction
    assert friction is not None
    if not friction.found:
        assert claimed(found) < 4.0
        assert u_c < 0.1
        return
    assert found.verdict.grade is not Grade.USABLE
    assert "friction_in_record" in list_codes(found.verdict)
    truths = (
        (friction.K, friction.K_std, K_M),
        (friction.T, friction.T_std, T_M),
        (friction.u_c, friction.u_c_std, u_c),
    )
    assert all(abs(value - truth) < 4.0 * std for value, std, truth in truths)
    # A linear model that friction changes by more than a tenth is not valid.
    off = max(abs(found.first_order.K / K_M - 1.0), abs(found.first_order.T / T_M - 1.0))
    assert (found.verdict.grade is Grade.UNUSABLE) or off < 0.11


def test_a_friction_model_that_explains_less_than_the_linear_model_is_not_reported() -> None:
    """With an additional lag as long as that of the motor, friction is overestimated by more than its error."""
    u, lag = voltages("sines", 7000), 1.0 - np.exp(-PERIOD_S / T_M)
    speed = lfilter([lag], [1.0, lag - 1.0], motor(u, 1.0)[0])
    record = Record(PERIOD_S, u, noisy(speed, 0.01))
    fitted = fit_friction(record, 0.0)
    assert fitted.parameters[2] - 1.0 > 0.25
    assert fitted.parameters[2] > SIGNIFICANT_STD * np.sqrt(fitted.covariance[2, 2])
    assert estimate_model(record, "first").friction is None


def test_the_fit_with_friction_is_limited_only_by_the_noise() -> None:
    """The reference is the speed of the true motor by another integration; the linear model fits less."""
    u = voltages("levels", 7000)
    clean = motor(u, 1.0)[0]
    y = noisy(clean, 0.1)
    found = estimate_model(Record(PERIOD_S, u, y), "first")
    left = np.linalg.norm(y - clean) / np.linalg.norm(y - np.mean(y))
    assert found.friction is not None
    assert found.friction.fit_percent == pytest.approx(100.0 * (1.0 - left), abs=0.02)
    assert found.fit_all_percent < found.friction.fit_percent - 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_motor_without_friction_is_usable_and_accurate(kind: str) -> None:
    found = motor_found(kind, 0.0, 0.01)
    assert found.verdict.grade is Grade.USABLE
    assert claimed(found) < 4.0
    spread_percent = 100.0 * found.first_order.deviations[1] / found.first_order.T
    (reason,) = (reason for reason in found.verdict.reasons if "spread_percent" in reason.values)
    assert reason.code in ("std_errors_within", "std_errors_within_with_friction")
    assert reason.values["spread_percent"] == pytest.approx(spread_percent)


@pytest.mark.parametrize("structure", ["first", "order:2"])
@pytest.mark.parametrize("delay_s", [0.02, 0.1])
def test_a_dead_time_outside_the_structure_is_reported(delay_s: float, structure: str) -> None:
    u = voltages("binary")
    found = estimate_model(Record(PERIOD_S, u, noisy(motor(u, delay_s=delay_s)[0], 0.01)), structure)
    assert found.verdict.grade is not Grade.USABLE
    assert found.friction is None or not found.friction.found


@pytest.mark.parametrize(("noise", "grade"), [(0.3, Grade.CAUTION), (3.0, Grade.UNUSABLE)])
def test_a_model_with_a_low_fit_is_not_usable_even_with_white_residuals(noise: float, grade: Grade) -> None:
    u = voltages("binary")
    found = estimate_model(Record(PERIOD_S, u, noisy(motor(u)[0], noise)), "first")
    assert found.residuals.whiteness.passed
    assert found.verdict.grade is grade
    assert find_reason(found.verdict, "fit_too_low")["fit_percent"] == found.fit_percent


def test_an_excitation_too_weak_for_the_sensor_is_refused() -> None:
    u = 0.02 * voltages("binary")
    y = 0.1 * np.round(motor(u)[0] / 0.1)
    found = estimate_model(Record(PERIOD_S, u, y), "first")
    assert found.verdict.grade is Grade.UNUSABLE
    assert find_reason(found.verdict, "too_little_motion")["counts"] == pytest.approx(np.ptp(y) / 0.1)


def test_an_output_that_moves_only_in_its_last_third_has_no_fit_on_validation_data() -> None:
    u = voltages("levels")
    u[:8000] = 0.0
    found = estimate_model(Record(PERIOD_S, u, motor(u)[0]), "first")
    assert np.isnan(found.fit_percent)
    assert found.verdict.grade is Grade.CAUTION
    assert "output_at_rest" in list_codes(found.verdict)


def test_a_structure_too_complex_for_the_record_is_not_usable() -> None:
    u = voltages("sines")
    found = estimate_model(Record(PERIOD_S, u, noisy(motor(u)[0], 0.3)), "order:2")
    ratio = found.std_errors["a2"] / found.model.parameters["a2"]
    assert not ratio < 0.39
    assert found.verdict.grade is Grade.UNUSABLE
    uncertain = {"structure_parameter_uncertain", "structure_parameter_undetermined"}
    assert any(reason.code in uncertain and reason.values["parameter"] == "a2" for reason in found.verdict.reasons)


def test_missing_dynamics_are_reported_without_a_known_sensor() -> None:
    u = voltages("levels")
    found = estimate_model(Record(PERIOD_S, u, lagged(motor(u)[0])), "first")
    assert not found.residuals.whiteness.passed
    assert found.verdict.grade is not Grade.USABLE


def lagged(y: Array) -> Array:
    """Add an offset, so that no friction is estimated, and a lag of 30 ms."""
    out, state, share = np.empty(y.size), 0.0, PERIOD_S / 0.03
    for k in range(y.size):
        out[k] = state
        state += share * (y[k] - state)
    return 100.0 + noisy(out, 0.002)


def passed(value: bool = True) -> CorrelationTest:
    return CorrelationTest((1e-3,), (0.0,), (0.1,), value)


GOOD_VERDICTS = ValidationData(
    first_order=FirstOrder(1.0, 0.2, 1e-3, 2e-4),
    model=Model("third", {"K": 1.0, "T": 0.2, "a2": 1e-4, "a1": 1e-2}),
    std_errors={"K": 1e-3, "T": 2e-4, "a2": 1e-6, "a1": 1e-4},
    fit=98.0,
    residuals=Residuals(passed(), passed(), 0.01, 0.0, 0.0, 0.0),
    gain_error_percent=0.5,
    motion_counts=500.0,
    resolution_percent=0.1,
    friction=None,
)
NAN = float("nan")


@pytest.mark.parametrize(
    "change",
    [
        {"fit": NAN},
        {"gain_error_percent": NAN},
        {"motion_counts": NAN},
        {"first_order": FirstOrder(1.0, 0.2, NAN, 2e-4)},
        {"first_order": FirstOrder(1.0, 0.2, 1e-3, NAN)},
        {"first_order": FirstOrder(1.0, NAN, 1e-3, 2e-4)},
        {"first_order": FirstOrder(NAN, 0.2, 1e-3, 2e-4)},
        {"std_errors": {**GOOD_VERDICTS.std_errors, "a2": NAN}},
        {"std_errors": {**GOOD_VERDICTS.std_errors, "a1": 7.6e4}},
    ],
    ids=str,
)
def test_a_missing_statistic_makes_a_model_unusable(change: dict[str, Any]) -> None:
    assert judge(GOOD_VERDICTS).grade is Grade.USABLE
    assert judge(replaced(change)).grade is Grade.UNUSABLE


def replaced(change: dict[str, Any]) -> ValidationData:
    return ValidationData(
        **{name: change.get(name, getattr(GOOD_VERDICTS, name)) for name in ValidationData.__dataclass_fields__}
    )


def test_reasons_for_unusable_precede_reasons_for_caution() -> None:
    verdict = judge(replaced({"fit": 70.0, "first_order": FirstOrder(1.0, 0.2, NAN, 2e-4)}))
    assert verdict.grade is Grade.UNUSABLE
    assert list_codes(verdict) == ["parameter_undetermined", "fit_too_low"]
    assert find_reason(verdict, "parameter_undetermined") == {"parameter": "K"}
    assert find_reason(verdict, "fit_too_low")["fit_percent"] == 70.0


def known_to(**percent: float) -> dict[str, Any]:
    """Return a change that sets the error of K, T, a2 or a1 in percent."""
    K, T = (0.01 * percent.get(name, 0.1) for name in ("K", "T"))
    others = {name: 0.01 * percent.get(name, 0.1) * GOOD_VERDICTS.model.parameters[name] for name in ("a2", "a1")}
    return {"first_order": FirstOrder(1.0, 0.2, K, 0.2 * T), "std_errors": {"K": K, "T": 0.2 * T, **others}}


def uncertain(parameter: str, std_percent: float) -> dict[str, Any]:
    return {"parameter": parameter, "std_percent": pytest.approx(std_percent)}


BOUNDS: list[tuple[dict[str, Any], Grade, str, dict[str, Any]]] = [
    ({"fit": 80.5}, Grade.USABLE, "", {}),
    ({"fit": 79.5}, Grade.CAUTION, "fit_too_low", {"fit_percent": 79.5, "minimum_percent": 80.0}),
    ({"fit": 50.5}, Grade.CAUTION, "fit_too_low", {"fit_percent": 50.5, "minimum_percent": 80.0}),
    ({"fit": 49.5}, Grade.UNUSABLE, "fit_too_low", {"fit_percent": 49.5, "minimum_percent": 50.0}),
    ({"gain_error_percent": -4.9}, Grade.USABLE, "", {}),
    ({"gain_error_percent": -5.1}, Grade.CAUTION, "gain_unlike_geometry", {"error_percent": -5.1}),
    ({"gain_error_percent": 9.9}, Grade.CAUTION, "gain_unlike_geometry", {"error_percent": 9.9}),
    ({"gain_error_percent": 10.1}, Grade.UNUSABLE, "gain_unlike_geometry", {"error_percent": 10.1}),
    ({"motion_counts": 20.1}, Grade.USABLE, "", {}),
    ({"motion_counts": 19.9}, Grade.UNUSABLE, "too_little_motion", {"counts": 19.9, "minimum": 20.0}),
    (known_to(K=2.9, T=2.9), Grade.USABLE, "", {}),
    (known_to(K=3.1), Grade.CAUTION, "parameter_uncertain", uncertain("K", 3.1)),
    (known_to(T=9.9), Grade.CAUTION, "parameter_uncertain", uncertain("T", 9.9)),
    (known_to(K=10.1), Grade.UNUSABLE, "parameter_uncertain", uncertain("K", 10.1)),
    (known_to(T=10.1), Grade.UNUSABLE, "parameter_uncertain", uncertain("T", 10.1)),
    (known_to(a2=9.9, a1=9.9), Grade.USABLE, "", {}),
    (known_to(a2=10.1), Grade.CAUTION, "structure_parameter_uncertain", uncertain("a2", 10.1)),
    (known_to(a1=38.9), Grade.CAUTION, "structure_parameter_uncertain", uncertain("a1", 38.9)),
    (known_to(a1=39.1), Grade.UNUSABLE, "structure_parameter_uncertain", uncertain("a1", 39.1)),
]


@pytest.mark.parametrize(("change", "grade", "code", "values"), BOUNDS)
def test_the_bounds_of_the_verdict_match_the_documented_table(
    change: dict[str, Any], grade: Grade, code: str, values: dict[str, Any]
) -> None:
    """The values are just inside and just outside each bound in docs/explanation/identification.md."""
    verdict = judge(replaced(change))
    assert verdict.grade is grade
    if code:
        assert [(reason.code, reason.values) for reason in verdict.reasons] == [(code, values)]


def test_the_deviation_of_a_linear_from_a_friction_model_covers_gain_lags_and_dead_time() -> None:
    found = DryFriction(True, 2.0, 0.1, 0.05, 0.0, 0.0, 0.0, 99.0, t_d=0.02)
    assert found.off_percent(2.2, 0.108) == pytest.approx((10.0, -10.0))


def test_the_rejection_names_a_wrapped_angle() -> None:
    random = np.random.default_rng(0)
    u = np.repeat(random.choice([-3.0, 3.0], 100), 20)
    y: Array = np.round(np.mod(np.cumsum(u + 1.0) * 0.01, 2.0 * np.pi), 4).astype(np.float64)
    jump = pytest.approx(2.0 * np.pi, rel=1e-4)
    with refused(NotConvergedError, "no_model_of_wrapped_angle", structure="first+delay", jump=jump):
        estimate_model(Record(1e-3, u, y), "first+delay")


def test_the_rejection_names_an_output_without_lag() -> None:
    random = np.random.default_rng(0)
    u = np.round(np.cumsum(random.standard_normal(400)) * 0.1, 3)
    y = np.round(2.0 * u, 3)
    for name in ("first", "lags2+delay", "order:4"):
        (reason,) = outcome(Provoked(u, y, name, None, 1e-3)).reasons
        assert reason.code in ("output_follows_at_once", "no_time_constant")
        assert reason.values["gain"] == pytest.approx(2.0)


def test_a_coefficient_that_underflows_is_rejected() -> None:
    with pytest.raises(UnstableModelError):
        find_structure("order:3").poles(np.array([1.0, 1e-3, 1e-5, 1e-323]))


# Two hundred provoked records: no grade "usable" is wrong, and no good record is rejected.
#
# A grade "usable" is wrong if gain or sum of lags is off by more than 5 % and by more than four standard errors, or if
# no model is true.

KINDS_PROVOKED = {**GOOD, **FAULTY}
SEEDS = range(10)
AT_LEAST_CAUTION = 0.97
"""Share of the good records that must be usable or usable with caution."""
FIRST_OF_EACH = [*each(KINDS_PROVOKED, range(1))]


@dataclass(frozen=True)
class Outcome:
    """Grade, and errors of gain and lag relative to the truth and to their standard errors, or ``refusal``."""

    grade: Grade | None
    off: tuple[float, ...] = ()
    in_std: tuple[float, ...] = ()
    words: str = ""
    reasons: tuple[Message, ...] = ()

    @property
    def wrong(self) -> bool:
        """Return whether the grade "usable" is wrong."""
        far = any(off > 0.05 and std > 4.0 for off, std in zip(self.off, self.in_std, strict=True))
        return self.grade is Grade.USABLE and (not self.off or far)


def outcome(case: Provoked) -> Outcome:
    try:
        record = Record(case.period_s, case.u, case.y, **case.more)
        if case.structure == "motor":
            motor = identify_motor_record(record)
            verdict, found, std = motor.verdict, (motor.K_m, motor.T_m), motor.std_errors[:2]
        else:
            linear = estimate_model(record, case.structure)
            reduced = linear.first_order
            verdict, found, std = linear.verdict, (reduced.K, reduced.T), reduced.deviations
    except IdentificationError as refusal:
        return Outcome(None, words=str(refusal), reasons=(refusal.message,))
    if case.truth is None:
        return Outcome(verdict.grade, words=verdict.sentence, reasons=verdict.reasons)
    errors = [abs(value - truth) for value, truth in zip(found, case.truth, strict=True)]
    return Outcome(
        verdict.grade,
        tuple(error / abs(truth) for error, truth in zip(errors, case.truth, strict=True)),
        tuple(error / one if one > 0.0 else np.inf for error, one in zip(errors, std, strict=True)),
        verdict.sentence,
        verdict.reasons,
    )


@pytest.mark.parametrize(("kind", "seed"), FIRST_OF_EACH)
def test_the_first_provoked_record_of_each_kind_has_a_correct_verdict(kind: str, seed: int) -> None:
    found = outcome(provoked(kind, seed))
    assert not found.wrong, found
    if kind in GOOD:
        assert found.grade in (Grade.USABLE, Grade.CAUTION), found
    else:
        assert found.grade is not Grade.USABLE, found


def test_no_provoked_record_is_graded_usable_and_wrong() -> None:
    outcomes = {(kind, seed): outcome(provoked(kind, seed)) for kind, seed in each(KINDS_PROVOKED, SEEDS)}
    assert len(outcomes) >= 200
    assert [(at, found) for at, found in outcomes.items() if found.wrong] == []
    good = [found.grade in (Grade.USABLE, Grade.CAUTION) for (kind, _), found in outcomes.items() if kind in GOOD]
    assert np.mean(good) >= AT_LEAST_CAUTION


@pytest.mark.parametrize("case", without_lag())
@pytest.mark.parametrize("structure", ["first", "first+delay", "order:2", "order:3+delay", "third", "lags3", "motor"])
def test_an_output_without_lag_gets_a_correct_verdict(case: str, structure: str) -> None:
    u, y = without_lag()[case]
    found = outcome(Provoked(u, y, structure, None, 1e-3))
    assert found.words
    assert "nan" not in found.words
    if case not in ("one sample late", "square"):
        assert found.grade is not Grade.USABLE, found


@pytest.mark.parametrize(
    ("kind", "code", "values"),
    [
        ("saturated_output", "output_stops_at_limit", {}),
        ("wrong_period", "sample_time_differs", {}),
        ("dead_time_left_out", "better_structure", {"dead_time": True}),
        ("wrapped_angle", "angle_wraps", {}),
        ("unnamed_loop", "noise_fed_back", {}),
        ("dry_friction", "friction_in_record", {}),
        ("order_too_low", "better_structure", {"dead_time": False}),
        ("step_from_rest", "input_of_one_step", {}),
    ],
)
def test_the_verdict_names_the_fault_of_a_provoked_record(kind: str, code: str, values: dict[str, object]) -> None:
    found = outcome(provoked(kind, 0))
    assert any(reason.code == code and values.items() <= dict(reason.values).items() for reason in found.reasons), found


@pytest.mark.parametrize("count", [50, 56, 58, 60])
def test_a_record_shorter_than_its_regression_indicates_no_feedback(count: int) -> None:
    """With hardly more samples than regressors, 29 regressors explain independent noise without feedback."""
    for seed in range(50):
        random = np.random.default_rng(seed)
        assert not has_noise_feedback(random.standard_normal(count), random.standard_normal(count), 1.0)


def test_the_joint_covariance_of_one_fit_is_its_own() -> None:
    random = np.random.default_rng(8)
    J = random.standard_normal((500, 3)) * [1.0, 1e3, 1e-4]
    Z, e = J + 0.1 * random.standard_normal(J.shape) * [1.0, 1e3, 1e-4], random.standard_normal(500)
    assert joint_sandwich([(Z, J, e)]) == pytest.approx(sandwich(Z, J, e), rel=1e-9)


def test_the_joint_covariance_of_two_least_squares_fits_is_that_of_their_noises() -> None:
    random = np.random.default_rng(9)
    n, rho = 20_000, 0.6
    first, second = random.standard_normal((n, 2)), random.standard_normal((n, 1))
    second += first[:, :1]
    e = random.multivariate_normal([0.0, 0.0], [[1.0, 2.0 * rho], [2.0 * rho, 4.0]], n)
    found = joint_sandwich([(first, first, e[:, 0]), (second, second, e[:, 1])])
    inverse = [np.linalg.inv(J.T @ J) for J in (first, second)]
    cross = 2.0 * rho * inverse[0] @ first.T @ second @ inverse[1]
    expected = np.block([[inverse[0], cross], [cross.T, 4.0 * inverse[1]]])
    assert found == pytest.approx(expected, abs=0.05 / n)
