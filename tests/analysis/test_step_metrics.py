"""Metrics of steps, and the windows of the samples that they use."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from backend.analysis.disturbance_metrics import compute_disturbance_metrics
from backend.analysis.evaluation import collect_bound_values
from backend.analysis.step_metrics import (
    NoSamplesError,
    ReferenceStep,
    compute_step_metrics,
    compute_tracking_metrics,
    find_pushes,
    find_undisturbed_end,
    list_load_steps,
    list_reference_steps,
)
from backend.execution.simulation import SimulatedRun, simulate_in_memory
from backend.experiments.library import build_ready_plan, find_experiment
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.models.run import LAMBDA, MOTIONS, TIME_OPTIMAL, Phase, StepFigures
from backend.realtime.program import Law, Program, Segment, Shape
from backend.tuning.gains import TuningParameters
from plant.parameters import load_parameters
from tests.experiments.composing.written import plan_of, with_parts
from tests.experiments.judging import tracking_criteria
from tests.reasons import assert_reason
from tests.refusals import refused

# Metrics against closed forms of step responses.

T_s = 1e-3
Array = NDArray[np.float64]


def double_lag(t: Array, lam: float) -> Array:
    """Step response of 1/(lam s + 1)^2."""
    return np.where(t > 0, 1 - (1 + t / lam) * np.exp(-t / lam), 0.0)


def second_order(t: Array, zeta: float, omega: float) -> Array:
    """Step response of omega²/(s² + 2 zeta omega s + omega²), zeta < 1."""
    damped = omega * math.sqrt(1 - zeta**2)
    return 1 - np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t))


def step(before: float = 0.0, after: float = 1.0, end_s: float = 8.0) -> ReferenceStep:
    return ReferenceStep("q", "position", 0.0, end_s, before, after, alone=True)


@pytest.mark.parametrize("lam", [0.25, 0.5, 0.9])
@pytest.mark.parametrize(("before", "after"), [(0.0, 1.0), (1.0, -1.0), (14.0, 8.0)])
def test_rise_and_settling_times_of_a_double_lag_are_exact(lam: float, before: float, after: float) -> None:
    t = np.arange(0, 8, T_s)
    result = compute_step_metrics(t, before + (after - before) * double_lag(t, lam), step(before, after))

    def remaining(x: float) -> float:
        return (1 + x) * math.exp(-x)

    x_10, x_90, x_98 = (brentq(lambda x, r=r: remaining(x) - r, 1e-9, 50) for r in (0.9, 0.1, 0.02))
    assert result.rise_s == pytest.approx(lam * (x_90 - x_10), abs=1e-5)
    assert result.settling_s == pytest.approx(lam * x_98, abs=T_s)
    assert result.overshoot_percent == pytest.approx(0.0, abs=1e-9)
    assert result.steady_error == pytest.approx(0.0, abs=abs(after - before) * remaining(7.5 / lam))


@pytest.mark.parametrize("zeta", [0.3, 0.5, 0.7])
def test_the_overshoot_of_a_second_order_system_is_exact(zeta: float) -> None:
    t = np.arange(0, 8, T_s)
    result = compute_step_metrics(t, -2 * second_order(t, zeta, 6.0), step(0.0, -2.0))
    assert result.overshoot_percent == pytest.approx(100 * math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), abs=1e-3)


def test_settling_is_the_last_exit_not_the_first_entry() -> None:
    t = np.arange(0, 8, T_s)
    response = second_order(t, 0.3, 6.0)
    result = compute_step_metrics(t, response, step())
    assert result.settling_s is not None
    after = t > result.settling_s
    assert np.all(np.abs(response[after] - 1) <= 0.02)
    assert abs(response[np.searchsorted(t, result.settling_s) - 1] - 1) > 0.02
    assert result.settling_s > float(t[np.flatnonzero(response > 0.98)[0]]) + 0.5


COUNT = 2 * math.pi / 4000
LAST_BIT = pytest.mark.parametrize("last_bit", [-1, 0, 1])


def counted(first: int, last: int, last_bit: int) -> tuple[Array, Array]:
    """Return times and readings of an encoder that moves one count per millisecond from first to last, then rests."""
    counts = np.arange(first, last + (1 if last > first else -1), 1 if last > first else -1)
    y = np.append(counts, np.full(500, last)) * COUNT * (1 + last_bit * np.finfo(float).eps)
    return np.arange(y.size, dtype=float) * T_s, y


@LAST_BIT
@pytest.mark.parametrize("side", [1, -1])
def test_a_joint_at_rest_at_90_percent_has_reached_90_percent(side: int, last_bit: int) -> None:
    """90 % of π/3 is 600 counts; the encoder changes to 600 when the joint passes 599.5."""
    t, y = counted(0, 600 * side, last_bit)
    result = compute_step_metrics(t, y, step(0.0, side * math.pi / 3), count=COUNT)
    assert result.reach_s == pytest.approx(0.5995, abs=1e-9)
    assert result.rise_s == pytest.approx(0.5995 - (math.pi / 30 / COUNT - 0.5) * T_s, abs=1e-9)


@LAST_BIT
@pytest.mark.parametrize(("before", "last", "settled"), [(0.0, 680, 0.653), (-math.pi / 3, 640, 1.307)])
def test_a_joint_at_rest_on_the_edge_of_the_band_has_settled(
    before: float, last: int, settled: float, last_bit: int
) -> None:
    """±2 % of π/3 end at 680 counts, ±2 % of 2π/3 at 640."""
    t, y = counted(round(before / COUNT), last, last_bit)
    assert compute_step_metrics(t, y, step(before, math.pi / 3), count=COUNT).settling_s == pytest.approx(
        settled, abs=1e-9
    )


def test_a_step_is_missed_by_more_than_half_a_count() -> None:
    t, y = counted(0, 599, 0)
    assert compute_step_metrics(t, y, step(0.0, math.pi / 3), count=COUNT).reach_s is None
    t, y = counted(0, 681, 0)
    assert compute_step_metrics(t, y, step(0.0, math.pi / 3), count=COUNT).settling_s is None


def test_a_step_without_rise_or_settling_has_no_times() -> None:
    t = np.arange(0, 1, T_s)
    result = compute_step_metrics(t, double_lag(t, 1.0), step(end_s=1.0))
    assert result.rise_s is None
    assert result.settling_s is None


def tracked(
    plan: ExperimentPlan, *, lam_q: float = 0.5, lam_S: float = 0.42, coupling: float = 0.0
) -> dict[str, Array]:
    """Samples of a loop that is exactly 1/(λs+1)² in both signals, plus a deviation of S proportional to dq/dt."""
    program = plan.program()
    t = np.arange(round(program.duration_s / T_s), dtype=float) * T_s
    columns = {"t": t, "F_A": np.full_like(t, 20.0), "F_B": np.full_like(t, 21.0)}
    columns |= {"u_A": np.full_like(t, -3.0), "u_B": np.full_like(t, 2.0)}
    for name, lam in (("q", lam_q), ("S", lam_S)):
        old = {"q": 0.0, "S": 10.0}[name]
        start, y, y_ref = 0.0, np.full_like(t, old), np.empty_like(t)
        for segment in program.segments:
            new = getattr(segment, f"{name}_ref")
            y_ref[t >= start - 1e-9] = new
            y += (new - old) * double_lag(t - start, lam)
            start, old = start + segment.duration_s, new
        columns |= {name: y, f"{name}_ref": y_ref}
    columns["S"] = columns["S"] + coupling * np.gradient(columns["q"], T_s)
    return columns


def test_the_steps_of_a_tracking_run_follow_the_references() -> None:
    plan = build_ready_plan("tracking")
    steps = list_reference_steps(plan.program(), plan.phases())
    assert [(s.signal, s.alone) for s in steps if s.phase == "position"] == [("q", True)] * 4
    assert [(s.signal, s.alone) for s in steps if s.phase == "stiffness"] == [("S", True)] * 5
    assert {s.signal for s in steps if s.phase == "both"} == {"q", "S"}
    assert not any(s.alone for s in steps if s.phase == "both")
    assert steps[0].start_s == 8.0
    assert steps[0].before == 0.0
    assert steps[0].after == math.pi / 3


def test_ramps_and_sines_are_not_steps() -> None:
    segments = (
        Segment(1.0, 0.0, 10.0),
        Segment(1.0, 0.5, 10.0, shape=Shape.RAMP),
        Segment(1.0, 0.8, 10.0, shape=Shape.SINE),
        Segment(1.0, 0.2, 10.0),
        Segment(1.0, 0.2, 12.0),
    )
    steps = list_reference_steps(Program(Law.CASCADE, segments), [Phase("all", "All", 0.0, 5.0)])
    assert [(s.signal, s.start_s) for s in steps] == [("S", 4.0)]


def test_tracking_metrics_of_a_known_loop() -> None:
    plan = build_ready_plan("tracking")
    coupling = 0.02
    columns = tracked(plan, coupling=coupling)
    metrics = compute_tracking_metrics(columns, plan.program(), plan.phases(), lambda turn: 0.1 * turn)
    assert metrics.complete
    assert len(metrics.steps) == 17
    # largest slope of 1/(λs+1)² is 1/(λe), on the largest step of q that moves alone
    assert metrics.overall.deviation_S == pytest.approx(coupling * (2 * math.pi / 3) / (0.5 * math.e), rel=0.01)
    assert metrics.overall.deviation_q == pytest.approx(0.0, abs=1e-4)
    assert (metrics.overall.min_tension_N, metrics.overall.max_tension_N) == (20.0, 21.0)
    assert metrics.overall.peak_voltage_V == 3.0
    # 1 − (1 + x) exp(−x) = 0.9 at x = 3.8897; the largest step turns by 2π/3
    assert metrics.overall.reach_q_s == pytest.approx(0.5 * 3.8897, abs=0.002)
    assert metrics.overall.reach_bound_q_s == pytest.approx(0.1 * 2 * math.pi / 3)
    assert metrics.overall.reach_ratio_q == pytest.approx(0.5 * 3.8897 / (0.1 * 2 * math.pi / 3), rel=0.002)
    assert metrics.overall.settling_q_s == pytest.approx(0.5 * 5.834, abs=0.002)
    expected = math.sqrt(np.mean((columns["q"] - columns["q_ref"]) ** 2))
    assert metrics.overall.rmse_q == pytest.approx(expected)


def test_the_time_to_90_percent_uses_only_the_largest_steps_of_q_alone() -> None:
    """Slower steps of q together with S are excluded, as the definition states."""
    plan = build_ready_plan("tracking")
    columns = tracked(plan)
    both = next(phase for phase in plan.phases() if phase.name == "both").start_s
    slow = tracked(plan, lam_q=0.9)
    columns["q"] = np.where(columns["t"] < both, columns["q"], slow["q"])
    metrics = compute_tracking_metrics(columns, plan.program(), plan.phases())
    alone = [item for item in metrics.steps if item.step.signal == "q" and item.step.alone]
    largest = max(abs(item.step.after - item.step.before) for item in alone)
    times = [item.reach_s for item in alone if abs(item.step.after - item.step.before) > 0.999 * largest]
    assert metrics.overall.reach_q_s == pytest.approx(0.5 * 3.8897, abs=0.002)
    assert metrics.overall.reach_q_s == max(time_s for time_s in times if time_s is not None)
    assert max(item.reach_s or 0.0 for item in metrics.steps if item.step.signal == "q") > 0.9 * 3.88
    declared = type(metrics.overall).__dataclass_fields__["reach_q_s"].metadata
    assert "at constant S_ref" in declared["definition"]


def test_the_voltage_at_rest_excludes_motion() -> None:
    """The voltage is a 50 Hz sine around the holding voltage, evaluated from 1 s after settling."""
    plan = build_ready_plan("tracking")
    columns = tracked(plan)
    t = columns["t"]
    columns["u_A"] = 0.6 + 0.2 * np.sin(2 * math.pi * 50 * t)
    columns["u_B"] = -0.8 + 0.3 * np.sin(2 * math.pi * 50 * t)
    for start_s in {step.start_s for step in list_reference_steps(plan.program(), plan.phases())}:
        columns["u_B"][(t >= start_s) & (t < start_s + 2.0)] = 9.0
    found = compute_tracking_metrics(columns, plan.program(), plan.phases())
    assert found.overall.u_rest_rms_V == pytest.approx(0.3 / math.sqrt(2), rel=1e-3)
    assert "u_rest_rms_V" not in found.reasons


def test_the_voltage_at_rest_is_not_measured_without_rest() -> None:
    plan = build_ready_plan(
        "tracking", q_duration_s=4.0, S_duration_s=4.0
    )  # settled after 2.9 s: less than 1 s + 1 s left
    found = compute_tracking_metrics(tracked(plan), plan.program(), plan.phases())
    assert found.overall.settling_q_s == pytest.approx(0.5 * 5.834, abs=0.002)
    assert found.overall.u_rest_rms_V is None
    assert_reason(found.reasons["u_rest_rms_V"], "no_rest_after_step", rest_s=1.0)


def test_a_stopped_run_is_incomplete_and_has_its_finished_steps() -> None:
    plan = build_ready_plan("tracking")
    columns = {name: column[:20_500] for name, column in tracked(plan).items()}
    metrics = compute_tracking_metrics(columns, plan.program(), plan.phases())
    assert not metrics.complete
    assert metrics.played_s == pytest.approx(20.5)
    assert [item.step.end_s for item in metrics.steps] == [16.0]
    verdicts = {item.name: item.passed for item in tracking_criteria(metrics, "ideal")}
    assert verdicts == {"overshoot_q": None, "overshoot_S": None, "deviation_S": None, "min_tension": None}
    with pytest.raises(NoSamplesError):
        compute_tracking_metrics({name: column[:0] for name, column in columns.items()}, plan.program(), plan.phases())


def test_each_criterion_compares_its_metric_with_its_own_bound() -> None:
    plan = build_ready_plan("tracking")
    columns = tracked(plan, coupling=0.1)  # deviates by about 0.15 N·m/rad: too much for ideal, fine for lab
    columns["F_A"] = columns["F_A"].copy()
    columns["F_A"][40_000] = 4.5
    metrics = compute_tracking_metrics(columns, plan.program(), plan.phases())
    ideal = {item.name: item.passed for item in tracking_criteria(metrics, "ideal")}
    lab = {item.name: item.passed for item in tracking_criteria(metrics, "lab")}
    assert (ideal["deviation_S"], ideal["min_tension"], ideal["overshoot_q"]) == (False, False, True)
    assert (lab["deviation_S"], lab["min_tension"], lab["overshoot_q"]) == (True, True, True)
    ours = replace(load_parameters("lab"), name="our_rig")
    assert (
        collect_bound_values({}, ours, TuningParameters())["ideal"] is False
    )  # other parameter files are evaluated like lab


# Sample ranges of pushes and loads in programs, and the deviations in them.

HELD = Segment(1.0, 0.0, 10.0)
PUSHED = Program(
    Law.CASCADE,
    (
        HELD,
        Segment(0.5, 0.0, 10.0, F_push=5.0),
        Segment(0.5, 0.0, 10.0, F_push=3.0),
        HELD,
        HELD,
        Segment(0.2, 0.0, 10.0, F_push=-5.0),
        HELD,
        Segment(1.0, 0.1, 10.0),
    ),
)


def test_consecutive_push_segments_form_one_push() -> None:
    assert find_pushes(PUSHED) == (slice(1000, 2000), slice(4000, 4200))


def test_the_undisturbed_interval_ends_at_the_next_push_or_reference() -> None:
    assert find_undisturbed_end(PUSHED, 2000) == 4000
    assert find_undisturbed_end(PUSHED, 4200) == 5200


def test_a_reference_step_at_the_end_of_a_push_ends_the_undisturbed_interval() -> None:
    pushed = Segment(0.5, 0.0, 10.0, F_push=5.0)
    program = Program(Law.CASCADE, (HELD, pushed, Segment(2.0, 0.3, 10.0)))
    assert find_undisturbed_end(program, 1500) == 1500


def test_load_steps_are_listed_for_each_side() -> None:
    program = Program(
        Law.CASCADE,
        (HELD, Segment(0.5, 0.0, 10.0, load_A=0.2), HELD, Segment(0.4, 0.0, 10.0, load_A=0.1, load_B=0.3), HELD),
    )
    assert [(step.side, step.window, step.on) for step in list_load_steps(program)] == [
        ("A", slice(1000, 1500), True),
        ("A", slice(1500, 2500), False),
        ("A", slice(2500, 2900), True),
        ("B", slice(2500, 2900), True),
        ("A", slice(2900, 3900), False),
        ("B", slice(2900, 3900), False),
    ]
    assert list_load_steps(PUSHED) == ()


def columns(off_q: np.ndarray) -> dict[str, np.ndarray]:
    ones = np.ones_like(off_q)
    return {
        "q": off_q,
        "q_ref": 0.0 * ones,
        "S": 10.02 * ones,
        "S_ref": 10.0 * ones,
        "F_A": 20.0 * ones,
        "F_B": 15.0 * ones,
        "u_A": -2.0 * ones,
        "u_B": ones,
    }


def test_a_push_is_measured_until_the_joint_has_recovered() -> None:
    off = np.zeros(6200)
    off[1000:2000] = 0.06
    off[2000:2300] = -0.03  # overshoot in the other direction
    off[4000:4200] = -0.08
    off[4200:4350] = -0.02
    figures = compute_disturbance_metrics(columns(off), PUSHED)
    assert figures.push_deviation_q == 0.08
    assert figures.push_deviation_S == pytest.approx(0.02)
    assert figures.push_back_s == pytest.approx(0.3)
    assert (figures.min_tension_N, figures.max_tension_N, figures.peak_voltage_V) == (15.0, 20.0, 2.0)


def test_the_recovery_of_an_unrecovered_joint_or_a_nan_signal_is_not_measured() -> None:
    for wrong in (0.03, np.nan):
        off = np.zeros(6200)
        off[2000:4000] = wrong
        figures = compute_disturbance_metrics(columns(off), PUSHED)
        assert figures.push_back_s is None
        assert_reason(figures.reasons["push_back_s"], "not_back_after_push", end_s=pytest.approx(2.0))


def test_a_run_that_ended_before_the_last_push_has_no_disturbance_metrics() -> None:
    with refused(NoSamplesError, "pushes_not_completed"):
        compute_disturbance_metrics(columns(np.zeros(4100)), PUSHED)
    with refused(NoSamplesError, "no_push"):
        compute_disturbance_metrics(columns(np.zeros(4100)), Program(Law.CASCADE, (HELD,)))


# λ determines the step time in lambda motion (3.89 λ to 90 %), but not in time-optimal motion.

TO_90_PERCENT = 3.89
"""Of 1 − (1 + t/λ) exp(−t/λ) = 0.9, in λ."""

SMALL_STEPS = (
    "{do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 6.0}",
    "{do: step, q_ref: 0.1, duration_s: 6.0}",
    "{do: step, q_ref: 0.0, duration_s: 6.0}",
    "{do: tuning, lam_q: 1.0, lam_S: 1.0}",
    "{do: step, q_ref: 0.1, duration_s: 10.0}",
    "{do: step, q_ref: 0.0, duration_s: 10.0}",
)


def play(name: str, plan: object, settings: LoopSettings) -> SimulatedRun:
    assert isinstance(plan, ExperimentPlan)
    played = simulate_in_memory(load_parameters(name), plan, settings, lambda _: pytest.fail("no bank is used"))
    assert played.end_state == "completed"
    return played


def list_reference_steps_lambda(played: SimulatedRun) -> tuple[StepFigures, ...]:
    assert played.metrics.steps is not None
    return played.metrics.steps


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_doubling_lambda_doubles_the_duration_of_a_small_step(name: str) -> None:
    """Step 4 of the README tutorial: t90 doubles within 10 % away from all limits."""
    played = play(name, plan_of(with_parts(*SMALL_STEPS)), LoopSettings(lam_q=0.5, lam_S=0.5))
    up_fast, down_fast, up_slow, down_slow = (step.reach_s for step in list_reference_steps_lambda(played)[-4:])
    for fast, slow in ((up_fast, up_slow), (down_fast, down_slow)):
        assert fast is not None
        assert slow is not None
        assert slow / fast == pytest.approx(2.0, rel=0.1)
        assert fast == pytest.approx(TO_90_PERCENT * 0.5, rel=0.06)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_the_step_times_of_a_lambda_sweep_are_proportional_to_lambda(name: str) -> None:
    """The active motion has no effect, because the experiment sets its own."""
    plan = find_experiment("lambda_sweep").make_plan({})
    assert isinstance(plan, ExperimentPlan)
    played = play(name, plan, LoopSettings(motion=TIME_OPTIMAL))
    lambdas = [float(change["lam_q"]) for change in plan.compiled.changes]
    assert lambdas == pytest.approx([0.9, (0.9 * 0.5) ** 0.5, 0.5])
    reach = [step.reach_s for step in list_reference_steps_lambda(played)][-4 * len(lambdas) :]
    for first, lam in zip(range(0, len(reach), 4), lambdas, strict=True):
        for kind in range(4):  # up and down, of q and of S
            slowest, this = reach[kind], reach[first + kind]
            assert slowest is not None
            assert this is not None
            assert slowest / this == pytest.approx(lambdas[0] / lam, rel=0.1)


def test_the_motions_are_compared_on_the_same_steps() -> None:
    plan = find_experiment("motion_comparison").make_plan({})
    played = play("ideal", plan, LoopSettings())
    assert not [item.name for item in played.criteria if item.passed is not True]
    by_phase = {
        name: [step.reach_s for step in list_reference_steps_lambda(played) if step.phase == name]
        for name in ("by_lambda", "time_optimal")
    }
    assert len(by_phase["by_lambda"]) == len(by_phase["time_optimal"]) == 8
    for slow, fast in zip(*by_phase.values(), strict=True):
        assert slow is not None
        assert fast is not None
        assert slow > 1.5 * fast


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_tracking_with_all_defaults_passes_in_both_motions(motion: str, name: str) -> None:
    played = play(name, find_experiment("tracking").make_plan({}), LoopSettings(motion=motion))
    figures = {item.name: item.value for item in played.metrics.figures}
    assert [item.passed for item in played.criteria] == [True] * len(played.criteria)
    if motion == LAMBDA or name != "ideal":
        return
    assert figures["overshoot_S_percent"] is not None
    assert figures["overshoot_S_percent"] <= 0.3
    assert figures["reach_q_s"] is not None
    assert figures["reach_q_s"] <= 1.01
