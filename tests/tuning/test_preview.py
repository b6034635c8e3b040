"""Previews of a tuning, and the shortest step that the motors allow."""

import math
import pickle
from dataclasses import replace

import control
import numpy as np
import pytest

from backend.errors import OutOfRangeError
from backend.services import background_work
from backend.services.background_work import TuningSnapshot
from backend.services.tuning_state import default_tuning
from backend.tuning.gains import (
    LAM_MOTOR,
    TuningError,
    TuningParameters,
    designed_point,
    make_cascade_tuning,
    make_motor_loops,
    motor_gains,
    motor_model,
    position_gains,
    stiffness_gains,
)
from backend.tuning.preview import Steps, TuningPreviewer, least_reach_time
from backend.tuning.robustness import M_S_MAX, common_lambda_range, decoupled_model, motor_range, motor_robustness
from backend.tuning.simulation import simulate_cascade
from plant.parameters import load_parameters
from tests.refusals import refused

# The preview, compared with the non-linear simulation, and its rejections.


@pytest.fixture(scope="module")
def previewer() -> TuningPreviewer:
    return TuningPreviewer(load_parameters("ideal"))


SMALL = Steps((0.0, 0.02), (10.55, 10.57))
"""Steps that the governor lets through within 10 ms."""


@pytest.mark.parametrize("lam", [0.4, 0.6, 1.2])
def test_small_steps_match_the_linear_loop(previewer: TuningPreviewer, lam: float) -> None:
    """The reference is a state space of motors, load and joint that python-control closes and integrates."""
    parameters, lambdas = load_parameters("ideal"), TuningParameters(lam_q=lam, lam_S=lam)
    preview = previewer.preview(lambdas, 10.55, steps=SMALL)
    model = decoupled_model(parameters, make_motor_loops(parameters, LAM_MOTOR), 10.55)
    point, s = designed_point(parameters), control.tf("s")
    for channel, gains, step in (
        (0, position_gains(parameters, point, lambdas), preview.step_q),
        (1, stiffness_gains(parameters, point, lambdas), preview.step_S),
    ):
        loop = control.feedback(model[channel, channel], control.tf2ss(gains.k_p + gains.k_i / s))
        closed = loop * control.tf2ss(gains.k_i / s)
        t = np.arange(0.0, 8.0 * lam, 1e-3)
        y = np.asarray(control.step_response(closed, t).outputs)
        np.testing.assert_allclose(step.y, np.interp(step.t, t, y), atol=0.01)
        assert step.t90_s == pytest.approx(t[np.argmax(y >= 0.9)], rel=0.01)


@pytest.mark.parametrize("S", [8.0, 11.0, 15.0])
def test_margins_match_python_control(previewer: TuningPreviewer, S: float) -> None:
    parameters, lambdas, s = load_parameters("ideal"), TuningParameters(lam_q=0.45, lam_S=0.4), control.tf("s")
    preview = previewer.preview(lambdas, S)
    model = decoupled_model(parameters, make_motor_loops(parameters, LAM_MOTOR), S)
    point = designed_point(parameters)
    for channel, gains, found in (
        (0, position_gains(parameters, point, lambdas), preview.position.robustness),
        (1, stiffness_gains(parameters, point, lambdas), preview.stiffness.robustness),
    ):
        gain, phase, *_ = control.stability_margins(model[channel, channel] * control.tf2ss(gains.k_p + gains.k_i / s))
        assert found.gain_margin == pytest.approx(gain, rel=1e-6)
        assert np.degrees(found.phase_margin) == pytest.approx(phase, rel=1e-6)


def test_preview_shows_less_robustness_for_a_faster_loop(previewer: TuningPreviewer) -> None:
    slow, fast = previewer.preview(TuningParameters(lam_q=0.8)), previewer.preview(TuningParameters(lam_q=0.36))
    assert slow.position.robustness.M_s < 1.3 < fast.position.robustness.M_s < 1.7
    assert fast.step_q.peak_voltage > slow.step_q.peak_voltage
    assert fast.step_q.least_tension > 5.0


def test_the_trajectory_sets_the_step_time_and_lambda_sets_the_recovery_time(previewer: TuningPreviewer) -> None:
    slow, fast = (previewer.preview(TuningParameters(lam_q=lam), 10.0, u_plan=8.5) for lam in (1.0, 0.5))
    assert slow.step_q.t90_s == pytest.approx(fast.step_q.t90_s, abs=0.003)
    assert slow.pushes[0].recovery_s > 1.8 * fast.pushes[0].recovery_s
    slow, fast = (previewer.preview(TuningParameters(lam_q=lam), 10.0, steps=SMALL) for lam in (1.0, 0.5))
    assert slow.step_q.t90_s == pytest.approx(2.0 * fast.step_q.t90_s, rel=0.1)


