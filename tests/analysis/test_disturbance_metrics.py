"""Metrics of disturbances: compliance, pushes, rest and impacts."""

from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from backend.analysis.context import EvaluationContext
from backend.analysis.disturbance_metrics import (
    Hit,
    compute_compliance_metrics,
    compute_hold_metrics,
    compute_impact_metrics,
    compute_push_metrics,
    find_hits,
    find_hold_windows,
    find_push_windows,
    measure_holds,
    measure_pushes,
    pair_hits,
)
from backend.analysis.step_metrics import NoSamplesError
from backend.banks.tuning_settings import TuningSettings
from backend.control.disturbance_observer import POLE
from backend.execution.simulation import simulate_in_memory
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.models.run import MOTIONS, TIME_OPTIMAL
from backend.realtime.commands import Accepted, RunProgram
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.program import ContactDetection, Law, Program, Segment
from backend.sample import NAMES
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import INPUTS, OUTPUTS, make_sampled_loop
from plant.interface import T_s
from plant.parameters import load_parameters
from plant.simulator import Simulator
from tests.experiments.composing.written import plan_of, with_parts
from tests.experiments.judging import LEAD_IN_S, compliance_criteria
from tests.plant.test_dynamics import own_rate
from tests.realtime.bench_top import BenchTop
from tests.reasons import assert_reason
from tests.refusals import refused

# Compliance metrics of an ideal spring with delayed load cells and an offset.

R_J = 0.075
Array = NDArray[np.float64]


def pushed(*, stiffness: float = 10.0, delay_ms: int = 0, offset_N: float = 0.0) -> dict[str, Array]:
    """A joint of ``stiffness`` under a push of 12 N at 0.5 Hz after the lead-in."""
    t = np.arange(round(1000 * (LEAD_IN_S + 10.0))) * 1e-3
    F_push = np.where(t < LEAD_IN_S, 0.0, 12.0 * np.sin(np.pi * (t - LEAD_IN_S)))
    seen = np.concatenate([np.zeros(delay_ms), F_push[: t.size - delay_ms]])
    ones = np.ones_like(t)
    return {
        "t": t,
        "q": R_J * F_push / stiffness,
        "S": 10.0 * ones,
        "S_ref": 10.0 * ones,
        "F_A": 17.0 - 0.5 * seen + offset_N,
        "F_B": 17.0 + 0.5 * seen,
        "u_A": ones,
        "u_B": -2.0 * ones,
    }


def test_a_spring_of_the_commanded_stiffness_agrees_exactly() -> None:
    figures = compute_compliance_metrics(pushed(), R_J, LEAD_IN_S)
    assert figures.rmse_raw_N == pytest.approx(0.0, abs=1e-9)
    assert figures.rmse_aligned_N == pytest.approx(0.0, abs=1e-9)
    assert figures.delay_s == 0.0
    assert figures.stiffness_felt == pytest.approx(10.0)
    assert figures.largest_push_N == pytest.approx(12.0, rel=1e-4)
    assert figures.min_tension_N == pytest.approx(11.0, rel=1e-4)
    assert figures.peak_voltage_V == 2.0


def test_the_aligned_error_excludes_delay_and_offset_and_the_raw_error_includes_them() -> None:
    figures = compute_compliance_metrics(pushed(delay_ms=12, offset_N=0.7), R_J, LEAD_IN_S)
    assert figures.delay_s == pytest.approx(0.012)
    # an offset and the sine's difference over 12 ms, uncorrelated: 12 N · 2 sin(π·0.5·0.012) / √2
    shift = 12.0 * 2.0 * np.sin(np.pi * 0.5 * 0.012) / np.sqrt(2.0)
    assert figures.rmse_raw_N == pytest.approx(np.hypot(0.7, shift), rel=0.01)
    assert figures.rmse_aligned_N is not None
    assert figures.rmse_aligned_N < 1e-6


