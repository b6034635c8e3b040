"""The interface against its schema: valid requests get the answers of the schema, never a 5xx."""

from collections.abc import Iterator
from typing import Any

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
from tests.api.conftest import client_with
from tests.e2e.service import Service, running_service

LONG = ("startExperiment", "start_experiment", "start_identification")
SHUTS_OUT = ("rotate_tokens",)
"""Requests that would disconnect this client and all others of the service."""

DESCRIBED = build_openapi_schema()
schema = schemathesis.openapi.from_dict(DESCRIBED).exclude(operation_id=[*LONG, *SHUTS_OUT])


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service without other users, because the requests may activate a bank."""
    with running_service(tmp_path_factory.mktemp("contract"), params="ideal") as running:
        yield running


@schema.parametrize()
@settings(
    max_examples=3,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
def test_answers_match_the_schema(case: schemathesis.Case[Any], alone: Service) -> None:
    with client_with(alone, "token") as operator:
        headers = {"Authorization": operator.headers["Authorization"]}
    response = case.call(base_url=alone.url, headers=headers, timeout=120.0)
    case.validate_response(
        response,
        checks=[
            not_a_server_error,
            status_code_conformance,
            content_type_conformance,
            response_schema_conformance,
        ],
    )


@pytest.mark.parametrize("name", ["State", "LiveMessage", "ErrorResponse"])
def test_the_schema_describes_the_messages(name: str) -> None:
    assert name in DESCRIBED["components"]["schemas"]


def test_schema_names_are_unique() -> None:
    """Two schemas of one name would be named by their modules, which change."""
    assert [name for name in DESCRIBED["components"]["schemas"] if "__" in name] == []
