"""The interface against its own description: what fits the schema is answered as the schema says, never by a 5xx."""

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from backend.api.export import openapi
from tests.e2e.service import Service

LONG = ("startExperiment", "start_experiment", "start_identification")
SHUTS_OUT = ("rotate_tokens",)
"""What would shut out this client and all others that share the service."""

schema = schemathesis.openapi.from_dict(openapi()).exclude(operation_id=[*LONG, *SHUTS_OUT])


@schema.parametrize()
@settings(
    max_examples=3,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
def test_answers_are_as_described(case: schemathesis.Case, service: Service, operator: httpx.Client) -> None:
    headers = {"Authorization": operator.headers["Authorization"]}
    response = case.call(base_url=service.url, headers=headers, timeout=120.0)
    case.validate_response(
        response,
        checks=[
            not_a_server_error,
            status_code_conformance,
            content_type_conformance,
            response_schema_conformance,
        ],
    )


@pytest.mark.parametrize("name", ["State", "LiveMessage", "Refusal"])
def test_messages_are_described(name: str) -> None:
    assert name in openapi()["components"]["schemas"]