def test_a_different_apparent_stiffness_counts_as_error() -> None:
    figures = compute_compliance_metrics(pushed(stiffness=11.0), R_J, LEAD_IN_S)
    assert figures.stiffness_felt == pytest.approx(11.0)
    assert figures.rmse_aligned_N == pytest.approx((1.0 - 10.0 / 11.0) * 12.0 / np.sqrt(2.0), rel=0.01)
    verdicts = {item.name: item.passed for item in compliance_criteria(figures)}
    assert verdicts == {"rmse_aligned": False, "min_tension": True}


def test_a_run_without_pushes_has_no_compliance_metrics() -> None:
    columns = {name: column[:5_000] for name, column in pushed().items()}
    with refused(NoSamplesError, "ended_before_push", start_s=LEAD_IN_S):
        compute_compliance_metrics(columns, R_J, LEAD_IN_S)


def test_the_estimated_force_is_compared_with_the_reaction_of_the_load_cells() -> None:
    columns = pushed(delay_ms=12)
    F_push = R_J**-1 * 10.0 * columns["q"]
    columns["F_ext_hat"] = F_push + 0.4  # its bias is subtracted
    assert compute_compliance_metrics(columns, R_J, LEAD_IN_S).rmse_estimated_N == pytest.approx(0.0, abs=1e-6)
    columns["F_ext_hat"] = 0.9 * F_push
    off = compute_compliance_metrics(columns, R_J, LEAD_IN_S).rmse_estimated_N
    assert off == pytest.approx(1.2 / np.sqrt(2.0), rel=0.01)
    for unknown in (None, np.where(columns["t"] > 5.0, np.nan, F_push)):
        if unknown is None:
            del columns["F_ext_hat"]
        else:
            columns["F_ext_hat"] = unknown
        figures = compute_compliance_metrics(columns, R_J, LEAD_IN_S)
        assert figures.rmse_estimated_N is None
        assert_reason(figures.reasons["rmse_estimated_N"], "no_estimated_force")


# Measured and predicted deviations of pushes, on the simulator and for known signals.

IDEAL = load_parameters("ideal")
R_J_PUSHES = IDEAL.geometry.r_j
HELD = "{do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 6.0}"
STEP = "{do: push, F_push: 6.0, duration_s: 1.0}"
REST = "{do: hold, duration_s: 5.0}"
RAMP = "{do: push, F_push: -8.0, duration_s: 0.5, shape: ramp}", "{do: push, F_push: 0.0, duration_s: 0.5, shape: ramp}"
IMPULSE = "{do: push, F_push: 10.0, duration_s: 0.01}"
PUSHED = with_parts(HELD, STEP, REST, *RAMP, REST, IMPULSE, REST, more="measures: [pushes]\n")


def of(plan: ExperimentPlan, tuning: TuningSettings | None = None) -> EvaluationContext:
    return EvaluationContext(IDEAL, plan, tuning or TuningSettings())


def columns(plan: ExperimentPlan, q: Any = 0.0) -> dict[str, Any]:
    """Return recorded samples; a push is in the sample after the tick in which it acted."""
    segments = plan.program().segments
    force: list[float] = []
    before = 0.0
    for one in segments:
        ticks = round(one.duration_s / T_s)
        share = np.arange(1, ticks + 1) / ticks if one.shape == "ramp" else np.ones(ticks)
        force += list(before + share * (one.F_push - before))
        before = one.F_push
    F = np.array([0.0, *force[:-1]])
    ones = np.ones(F.size)
    return {
        "t": np.arange(F.size) * T_s, "q": q * ones, "q_ref": 0.0 * ones, "S": 10.0 * ones, "S_ref": 10.0 * ones,
        "F_push": F, "F_A": 20.0 * ones, "F_B": 20.0 * ones, "u_A": ones, "u_B": ones,
    }  # fmt: skip


def test_steps_ramps_and_impulses_are_distinguished_and_a_ramp_ends_at_zero_force() -> None:
    found = find_push_windows(plan_of(PUSHED).program())
    assert [(one.shape, one.pushed.start, one.pushed.stop, one.until) for one in found] == [
        ("step", 6000, 7000, 12000),
        ("ramp", 12000, 13000, 18000),
        ("impulse", 18000, 18010, 23010),
    ]


