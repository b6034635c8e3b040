"""Faults injected through the interface, as the developer page does, on the running service."""

import asyncio
from typing import Any, cast

import httpx
import pytest

from backend.auth.control_lease import ControlLease
from backend.errors import RequestRejectedError
from backend.faults import FAULTS, Fault
from backend.services.actuator import ActuatorService
from backend.services.fault_injection import INJECTIONS, MANUAL_CAUSES, apply_fault, describe_faults
from plant.errors import ErrorCode
from plant.interface import ONLY_OF_A_CARD, SIMULATOR, PlantChoice, PlantKind
from tests.api.conftest import once_told, problem, until, wait_for

ONLY_HERE = [
    Fault.SENSOR_JUMP,
    Fault.DEADLINES_MISSED,
    Fault.SERVICE_LOST,
    Fault.SAFETY_MODULE,
    Fault.WATCHDOG,
    Fault.WATCHDOG_DEAD,
]
"""Those that need the live loop, its clock, its channel or the card; tests/realtime/test_faults.py covers the rest."""


def test_every_fault_has_its_injection_or_a_button() -> None:
    assert set(INJECTIONS) == set(FAULTS) - {Fault.NONE, *MANUAL_CAUSES}
    assert set(MANUAL_CAUSES) == {Fault.STOP_PRESSED, Fault.SERVICE_ENDED, Fault.INTERNAL_ERROR}


def test_what_only_a_card_has_is_offered_on_the_virtual_card_only() -> None:
    here, there = describe_faults(SIMULATOR), describe_faults(PlantChoice(PlantKind.VIRTUAL_CARD))
    assert here.card == []
    assert {fault.injection.kind.value for fault in there.card} >= set(ONLY_OF_A_CARD)
    assert all(fault.leads_to for fault in there.card)
    lacking = {fault.code for fault in here.faults if fault.injection is None} - set(MANUAL_CAUSES)
    assert lacking == {Fault.SENSOR_SATURATED, Fault.MOTOR_REVERSED}
    assert all("--virtual-card" in fault.by_hand for fault in here.faults if fault.code in lacking)
    assert {fault.code for fault in there.faults if fault.injection is None} == set(MANUAL_CAUSES)


def test_a_simulator_has_no_card_to_break(off: httpx.Client) -> None:
    refused = off.post("/api/faults/injection", json={"kind": "device_gone"})
    assert refused.status_code == 409
    assert problem(refused)["code"] == "no_virtual_card"
    assert "--virtual-card" in str(problem(refused)["message"])


def test_the_list_tells_words_and_injections(viewer: httpx.Client) -> None:
    listed = viewer.get("/api/faults").json()["faults"]
    assert [entry["code"] for entry in listed] == [str(fault) for fault in FAULTS[1:]]
    assert all(entry["message"] and entry["remedy"] for entry in listed)
    assert all((entry["injection"] is None) == (entry["by_hand"] != "") for entry in listed)
    words = {entry["code"]: entry["by_hand"] for entry in listed}
    assert "STOP" in words[Fault.STOP_PRESSED]
    assert "STOP" not in words[Fault.SERVICE_ENDED]  # ends by a signal, whatever button there is


@pytest.mark.parametrize("fault", ONLY_HERE)
def test_an_injected_fault_is_latched_and_told(off: httpx.Client, fault: Fault) -> None:
    off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    off.post("/api/faults/injection", json=INJECTIONS[fault].model_dump(mode="json")).raise_for_status()
    wait_for(off, "mode", "tripped")
    state = once_told(off, "stop_proof")  # an event, which comes a moment after the sample
    told = state["fault"]
    assert isinstance(told, dict)
    assert told["code"] == fault
    assert told["remedy"]
    off.request("DELETE", "/api/faults/injection").raise_for_status()
    assert off.post("/api/reset").json()["mode"] == "off"

    def all_links_are_good() -> bool:
        broken = [link["name"] for link in off.get("/api/state").json()["chain"] if not link["good"]]
        assert broken in ([], ["service"])  # that which was broken is shown as such until it is heard again
        return not broken

    until(all_links_are_good)


@pytest.mark.parametrize("kind", ["read_error", "write_error"])
def test_a_plant_that_fails_while_tripped_is_a_standing_problem(off: httpx.Client, kind: str) -> None:
    off.post("/api/stop").raise_for_status()
    off.post("/api/faults/injection", json={"kind": kind}).raise_for_status()
    (problem_shown,) = cast(list[str], once_told(off, "problems")["problems"])
    assert problem_shown.startswith("the plant cannot be read or written")
    state = off.get("/api/state").json()
    assert state["fault"]["code"] == "stop_pressed"
    off.request("DELETE", "/api/faults/injection").raise_for_status()
    wait_for(off, "problems", [])
    assert off.post("/api/reset").json()["mode"] == "off"


def test_a_dead_watchdog_is_shown_and_a_reset_brings_a_new_one(off: httpx.Client) -> None:
    """Also where something else is latched already, so that no trip tells of it."""
    off.post("/api/stop").raise_for_status()
    starts = off.get("/api/state").json()["link"]["starts"]
    off.post("/api/faults/injection", json={"kind": "watchdog_death"}).raise_for_status()
    state = wait_for(off, "problems", ["the card's watchdog is dead: reset starts a new loop with a new one"])
    (link,) = (link for link in cast(list[dict[str, object]], state["chain"]) if link["name"] == "watchdog")
    assert not link["good"]
    assert "dead" in str(link["says"])
    assert off.post("/api/reset").json()["mode"] == "off"
    state = wait_for(off, "problems", [])
    assert cast(dict[str, object], state["link"])["starts"] == cast(int, starts) + 1


def test_a_viewer_breaks_nothing(viewer: httpx.Client) -> None:
    refused = viewer.post("/api/faults/injection", json={"kind": "jump"})
    assert refused.status_code == 403
    assert problem(refused)["code"] == "not_allowed"


class _RigState:
    plant = PlantChoice(PlantKind.RIG)


class _RigActuator:
    live_state = _RigState()


@pytest.mark.parametrize("fault", INJECTIONS)
def test_nothing_is_injected_into_a_rig(fault: Fault) -> None:
    rig, control = cast(ActuatorService, _RigActuator()), cast(ControlLease, None)
    with pytest.raises(
        RequestRejectedError, match="only into what is simulated, and what is driven is the rig"
    ) as error:
        asyncio.run(apply_fault(rig, control, INJECTIONS[fault], "Ana"))
    assert error.value.category is ErrorCode.NOT_NOW


def test_a_trip_leaves_a_flight_record(off: httpx.Client) -> None:
    before = {flight["id"] for flight in off.get("/api/flights").json()["flights"]}
    assert off.post("/api/stop").is_success

    def recorded() -> dict[str, Any] | None:
        assert off.get("/api/state").json()["fault"]["code"] == "stop_pressed"
        flights = off.get("/api/flights").raise_for_status().json()["flights"]
        return next((f for f in flights if f["id"] not in before and f["fault"] == "stop_pressed"), None)

    found = until(recorded)
    assert found["after_s"] == pytest.approx(5.0)
    text = off.get(f"/api/flights/{found['id']}/data.csv").raise_for_status().text
    csv = [line for line in text.splitlines() if not line.startswith("#")]
    assert csv[0].startswith("t,q,q_ref")
    assert len(csv) - 1 == round(1000 * (found["before_s"] + found["after_s"]))
    assert float(csv[1].split(",")[0]) == pytest.approx(-found["before_s"])
    assert off.get("/api/flights/999999/data.csv").status_code == 404
