"""No "usable" that is wrong: verdicts on records whose truth is known, good ones and bad ones."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from backend.identification.estimation import estimate_model
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
from backend.identification.records import NotConvergedError, Record, UnstableModelError
from backend.identification.validation import ValidationData, judge
from tests.identification.own_motor import K_M, PERIOD_S, T_M, Array, motor, noisy, voltages

KINDS = ("binary", "levels", "sines")


@cache
def motor_found(kind: str, u_c: float, noise: float) -> Estimate:
    """What is estimated of a motor with this friction; seven seconds of record are twenty time constants and more."""
    u = voltages(kind, 7000)
    return estimate_model(Record(PERIOD_S, u, noisy(motor(u, u_c)[0], noise)), "first")


def claimed(found: Estimate) -> float:
    """Errors of K and T in multiples of what the estimate says that they are known to."""
    errors = found.first_order.K / K_M - 1.0, found.first_order.T / T_M - 1.0
    return 100.0 * float(np.max(np.abs(errors))) / found.spread_percent


@pytest.mark.parametrize("noise", [0.01, 0.1])
@pytest.mark.parametrize("u_c", [0.0, 0.05, 0.2, 1.0, 3.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_motor_with_dry_friction_is_right_or_its_friction_is_named(kind: str, u_c: float, noise: float) -> None:
    found = motor_found(kind, u_c, noise)
    friction = found.friction
    assert friction is not None
    if not friction.found:
        assert claimed(found) < 4.0
        assert u_c < 0.1
        return
    assert found.verdict.grade is not Grade.USABLE
    assert "dry (Coulomb) friction" in found.verdict.sentence
    truths = (
        (friction.K, friction.K_std, K_M),
        (friction.T, friction.T_std, T_M),
        (friction.u_c, friction.u_c_std, u_c),
    )
    assert all(abs(value - truth) < 4.0 * std for value, std, truth in truths)
    # A linear model that friction moved by more than a tenth is no model.
    off = max(abs(found.first_order.K / K_M - 1.0), abs(found.first_order.T / T_M - 1.0))
    assert (found.verdict.grade is Grade.UNUSABLE) or off < 0.11


def test_a_model_with_friction_that_explains_less_than_the_linear_one_tells_of_none() -> None:
    """Behind a lag as long as the motor's own, friction is over-told by more than its error: no word is the truth."""
    u, lag = voltages("sines", 7000), 1.0 - np.exp(-PERIOD_S / T_M)
    speed = lfilter([lag], [1.0, lag - 1.0], motor(u, 1.0)[0])
    record = Record(PERIOD_S, u, noisy(speed, 0.01))
    fitted = fit_friction(record, 0.0)
    assert fitted.parameters[2] - 1.0 > 0.25
    assert fitted.parameters[2] > SIGNIFICANT_STD * np.sqrt(fitted.covariance[2, 2])
    assert estimate_model(record, "first").friction is None


def test_the_fit_with_friction_is_what_the_noise_leaves() -> None:
    """Against the true motor's own speed, by another integration; the linear model leaves more."""
    u = voltages("levels", 7000)
    clean = motor(u, 1.0)[0]
    y = noisy(clean, 0.1)
    found = estimate_model(Record(PERIOD_S, u, y), "first")
    left = np.linalg.norm(y - clean) / np.linalg.norm(y - np.mean(y))
    assert found.friction is not None
    assert found.friction.fit_percent == pytest.approx(100.0 * (1.0 - left), abs=0.02)
    assert found.fit_all_percent < found.friction.fit_percent - 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_motor_without_friction_is_usable_and_right(kind: str) -> None:
    found = motor_found(kind, 0.0, 0.01)
    assert found.verdict.grade is Grade.USABLE
    assert claimed(found) < 4.0
    assert (
        f"K and T known to ±{100.0 * found.first_order.deviations[1] / found.first_order.T:.2g}"
        in found.verdict.sentence
    )


@pytest.mark.parametrize("structure", ["first", "order:2"])
@pytest.mark.parametrize("delay_s", [0.02, 0.1])
def test_a_dead_time_that_the_structure_leaves_out_is_told(delay_s: float, structure: str) -> None:
    u = voltages("binary")
    found = estimate_model(Record(PERIOD_S, u, noisy(motor(u, delay_s=delay_s)[0], 0.01)), structure)
    assert found.verdict.grade is not Grade.USABLE
    assert found.friction is None or not found.friction.found