def test_force_impulse_and_static_deviation_are_those_of_the_push() -> None:
    plan = plan_of(PUSHED)
    step, ramp, impulse = measure_pushes(columns(plan), plan.program(), of(plan))
    assert (step.F, ramp.F, impulse.F) == (6.0, -8.0, 10.0)
    assert [one.impulse for one in (step, ramp, impulse)] == pytest.approx([6.0, -4.0, 0.1])
    assert [one.static for one in (step, ramp)] == pytest.approx([R_J_PUSHES * 6.0 / 10.0, R_J_PUSHES * 8.0 / 10.0])


def test_a_peak_is_compared_with_the_loop_response_to_the_same_force() -> None:
    plan, lam_q = plan_of(PUSHED), 0.6
    seen = columns(plan)
    loop = make_sampled_loop(IDEAL, make_cascade_tuning(IDEAL, TuningParameters(lam_q=lam_q)), 10.0).closed
    w = np.zeros((seen["q"].size, len(INPUTS)))
    w[:-1, INPUTS.tau_ext] = R_J_PUSHES * seen["F_push"][1:]
    seen["q"] = 1.1 * loop.simulate(w)[:, OUTPUTS.q]
    step, ramp, impulse = measure_pushes(seen, plan.program(), of(plan, TuningSettings(lam_q=lam_q)))
    # the responses to earlier pushes have almost decayed
    assert [one.off_percent for one in (step, ramp, impulse)] == pytest.approx([10.0, 10.0, 10.0], abs=1.0)
    assert step.peak_q > 1.1 * step.static  # overshoot
    assert ramp.peak_q < 1.1 * ramp.static
    figures = compute_push_metrics(seen, plan.program(), of(plan, TuningSettings(lam_q=lam_q)))
    assert figures.pushed_off_percent == pytest.approx(10.0, abs=1.0)
    assert figures.pushed_peak_q == max(step.peak_q, impulse.peak_q)
    assert figures.pushed_static_ratio == step.peak_q / step.static


@pytest.mark.parametrize("motion", MOTIONS)
def test_push_peaks_match_the_prediction_on_the_ideal_plant_in_both_motions(motion: str) -> None:
    played = simulate_in_memory(IDEAL, plan_of(PUSHED), LoopSettings(motion=motion), lambda _: pytest.fail("no bank"))
    assert (played.metrics.find_value("pushed_off_percent") or 100.0) < 2.0
    assert 1.0 < (played.metrics.find_value("pushed_static_ratio") or 0.0) < 2.0


@pytest.mark.parametrize("begun_with", [0.0, 0.8])
def test_the_push_prediction_includes_disturbance_rejection_once_it_is_active(begun_with: float) -> None:
    """The bias is measured first; the program then changes k_ext before a second, equal push."""
    text = with_parts(HELD, STEP, REST, "{do: tuning, k_ext: 0.4}", STEP, REST, more="measures: [pushes]\n")
    settings = LoopSettings(lam_q=1.0, motion=TIME_OPTIMAL, k_ext=begun_with)
    played = simulate_in_memory(IDEAL, plan_of(text), settings, lambda _: pytest.fail("no bank"))
    assert (played.metrics.find_value("pushed_off_percent") or 100.0) < 2.0
    plan = plan_of(text)
    choice = TuningSettings(lam_q=1.0, motion=TIME_OPTIMAL, k_ext=begun_with)
    pushes = measure_pushes(columns(plan), plan.program(), of(plan, choice))
    left = [float(abs(one.expected[900])) for one in pushes if one.expected is not None]
    assert len(left) == 2
    assert (left[1] < 0.75 * left[0]) if begun_with == 0.0 else (left[1] > 1.25 * left[0])


def test_a_held_push_causes_the_static_deviation_without_the_position_loop() -> None:
    text = with_parts(HELD, STEP, REST, more="measures: [pushes]\nlaw: compliance\n")
    played = simulate_in_memory(IDEAL, plan_of(text), LoopSettings(), lambda _: pytest.fail("no bank"))
    assert (played.metrics.find_value("pushed_off_percent") or 100.0) < 2.0
    plan = plan_of(text)
    (one,) = measure_pushes(columns(plan), plan.program(), of(plan))
    assert one.expected is not None
    assert one.expected[900] == pytest.approx(one.static, rel=0.01)


