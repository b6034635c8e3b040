"""λ determines the step time in lambda motion (3.89 λ to 90 %), but not in time-optimal motion."""

import pytest

from backend.execution.simulation import SimulatedRun, simulate_in_memory
from backend.experiments.library import find_experiment
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.models.run import LAMBDA, MOTIONS, TIME_OPTIMAL, StepFigures
from plant.parameters import load_parameters
from tests.experiments.composing.written import plan_of, with_parts

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


def list_reference_steps(played: SimulatedRun) -> tuple[StepFigures, ...]:
    assert played.metrics.steps is not None
    return played.metrics.steps


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_lambda_from_half_a_second_to_one_doubles_the_time_of_a_small_step(name: str) -> None:
    """README's five minutes, step 4: t90 doubles within 10 %, away from every limit."""
    played = play(name, plan_of(with_parts(*SMALL_STEPS)), LoopSettings(lam_q=0.5, lam_S=0.5))
    up_fast, down_fast, up_slow, down_slow = (step.reach_s for step in list_reference_steps(played)[-4:])
    for fast, slow in ((up_fast, up_slow), (down_fast, down_slow)):
        assert fast is not None
        assert slow is not None
        assert slow / fast == pytest.approx(2.0, rel=0.1)
        assert fast == pytest.approx(TO_90_PERCENT * 0.5, rel=0.06)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_the_lambda_sweep_has_times_in_the_ratio_of_its_lambdas(name: str) -> None:
    """Whatever motion is active: the experiment names its own."""
    plan = find_experiment("lambda_sweep").make_plan({})
    assert isinstance(plan, ExperimentPlan)
    played = play(name, plan, LoopSettings(motion=TIME_OPTIMAL))
    lambdas = [float(change["lam_q"]) for change in plan.compiled.changes]
    assert lambdas == pytest.approx([0.9, (0.9 * 0.5) ** 0.5, 0.5])
    reach = [step.reach_s for step in list_reference_steps(played)][-4 * len(lambdas) :]
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
        name: [step.reach_s for step in list_reference_steps(played) if step.phase == name]
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
