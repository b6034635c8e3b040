"""Measured frequency responses, against closed forms and predictions."""

from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from backend.analysis.context import EvaluationContext, load_bank_points, load_initial_tuning
from backend.analysis.frequency_metrics import (
    LOW_GAIN_MIN,
    BodeMetrics,
    Response,
    build_bode_lines,
    compute_bandwidth,
    compute_bode_metrics,
    compute_lag,
    compute_resonance,
    compute_response_metrics,
    compute_responses,
)
from backend.analysis.step_metrics import NoSamplesError, list_excitations
from backend.banks.tuning_settings import TuningSettings
from backend.control.motion_types import Setpoint
from backend.control.setpoint_player import step_setpoint_player
from backend.execution.simulation import SimulatedRun, simulate_in_memory
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.faults import Limit
from backend.models.run import LAMBDA, TIME_OPTIMAL, StoredLoopSettings
from backend.realtime.motions import make_segment_player
from backend.realtime.program import Program
from backend.storage.banks import Bank, BankEntry
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.experiments.composing.written import plan_of, with_parts
from tests.reasons import assert_reason
from tests.refusals import refused

# Frequency responses of signals filtered by known systems.

Array = NDArray[np.float64]
LEAD_IN = "{do: step, q_ref: 0.0, S_ref: 11.0, duration_s: 4.0}"
MULTISINE = "{do: multisine, q_amplitude: 0.1, period_s: 10, lines: 30, periods: 3}"
LAG_S = 0.4


def references(program: Program) -> tuple[Array, Array]:
    """Return the references of the player of the control loop at every tick."""
    player, target = make_segment_player(program.segments, Setpoint(0.0, 10.0, 0.0)), Setpoint(0.0, 10.0, 0.0)
    rows = []
    done = False
    while not done:
        done, target, player = step_setpoint_player(player, target)
        if not done:
            rows.append((target.q_ref, target.S_ref))
    both = np.array(rows)
    return both[:, 0], both[:, 1]


def behind(u: Array, lag_s: float) -> Array:
    """Filter by a first-order lag, exact for an input held between samples."""
    pole = np.exp(-T_s / lag_s)
    return np.asarray(lfilter([0.0, 1.0 - pole], [1.0, -pole], u - u[0]) + u[0])


def columns_of(program: Program, lag_q: float = LAG_S, lag_S: float = LAG_S) -> dict[str, Array]:
    q_ref, S_ref = references(program)
    ones = np.ones_like(q_ref)
    return {
        "q_ref": q_ref,
        "S_ref": S_ref,
        "q": behind(q_ref, lag_q),
        "S": behind(S_ref, lag_S),
        "F_A": 20.0 * ones,
        "F_B": 18.0 * ones,
        "u_A": ones,
        "u_B": -3.0 * ones,
    }


def lag(f: Array, lag_s: float) -> NDArray[np.complex128]:
    """Return the response of the sampled lag to a held input."""
    pole, z = np.exp(-T_s / lag_s), np.exp(2j * np.pi * f * T_s)
    return np.asarray((1.0 - pole) / (z - pole))


def test_a_first_order_lag_is_found_line_by_line() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    (found,) = compute_responses(columns_of(program), program)
    np.testing.assert_allclose(found.f, np.arange(1, 31) / 10.0, rtol=1e-12)
    np.testing.assert_allclose(found.H, lag(found.f, LAG_S), rtol=1e-6)


@pytest.mark.parametrize("lag_s", [0.15, 0.4, 1.0])
def test_the_bandwidth_of_a_lag_is_the_inverse_of_its_time_constant(lag_s: float) -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    figures = compute_response_metrics(columns_of(program, lag_q=lag_s), program)
    assert figures.bandwidth_q_Hz == pytest.approx(1.0 / (2.0 * np.pi * lag_s), rel=0.003)
    assert figures.lag_q_deg == pytest.approx(45.0, abs=0.3)
    assert figures.resonance_q_dB == 0.0
    assert (figures.min_tension_N, figures.peak_voltage_V) == (18.0, 3.0)
    assert figures.bandwidth_S_Hz is None
    assert_reason(figures.reasons["bandwidth_S_Hz"], "reference_not_excited", signal="S")