def test_the_recovery_time_of_a_push_is_measured_or_has_a_reason() -> None:
    plan = plan_of(PUSHED)
    seen = columns(plan)
    seen["q"][6500:7400] = 0.05
    figures = compute_push_metrics(seen, plan.program(), of(plan))
    assert figures.pushed_back_s == pytest.approx(0.4)
    seen["q"][13000:18000] = 0.05
    figures = compute_push_metrics(seen, plan.program(), of(plan))
    assert figures.pushed_back_s is None
    deviation = pytest.approx(0.05)
    assert_reason(figures.reasons["pushed_back_s"], "not_back_after_push", end_s=13.0, deviation_rad=deviation)
    tight = plan_of(with_parts(HELD, STEP))
    figures = compute_push_metrics(columns(tight), tight.program(), of(tight))
    assert_reason(figures.reasons["pushed_back_s"], "no_hold_after_push")


def test_a_push_without_prediction_is_measured_and_the_missing_prediction_has_a_reason() -> None:
    law = "{name: by, kind: choice, symbol: law, meaning: law, default: single-loop, choices: [single-loop]}"
    chosen = f"settings:\n  - {law}\n"
    plan = plan_of(with_parts(HELD, STEP, REST, settings=chosen, more="law: by\nmeasures: [pushes]\n"))
    figures = compute_push_metrics(columns(plan), plan.program(), of(plan))
    assert figures.pushed_off_percent is None
    assert_reason(figures.reasons["pushed_off_percent"], "law_without_prediction", law=Law.SINGLE_LOOP)
    assert figures.pushed_peak_q == 0.0


def test_a_run_without_completed_pushes_has_no_push_metrics() -> None:
    plan = plan_of(PUSHED)
    early = {name: column[:6900] for name, column in columns(plan).items()}
    with refused(NoSamplesError, "pushes_not_completed"):
        compute_push_metrics(early, plan.program(), of(plan))
    still = plan_of(with_parts(HELD, REST))
    with refused(NoSamplesError, "no_push"):
        compute_push_metrics(columns(still), still.program(), of(still))
    part = {name: column[:12500] for name, column in columns(plan).items()}
    assert len(measure_pushes(part, plan.program(), of(plan))) == 1


# Metrics of holds, for signals with known swing and counts.

LAB, IDEAL_HOLDS = load_parameters("lab"), load_parameters("ideal")
COUNT, MOTOR = 2.0 * np.pi / 4000.0, 2.0 * np.pi / 8000.0
MOVE = "{do: step, q_ref: 0.3, S_ref: 10.0, duration_s: 2.0}"
HOLD = "{do: hold, duration_s: 3.0}"
BACK = "{do: step, q_ref: 0.0, duration_s: 2.0}"


def columns_holds(plan: ExperimentPlan) -> dict[str, Any]:
    """Return samples of an actuator exactly at its references, on whole counts."""
    segments = plan.program().segments
    q_ref, S_ref = (
        np.repeat([getattr(one, name) for one in segments], [round(one.duration_s / T_s) for one in segments])
        for name in ("q_ref", "S_ref")
    )
    ones = np.ones(q_ref.size)
    return {
        "t": np.arange(q_ref.size) * T_s, "q": q_ref.copy(), "q_ref": q_ref, "S": S_ref.copy(), "S_ref": S_ref,
        "theta_A": 100.0 * MOTOR * ones, "theta_B": 90.0 * MOTOR * ones, "F_A": 20.0 * ones, "F_B": 15.0 * ones,
        "u_A": ones.copy(), "u_B": ones.copy(),
    }  # fmt: skip


def test_only_constant_references_after_a_move_are_a_hold() -> None:
    push, sine = (
        "{do: push, F_push: 3.0, duration_s: 2.0}",
        "{do: sine, q_amplitude: 0.1, period_s: 2.0, duration_s: 2.0}",
    )
    short = "{do: hold, duration_s: 0.5}", "{do: hold, duration_s: 0.3}"
    plan = plan_of(with_parts(MOVE, HOLD, HOLD, BACK, push, HOLD, HOLD, sine, *short))
    # the end of a push is no hold, the next hold is one; 0.3 s is too short
    assert find_hold_windows(plan.program()) == (slice(2000, 8000), slice(15000, 18000))


