"""Each operation of the interface with valid and invalid input, with either token: no server error."""

from typing import Any

import hypothesis
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from backend.api.export import build_openapi_schema
from backend.experiments.library import experiments_by_name
from tests.fuzz.conftest import EXAMPLES, SEED
from tests.fuzz.target import TIMEOUT_S, Role, Target

pytestmark = pytest.mark.timeout(3 * TIMEOUT_S)  # a requested dry run may use its complete time limit

CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
WITH_BOUNDS = 20
"""From so many examples on, also everything at and beyond the bounds of the schema: some thousand requests more."""

IN_RUN = {"set_references", "push", "start_experiment", "run_queue", "start_identification"}
"""Operations that only a loop in run takes up: it is brought there again and again."""
AGAIN = 25
DRY_RUN = "dry_run_experiment"
DRY_RUNS = 6
"""How many whole experiments to have played on a simulator for each kind of token: each takes seconds."""

MEMORY_EVERY = 1000
QUICK_S = 0.2
KEPT = 8
"""How many questions of each operation to ask again."""
TURNS = 2 if EXAMPLES < WITH_BOUNDS else 20
LEVEL_MB = 24.0
"""What the allocator may shift by itself. In the long run a request that leaves 2.4 kB behind goes beyond it."""

THERE = [1, 2, 3]
"""Rows that the furnished data folder has."""


def aimed(document: dict[str, Any]) -> dict[str, Any]:
    """Add existing names and numbers to the values that the schema allows, because random ones rarely exist."""

    def also(values: list[Any], described: dict[str, Any]) -> dict[str, Any]:
        return {"anyOf": [{"enum": values}, described]}

    for operations in document["paths"].values():
        for operation in operations.values():
            for parameter in operation.get("parameters", ()):
                if parameter["name"] == "id":
                    parameter["schema"] = also(THERE, parameter["schema"])
    experiment = document["components"]["schemas"]["ExperimentRequest"]["properties"]
    experiment["name"] = also(sorted(experiments_by_name()), experiment["name"])
    return document


Case = schemathesis.Case[Any]
schema = schemathesis.openapi.from_dict(aimed(build_openapi_schema()))
once_each = settings(
    max_examples=EXAMPLES,
    derandomize=False,
    phases=[Phase.explicit, Phase.generate] if EXAMPLES >= WITH_BOUNDS else [Phase.generate],
    suppress_health_check=list(HealthCheck),
)


@schema.parametrize()
@once_each
@hypothesis.seed(SEED)
def test_requests_of_an_operator_cause_no_server_error(case: Case, target: Target) -> None:
    send(case, target, "operator")


@schema.parametrize()
@once_each
@hypothesis.seed(SEED)
def test_requests_of_a_viewer_cause_no_server_error(case: Case, target: Target) -> None:
    send(case, target, "viewer")


def test_repeated_requests_do_not_increase_the_memory(target: Target) -> None:
    def repeat_requests() -> None:
        for asked in target.harmless:
            asked.headers.update(target.authorization("viewer"))
            assert target.sessions["viewer"].send(asked, timeout=TIMEOUT_S).status_code < 500

    repeat_requests()
    before = target.memory_MB()
    for _ in range(TURNS):
        repeat_requests()
    growth = target.memory_MB() - before
    count = TURNS * len(target.harmless)
    target.summary.append(f"memory: {growth:+.1f} MB from {before:.0f} MB by {count} questions asked again")
    assert growth < LEVEL_MB


def send(case: Case, target: Target, role: Role) -> None:
    name = str(case.operation.definition.raw["operationId"])
    if role == "operator" and name in IN_RUN and target.sent[name] % AGAIN == 0:
        target.be_in_run()
    if name == DRY_RUN and target.accepted[name, role] >= DRY_RUNS and names_an_experiment(case):
        return
    target.sent[name] += 1
    response = case.call(
        base_url=target.service.url,
        session=target.sessions[role],
        headers=target.authorization(role),
        timeout=TIMEOUT_S,
    )
    target.answers[role, response.status_code] += 1
    if case.method == "GET" and response.elapsed < QUICK_S and target.sent[name] <= KEPT:
        target.harmless.append(response.request)
    if sum(target.answers.values()) % MEMORY_EVERY == 0:
        target.note_memory()
    if response.status_code < 300:
        target.accepted[name, role] += 1
        if case.method != "GET":
            target.reset_activity()
    case.validate_response(response, checks=CHECKS)


def names_an_experiment(case: Case) -> bool:
    return isinstance(case.body, dict) and case.body.get("name") in experiments_by_name()