def test_the_preview_uses_the_requested_stiffness(previewer: TuningPreviewer) -> None:
    """The tension is 10 N at S = 8.24 N·m/rad and 40 N at 14.06 (method section 1); steps of q do not exceed it."""
    for S, tension in ((8.24, 10.0), (14.06, 40.0)):
        preview = previewer.preview(TuningParameters(), S)
        assert preview.S == S
        assert tension - 1.0 < preview.step_q.least_tension < tension + 0.1
        assert preview.step_S.start == S


def test_lambda_outside_the_safe_range_is_refused(previewer: TuningPreviewer) -> None:
    lam_q_min, lam_S_min = previewer.safe_range()
    previewer.require_safe(TuningParameters(lam_q=lam_q_min, lam_S=lam_S_min))
    with pytest.raises(OutOfRangeError, match="λ_q"):
        previewer.require_safe(TuningParameters(lam_q=lam_q_min - 0.01))
    with pytest.raises(OutOfRangeError, match="λ_S"):
        previewer.require_safe(TuningParameters(lam_S=3.01))
    with pytest.raises(OutOfRangeError, match="λ_q"):
        previewer.require_safe(TuningParameters(lam_q=float("nan")))


def test_robustness_bounds_the_lambda_range_at_full_voltage(previewer: TuningPreviewer) -> None:
    """At the ±10 V of the paper the governor avoids saturation in the largest steps, so M_s = 1.7 ends the range."""
    lam_q_min, lam_S_min = previewer.safe_range()
    preview = previewer.preview(TuningParameters(lam_q=lam_q_min, lam_S=lam_S_min))
    assert preview.position.robustness.M_s == pytest.approx(1.7, abs=1e-3)
    assert preview.stiffness.robustness.M_s == pytest.approx(1.7, abs=1e-3)


def test_a_low_maximum_voltage_narrows_the_lambda_range() -> None:
    """At 4 V these steps would saturate; the range ends where the largest step just does not."""
    ideal = load_parameters("ideal")
    weak = replace(ideal, motor=replace(ideal.motor, u_max=4.0))
    lam_q_min, lam_S_min = TuningPreviewer(weak).safe_range()
    full_q, full_S = TuningPreviewer(ideal).safe_range()
    assert lam_q_min > 1.2 * full_q
    assert lam_S_min >= full_S

    def peak(lam_q: float) -> float:
        q_ref = np.repeat([-np.pi / 3.0, np.pi / 3.0], [100, 6000])
        trajectory = simulate_cascade(
            weak, make_cascade_tuning(weak, TuningParameters(lam_q=lam_q)), q_ref, np.full(q_ref.size, 10.55)
        )
        return float(np.max(np.abs([trajectory.u_A, trajectory.u_B])))

    assert peak(lam_q_min) < 4.0
    assert peak(lam_q_min - 0.005) == 4.0


def test_lambdas_for_a_requested_sensitivity_peak_attain_it(previewer: TuningPreviewer) -> None:
    found = previewer.lambdas_for(1.4)
    lam_q, lam_S, lam_motor = (found[name] for name in ("lam_q", "lam_S", "lam_motor"))
    assert isinstance(lam_q, float)
    assert isinstance(lam_S, float)
    assert isinstance(lam_motor, float)
    preview = previewer.preview(TuningParameters(lam_q=lam_q, lam_S=lam_S))
    assert preview.position.robustness.M_s == pytest.approx(1.4, abs=1e-3)
    assert preview.stiffness.robustness.M_s == pytest.approx(1.4, abs=1e-3)
    slower = TuningPreviewer(load_parameters("ideal"), lam_motor=lam_motor).preview(
        TuningParameters(lam_q=0.6, lam_S=0.6)
    )
    assert slower.motor.M_s == pytest.approx(1.4, abs=1e-3)
    # Erratum E5: the paper's 1.4 at 0.0854 s is near what the sampled loop with its electrical lag has.
    assert lam_motor == pytest.approx(0.0933, abs=2e-4)
    assert preview.motor.M_s == pytest.approx(1.413, abs=1e-3)


def test_an_unattainable_sensitivity_peak_is_rejected_with_the_attainable_range(previewer: TuningPreviewer) -> None:
    found = previewer.lambdas_for(1.6)
    refusal = found["lam_motor"]
    assert isinstance(refusal, TuningError)
    assert refusal.message.code == "M_s_not_attainable"
    assert refusal.message.values == {
        "M_s": 1.6,
        "lowest": pytest.approx(1.321, abs=5e-4),
        "lam_lowest": pytest.approx(0.2),
        "highest": pytest.approx(1.512, abs=5e-4),
        "lam_highest": pytest.approx(0.05),
    }
    assert isinstance(found["lam_q"], float)