def test_swing_and_deviation_are_the_maxima_over_all_holds() -> None:
    plan = plan_of(with_parts(MOVE, HOLD, BACK, HOLD))
    seen = columns_holds(plan)
    seen["q"][3000:3100] += 1.0 * COUNT
    seen["q"][8000:8100] -= 2.0 * COUNT
    seen["u_B"][8500] += 0.2
    seen["u_A"][8600] -= 0.15
    seen["S"][4000] += 0.004
    seen["theta_A"][3000] += MOTOR  # forth and back: two ticks in motion
    figures = compute_hold_metrics(seen, plan.program(), LAB)
    assert figures.held_q_swing_counts == pytest.approx(2.0)
    assert figures.held_q_swing == pytest.approx(2.0 * COUNT)
    assert figures.held_off_counts == pytest.approx(1.5)  # the resolution is half a count
    assert figures.held_u_swing_V == pytest.approx(0.2)
    assert figures.held_S_swing == pytest.approx(0.004)
    assert figures.held_moving_percent == pytest.approx(100.0 * 2 / 2999)
    first, second = measure_holds(seen, plan.program(), LAB)
    assert (first.q_ref, first.S_ref, second.q_ref) == (0.3, 10.0, 0.0)
    assert (first.start_s, second.start_s) == (2.0, 7.0)
    assert first.off == pytest.approx(COUNT * 100 / 3000)


def test_exact_readings_use_the_papers_counts_without_tolerance() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    seen = columns_holds(plan)
    seen["q"][3000:3100] += 0.3 * COUNT
    figures = compute_hold_metrics(seen, plan.program(), IDEAL_HOLDS)
    assert figures.held_off_counts == pytest.approx(0.3)
    assert figures.held_q_swing_counts == pytest.approx(0.3)


def test_motion_before_a_hold_is_not_counted() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    seen = columns_holds(plan)
    seen["q"][:1999] = 0.0
    seen["u_A"][:1999] = 9.0
    figures = compute_hold_metrics(seen, plan.program(), LAB)
    assert (figures.held_q_swing_counts, figures.held_u_swing_V, figures.held_moving_percent) == (0.0, 0.0, 0.0)


def test_a_nan_reading_is_not_at_rest() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    seen = columns_holds(plan)
    seen["q"][3000] = np.nan
    figures = compute_hold_metrics(seen, plan.program(), LAB)
    assert (figures.held_q_swing_counts, figures.held_off_counts) == (None, None)
    assert_reason(figures.reasons["held_off_counts"], "sample_without_value")
    assert figures.held_u_swing_V == 0.0


def test_an_incomplete_hold_has_no_metrics() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    early = {name: column[:-1] for name, column in columns_holds(plan).items()}
    with refused(NoSamplesError, "no_hold_completed"):
        compute_hold_metrics(early, plan.program(), LAB)


# Impacts: metrics of hits, compared with an independent integration and between stiffnesses.

LAB_IMPACT = load_parameters("lab")
PROGRAM = build_ready_plan("impact").program()
SPEEDS = (0.2, 0.4, 0.6)
AHEAD = 30
"""Samples before the touch from which the test integrates on its own."""


@dataclass(frozen=True)
class Driven:
    """A run: its columns, and the plant's true state at each sample (n, 10)."""

    columns: dict[str, Array]
    states: Array


@cache
def impacts(name: str = "lab") -> Driven:
    """Return the ready-made experiment, with the voltage limit from the start."""
    parameters = load_parameters(name)
    plant = Simulator(parameters)
    bench = BenchTop(parameters, make_tuning_command(parameters, TuningParameters(), u_plan=8.5), plant)
    bench.wind_up()
    laid = PROGRAM
    segments = tuple(replace(segment, tuning=0) for segment in laid.segments)
    assert isinstance(bench.send(RunProgram(replace(laid, segments=segments))), Accepted)
    begun, states = len(bench.samples.rows), []
    for _ in range(round(laid.duration_s / T_s)):
        states.append(plant.x)
        bench.advance(T_s)
        assert bench.loop.mode is Mode.EXPERIMENT
    rows = np.array(bench.samples.rows[begun:])
    return Driven({name: rows[:, place] for place, name in enumerate(NAMES)}, np.array(states))


