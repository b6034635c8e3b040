"""Evaluation of runs: own criteria, and stored samples evaluated again."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.analysis.context import EvaluationContext
from backend.analysis.evaluation import (
    METRICS_BY_MEASURE,
    Evaluation,
    NotEvaluableError,
    collect_bound_values,
    evaluate_criteria,
    evaluate_experiment,
    list_metric_names,
    reevaluate_run,
    require_measurable,
)
from backend.analysis.step_metrics import NoSamplesError
from backend.banks.tuning_settings import TuningSettings
from backend.execution.runner import RunRequest, create_run, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan
from backend.experiments.parser import ExperimentError
from backend.experiments.plans import ActuatorIdentificationPlan, ExperimentPlan, LoopSettings, Plan
from backend.experiments.schema import Bound, Experiment, Measure
from backend.models.run import MeasuredFigure, Metrics
from backend.storage import results, runs
from backend.storage.database import open_database
from backend.storage.runs import EndState
from backend.tuning.gains import TuningParameters
from plant.parameters import SHIPPED, load_parameters, parse_parameters
from tests.experiments.composing.written import plan_of, with_parts
from tests.reasons import TextWith, assert_reason
from tests.refusals import refused

# Results of experiments: merged measures and criteria.

LAB = load_parameters("lab")
STEPS = "{do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 1.0}", "{do: step, q_ref: 0.2, duration_s: 1.0}"
PUSHES = "{do: push, F_push: 4.0, duration_s: 0.5}", "{do: hold, duration_s: 1.5}"


def plan(*parts: str, measures: tuple[Measure, ...], criteria: tuple[Bound, ...] = ()) -> ExperimentPlan:
    made = plan_of(with_parts(*parts))
    return replace(made, experiment=replace(made.experiment, measures=measures, criteria=criteria))


def columns(played: ExperimentPlan) -> dict[str, Any]:
    """Return samples at the references, except for a push that moves the joint by 0.05 rad."""
    segments = played.program().segments
    ticks = [round(one.duration_s * 1000) for one in segments]
    q_ref, S_ref, push = (
        np.repeat([getattr(one, name) for one in segments], ticks) for name in ("q_ref", "S_ref", "F_push")
    )
    ones = np.ones_like(q_ref)
    return {
        "t": np.arange(q_ref.size) / 1000.0, "q": q_ref + 0.05 * (push != 0.0), "q_ref": q_ref, "S": S_ref,
        "S_ref": S_ref, "F_A": 20.0 * ones, "F_B": 15.0 * ones, "u_A": -2.0 * ones, "u_B": ones,
        "theta_A": ones, "theta_A_ref": ones, "theta_B": ones, "theta_B_ref": ones,
        "limits": 0.0 * ones, "F_push": push,
        "F_wall": np.where(np.repeat([one.wall for one in segments], ticks) > 0, -3.0, 0.0),
    }  # fmt: skip


def outline(made: ExperimentPlan, played_s: float | None = None) -> Metrics:
    planned_s = made.program().duration_s
    played_s = planned_s if played_s is None else played_s
    return Metrics(
        complete=played_s >= planned_s, played_s=played_s, planned_s=planned_s, figures=(), phases=made.phases()
    )


def result(
    made: ExperimentPlan, missed: int = 0, played_s: float | None = None
) -> tuple[dict[str, MeasuredFigure], Any]:
    run_outline = outline(made, played_s)
    seen = {name: column[: round(run_outline.played_s * 1000)] for name, column in columns(made).items()}
    metrics, criteria = evaluate_experiment(seen, EvaluationContext(LAB, made, TuningSettings()), run_outline, missed)
    return {item.name: item for item in metrics.figures}, {item.name: item for item in criteria}


@pytest.mark.parametrize("measure", Measure)
def test_each_measure_yields_the_metrics_that_criteria_may_name(measure: Measure) -> None:
    parts = {
        Measure.LOADS: ("{do: load, load_A: 0.2, duration_s: 0.5}",),
        Measure.RESPONSE: ("{do: multisine, q_amplitude: 0.1, period_s: 1, lines: 3}",),
        Measure.BODE: ("{do: multisine, q_amplitude: 0.1, period_s: 1, lines: 3}",),
        Measure.HOLDS: ("{do: hold, duration_s: 1.5}",),
        Measure.STEPS: (),
        Measure.IMPACT: ("{do: wall, q_wall: 0.3}", "{do: hold, duration_s: 0.5}"),
    }
    figures, _ = result(plan(*STEPS, *parts.get(measure, PUSHES), measures=(measure,)))
    assert tuple(figures) == list_metric_names((measure,))


def test_several_measures_are_merged_and_a_metric_of_both_appears_once() -> None:
    both = (Measure.STEPS, Measure.DISTURBANCE)
    figures, _ = result(plan(*STEPS, *PUSHES, measures=both))
    assert tuple(figures) == list_metric_names(both)
    assert figures["push_deviation_q"].value == pytest.approx(0.05)
    assert figures["min_tension_N"].value == 15.0
    assert len(list_metric_names(both)) < len(list_metric_names(both[:1])) + len(list_metric_names(both[1:]))


def test_a_failed_measure_has_a_reason_and_does_not_affect_others() -> None:
    figures, criteria = result(
        plan(
            *STEPS,
            measures=(Measure.DISTURBANCE, Measure.STEPS),
            criteria=(Bound(figure="push_back_s", below=1.0), Bound(figure="min_tension_N", above=4.0)),
        )
    )
    assert figures["push_back_s"].value is None
    assert_reason(figures["push_back_s"].reason, "no_push")
    assert figures["min_tension_N"].value == 15.0
    assert criteria["push_back_s"].passed is None
    assert_reason(criteria["push_back_s"].reason, "no_push")
    assert criteria["min_tension_N"].passed is True


@pytest.mark.parametrize("measure", [measure for measure in Measure if measure is not Measure.STEPS])
def test_a_run_without_any_measurement_has_no_result(measure: Measure) -> None:
    with pytest.raises(NoSamplesError):
        result(plan(*STEPS, measures=(measure,)))


def test_an_incomplete_run_passes_no_criterion_and_failed_criteria_stay_failed() -> None:
    bounds = (Bound(figure="min_tension_N", above=4.0), Bound(figure="peak_voltage_V", below=1.5))
    made = plan(*STEPS, measures=(Measure.STEPS,), criteria=bounds)
    early: dict[str, object] = {"played_s": 1.5, "planned_s": 2.0}
    for missed, played_s, code, values in (
        (12, 2.0, "samples_missing", {"missed": 12}),
        (0, 1.5, "run_ended_early", early),
    ):
        _, criteria = result(made, missed, played_s)
        assert criteria["min_tension_N"].passed is None
        assert_reason(criteria["min_tension_N"].reason, code, **values)
        assert criteria["peak_voltage_V"].passed is False
    _, whole = result(made)
    assert [item.passed for item in whole.values()] == [True, False]


FIGURE = MeasuredFigure("min_tension_N", "N", "Smallest tension", "of both", 5.0)


def judged(
    bound: Bound, figure: MeasuredFigure = FIGURE, parameters: str = "lab", lambdas: TuningParameters | None = None
) -> Any:
    made = plan(*STEPS, measures=(Measure.STEPS,), criteria=(bound,))
    known = collect_bound_values({"depth": 0.5}, load_parameters(parameters), lambdas or TuningParameters())
    (criterion,) = evaluate_criteria(made.experiment, [figure], known)
    return criterion


@pytest.mark.parametrize(
    ("bound", "relation", "limit", "passed"),
    [
        ({"above": 4.0}, ">", 4.0, True),
        ({"above": 5.0}, ">", 5.0, False),
        ({"below": 5.0}, "<", 5.0, False),
        ({"below": "5 + depth"}, "<", 5.5, True),
        ({"below": "u_max"}, "<", LAB.motor.u_max, True),
        ({"above": "F_max"}, ">", LAB.safety.F_max, False),
        ({"below": "100 * r_j + 1e4 * r_m"}, "<", 100.0 * LAB.geometry.r_j + 1e4 * LAB.geometry.r_m, True),
        ({"below": "10 * (lam_q + lam_S + lam_motor)"}, "<", 10.0 * (0.7 + 0.9 + 0.05), True),
        ({"below": 0.0}, "<", 0.0, False),
    ],
)
def test_a_bound_may_use_settings_plant_and_tuning(
    bound: dict[str, Any], relation: str, limit: float, passed: bool
) -> None:
    lambdas = TuningParameters(lam_q=0.7, lam_S=0.9, lam_motor=0.05)
    criterion = judged(Bound(figure="min_tension_N", **bound), lambdas=lambdas)
    assert (criterion.relation, criterion.bound, criterion.passed) == (relation, pytest.approx(limit), passed)


def test_a_bound_may_differ_on_the_ideal_plant() -> None:
    bound = Bound(figure="min_tension_N", above="5.5 if ideal else 4.5")
    assert (judged(bound, parameters="ideal").passed, judged(bound, parameters="lab").passed) == (False, True)


def test_a_criterion_has_its_own_name_or_that_of_its_metric() -> None:
    plain, named = (
        judged(Bound(figure="min_tension_N", above=4.0, **words)) for words in ({}, {"name": "taut", "title": "Taut"})
    )
    assert (plain.name, plain.title, plain.unit) == ("min_tension_N", "Smallest tension", "N")
    assert (named.name, named.title, named.unit) == ("taut", "Taut", "N")


def test_a_criterion_with_an_unevaluable_bound_does_not_pass() -> None:
    criterion = judged(Bound(figure="min_tension_N", above="1 / (depth - 0.5)"))
    assert criterion.passed is None
    assert_reason(criterion.reason, "bound_not_evaluated")


def test_the_criterion_of_an_unmeasured_metric_has_the_reason_of_the_metric() -> None:
    lacking = replace(FIGURE, value=None, reason="it never settled")
    criterion = judged(Bound(figure="min_tension_N", above=4.0), lacking)
    assert (criterion.passed, criterion.figure, criterion.reason) == (None, None, "it never settled")


@pytest.mark.parametrize(
    ("bound", "code", "values", "line"),
    [
        (
            {"figure": "rmse_q", "below": "u_least"},
            "unknown_name",
            {"name": "u_least", "known": TextWith("^depth, u_max,")},
            30,
        ),
        (
            {"figure": "rmse_q", "below": "__import__('os')"},
            "unsupported_operation",
            {"operation": "__import__('os')"},
            30,
        ),
        (
            {"figure": "back_s", "below": 1.0},
            "metric_not_measured",
            {"metric": "back_s", "measures": "steps"},
            31,
        ),
        ({"figure": "rmse_q"}, "not_exactly_one_bound", {}, 30),
        ({"figure": "rmse_q", "below": 1.0, "above": 0.0}, "not_exactly_one_bound", {}, 30),
    ],
)
def test_an_unmeasurable_criterion_is_rejected(
    bound: dict[str, Any], code: str, values: dict[str, object], line: int
) -> None:
    made: Experiment = plan(*STEPS, measures=(Measure.STEPS,), criteria=(Bound(**bound),)).experiment
    with pytest.raises(ExperimentError) as refused:
        require_measurable(made, {"depth": 0.5}, {(): 1, ("criteria", 0): 30, ("criteria", 0, "figure"): 31})
    assert isinstance(refused.value.why, str)
    assert_reason(refused.value.why, code, **values)
    assert refused.value.why in refused.value.message
    assert refused.value.line == line


def test_every_measure_has_metrics() -> None:
    assert set(METRICS_BY_MEASURE) == set(Measure)
    assert all(list_metric_names((measure,)) for measure in Measure)


# Stored runs evaluated again from their stored data.

SETTINGS = LoopSettings(seed=3)


@pytest.mark.parametrize(
    "plan",
    [
        build_ready_plan("tracking", q_duration_s=0.6, S_duration_s=0.5),
        ActuatorIdentificationPlan(tension_N=20.0, bits=6),
    ],
)
def test_a_second_evaluation_is_equal_and_stored_in_addition(tmp_path: Path, plan: Plan) -> None:
    database = open_database(tmp_path)
    with open_headless_rig(database, load_parameters("ideal"), SETTINGS) as station:
        outcome = asyncio.run(run_experiment(station, RunRequest(plan, SETTINGS, "Ana")))
    first = outcome.evaluation
    again = reevaluate_run(database, outcome.run.id)
    assert first.result is not None
    assert again.result is not None
    assert again.result.id == first.result.id + 1
    assert again.result.metrics == first.result.metrics
    assert again.result.criteria == first.result.criteria
    assert (again.identification is None) == (first.identification is None)
    if first.identification is not None and again.identification is not None:
        assert again.identification.model == first.identification.model
    database.close()


def test_a_failed_evaluation_is_stored_with_the_run_until_one_succeeds(tmp_path: Path) -> None:
    database = open_database(tmp_path)

    async def compute(*_: object) -> Evaluation:
        raise MemoryError("no more of it")

    with open_headless_rig(database, load_parameters("ideal"), SETTINGS) as station:
        object.__setattr__(station, "compute", compute)
        plan = build_ready_plan("tracking", q_duration_s=0.6, S_duration_s=0.5)
        outcome = asyncio.run(run_experiment(station, RunRequest(plan, SETTINGS, "Ana")))
        running = create_run(station, RunRequest(plan, SETTINGS, "Ana"))
    assert (outcome.run.end_state, outcome.evaluation.result) == (EndState.COMPLETED, None)
    with database.reading() as session:
        assert runs.get(session, outcome.run.id).evaluation_problem == "MemoryError: no more of it"
        assert results.present(session, [outcome.run.id]) == set()
    reevaluate_run(database, outcome.run.id)
    with database.reading() as session:
        assert runs.get(session, outcome.run.id).evaluation_problem == ""
        assert results.present(session, [outcome.run.id, running.id]) == {outcome.run.id}
    with refused(NotEvaluableError, "run_not_ended", run=running.id):
        reevaluate_run(database, running.id)
    database.close()


@pytest.mark.parametrize("name", SHIPPED)
def test_parameters_are_unchanged_after_storage_as_a_document(name: str) -> None:
    parameters = load_parameters(name)
    assert parse_parameters(name, json.loads(json.dumps(parameters.to_document()))) == parameters
