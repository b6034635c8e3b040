"""Stored runs evaluated again from their stored data."""

import asyncio
import json
from pathlib import Path

import pytest

from backend.analysis.evaluation import Evaluation, NotEvaluableError, reevaluate_run
from backend.execution.runner import RunRequest, create_run, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import ActuatorIdentificationPlan, LoopSettings, Plan
from backend.storage import results, runs
from backend.storage.database import open_database
from backend.storage.runs import EndState
from plant.parameters import SHIPPED, load_parameters, parse_parameters

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
    with pytest.raises(NotEvaluableError, match="not over yet"):
        reevaluate_run(database, running.id)
    database.close()


@pytest.mark.parametrize("name", SHIPPED)
def test_parameters_come_back_from_their_stored_document(name: str) -> None:
    parameters = load_parameters(name)
    assert parse_parameters(name, json.loads(json.dumps(parameters.to_document()))) == parameters