def own_hit(driven: Driven, hit: Hit) -> tuple[float, float]:
    """Integrate a hit under the recorded voltages; return its peak force [N] and impulse [N·s].

    The obstacle is an independent implementation of its three parameters; ten steps per millisecond.
    """
    wall = next(wall for wall in PROGRAM.walls if wall is not None)
    r_j, step_V = LAB_IMPACT.geometry.r_j, 2.0 * LAB_IMPACT.motor.u_max / 2**16

    def depth(x: Array) -> float:
        return float(r_j * (x[0] - wall.q_wall))

    def pressed(x: Array) -> float:
        return max(wall.k_wall * depth(x) * (1.0 + wall.c_wall * r_j * float(x[1])), 0.0) if depth(x) > 0.0 else 0.0

    def rate(u_A: float, u_B: float, t: float, x: Array) -> list[float]:
        return own_rate(LAB_IMPACT, u_A, u_B, -r_j * pressed(x), t, x)

    def contact_detection(_t: float, x: Array) -> float:
        return depth(x)

    first = hit.window.start - AHEAD
    x, peak, impulse = driven.states[first].copy(), 0.0, 0.0
    for tick in range(first, hit.window.stop + AHEAD):
        u_A, u_B = (round(driven.columns[u][tick] / step_V) * step_V for u in ("u_A", "u_B"))
        points = np.linspace(0.0, T_s, 11)
        solved = solve_ivp(
            partial(rate, u_A, u_B),
            (0.0, T_s),
            x,
            "RK45",
            points,
            events=contact_detection,
            rtol=1e-8,
            atol=1e-11,
            max_step=2e-4,
        )
        forces = np.array([pressed(at) for at in solved.y.T])
        peak, impulse = max(peak, float(forces.max())), impulse + float(np.trapezoid(forces, points))
        x = solved.y[:, -1]
    return peak, impulse


@pytest.mark.parametrize("number", range(12))
def test_peak_and_impulse_agree_with_an_independent_integration_within_3_percent(number: int) -> None:
    driven = impacts()
    hits = find_hits(driven.columns, PROGRAM)
    assert [hit.S_ref for hit in hits] == pytest.approx([8.0] * 3 + [15.0] * 6 + [8.0] * 3)
    assert [hit.speed for hit in hits] == pytest.approx(4 * SPEEDS, rel=0.04)
    assert [hit.reacts for hit in hits] == [False] * 6 + [True] * 6
    peak, impulse = own_hit(driven, hits[number])
    assert hits[number].peak_N == pytest.approx(peak, rel=0.03)
    assert hits[number].impulse_Ns == pytest.approx(impulse, rel=0.03)


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_a_soft_joint_hits_softer_than_a_stiff_one_at_each_speed(name: str) -> None:
    hits = find_hits(impacts(name).columns)
    for soft, stiff in zip(hits[:3], hits[3:6], strict=True):
        assert soft.peak_N < 0.7 * stiff.peak_N
        assert soft.impulse_Ns < 0.7 * stiff.impulse_Ns
    for alike in (hits[:3], hits[3:6]):
        assert [hit.peak_N for hit in alike] == sorted(hit.peak_N for hit in alike)
    figures = compute_impact_metrics(impacts(name).columns, PROGRAM)
    assert figures.hits == 12.0
    assert figures.soft_to_stiff_peak == pytest.approx(
        np.mean([soft.peak_N / stiff.peak_N for soft, stiff in zip(hits[:3], hits[3:6], strict=True)])
    )


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_the_contact_reaction_reduces_each_impulse_by_a_third_and_each_peak(name: str) -> None:
    hits = find_hits(impacts(name).columns, PROGRAM)
    pairs, why = pair_hits(hits)
    assert (len(pairs), why) == (6, "")
    for plain, reacted in pairs:
        assert plain.S_ref == reacted.S_ref
        assert reacted.speed == pytest.approx(plain.speed, rel=0.04)
        assert reacted.impulse_Ns < 0.6 * plain.impulse_Ns
        assert reacted.peak_N < plain.peak_N
    figures = compute_impact_metrics(impacts(name).columns, PROGRAM)
    assert figures.reaction_impulse == pytest.approx(np.mean([b.impulse_Ns / a.impulse_Ns for a, b in pairs]))
    assert figures.reaction_peak == pytest.approx(np.mean([b.peak_N / a.peak_N for a, b in pairs]))
    assert figures.felt_after_s == max(hit.detection_s for hit in hits[6:])
    assert figures.reasons == {}


