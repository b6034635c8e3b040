"""Identification of the motor from records of voltage and angle."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lsim

from backend.cli import main
from backend.identification.models import Grade
from backend.identification.motor import MotorRecord, VoltageStepRecord, identify_motor_record
from backend.identification.records import Record, RecordError
from tests.identification.own_motor import K_M, PERIOD_S, T_M, motor, noisy, voltages
from tests.identification.verdicts import find_reason, list_codes
from tests.refusals import refused

# Equation 17 from records of voltage and angle: accurate within its errors, or rejected with a reason.

COUNT_RAD = 2.0 * np.pi / 8000


TRUTHS = ("K_m", "T_m", "u_c", "t_d", "u_0")


def worst_error(found: MotorRecord, u_c: float, delay_s: float) -> float:
    """Return the largest error in standard errors; omitted friction and dead time must be 0."""
    values = zip(found.parameters.values(), (K_M, T_M, u_c, delay_s, 0.0), found.std_errors, strict=True)
    return max(abs(value - truth) / std if std > 0.0 else np.inf * (value != truth) for value, truth, std in values)


def angles(u: np.ndarray, u_c: float, delay_s: float = 0.0) -> np.ndarray:
    noise = 0.5 * COUNT_RAD * np.random.default_rng(4).standard_normal(u.size)
    return COUNT_RAD * np.round((motor(u, u_c, delay_s)[1] + noise) / COUNT_RAD)


@pytest.mark.parametrize(
    ("kind", "u_c", "delay_s"),
    [
        ("binary", 0.0, 0.0),
        ("binary", 0.3, 0.0373),
        ("binary", 2.0, 0.05),
        ("levels", 0.0, 0.004),
        ("levels", 0.3, 0.0),
        ("levels", 2.0, 0.0006),
        ("sines", 0.0, 0.2),
        ("sines", 0.3, 0.012),
        ("sines", 2.0, 0.0),
    ],
)
def test_gain_lag_friction_and_dead_time_are_estimated_from_voltage_and_angle(
    kind: str, u_c: float, delay_s: float
) -> None:
    u = voltages(kind, 12_000 if kind == "sines" else 6000)
    found = identify_motor_record(Record(PERIOD_S, u, angles(u, u_c, delay_s)), COUNT_RAD)
    assert worst_error(found, u_c, delay_s) < 4.0
    assert (found.u_c > 0.0) is (u_c > 0.0)
    assert (found.t_d > 0.0) is (delay_s > 0.0)
    assert found.verdict.grade is Grade.USABLE
    assert ("friction_found" in list_codes(found.verdict)) is (u_c > 0.0)
    assert ("dead_time_found" in list_codes(found.verdict)) is (delay_s > 0.0)
    if delay_s > 0.0:
        assert find_reason(found.verdict, "dead_time_found") == {"t_d": found.t_d}


@pytest.mark.parametrize("seed", range(3))
def test_the_parameters_of_equation_17_simulated_by_scipy_are_estimated_in_noise(seed: int) -> None:
    """Without friction, on a ten times finer grid, with 13.7 samples dead time, white noise, and a cut start."""
    u, finer = voltages("levels", 5000, seed), 10
    t = np.arange(finer * u.size) * PERIOD_S / finer
    late = np.concatenate((np.zeros(137), np.repeat(u, finer)[:-137]))
    theta = lsim(([K_M], [T_M, 1.0, 0.0]), late, t, interp=False)[1][::finer]
    y = theta + 0.005 * np.std(theta) * np.random.default_rng(seed).standard_normal(u.size)
    found = identify_motor_record(Record(PERIOD_S, u[700:], y[700:]))
    assert worst_error(found, 0.0, 0.0137) < 4.0
    assert found.whiteness.passed
    assert found.input_correlation.passed
    assert found.verdict.grade is Grade.USABLE


@pytest.mark.parametrize("late", [0.4, 0.8])
@pytest.mark.parametrize("seed", range(2))
def test_the_voltage_before_a_record_does_not_bias_a_dead_time_below_one_sample(seed: int, late: float) -> None:
    """At 20 samples per second and a start in motion, the previous voltage still acts in the first sample."""
    period_s, finer = 0.05, 50
    random = np.random.default_rng(seed)
    u = random.uniform(-5.0, 5.0, 620)
    held = np.concatenate((np.zeros(round(late * finer)), np.repeat(u, finer)))[: finer * u.size]
    t = np.arange(held.size) * period_s / finer
    theta = lsim(([K_M], [T_M, 1.0, 0.0]), held, t, interp=False)[1][::finer]
    noise = 1e-6 * random.standard_normal(u.size)
    found = identify_motor_record(Record(period_s, u[20:], (theta + noise)[20:]))
    assert found.rms < 1.2e-6
    assert worst_error(found, 0.0, late * period_s) < 4.0
    assert found.t_d == pytest.approx(late * period_s, abs=1e-6)


@pytest.mark.parametrize(("noise", "grade"), [(0.49, Grade.CAUTION), (0.5, Grade.UNUSABLE)])
def test_a_motor_model_that_explains_less_than_half_of_the_angle_is_not_usable(noise: float, grade: Grade) -> None:
    """This applies even with white residuals and small errors of gain, lag, friction and dead time."""
    u = voltages("levels", 12_000)
    u -= np.mean(u)
    found = identify_motor_record(Record(PERIOD_S, u, noisy(motor(u)[1], noise)))
    assert found.whiteness.passed
    assert found.input_correlation.passed
    assert found.spread_percent < 10.0
    assert abs(found.fit_percent - 50.0) < 1.0
    assert (found.fit_percent < 50.0) is (grade is Grade.UNUSABLE)
    assert found.verdict.grade is grade


@pytest.mark.parametrize("u_c", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_single_voltage_does_not_distinguish_gain_from_friction(seed: int, u_c: float) -> None:
    u = np.where(np.arange(6000) < 500, 0.0, 4.0)
    noise = 0.5 * np.random.default_rng(seed).standard_normal(u.size)
    y = COUNT_RAD * np.round(motor(u, u_c)[1] / COUNT_RAD + noise)
    found = identify_motor_record(Record(PERIOD_S, u, y), COUNT_RAD)
    assert found.verdict.grade is Grade.UNUSABLE
    assert find_reason(found.verdict, "not_separable") == {"quantity": "friction"}
    assert np.isnan(found.spread_percent)


@pytest.mark.parametrize("scale", [0.02, 0.005, 0.002])
def test_estimates_from_a_weak_voltage_are_within_their_larger_errors(scale: float) -> None:
    u = scale * voltages("binary", 6000)
    found = identify_motor_record(Record(PERIOD_S, u, angles(u, 0.0, 0.05)), COUNT_RAD)
    assert worst_error(found, 0.0, 0.05) < 4.0
    assert find_reason(found.verdict, "fit_on_validation_data") == {"fit_percent": found.fit_percent}
    assert (found.verdict.grade is Grade.USABLE) is (found.fit_percent >= 80.0 and found.spread_percent <= 3.0)


def test_the_verdict_reports_asymmetric_friction() -> None:
    u = voltages("levels", 6000)
    y = np.cumsum(motor(u, 0.3)[0] * (1.0 + 0.1 * (motor(u, 0.3)[0] > 0.0))) * PERIOD_S
    found = identify_motor_record(Record(PERIOD_S, u, COUNT_RAD * np.round(y / COUNT_RAD)), COUNT_RAD)
    assert found.verdict.grade is not Grade.USABLE
    assert "motor_residuals_not_white" in list_codes(found.verdict)


def test_an_angle_with_hardly_any_motion_is_rejected() -> None:
    u = 0.0002 * voltages("binary")
    with refused(RecordError, "motor_hardly_moves", minimum=20.0):
        identify_motor_record(Record(PERIOD_S, u, angles(u, 0.0)), COUNT_RAD)


def test_the_command_line_identifies_a_motor_from_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    u = voltages("levels")
    table = np.column_stack((1e3 * PERIOD_S * np.arange(u.size), u, angles(u, 0.3, 0.0373)))
    np.savetxt(tmp_path / "motor.csv", table, delimiter=",", header="t_ms,u,theta", comments="", fmt="%.9g")
    words = ["--input", "u", "--output", "theta", "--structure", "motor", "--resolution", repr(COUNT_RAD)]
    monkeypatch.setattr(sys, "argv", ["sinew", "identify", "data", str(tmp_path / "motor.csv"), *words, "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    for name, truth in zip(TRUTHS, (K_M, T_M, 0.3, 0.0373, 0.0), strict=True):
        assert abs(printed["parameters"][name] - truth) <= 4.0 * printed["std_errors"][name]
    assert printed["grade"] == "usable"


# A motor step without load: rejected with a reason if it is unusable.

N = 400
PERIOD_S_VOLTAGE_STEP = 1e-3
U = np.where(np.arange(N) < 50, 0.0, 3.0)
THETA = np.maximum(np.arange(N) - 50, 0) * PERIOD_S_VOLTAGE_STEP * 8.0
GOOD = VoltageStepRecord(PERIOD_S_VOLTAGE_STEP, U, THETA, 10.0, COUNT_RAD, np.full(N, 0.2))


def with_nan(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    spoilt = signal.copy()
    spoilt[7] = np.nan
    return spoilt


def test_a_step_record_finds_the_time_and_voltage_of_its_step() -> None:
    assert (GOOD.first, GOOD.voltage) == (50, 3.0)
    assert (replace(GOOD, u=-U).first, replace(GOOD, u=-U).voltage) == (50, -3.0)


@pytest.mark.parametrize(
    ("change", "code", "values"),
    [
        ({"theta": THETA[:-1]}, "step_too_short", {"length": 400}),
        ({"u": U[:-1]}, "step_too_short", {"length": 399}),
        ({"u": U.reshape(2, -1), "theta": THETA.reshape(2, -1)}, "step_too_short", {"length": 400}),
        ({"u": U[30:79], "theta": THETA[30:79]}, "step_too_short", {"length": 49, "minimum": 50}),
        ({"u": with_nan(U)}, "step_not_finite", {"name": "u", "count": 1}),
        ({"theta": with_nan(THETA)}, "step_not_finite", {"name": "theta", "count": 1}),
        ({"u_max": 3.0}, "step_saturates", {"voltage_V": 3.0, "maximum_V": 3.0}),
        ({"u": 0.0 * U}, "voltage_changes_after_step", {"change_V": 0.0}),
        (
            {"u": U + 0.01 * (np.arange(N) > 300)},
            "voltage_changes_after_step",
            {"change_V": pytest.approx(0.01), "maximum_V": pytest.approx(0.00301)},
        ),
        ({"tension_N": np.full(N, 0.6)}, "motor_is_loaded", {"force_N": 0.6, "maximum_N": 0.5}),
        ({"tension_N": np.full(N, -0.6)}, "motor_is_loaded", {"force_N": 0.6, "maximum_N": 0.5}),
        ({"theta": 0.05 * THETA}, "motor_hardly_moves", {"minimum": 200.0}),
    ],
)
def test_a_record_that_is_not_a_free_step_is_rejected(
    change: dict[str, NDArray[np.float64]], code: str, values: dict[str, object]
) -> None:
    with refused(RecordError, code, **values):
        replace(GOOD, **change)  # type: ignore[arg-type]  # which of the fields it is, the case says
