"""Faults and stops through the interface: trips, their effects and their display."""

import asyncio
import json
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from typing import Any, cast

import httpx
import pytest

from backend.auth.control_lease import ControlLease
from backend.errors import RequestRejectedError
from backend.faults import FAULTS, Fault
from backend.services import messages
from backend.services.actuator import ActuatorService
from backend.services.fault_injection import INJECTIONS, MANUAL_CAUSES, apply_fault, describe_faults
from plant.errors import ErrorCode
from plant.interface import ONLY_OF_A_CARD, SIMULATOR, PlantChoice, PlantKind
from tests.api.conftest import client_with, problem, until, until_state, wait_for, wait_until_present
from tests.api.pages import Page
from tests.docs.faults_page import PAGE
from tests.e2e.service import Service, running_service

# Faults injected through the interface, as the developer page does, on the running service.

ONLY_HERE = [
    Fault.SENSOR_JUMP,
    Fault.DEADLINES_MISSED,
    Fault.SERVICE_LOST,
    Fault.SAFETY_MODULE,
    Fault.WATCHDOG,
    Fault.WATCHDOG_DEAD,
]
"""Faults that need the live loop, its clock, its channel or the card; tests/realtime/test_faults.py covers the rest."""


def test_every_fault_has_its_injection_or_a_button() -> None:
    assert set(INJECTIONS) == set(FAULTS) - {Fault.NONE, *MANUAL_CAUSES}
    assert set(MANUAL_CAUSES) == {Fault.STOP_PRESSED, Fault.SERVICE_ENDED, Fault.INTERNAL_ERROR}


def test_card_faults_are_offered_on_the_virtual_card_only() -> None:
    here, there = describe_faults(SIMULATOR), describe_faults(PlantChoice(PlantKind.VIRTUAL_CARD))
    assert here.card == []
    assert {fault.injection.kind.value for fault in there.card} >= set(ONLY_OF_A_CARD)
    assert all(fault.leads_to for fault in there.card)
    lacking = {fault.code for fault in here.faults if fault.injection is None} - set(MANUAL_CAUSES)
    assert lacking == {Fault.SENSOR_SATURATED, Fault.MOTOR_REVERSED}
    assert all("--virtual-card" in fault.by_hand for fault in here.faults if fault.code in lacking)
    assert {fault.code for fault in there.faults if fault.injection is None} == set(MANUAL_CAUSES)


def test_card_faults_are_rejected_on_the_simulator(off: httpx.Client) -> None:
    refused = off.post("/api/faults/injection", json={"kind": "device_gone"})
    assert refused.status_code == 409
    assert problem(refused)["code"] == "no_virtual_card"
    assert problem(refused)["message_code"] == "fault_needs_virtual_card"


def test_the_list_of_faults_has_texts_and_injections(viewer: httpx.Client) -> None:
    listed = viewer.get("/api/faults").json()["faults"]
    assert [entry["code"] for entry in listed] == [str(fault) for fault in FAULTS[1:]]
    assert all(entry["message"] and entry["remedy"] for entry in listed)
    assert all((entry["injection"] is None) == (entry["by_hand"] != "") for entry in listed)
    words = {entry["code"]: entry["by_hand"] for entry in listed}
    assert "STOP" in words[Fault.STOP_PRESSED]
    assert "STOP" not in words[Fault.SERVICE_ENDED]  # ends by a signal, whatever button exists


@pytest.mark.parametrize("fault", ONLY_HERE)
def test_an_injected_fault_is_latched_and_reported(off: httpx.Client, fault: Fault) -> None:
    off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    off.post("/api/faults/injection", json=INJECTIONS[fault].model_dump(mode="json")).raise_for_status()
    wait_for(off, "mode", "tripped")
    state = wait_until_present(off, "stop_proof")  # an event, which arrives shortly after the sample
    fault_view = state["fault"]
    assert isinstance(fault_view, dict)
    assert fault_view["code"] == fault
    assert fault_view["remedy"]
    off.request("DELETE", "/api/faults/injection").raise_for_status()
    assert off.post("/api/reset").json()["mode"] == "off"

    def all_links_are_good() -> bool:
        broken = [link["name"] for link in off.get("/api/state").json()["chain"] if not link["good"]]
        assert broken in ([], ["service"])  # the service is shown as failed until its next heartbeat
        return not broken

    until(all_links_are_good)


@pytest.mark.parametrize("kind", ["read_error", "write_error"])
def test_a_plant_error_while_tripped_remains_a_problem(off: httpx.Client, kind: str) -> None:
    off.post("/api/stop").raise_for_status()
    off.post("/api/faults/injection", json={"kind": kind}).raise_for_status()
    (problem_shown,) = cast(list[str], wait_until_present(off, "problems")["problems"])
    assert problem_shown.startswith(messages.plant_failing(reason=""))
    state = off.get("/api/state").json()
    assert state["fault"]["code"] == "stop_pressed"
    off.request("DELETE", "/api/faults/injection").raise_for_status()
    wait_for(off, "problems", [])
    assert off.post("/api/reset").json()["mode"] == "off"