@pytest.mark.parametrize(
    "part",
    [
        "{do: sweep, S_amplitude: 0.5, from_Hz: 0.05, to_Hz: 5, duration_s: 200}",
        "{do: prbs, S_amplitude: 0.5, chip_s: 0.1, bits: 10, periods: 2}",
    ],
)
def test_a_sweep_and_a_prbs_give_the_same_response(part: str) -> None:
    program = plan_of(with_parts(LEAD_IN, part, "{do: hold, duration_s: 4}")).program()
    (found,) = compute_responses(columns_of(program), program)
    inner = (found.f > 0.1) & (found.f < 3.0)
    assert inner.sum() > 10
    np.testing.assert_allclose(np.abs(found.H[inner]), np.abs(lag(found.f[inner], LAG_S)), rtol=0.06)


def test_a_bandwidth_above_the_highest_line_has_a_reason() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    figures = compute_response_metrics(columns_of(program, lag_q=0.01), program)
    assert figures.bandwidth_q_Hz is None
    assert_reason(figures.reasons["bandwidth_q_Hz"], "bandwidth_above_lines", highest_Hz=pytest.approx(3.0))


def test_the_response_to_an_incomplete_excitation_is_not_measured() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    early = {name: column[:-10] for name, column in columns_of(program).items()}
    with refused(NoSamplesError, "no_excitation_completed"):
        compute_response_metrics(early, program)


def test_an_excitation_of_both_references_is_not_listed() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE.replace("q_amplitude: 0.1", "q_amplitude: 0.1, S_amplitude: 0.5")))
    assert list_excitations(program.program()) == ()


@pytest.mark.parametrize(
    ("q", "code"),
    [(np.nan, "sample_without_value"), (0.02, "reference_not_followed")],
)
def test_a_joint_without_motion_or_samples_has_no_response(q: float, code: str) -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    columns = columns_of(program)
    columns["q"] = np.full_like(columns["q"], q)
    figures = compute_response_metrics(columns, program)
    assert (figures.bandwidth_q_Hz, figures.resonance_q_dB, figures.lag_q_deg) == (None, None, None)
    for name in ("bandwidth_q_Hz", "resonance_q_dB", "lag_q_deg"):
        assert_reason(figures.reasons[name], code)


def test_an_excitation_directly_after_a_sine_is_assigned_to_its_own_reference() -> None:
    sine = "{do: sine, q_amplitude: 0.2, period_s: 2, duration_s: 4}"
    program = plan_of(with_parts(LEAD_IN, sine, MULTISINE.replace("q_amplitude: 0.1", "S_amplitude: 0.5"))).program()
    assert [one.signal for one in list_excitations(program)] == ["S"]


def lags(f: Array, lag_s: float, count: int) -> NDArray[np.complex128]:
    return np.asarray(1.0 / (1.0 + 2j * np.pi * f * lag_s) ** count)


@pytest.mark.parametrize(("count", "within"), [(1, 0.001), (2, 0.011), (4, 0.02)])
def test_the_bandwidth_does_not_depend_on_the_frequencies_of_the_lines(count: int, within: float) -> None:
    """The lowest line varies from far below the bandwidth to a gain of 0.6; the lags are equal, in closed form."""
    lag_s = 0.5
    exact = np.sqrt(2.0 ** (1.0 / count) - 1.0) / (2.0 * np.pi * lag_s)
    highest = np.sqrt(LOW_GAIN_MIN ** (-2.0 / count) - 1.0) / (2.0 * np.pi * lag_s)
    for lowest in np.geomspace(0.02 * exact, 0.999 * highest, 40):
        f = lowest * np.arange(1, 81)
        found, reason = compute_bandwidth(Response("q", f, lags(f, lag_s, count)))
        assert reason == ""
        assert found == pytest.approx(exact, rel=within)
        two_thirds = 0.6 * exact
        phase = -np.degrees(count * np.arctan(2.0 * np.pi * two_thirds * lag_s))
        assert -compute_lag(Response("q", f, lags(f, lag_s, count)), two_thirds) == pytest.approx(phase, rel=0.05)


def test_a_bandwidth_far_below_the_lowest_line_is_not_measured() -> None:
    f = np.array([0.5, 1.0, 1.5])
    found, reason = compute_bandwidth(Response("q", f, lags(f, 0.5, 2)))
    assert found is None
    assert_reason(reason, "bandwidth_below_lines", gain=pytest.approx(0.29, abs=0.005), lowest_Hz=0.5)


def test_the_resonance_is_relative_to_the_static_gain() -> None:
    f = np.linspace(0.05, 3.0, 400)
    s = 2j * np.pi * f
    peaked = Response("q", f, np.asarray(1.0 / ((s / 6.0) ** 2 + 0.4 * s / 6.0 + 1.0)))
    assert compute_resonance(peaked) == pytest.approx(-20.0 * np.log10(0.4 * np.sqrt(1.0 - 0.2**2)), abs=0.001)
    assert compute_resonance(Response("q", f, lags(f, 0.5, 2))) == 0.0
    # The lowest line is above the resonance: the result is the largest line, not 0 dB by definition.
    assert compute_resonance(Response("q", f[150:], peaked.H[150:])) == pytest.approx(
        20.0 * np.log10(abs(peaked.H[150]))
    )