@pytest.mark.parametrize("M_s", [1.45, 1.6, 1.69, 1.9])
def test_lambdas_for_a_sensitivity_peak_are_within_the_offered_range(previewer: TuningPreviewer, M_s: float) -> None:
    """The λ for a requested M_s can be activated, or the rejection states the start of the offered range."""
    found = previewer.lambdas_for(M_s)
    given = {name: lam for name, lam in found.items() if isinstance(lam, float)}
    low, high = previewer.motor_range()
    assert low <= given.pop("lam_motor", low) <= high
    previewer.require_safe(TuningParameters(**given))
    refusals = [reason.message for reason in found.values() if isinstance(reason, TuningError)]
    assert {message.code for message in refusals} <= {"M_s_not_attainable", "M_s_needs_smaller_lambda"}
    assert ("lam_q" in given) == (M_s <= M_S_MAX)


def test_two_motors_without_a_common_lambda_are_rejected() -> None:
    """M_s of one motor exceeds 1.7 below 0.12 s; the lag of the other allows no λ above 0.076 s."""
    ideal = load_parameters("ideal")
    slow = motor_model(replace(ideal, motor=replace(ideal.motor, tau_e=0.02)), "A")
    brisk = replace(motor_model(ideal, "B"), T_m=0.02)
    minimum_s, maximum_s = pytest.approx(0.1205, abs=5e-4), pytest.approx(0.076, abs=5e-4)
    with refused(TuningError, "no_lambda_for_both_motors", minimum_s=minimum_s, maximum_s=maximum_s):
        common_lambda_range([slow, brisk])


def test_a_slow_winding_narrows_the_range_of_the_motor_loop() -> None:
    """With L/R = 20 ms, M_s at 0.0854 s exceeds 1.7 and is rejected; the offered range begins at M_s = 1.7."""
    ideal = load_parameters("ideal")
    slow = replace(ideal, motor=replace(ideal.motor, tau_e=0.02))
    motor = motor_model(slow, "A")
    low, _ = motor_range(motor)
    assert 0.1205 < low < 0.1206  # the message rounds the bound inwards, to three digits
    with pytest.raises(OutOfRangeError, match=r"λ_motor: 0\.0854 s is outside 0\.121 to 0\.2 s"):
        TuningPreviewer(slow)
    assert motor_robustness(motor, motor_gains(motor.K_m, motor.T_m, low)).M_s == pytest.approx(M_S_MAX, abs=1e-3)


# A preview in another process equals a preview of the active tuning.


def test_a_preview_from_a_pickled_snapshot_is_unchanged() -> None:
    tuning, _ = default_tuning(load_parameters("lab"))
    snapshot = pickle.loads(pickle.dumps(TuningSnapshot.from_active(tuning)))
    wanted = 0.6, 0.5, 10.0, -1.0, None, None, None, True
    assert background_work.preview_tuning(snapshot, *wanted) == tuning.preview(0.6, 0.5, 10.0, -1.0, printed=True)
    assert background_work.preview_motor(snapshot, 0.2) == tuning.preview_motor(0.2)
    assert background_work.compute_robust_tuning(snapshot, 1.5) == tuning.compute_robust_tuning(1.5)


def test_models_are_cached_for_equal_tunings_only() -> None:
    tuning, _ = default_tuning(load_parameters("lab"))
    snapshot = TuningSnapshot.from_active(tuning)
    first = snapshot.resolve().previewer
    assert snapshot.resolve().previewer is first
    assert replace(snapshot, settings=replace(snapshot.settings, lam_q=0.9)).resolve().previewer is first
    assert replace(snapshot, settings=replace(snapshot.settings, lam_motor=0.1)).resolve().previewer is not first
    assert replace(snapshot, parameters=load_parameters("ideal")).resolve().previewer is not first


# The shortest position step that the motors allow, compared with the method and an integrated motor.

PARAMETERS = load_parameters("ideal")


def test_the_least_reach_time_of_the_papers_largest_step() -> None:
    assert least_reach_time(PARAMETERS, 2.0 * math.pi / 3.0) == pytest.approx(0.875, abs=0.002)


def test_the_least_reach_time_without_lag_depends_only_on_the_speed() -> None:
    quick = replace(PARAMETERS, identified=replace(PARAMETERS.identified, T_m=1e-6))
    assert least_reach_time(quick, 2.0 * math.pi / 3.0) == pytest.approx(0.66, abs=0.002)


@pytest.mark.parametrize("step", [-1.0, 0.3])
def test_a_motor_at_full_voltage_reaches_the_step_at_the_least_reach_time(step: float) -> None:
    t = least_reach_time(PARAMETERS, step)
    omega = 28.6 * (1.0 - np.exp(-np.linspace(0.0, t, 100_001) / 0.22))
    turned = float(np.trapezoid(omega, dx=t / 100_000))
    assert turned == pytest.approx(0.9 * abs(step) * 10.0, rel=1e-6)


def test_the_slower_motor_determines_the_least_reach_time() -> None:
    slow = replace(PARAMETERS, sided={"identified_B": {"K_m": 1.43}})
    assert least_reach_time(slow, 1.0) > 1.5 * least_reach_time(PARAMETERS, 1.0)


def test_the_least_reach_time_of_a_zero_step_is_zero() -> None:
    assert least_reach_time(PARAMETERS, 0.0) == 0.0