def test_a_dead_watchdog_is_shown_and_a_reset_starts_a_new_one(off: httpx.Client) -> None:
    """Another fault is latched already, so that no trip reports the watchdog."""
    off.post("/api/stop").raise_for_status()
    starts = off.get("/api/state").json()["link"]["starts"]
    off.post("/api/faults/injection", json={"kind": "watchdog_death"}).raise_for_status()
    state = wait_for(
        off, "problems", ["the card's watchdog is dead: Reset starts a new control loop with a new watchdog"]
    )
    (link,) = (link for link in cast(list[dict[str, object]], state["chain"]) if link["name"] == "watchdog")
    assert not link["good"]
    assert "dead" in str(link["says"])
    assert off.post("/api/reset").json()["mode"] == "off"
    state = wait_for(off, "problems", [])
    assert cast(dict[str, object], state["link"])["starts"] == cast(int, starts) + 1


def test_a_viewer_cannot_inject_faults(viewer: httpx.Client) -> None:
    refused = viewer.post("/api/faults/injection", json={"kind": "jump"})
    assert refused.status_code == 403
    assert problem(refused)["code"] == "not_allowed"


class _RigState:
    plant = PlantChoice(PlantKind.RIG)


class _RigActuator:
    live_state = _RigState()


@pytest.mark.parametrize("fault", INJECTIONS)
def test_faults_cannot_be_injected_into_a_rig(fault: Fault) -> None:
    rig, control = cast(ActuatorService, _RigActuator()), cast(ControlLease, None)
    with pytest.raises(RequestRejectedError) as error:
        asyncio.run(apply_fault(rig, control, INJECTIONS[fault], "Ana"))
    assert error.value.category is ErrorCode.NOT_NOW
    message = error.value.message
    assert (message.code, message.values) == ("fault_injection_needs_simulated_plant", {"plant": "rig"})


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


# Objects that a stop, a change of mode or of control ends, as the table in docs/reference/faults.md states.

HEADING = "| armed or temporary | STOP or a trip | another mode | control changes |"
EVENTS = ("STOP or a trip", "another mode", "control changes")
LONG = json.dumps([{"duration_s": 60, "q_ref": 0.1, "S_ref": 10}])


def documented() -> dict[str, dict[str, str]]:
    """Return the documented outcome by object and event, without the text after a comma."""
    table = PAGE[PAGE.index(HEADING) :].split("\n\n")[0].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    return {name: dict(zip(EVENTS, (re.split(",", cell)[0] for cell in cells), strict=True)) for name, *cells in rows}


class Bench:
    """Ana at a page with control, in run at rest, Vera at another page, and a client of a viewer."""

    def __init__(self, service: Service, viewer: httpx.Client) -> None:
        self.ana, self.vera, self.viewer = Page(service, "Ana"), Page(service, "Vera"), viewer
        self.ana.take(take_over=True).raise_for_status()
        self._open = ExitStack()
        self._open.enter_context(self.ana.staying())

    def close(self) -> None:
        self._open.close()
        self.ana.browser.close()
        self.vera.browser.close()

    def order(self, method: str, path: str, body: object = None) -> None:
        answer = self.ana.command(method, path, body)
        assert answer.is_success, answer.text

    def begin(self) -> None:
        self.ana.browser.post("/api/stop").raise_for_status()
        self.order("POST", "/api/reset")
        self.order("POST", "/api/mode", {"mode": "pretension"})
        until(self.is_pretensioned)
        self.order("POST", "/api/mode", {"mode": "run"})

    def is_pretensioned(self) -> bool:
        return bool(self.state()["pretension_done"])

    def state(self) -> dict[str, Any]:
        return dict(self.viewer.get("/api/state").raise_for_status().json())

    def queue(self) -> dict[str, Any]:
        return dict(self.viewer.get("/api/experiments/queue").raise_for_status().json())

    def log(self) -> list[str]:
        entries = self.viewer.get("/api/log").raise_for_status().json()["entries"]
        texts = [entry["text"] for entry in entries]
        return texts[: texts.index(next(text for text in texts if text.startswith("push of")))]

    def arm(self, name: str) -> None:
        match name:
            case "tuning trial":
                self.order("POST", "/api/tuning/trial", {"lam_q": 1.0, "duration_s": 60.0})
            case "manual push":
                self.order("POST", "/api/push", {"F_push": 5.0, "duration_s": 10.0})
            case "calibration over S":
                self.order("PUT", "/api/touch", {"sweep": "begin"})
            case "obstacle":
                self.order("PUT", "/api/wall", {"wall": {"q_wall": 1.0}})
            case "run, and its temporary tuning" | "queue after the run":
                item = {"name": "sequence", "settings": {"segments": LONG}}
                self.order("POST", "/api/experiments/queue", item)
                self.order("POST", "/api/experiments/queue", item)
                self.order("POST", "/api/experiments/queue/run")
                wait_for(self.viewer, "mode", "experiment")
            case _:
                pytest.fail(f"the test does not know how to arm: {name}")

    def is_there(self, name: str) -> bool:
        """Return whether the armed object still exists."""
        state = self.state()
        checks: dict[str, Callable[[], bool]] = {
            "tuning trial": lambda: state["trial"] is not None and state["tuning"]["lam_q"] == 1.0,
            "manual push": lambda: not any(text.startswith("push released") for text in self.log()),
            "calibration over S": lambda: bool(state["touch"]["sweep"] and state["touch"]["sweep"]["under_way"]),
            "run, and its temporary tuning": lambda: state["own_tuning"] is not None and state["task"] is not None,
            "queue after the run": lambda: bool(self.queue()["running"]),
            "obstacle": lambda: state["wall"] is not None,
        }
        return checks[name]()

    def is_gone(self, name: str) -> bool:
        return not self.is_there(name)

    def cause(self, event: str) -> int:
        """Cause the event; return the status of the answer."""
        match event:
            case "STOP or a trip":
                return self.vera.browser.post("/api/stop").status_code
            case "another mode":
                return self.ana.command("POST", "/api/mode", {"mode": "compliance"}).status_code
            case _:
                return self.vera.take(take_over=True).status_code

    def clear(self) -> None:
        self.ana.take(take_over=True)
        self.ana.browser.post("/api/stop").raise_for_status()
        self.order("PUT", "/api/wall", {"wall": None})
        for item in self.queue()["items"]:
            self.order("DELETE", f"/api/experiments/queue/{item['id']}")
        self.order("POST", "/api/reset")
        self.order("DELETE", "/api/control")