# Measured and predicted frequency responses, and lines that are not measured.

IDEAL = load_parameters("ideal")
MULTISINE_BODE = "{do: multisine, q_amplitude: 0.1, period_s: 4, lines: 8, periods: 3}"
SMALL = {"period_s": 8.0, "lines": 10, "q_amplitude": 0.05, "S_amplitude": 0.3}


def made(*parts: str, tuning: TuningSettings | None = None) -> EvaluationContext:
    return EvaluationContext(IDEAL, plan_of(with_parts(*parts)), tuning or TuningSettings())


def seen(evaluation: EvaluationContext, **lags: float) -> dict[str, Any]:
    columns = columns_of(evaluation.plan.program(), **lags)
    return columns | {"limits": np.zeros_like(columns["q"])}


def figures(evaluation: EvaluationContext, columns: dict[str, Any]) -> BodeMetrics:
    return compute_bode_metrics(columns, evaluation.plan.program(), evaluation)


def played(parameters: str, **tuning: Any) -> SimulatedRun:
    plan = build_ready_plan("frequency_response", **SMALL)
    return simulate_in_memory(
        load_parameters(parameters), plan, LoopSettings(**tuning), lambda _: pytest.fail("no bank")
    )


@pytest.mark.parametrize("motion", [LAMBDA, TIME_OPTIMAL])
def test_the_measured_response_matches_the_prediction_on_the_ideal_plant(motion: str) -> None:
    metrics = played("ideal", motion=motion, lam_q=0.42).metrics
    for signal in ("q", "S"):
        gain, phase = metrics.find_value(f"gain_off_{signal}_dB"), metrics.find_value(f"phase_off_{signal}_deg")
        assert gain is not None
        assert phase is not None
        assert gain < 0.02
        assert phase < 0.1
    width, expected = metrics.find_value("bandwidth_q_Hz"), metrics.find_value("bandwidth_q_predicted_Hz")
    assert expected is not None
    if motion == TIME_OPTIMAL:
        assert width is None
        assert expected > 20.0
    else:
        assert width == pytest.approx(expected, rel=0.005)


def bandwidth_by_hand() -> float:
    """−3 dB [Hz] of the q loop of `ideal` at S = 11, λ_q = 0.5: motor equations, springs and the laws of table 2."""
    K_m, T_m, K_t, tau_e, r_m, r_j, J_j, B_j = 2.86, 0.22, 0.3, 2e-3, 7.5e-3, 75e-3, 5.2e-4, 0.046
    lam, lam_q = 0.0854, 0.5
    D, T, slope = 4.0 * T_m - lam, 4.0 * lam, 11.0 / (2.0 * r_j**2)
    k_p, k_i = 4.0 * T_m**2 / (K_m * lam**2 * D), T_m**2 / (K_m * lam**3 * D)
    k_d, t_f = (6.0 * T_m**2 - lam * D) / (K_m * lam * D), T_m * lam / D
    f = np.geomspace(0.05, 1.0, 20_000)
    s = 2j * np.pi * f
    drive = K_t / (tau_e * s + 1.0) / (t_f * s + 1.0)
    shaft = K_t / K_m * (T_m * s**2 + s) + drive * (k_i / s + k_p + k_d * s)
    joint = 2.0 * r_j * r_m * slope / (J_j * s**2 + B_j * s + 2.0 * r_j**2 * slope)
    process = r_j / r_m * joint * drive * k_i / s / (shaft + r_m * slope * (r_m - r_j * joint))
    integral, proportional = T / lam_q**2 / s, (2.0 * T - lam_q) / lam_q
    closed = integral * process / (1.0 + (proportional + integral) * process)
    return float(f[np.flatnonzero(np.abs(closed) < 2.0**-0.5)[0]])


