"""Statistics and spectra of ranges of a run, and chart sheets, through the interface."""

import io
import json
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import httpx
import numpy as np
import pytest
from pypdf import PdfReader

from backend.reports.messages import element_not_allowed, not_a_sheet
from backend.sample import STORED_NAMES
from backend.server import messages
from backend.server.security import MAX_BODY_BYTES, MAX_SHEET_BYTES, SHEETS
from backend.storage.database import open_database
from plant.interface import T_s
from tests.api.conftest import PATIENCE_S, client_with, problem
from tests.e2e.service import Service, running_service
from tests.recording.stored_run import store_run

# A sheet of charts for printing: signed-in people get a PDF; an invalid or too large sheet gets a message.

FOOT = "run 3 · SIM · λ_q 0.5 s"


def sheet(inside: str = "") -> dict[str, str]:
    root = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm" viewBox="0 0 900 450">'
    return {"svg": f'{root}<text x="16" y="430">{FOOT}</text>{inside}</svg>'}


def test_a_sheet_is_returned_as_a_pdf_attachment(viewer: httpx.Client) -> None:
    points = "".join(f"L{column % 900} {column % 430}" for column in range(MAX_BODY_BYTES // 7))
    body = sheet(f'<path d="M0 0{points}" fill="none" stroke="#0072B2"/>')
    assert len(body["svg"]) > MAX_BODY_BYTES  # larger than the limit of other bodies
    answer = viewer.post(SHEETS, json=body)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/pdf"
    assert answer.headers["content-disposition"] == 'attachment; filename="sinew-charts.pdf"'
    (page,) = PdfReader(io.BytesIO(answer.content)).pages
    assert FOOT in page.extract_text()


def test_an_invalid_sheet_is_rejected_with_a_message(operator: httpx.Client) -> None:
    answer = operator.post(SHEETS, json=sheet("<script>fetch('/api/stop')</script>"))
    assert answer.status_code == 422
    problem = answer.json()["error"]
    assert problem["code"] == "not_a_sheet"
    reason = element_not_allowed(element="script", allowed=[])
    assert problem["message"].startswith(not_a_sheet(reason=reason).partition(";")[0])


def test_a_sheet_that_is_too_large_is_rejected_before_it_is_read(operator: httpx.Client) -> None:
    answer = operator.post(SHEETS, content=b"x" * (MAX_SHEET_BYTES + 1))
    assert answer.status_code == 413
    assert answer.json()["error"]["message"] == messages.body_too_large(maximum_bytes=MAX_SHEET_BYTES)
    elsewhere = operator.put("/api/preferences", content=b"x" * (MAX_BODY_BYTES + 1))
    assert elsewhere.status_code == 413


def test_anonymous_clients_get_no_sheet(service: Service) -> None:
    assert httpx.post(f"{service.url}{SHEETS}", json=sheet()).status_code == 401


# Statistics of ranges of a run over HTTP: progress lines, refusals before them, an end on disconnect.

COUNT = 120_000
KINDS = ("statistics", "spectra", "range.csv")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[httpx.Client, int]]:
    data = tmp_path_factory.mktemp("figures")
    q = 0.4 * np.sin(np.arange(COUNT) * 1e-3)
    q[70_123] = 2.0
    with closing(open_database(data)) as database:
        run = store_run(database, {"q": q, "S": np.where(np.arange(COUNT) < 1000, np.nan, 8.0)})
    with running_service(data, params="ideal") as service, client_with(service, "viewer-token") as viewer:
        yield viewer, run


def lines(response: httpx.Response) -> list[dict[str, Any]]:
    assert response.headers["content-type"] == "application/x-ndjson"
    return [json.loads(line) for line in response.raise_for_status().iter_lines()]


def test_statistics_are_streamed_as_lines_and_the_last_is_the_result(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    *under_way, last = lines(client.get(f"/api/runs/{run}/statistics", params={"signals": "q,S"}))
    assert [line["result"] for line in under_way] == [None] * len(under_way)
    assert len(under_way) >= 2
    result = last["result"]
    assert (result["samples"], result["missing"], result["to_s"]) == (COUNT, 0, pytest.approx((COUNT - 1) * T_s))
    q, stiffness = result["signals"]["q"], result["signals"]["S"]
    assert (q["maximum"], q["maximum_s"], q["values"]) == (2.0, pytest.approx(70.123), COUNT)
    assert (stiffness["without_value"], stiffness["values"], stiffness["mean"]) == (1000, COUNT - 1000, 8.0)


def test_spectra_state_their_method(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    result = lines(client.get(f"/api/runs/{run}/spectra", params={"signals": "q,S", "from": 2.0}))[-1]["result"]
    assert (result["method"], result["window"], result["overlap"]) == ("Welch", "Hann", 0.5)
    q = result["signals"]["q"]
    assert len(q["density"]) == q["segment"] // 2 - 1
    assert (q["values"], q["unit"]) == (COUNT - 2000, "rad")


def test_a_range_is_downloaded_with_every_sample(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    answer = client.get(f"/api/runs/{run}/range.csv", params={"from": 69.0, "to": 71.0, "signals": "q,S"})
    assert f"sinew-run-{run}-69.000-to-71.000-s.csv" in answer.headers["content-disposition"]
    rows = [line for line in answer.text.splitlines() if not line.startswith("#")]
    assert rows[0] == "t,q,S"
    assert len(rows) == 1 + 2001
    assert rows[1 + 1123].startswith("70.123,2")


def test_values_are_taken_from_the_sample_at_or_before_the_time(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    asked = client.get(f"/api/runs/{run}/values", params={"at": [0.5, 70.1234], "signals": "q,S"})
    first, second = asked.raise_for_status().json()["moments"]
    assert (first["values"]["S"], second["t"], second["values"]["q"]) == (None, pytest.approx(70.123), 2.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("params", "status", "expected"),
    [
        ({"from": 500.0}, 422, {"quantity": "from", "value": 500.0, "maximum": 119.999, "unit": "s"}),
        ({"from": 3.0, "to": 2.0}, 422, {"quantity": "to", "value": 2.0, "minimum": 3.0, "unit": "s"}),
        ({"to": 121.0}, 422, {"quantity": "to", "value": 121.0, "maximum": 119.999, "unit": "s"}),
        ({"signals": "q,nonsense"}, 422, {}),
    ],
)
def test_an_invalid_range_is_rejected_before_the_first_byte(
    stored: tuple[httpx.Client, int], kind: str, params: dict[str, Any], status: int, expected: dict[str, Any]
) -> None:
    client, run = stored
    response = client.get(f"/api/runs/{run}/{kind}", params=params)
    assert response.status_code == status
    refused = problem(response)
    assert {name: refused[name] for name in expected} == pytest.approx(expected)
    assert client.get(f"/api/runs/{run + 1}/{kind}").status_code == 404


def test_an_abandoned_range_frees_its_slot(stored: tuple[httpx.Client, int]) -> None:
    """More ranges than are read at a time, each abandoned after its first line: the next request is still answered."""
    client, run = stored
    for _ in range(20):
        with client.stream("GET", f"/api/runs/{run}/statistics", params={"signals": ",".join(STORED_NAMES)}) as begun:
            assert begun.status_code == 200
            next(begun.iter_bytes())
    end = time.monotonic() + PATIENCE_S
    while (answer := client.get(f"/api/runs/{run}/statistics", params={"signals": "q"})).status_code == 429:
        assert time.monotonic() < end
    assert lines(answer)[-1]["result"]["samples"] == COUNT
