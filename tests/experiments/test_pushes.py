"""Measured and predicted deviations of pushes, on the simulator and for known signals."""

from typing import Any

import numpy as np
import pytest

from backend.analysis.context import EvaluationContext
from backend.analysis.disturbance_metrics import compute_push_metrics, find_push_windows, measure_pushes
from backend.analysis.step_metrics import NoSamplesError
from backend.banks.tuning_settings import TuningSettings
from backend.execution.simulation import simulate_in_memory
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.models.run import MOTIONS, TIME_OPTIMAL
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import INPUTS, OUTPUTS, make_sampled_loop
from plant.interface import T_s
from plant.parameters import load_parameters
from plant.quantity import Angle
from tests.experiments.composing.written import plan_of, with_parts

IDEAL = load_parameters("ideal")
R_J = IDEAL.geometry.r_j
HELD = "{do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 6.0}"
STEP = "{do: push, F_push: 6.0, duration_s: 1.0}"
REST = "{do: hold, duration_s: 5.0}"
RAMP = "{do: push, F_push: -8.0, duration_s: 0.5, shape: ramp}", "{do: push, F_push: 0.0, duration_s: 0.5, shape: ramp}"
IMPULSE = "{do: push, F_push: 10.0, duration_s: 0.01}"
PUSHED = with_parts(HELD, STEP, REST, *RAMP, REST, IMPULSE, REST, more="measures: [pushes]\n")


def of(plan: ExperimentPlan, tuning: TuningSettings | None = None) -> EvaluationContext:
    return EvaluationContext(IDEAL, plan, tuning or TuningSettings())


def columns(plan: ExperimentPlan, q: Any = 0.0) -> dict[str, Any]:
    """Samples as they are recorded: a push stands in the sample after the tick that it acted in."""
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
    assert [one.static for one in (step, ramp)] == pytest.approx([R_J * 6.0 / 10.0, R_J * 8.0 / 10.0])


def test_a_peak_is_compared_with_the_answer_of_the_loop_to_the_same_force() -> None:
    plan, lam_q = plan_of(PUSHED), 0.6
    seen = columns(plan)
    loop = make_sampled_loop(IDEAL, make_cascade_tuning(IDEAL, TuningParameters(lam_q=lam_q)), 10.0).closed
    w = np.zeros((seen["q"].size, len(INPUTS)))
    w[:-1, INPUTS.tau_ext] = R_J * seen["F_push"][1:]
    seen["q"] = 1.1 * loop.simulate(w)[:, OUTPUTS.q]
    step, ramp, impulse = measure_pushes(seen, plan.program(), of(plan, TuningSettings(lam_q=lam_q)))
    # the answers of earlier pushes have nearly died down
    assert [one.off_percent for one in (step, ramp, impulse)] == pytest.approx([10.0, 10.0, 10.0], abs=1.0)
    assert step.peak_q > 1.1 * step.static  # it swings beyond
    assert ramp.peak_q < 1.1 * ramp.static
    figures = compute_push_metrics(seen, plan.program(), of(plan, TuningSettings(lam_q=lam_q)))
    assert figures.pushed_off_percent == pytest.approx(10.0, abs=1.0)
    assert figures.pushed_peak_q == max(step.peak_q, impulse.peak_q)
    assert figures.pushed_static_ratio == step.peak_q / step.static


@pytest.mark.parametrize("motion", MOTIONS)
def test_on_the_ideal_plant_peaks_are_those_expected_in_both_motions(motion: str) -> None:
    played = simulate_in_memory(IDEAL, plan_of(PUSHED), LoopSettings(motion=motion), lambda _: pytest.fail("no bank"))
    assert (played.metrics.find_value("pushed_off_percent") or 100.0) < 2.0
    assert 1.0 < (played.metrics.find_value("pushed_static_ratio") or 0.0) < 2.0


@pytest.mark.parametrize("begun_with", [0.0, 0.8])
def test_pushes_that_are_rejected_are_expected_so_from_where_on_they_are(begun_with: float) -> None:
    """A computed run learns first; the program then changes k_ext on its way. The second push is as the first one."""
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


def test_without_the_joint_loop_a_held_push_turns_the_joint_by_the_static_deviation() -> None:
    text = with_parts(HELD, STEP, REST, more="measures: [pushes]\nlaw: compliance\n")
    played = simulate_in_memory(IDEAL, plan_of(text), LoopSettings(), lambda _: pytest.fail("no bank"))
    assert (played.metrics.find_value("pushed_off_percent") or 100.0) < 2.0
    plan = plan_of(text)
    (one,) = measure_pushes(columns(plan), plan.program(), of(plan))
    assert one.expected is not None
    assert one.expected[900] == pytest.approx(one.static, rel=0.01)


def test_how_soon_the_joint_is_back_and_why_that_is_not_known() -> None:
    plan = plan_of(PUSHED)
    seen = columns(plan)
    seen["q"][6500:7400] = 0.05
    figures = compute_push_metrics(seen, plan.program(), of(plan))
    assert figures.pushed_back_s == pytest.approx(0.4)
    seen["q"][13000:18000] = 0.05
    figures = compute_push_metrics(seen, plan.program(), of(plan))
    assert figures.pushed_back_s is None
    assert (
        f"after the push that ended at 13 s the joint was still {Angle(0.05)} off" in figures.reasons["pushed_back_s"]
    )
    tight = plan_of(with_parts(HELD, STEP))
    assert (
        "nothing was held after"
        in compute_push_metrics(columns(tight), tight.program(), of(tight)).reasons["pushed_back_s"]
    )


def test_a_push_without_prediction_is_measured_with_a_reason() -> None:
    law = "{name: by, kind: choice, symbol: law, meaning: law, default: single-loop, choices: [single-loop]}"
    chosen = f"settings:\n  - {law}\n"
    plan = plan_of(with_parts(HELD, STEP, REST, settings=chosen, more="law: by\nmeasures: [pushes]\n"))
    figures = compute_push_metrics(columns(plan), plan.program(), of(plan))
    assert figures.pushed_off_percent is None
    assert figures.reasons["pushed_off_percent"] == "of the law single-loop no prediction is made"
    assert figures.pushed_peak_q == 0.0


def test_a_run_that_ended_before_a_push_or_has_none_gives_nothing() -> None:
    plan = plan_of(PUSHED)
    early = {name: column[:6900] for name, column in columns(plan).items()}
    with pytest.raises(NoSamplesError, match="the run ended before the pushes were over"):
        compute_push_metrics(early, plan.program(), of(plan))
    still = plan_of(with_parts(HELD, REST))
    with pytest.raises(NoSamplesError, match="nothing pushes the joint"):
        compute_push_metrics(columns(still), still.program(), of(still))
    part = {name: column[:12500] for name, column in columns(plan).items()}
    assert len(measure_pushes(part, plan.program(), of(plan))) == 1