@pytest.mark.parametrize("period_s", [4, 8, 16, 32])
def test_the_bandwidth_does_not_depend_on_the_period_of_the_excitation(period_s: float) -> None:
    truth = bandwidth_by_hand()
    assert truth == pytest.approx(0.2249, rel=0.003)
    lead_in = "{do: step, q_ref: 0.0, S_ref: 11.0, duration_s: 4}"
    multisine = f"{{do: multisine, q_amplitude: 0.1, period_s: {period_s}, lines: 12, periods: 2}}"
    plan = plan_of(with_parts(lead_in, multisine, more="measures: [bode]\n"))
    metrics = simulate_in_memory(IDEAL, plan, LoopSettings(), lambda _: pytest.fail("no bank")).metrics
    assert metrics.find_value("bandwidth_q_Hz") == pytest.approx(truth, rel=0.01)
    assert metrics.find_value("bandwidth_q_predicted_Hz") == pytest.approx(truth, rel=0.005)
    assert metrics.find_value("resonance_q_dB") == 0.0


def test_lines_above_the_predicted_bandwidth_give_no_deviation_from_the_prediction() -> None:
    evaluation = made(LEAD_IN, MULTISINE_BODE.replace("period_s: 4", "period_s: 2"))
    result = figures(evaluation, seen(evaluation, lag_q=0.7))
    assert (result.bandwidth_q_Hz, result.gain_off_q_dB, result.phase_off_q_deg) == (None, None, None)
    assert_reason(result.reasons["bandwidth_q_Hz"], "bandwidth_below_lines", lowest_Hz=pytest.approx(0.5))
    assert_reason(result.reasons["phase_off_q_deg"], "no_line_below_predicted_bandwidth")
    assert result.bandwidth_q_predicted_Hz == pytest.approx(0.225, abs=0.002)


def test_friction_shifts_the_lab_response_from_the_prediction_and_the_lines_repeat() -> None:
    metrics = played("lab").metrics
    assert 0.1 < (metrics.find_value("gain_off_q_dB") or 0.0) < 1.0
    assert 0.0 < (metrics.find_value("unlike_q_percent") or 0.0) < 3.0


def test_a_lag_is_measured_line_by_line_and_compared_with_its_prediction() -> None:
    evaluation = made(LEAD_IN, MULTISINE_BODE.replace("period_s: 4", "period_s: 8"))
    columns = seen(evaluation)
    (lines,) = build_bode_lines(columns, evaluation.plan.program(), evaluation)
    np.testing.assert_allclose(lines.f, np.arange(1, 9) / 8.0)
    np.testing.assert_allclose(np.abs(lines.H), 1.0 / np.hypot(1.0, 2.0 * np.pi * lines.f * 0.4), rtol=1e-3)
    assert lines.measured.all()
    result = figures(evaluation, columns)
    assert lines.expected is not None
    off = np.abs(20.0 * np.log10(np.abs(lines.H / lines.expected)))
    assert result.bandwidth_q_predicted_Hz is not None
    within = lines.f <= result.bandwidth_q_predicted_Hz
    assert 0 < within.sum() < within.size
    assert result.gain_off_q_dB == pytest.approx(off[within].max())
    assert result.unlike_q_percent == pytest.approx(0.0, abs=0.1)
    assert result.residual_q_percent == pytest.approx(0.0, abs=0.2)
    assert_reason(result.reasons["gain_off_S_dB"], "reference_not_excited", signal="S")


def test_only_a_line_that_does_not_repeat_is_not_measured() -> None:
    evaluation = made(LEAD_IN, MULTISINE_BODE)
    columns = seen(evaluation)
    t = np.arange(columns["q"].size) * T_s
    columns["q"] = columns["q"] + np.where(t >= 12.0, 0.004 * np.sin(2.0 * np.pi * 1.5 * t), 0.0)
    (lines,) = build_bode_lines(columns, evaluation.plan.program(), evaluation)
    assert lines.f[~lines.measured].tolist() == [1.5]
    assert_reason(lines.reasons[5], "line_not_periodic")
    assert figures(evaluation, columns).unlike_q_percent == pytest.approx(0.0, abs=1.0)


def test_the_residual_is_the_motion_outside_all_lines() -> None:
    evaluation = made(LEAD_IN, MULTISINE_BODE)
    columns = seen(evaluation)
    size = float(np.std(columns["q"][-4000:]))
    t = np.arange(columns["q"].size) * T_s
    columns["q"] = columns["q"] + 0.1 * size * np.sqrt(2.0) * np.sin(2.0 * np.pi * 5.0 * t)
    assert figures(evaluation, columns).residual_q_percent == pytest.approx(10.0, rel=0.01)