def test_hit_detection_follows_the_observer_poles_and_the_reaction_follows_immediately() -> None:
    driven = impacts("ideal")  # without encoder counts, noise and bias
    kept, seen = np.exp(-POLE * T_s), np.abs(driven.columns["F_wall"])
    for _ in range(3):  # p/(s + p) three times
        seen = lfilter([1.0 - kept], [1.0, -kept], seen)
    for hit in find_hits(driven.columns, PROGRAM)[6:]:
        expected = T_s * int(np.argmax(seen[hit.window] > hit.contact_N))
        assert hit.detection_s == pytest.approx(expected, abs=0.002)
        assert hit.reaction_s == 0.0
        largest = hit.window.start + round((hit.detection_s + hit.to_peak_s) / T_s)
        assert abs(driven.columns["F_wall"][largest]) == hit.peak_N


def test_undetected_hits_do_not_count_as_measured_reactions() -> None:
    program = Program(
        Law.CASCADE, (Segment(2.0, 0.0, 8.0, contact_detection=1),), contact_detections=(ContactDetection(1.5),)
    )
    seen = columns_impact((8.0, 0.3, 4.0), (8.0, 0.3, 5.0))
    seen |= {"F_ext_hat": np.where(seen["t"] > 1.5, seen["F_wall"], 0.0), "limits": np.zeros_like(seen["t"])}
    one, other = find_hits(seen, program)
    assert one.reacts
    assert np.isnan([one.detection_s, one.reaction_s, one.to_peak_s, other.reaction_s, other.to_peak_s]).all()
    assert other.detection_s == pytest.approx(0.1 * np.arcsin(0.3) / np.pi, abs=0.001)
    figures = compute_impact_metrics(seen, program)
    assert figures.felt_after_s is figures.gave_way_after_s is figures.reaction_peak is None
    assert_reason(figures.reasons["felt_after_s"], "hits_without_reaction", missed=2, hits=2)


def test_hits_with_reaction_are_not_compared_without_matching_plain_hits() -> None:
    segments = (Segment(1.0, 0.0, 8.0), Segment(1.0, 0.0, 12.0, contact_detection=1))
    program = Program(Law.CASCADE, segments, contact_detections=(ContactDetection(1.5),))
    seen = columns_impact((8.0, 0.3, 4.0), (12.0, 0.3, 5.0))
    felt = np.where(np.abs(seen["F_wall"]) > 1.5, 64.0, 0.0)
    figures = compute_impact_metrics(seen | {"F_ext_hat": seen["F_wall"], "limits": felt}, program)
    assert figures.gave_way_after_s == 0.0
    assert figures.reaction_impulse is None
    speed = pytest.approx(0.3)
    assert_reason(figures.reasons["reaction_impulse"], "hit_without_counterpart", S_ref=12.0, speed=speed)
    assert_reason(figures.reasons["soft_to_stiff_peak"], "hits_of_equal_stiffness", S_ref=8.0)