@pytest.mark.parametrize(("noise", "grade"), [(0.3, Grade.CAUTION), (3.0, Grade.UNUSABLE)])
def test_a_model_that_explains_little_is_not_usable_however_white_the_rest(noise: float, grade: Grade) -> None:
    u = voltages("binary")
    found = estimate_model(Record(PERIOD_S, u, noisy(motor(u)[0], noise)), "first")
    assert found.residuals.whiteness.passed
    assert found.verdict.grade is grade
    assert f"fit of {found.fit_percent:.1f} % on unseen data" in found.verdict.sentence


def test_an_excitation_too_weak_for_the_sensor_is_refused() -> None:
    u = 0.02 * voltages("binary")
    y = 0.1 * np.round(motor(u)[0] / 0.1)
    found = estimate_model(Record(PERIOD_S, u, y), "first")
    assert found.verdict.grade is Grade.UNUSABLE
    assert f"moved by {np.ptp(y) / 0.1:.1f} counts" in found.verdict.sentence


def test_an_output_that_moves_in_its_last_third_only_has_no_fit_on_unseen_data() -> None:
    u = voltages("levels")
    u[:8000] = 0.0
    found = estimate_model(Record(PERIOD_S, u, motor(u)[0]), "first")
    assert np.isnan(found.fit_percent)
    assert found.verdict.grade is Grade.CAUTION
    assert "fit on unseen data not measured" in found.verdict.sentence


def test_a_structure_too_rich_for_the_record_is_not_usable() -> None:
    u = voltages("sines")
    found = estimate_model(Record(PERIOD_S, u, noisy(motor(u)[0], 0.3)), "order:2")
    ratio = found.std_errors["a2"] / found.model.parameters["a2"]
    assert not ratio < 0.39
    assert found.verdict.grade is Grade.UNUSABLE
    assert "a2 known to" in found.verdict.sentence or "standard error of a2 not measured" in found.verdict.sentence


def test_missing_dynamics_count_without_a_known_sensor_too() -> None:
    u = voltages("levels")
    found = estimate_model(Record(PERIOD_S, u, lagged(motor(u)[0])), "first")
    assert not found.residuals.whiteness.passed
    assert found.verdict.grade is not Grade.USABLE


def lagged(y: Array) -> Array:
    """Offset, so that no friction is looked for, and another lag of 30 ms."""
    out, state, share = np.empty(y.size), 0.0, PERIOD_S / 0.03
    for k in range(y.size):
        out[k] = state
        state += share * (y[k] - state)
    return 100.0 + noisy(out, 0.002)


def passed(value: bool = True) -> CorrelationTest:
    return CorrelationTest((1e-3,), (0.0,), (0.1,), value)


GOOD = ValidationData(
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
        {"std_errors": {**GOOD.std_errors, "a2": NAN}},
        {"std_errors": {**GOOD.std_errors, "a1": 7.6e4}},
    ],
    ids=str,
)
def test_a_figure_that_could_not_be_had_grants_nothing(change: dict[str, Any]) -> None:
    assert judge(GOOD).grade is Grade.USABLE
    assert judge(replaced(change)).grade is Grade.UNUSABLE


def replaced(change: dict[str, Any]) -> ValidationData:
    return ValidationData(
        **{name: change.get(name, getattr(GOOD, name)) for name in ValidationData.__dataclass_fields__}
    )


def test_what_makes_a_model_unusable_is_told_before_what_makes_it_doubtful() -> None:
    verdict = judge(replaced({"fit": 70.0, "first_order": FirstOrder(1.0, 0.2, NAN, 2e-4)}))
    assert verdict.grade is Grade.UNUSABLE
    assert [reason[:17] for reason in verdict.reasons] == ["standard error of", "fit of 70.0 % on "]


def known_to(**percent: float) -> dict[str, Any]:
    """K, T, a2 or a1 known to so many per cent."""
    K, T = (0.01 * percent.get(name, 0.1) for name in ("K", "T"))
    others = {name: 0.01 * percent.get(name, 0.1) * GOOD.model.parameters[name] for name in ("a2", "a1")}
    return {"first_order": FirstOrder(1.0, 0.2, K, 0.2 * T), "std_errors": {"K": K, "T": 0.2 * T, **others}}