@pytest.mark.parametrize("limit", [Limit.VOLTAGE_B, Limit.GOVERNOR, Limit.TENSION_FLOOR])
def test_an_excitation_during_an_active_limit_is_not_measured(limit: Limit) -> None:
    evaluation = made(LEAD_IN, MULTISINE_BODE)
    columns = seen(evaluation)
    columns["limits"][13_000:13_020] = float(limit)
    result = figures(evaluation, columns)
    assert (result.bandwidth_q_Hz, result.gain_off_q_dB, result.unlike_q_percent) == (None, None, None)
    assert result.bandwidth_q_predicted_Hz is not None
    duration_s = pytest.approx(0.02)
    assert_reason(result.reasons["bandwidth_q_Hz"], "limit_was_active", limit=limit, duration_s=duration_s)
    columns["limits"][13_000:13_020] = 0.0
    columns["limits"][5_000:5_020] = float(limit)  # in the first period, which is not measured
    assert figures(evaluation, columns).bandwidth_q_Hz is not None


def test_a_trajectory_is_not_a_limit_and_has_no_prediction_above_its_voltage_limit() -> None:
    for amplitude, code in ((0.02, ""), (1.0, "excitation_above_voltage_limit")):
        evaluation = made(
            LEAD_IN, MULTISINE_BODE.replace("0.1", str(amplitude)), tuning=TuningSettings(motion=TIME_OPTIMAL)
        )
        columns = seen(evaluation)
        columns["limits"][:] = float(Limit.GOVERNOR)
        result = figures(evaluation, columns)
        assert result.bandwidth_q_Hz is not None
        if code:
            assert_reason(result.reasons["bandwidth_q_predicted_Hz"], code)
        assert (result.gain_off_q_dB is None) is bool(code)


def test_two_periods_are_too_few_to_measure_the_repeatability_of_a_line() -> None:
    evaluation = made(LEAD_IN, MULTISINE_BODE.replace("periods: 3", "periods: 2"))
    result = figures(evaluation, seen(evaluation))
    assert result.unlike_q_percent is None
    assert_reason(result.reasons["unlike_q_percent"], "fewer_than_three_periods")
    assert result.bandwidth_q_Hz is not None


def test_the_coherence_of_a_sweep_measures_its_quality() -> None:
    evaluation = made(LEAD_IN, "{do: sweep, q_amplitude: 0.2, from_Hz: 0.1, to_Hz: 4, duration_s: 120}")
    columns = seen(evaluation)
    (clean,) = build_bode_lines(columns, evaluation.plan.program(), evaluation)
    columns["q"] = columns["q"] + lfilter(
        [0.03], [1.0, -0.97], np.random.default_rng(1).normal(0.0, 2.0, columns["q"].size)
    )
    (noisy,) = build_bode_lines(columns, evaluation.plan.program(), evaluation)
    assert np.nanmedian(clean.variation) < 0.05 < np.nanmedian(noisy.variation)
    assert noisy.measured.sum() < clean.measured.sum()


def test_the_prediction_follows_a_change_of_lambda_and_is_missing_for_another_bank() -> None:
    tuned = made(LEAD_IN, "{do: tuning, lam_q: 1.0}", MULTISINE_BODE)
    plain = made(LEAD_IN, MULTISINE_BODE, tuning=TuningSettings(lam_q=1.0))
    slow, same = (build_bode_lines(seen(one), one.plan.program(), one)[0] for one in (tuned, plain))
    assert slow.expected is not None
    assert same.expected is not None
    np.testing.assert_allclose(slow.expected, same.expected)
    other = made(LEAD_IN, "{do: tuning, bank: 3}", MULTISINE_BODE)
    unpredicted = build_bode_lines(seen(other), other.plan.program(), other)[0].unpredicted
    assert_reason(unpredicted, "bank_changed_during_run")
    lost = made(LEAD_IN, MULTISINE_BODE, tuning=TuningSettings(bank=3))
    result = figures(lost, seen(lost))
    assert_reason(result.reasons["gain_off_q_dB"], "bank_not_readable")
    assert result.bandwidth_q_Hz is not None


def test_an_unreadable_bank_or_an_out_of_range_tuning_does_not_prevent_a_result() -> None:
    broken = Bank(3, "old", 1, "", "A. Operator", datetime.now(UTC), (BankEntry(10.0, {"version": 99}),))
    assert load_bank_points(broken) == ()
    assert load_initial_tuning(StoredLoopSettings(lam_q=0.6, lam_motor=0.0258, seed=4)) == TuningSettings(
        lam_q=0.6, lam_motor=0.0258
    )


def test_an_incomplete_excitation_is_not_measured() -> None:
    evaluation = made(LEAD_IN, MULTISINE_BODE)
    early = {name: column[:-10] for name, column in seen(evaluation).items()}
    with refused(NoSamplesError, "no_excitation_completed"):
        figures(evaluation, early)