def columns_impact(*hits: tuple[float, float, float], ticks: int = 1000) -> dict[str, Array]:
    """A second for each hit of S_ref [N·m/rad], speed [rad/s] and peak [N]: a half-sine of 100 ms, half of it again
    50 ms later."""
    n = ticks * len(hits)
    t = T_s * np.arange(n, dtype=np.float64)
    F_wall, q, S_ref = np.zeros(n), np.zeros(n), np.zeros(n)
    bump = np.sin(np.pi * (np.arange(100) + 0.5) / 100.0)
    for place, (S, speed, peak) in enumerate(hits):
        begin = place * ticks
        S_ref[begin : begin + ticks] = S
        q[begin : begin + ticks] = speed * np.minimum(t[:ticks] - 0.5, 0.0)
        F_wall[begin + 500 : begin + 600] = -peak * bump
        F_wall[begin + 650 : begin + 750] = -0.5 * peak * bump
    ones = np.ones(n)
    return {
        "t": t,
        "F_wall": F_wall,
        "q": q,
        "S_ref": S_ref,
        "F_A": 20 * ones,
        "F_B": 15 * ones,
        "u_A": ones,
        "u_B": -ones,
    }


def test_a_hit_has_a_peak_a_speed_and_an_impulse_that_includes_all_bounces() -> None:
    soft, stiff = find_hits(columns_impact((8.0, 0.3, 4.0), (12.0, 0.3, 5.0)))
    assert (soft.window, stiff.window) == (slice(500, 750), slice(1500, 1750))
    assert (soft.S_ref, stiff.S_ref, soft.contact_s) == (8.0, 12.0, 0.2)
    assert soft.peak_N == pytest.approx(4.0, rel=1e-3)
    assert soft.impulse_Ns == pytest.approx(1.5 * 4.0 * 0.1 * 2.0 / np.pi, rel=1e-3)
    assert soft.speed == pytest.approx(0.3)
    figures = compute_impact_metrics(columns_impact((8.0, 0.3, 4.0), (12.0, 0.3, 5.0)))
    assert (figures.soft_to_stiff_peak, figures.soft_to_stiff_impulse) == pytest.approx((0.8, 0.8))
    assert (figures.hits, figures.min_tension_N) == (2.0, 15.0)
    assert figures.impulse_Ns == pytest.approx(stiff.impulse_Ns)


@pytest.mark.parametrize(
    ("hits", "code", "values"),
    [
        (((8.0, 0.3, 4.0), (8.0, 0.3, 5.0)), "hits_of_equal_stiffness", {"S_ref": 8.0}),
        (
            ((8.0, 0.3, 4.0), (8.0, 0.4, 4.0), (15.0, 0.3, 5.0)),
            "unequal_numbers_of_hits",
            {"soft": 2, "stiff": 1},
        ),
        (
            ((8.0, 0.3, 4.0), (15.0, 0.4, 5.0)),
            "unequal_speeds_of_hits",
            {"soft": pytest.approx(0.3), "stiff": pytest.approx(0.4)},
        ),
    ],
)
def test_unlike_hits_are_not_compared_and_have_a_reason(
    hits: tuple[tuple[float, float, float], ...], code: str, values: dict[str, object]
) -> None:
    figures = compute_impact_metrics(columns_impact(*hits))
    assert figures.soft_to_stiff_peak is None
    assert_reason(figures.reasons["soft_to_stiff_peak"], code, **values)
    assert figures.reasons["soft_to_stiff_impulse"] == figures.reasons["soft_to_stiff_peak"]


def test_a_contact_at_the_start_of_the_record_has_no_speed_and_is_not_compared() -> None:
    early = {name: column[499:] for name, column in columns_impact((8.0, 0.3, 4.0), (15.0, 0.3, 5.0)).items()}
    assert np.isnan(find_hits(early)[0].speed)
    assert compute_impact_metrics(early).soft_to_stiff_peak is None


@pytest.mark.parametrize("force", [0.0, np.nan, None])
def test_impact_metrics_are_rejected_without_a_hit_or_an_obstacle_column(
    force: float | None,
) -> None:
    seen = columns_impact((8.0, 0.3, 4.0))
    if force is None:
        del seen["F_wall"]
    else:
        seen["F_wall"] = np.full_like(seen["t"], force)
    assert find_hits(seen) == ()
    with refused(NoSamplesError, "no_hit"):
        compute_impact_metrics(seen)