BOUNDS: list[tuple[dict[str, Any], Grade, str]] = [
    ({"fit": 80.5}, Grade.USABLE, ""),
    ({"fit": 79.5}, Grade.CAUTION, "fit of 79.5 % on unseen data, where 80 % are needed"),
    ({"fit": 50.5}, Grade.CAUTION, "fit of 50.5 % on unseen data, where 80 % are needed"),
    ({"fit": 49.5}, Grade.UNUSABLE, "fit of 49.5 % on unseen data, where 50 % are needed"),
    ({"gain_error_percent": -4.9}, Grade.USABLE, ""),
    ({"gain_error_percent": -5.1}, Grade.CAUTION, "gain -5.1 % off the geometric one"),
    ({"gain_error_percent": 9.9}, Grade.CAUTION, "gain +9.9 % off the geometric one"),
    ({"gain_error_percent": 10.1}, Grade.UNUSABLE, "gain +10.1 % off the geometric one"),
    ({"motion_counts": 20.1}, Grade.USABLE, ""),
    ({"motion_counts": 19.9}, Grade.UNUSABLE, "moved by 19.9 counts where 20 are needed"),
    (known_to(K=2.9, T=2.9), Grade.USABLE, ""),
    (known_to(K=3.1), Grade.CAUTION, "K known to ±3.1 % only"),
    (known_to(T=9.9), Grade.CAUTION, "T known to ±9.9 % only"),
    (known_to(K=10.1), Grade.UNUSABLE, "K known to ±10.1 % only"),
    (known_to(T=10.1), Grade.UNUSABLE, "T known to ±10.1 % only"),
    (known_to(a2=9.9, a1=9.9), Grade.USABLE, ""),
    (known_to(a2=10.1), Grade.CAUTION, "a2 known to ±10.1 % only (take a simpler structure)"),
    (known_to(a1=38.9), Grade.CAUTION, "a1 known to ±38.9 % only (take a simpler structure)"),
    (known_to(a1=39.1), Grade.UNUSABLE, "a1 known to ±39.1 % only (take a simpler structure)"),
]


@pytest.mark.parametrize(("change", "grade", "reason"), BOUNDS)
def test_the_bounds_are_those_of_the_table_of_verdicts(change: dict[str, Any], grade: Grade, reason: str) -> None:
    """Just this side and just that side of each bound in docs/explanation/identification.md."""
    verdict = judge(replaced(change))
    assert verdict.grade is grade
    if reason:
        assert len(verdict.reasons) == 1
        assert reason in verdict.reasons[0]


def test_a_linear_model_is_so_many_per_cent_off_one_with_friction_in_gain_and_in_lags_with_dead_time() -> None:
    found = DryFriction(True, 2.0, 0.1, 0.05, 0.0, 0.0, 0.0, 99.0, t_d=0.02)
    assert found.off_percent(2.2, 0.108) == pytest.approx((10.0, -10.0))


def test_a_wrapped_angle_is_named_where_no_model_is_found() -> None:
    random = np.random.default_rng(0)
    u = np.repeat(random.choice([-3.0, 3.0], 100), 20)
    y: Array = np.round(np.mod(np.cumsum(u + 1.0) * 0.01, 2.0 * np.pi), 4).astype(np.float64)
    with pytest.raises(NotConvergedError, match=r"jumps by 6\.283 and back .* wraps"):
        estimate_model(Record(1e-3, u, y), "first+delay")


def test_an_output_without_lag_is_named_where_no_model_is_found() -> None:
    random = np.random.default_rng(0)
    u = np.round(np.cumsum(random.standard_normal(400)) * 0.1, 3)
    y = np.round(2.0 * u, 3)
    named = []
    for name in ("first", "lags2+delay", "order:4"):
        try:
            named.append(estimate_model(Record(1e-3, u, y), name).verdict.sentence)
        except NotConvergedError as error:
            named.append(str(error))
    assert all("same sample (y = 2 u" in words for words in named)


def test_a_coefficient_that_underflows_is_refused_and_drops_no_pole() -> None:
    with pytest.raises(UnstableModelError):
        find_structure("order:3").poles(np.array([1.0, 1e-3, 1e-5, 1e-323]))
