"""Faults of a card through the interface, on a service that drives the virtual card in real time."""

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from backend.faults import Fault
from tests.api.conftest import client_with, until, until_state, wait_for
from tests.e2e.service import running_service

pytestmark = pytest.mark.live


@pytest.fixture(scope="module")
def card(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    data = tmp_path_factory.mktemp("card")
    with (
        running_service(data, params="ideal", plant=("rig", "--virtual-card")) as service,
        client_with(service, "token") as client,
    ):
        yield client


def latched(client: httpx.Client, kind: str) -> tuple[str, str]:
    """Wind up, break something, wait for the trip; return the fault and what was seen of it."""
    client.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    offered = client.get("/api/faults").raise_for_status().json()["card"]
    (injection,) = [fault["injection"] for fault in offered if fault["injection"]["kind"] == kind]
    client.post("/api/faults/injection", json=injection).raise_for_status()
    state = wait_for(client, "mode", "tripped")
    told = state["fault"]
    assert isinstance(told, dict)
    return str(told["code"]), str(told["remedy"])


def watchdog_in(state: dict[str, Any]) -> dict[str, Any]:
    (link,) = [link for link in state["chain"] if link["name"] == "watchdog"]
    return dict(link)


def test_a_load_cell_at_its_end_has_a_fault_of_its_own(card: httpx.Client) -> None:
    code, remedy = latched(card, "saturation")
    assert code == Fault.SENSOR_SATURATED
    assert "amplifier" in remedy
    refused = card.post("/api/reset")
    assert refused.status_code == 409
    assert "10.00 V" in refused.text
    card.request("DELETE", "/api/faults/injection").raise_for_status()
    assert card.post("/api/reset").raise_for_status().json()["mode"] == "off"


def test_a_card_that_is_gone_is_opened_anew_by_a_reset(card: httpx.Client) -> None:
    starts = card.get("/api/state").json()["link"]["starts"]
    code, _ = latched(card, "device_gone")
    assert code == Fault.PLANT_ERROR
    # Its own watchdog is what takes the drives away, as nothing can be written any more.
    until_state(card, lambda state: not watchdog_in(state)["good"], "the watchdog did not expire")
    assert card.post("/api/reset").raise_for_status().json()["mode"] == "off"
    state = card.get("/api/state").json()
    assert (state["link"]["starts"], state["problems"]) == (starts + 1, [])


def test_motors_that_were_exchanged_have_to_be_proven_anew_after_the_next_start_too(card: httpx.Client) -> None:
    card.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_for(card, "pretension_done", True)
    card.post("/api/mode", json={"mode": "run"}).raise_for_status()
    card.post("/api/faults/injection", json={"kind": "swapped_motors"}).raise_for_status()
    card.put("/api/references", json={"q_ref": 0.1, "S_ref": 9.0}).raise_for_status()
    state = wait_for(card, "mode", "tripped")
    assert isinstance(state["fault"], dict)
    assert state["fault"]["code"] == Fault.MOTOR_REVERSED
    card.request("DELETE", "/api/faults/injection").raise_for_status()

    def direction() -> dict[str, Any]:
        steps = card.get("/api/bring-up").raise_for_status().json()["steps"]
        return next(dict(step) for step in steps if step["id"] == "direction")

    until(lambda: direction()["state"] == "failed")
    result = direction()["result"]
    assert (result["passed"], result["who"]) == (False, "the loop")
    assert "runs away from" in result["text"]