@pytest.fixture
def bench(service: Service, viewer: httpx.Client) -> Iterator[Bench]:
    with closing(Bench(service, viewer)) as bench:
        yield bench


ALONE = ("calibration over S", "run, and its temporary tuning", "queue after the run")
TOGETHER = ("tuning trial", "manual push", "obstacle")


def test_the_documented_table_lists_the_tested_objects() -> None:
    assert sorted(documented()) == sorted((*ALONE, *TOGETHER))


@pytest.mark.parametrize("names", [TOGETHER, ALONE[:1], ALONE[1:]], ids=["in run", "learning", "run"])
@pytest.mark.parametrize("event", EVENTS)
def test_each_event_ends_the_objects_in_the_documented_table(bench: Bench, names: tuple[str, ...], event: str) -> None:
    bench.begin()
    for name in names:
        if name != "queue after the run":
            bench.arm(name)
    assert all(bench.is_there(name) for name in names)
    status = bench.cause(event)
    for name in names:
        outcome = documented()[name][event]
        assert (status >= 400) == (outcome == "refused"), (name, status)
        if outcome in ("ends", "paused"):
            until(partial(bench.is_gone, name))
        else:
            assert bench.is_there(name), name
    bench.clear()


# Faults of a card through the interface, on a service that drives the virtual card in real time.


@pytest.fixture(scope="module")
def card(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    data = tmp_path_factory.mktemp("card")
    with (
        running_service(data, params="ideal", plant=("rig", "--virtual-card")) as service,
        client_with(service, "token") as client,
    ):
        yield client


def latched(client: httpx.Client, kind: str) -> tuple[str, str]:
    """Pretension, inject a fault, wait for the trip; return the fault and its remedy."""
    client.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    offered = client.get("/api/faults").raise_for_status().json()["card"]
    (injection,) = [fault["injection"] for fault in offered if fault["injection"]["kind"] == kind]
    client.post("/api/faults/injection", json=injection).raise_for_status()
    state = wait_for(client, "mode", "tripped")
    fault_view = state["fault"]
    assert isinstance(fault_view, dict)
    return str(fault_view["code"]), str(fault_view["remedy"])


def watchdog_in(state: dict[str, Any]) -> dict[str, Any]:
    (link,) = [link for link in state["chain"] if link["name"] == "watchdog"]
    return dict(link)


def test_a_saturated_load_cell_has_its_own_fault(card: httpx.Client) -> None:
    code, remedy = latched(card, "saturation")
    assert code == Fault.SENSOR_SATURATED
    assert "amplifier" in remedy
    refused = card.post("/api/reset")
    assert refused.status_code == 409
    assert "10.00 V" in refused.text
    card.request("DELETE", "/api/faults/injection").raise_for_status()
    assert card.post("/api/reset").raise_for_status().json()["mode"] == "off"


def test_a_reset_reopens_a_disconnected_card(card: httpx.Client) -> None:
    starts = card.get("/api/state").json()["link"]["starts"]
    code, _ = latched(card, "device_gone")
    assert code == Fault.PLANT_ERROR
    # Its watchdog disables the drives, because the loop cannot write any more.
    until_state(card, lambda state: not watchdog_in(state)["good"], "the watchdog did not expire")
    assert card.post("/api/reset").raise_for_status().json()["mode"] == "off"
    state = card.get("/api/state").json()
    assert (state["link"]["starts"], state["problems"]) == (starts + 1, [])


def test_swapped_motors_invalidate_the_direction_step_after_a_restart_too(card: httpx.Client) -> None:
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
    assert "accelerates against the voltage of" in result["text"]
