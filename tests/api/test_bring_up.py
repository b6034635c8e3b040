"""Commissioning of a rig through the interface, on a virtual card."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.commissioning import status
from backend.commissioning.procedure import StepFinding
from backend.commissioning.steps import StepId
from backend.services import messages
from backend.storage.database import open_database
from plant.calibration import CellCalibration
from plant.messages import directions_not_proven
from plant.wiring import load_wiring
from tests.api.conftest import client_with, problem, until
from tests.e2e.service import running_service

URL = "/api/bring-up"

STARTING: list[tuple[str, dict[str, Any]]] = [
    ("/api/mode", {"mode": "pretension"}),
    ("/api/experiments", {"name": "tracking"}),
    ("/api/experiments/queue/run", {}),
    ("/api/identifications", {"tension_N": 20.0, "bits": 6}),
    (f"{URL}/drives", {"on": True}),
]
"""Requests that are rejected during the drive lockout."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bring-up")


@pytest.fixture(scope="module")
def rig(folder: Path) -> Iterator[httpx.Client]:
    """An operator at a rig with a virtual card."""
    with running_service(folder, plant=("rig", "--virtual-card")) as running, client_with(running, "token") as client:
        yield client


def step_of(client: httpx.Client, name: str) -> dict[str, Any]:
    answer = client.get(URL)
    answer.raise_for_status()
    return next(step for step in answer.json()["steps"] if step["id"] == name)


def begin(client: httpx.Client, name: str) -> None:
    client.post(f"{URL}/{name}", json={"values": {}}).raise_for_status()


def confirmed(client: httpx.Client, name: str) -> tuple[dict[str, Any], set[str]]:
    """Confirm each request of a step until its end; return the step and the requests."""
    read_problems: set[str] = set()

    def over() -> dict[str, Any] | None:
        step = step_of(client, name)
        if step["running"] is None:
            return step
        if step["running"]["confirm"]:
            read_problems.add(step["running"]["confirm"])
            client.post(f"{URL}/confirm")
        return None

    return until(over), read_problems


def switch_on(client: httpx.Client) -> None:
    """End the drive lockout."""
    assert client.post(f"{URL}/drives", json={"on": True}).raise_for_status().json()["drives_on"] is True


def test_a_simulator_has_no_commissioning(operator: httpx.Client) -> None:
    view = operator.get(URL).json()
    assert not view["applies"]
    assert "simulator" in view["why_not"]
    assert operator.post(f"{URL}/zero", json={"values": {}}).status_code == 409


def test_the_wiring_test_is_run_confirmed_and_stored(rig: httpx.Client) -> None:
    view = rig.get(URL).raise_for_status().json()
    assert view["applies"]
    assert {step["state"] for step in view["steps"]} == {"never"}
    refused = problem(rig.post(f"{URL}/direction", json={"values": {}}))
    assert "Wiring test" in str(refused["message"])
    begin(rig, "wiring_test")
    assert step_of(rig, "tare")["blocked"] == messages.other_step_in_progress(title="Wiring test")
    until(lambda: step_of(rig, "wiring_test")["running"]["confirm"])
    view = rig.get(URL).json()
    assert (view["drives_on"], view["drives_locked"]) == (False, True)
    unready = messages.step_occupies_rig(title="Wiring test")
    assert rig.get("/api/state").json()["unready"] == unready
    rig.post("/api/experiments/queue", json={"name": "tracking"}).raise_for_status()
    for order, body in STARTING:
        refused = problem(rig.post(order, json=body))
        assert (refused["message_code"], unready in refused["message"]) == ("rig_is_occupied", True), order
    step, read_problems = confirmed(rig, "wiring_test")
    assert (step["state"], step["result"]["passed"]) == ("current", True), step
    assert len(read_problems) >= 6
    assert step_of(rig, "zero")["blocked"] == ""
    # The drive lockout has not been ended yet.
    assert "drives are switched off" in str(problem(rig.post("/api/mode", json={"mode": "pretension"}))["message"])
    switch_on(rig)


def test_a_cancelled_step_leaves_no_result(rig: httpx.Client) -> None:
    rig.post(f"{URL}/zero", json={"values": {}}).raise_for_status()
    until(lambda: (step_of(rig, "zero")["running"] or {}).get("confirm"))
    rig.post(f"{URL}/cancel").raise_for_status()
    assert step_of(rig, "zero")["state"] == "never"
    assert problem(rig.post(f"{URL}/confirm"))["code"] == "conflict"


def test_the_state_lists_the_steps_required_before_pretension(rig: httpx.Client) -> None:
    """A failed direction step leaves the directions unproven until it has passed."""

    def read_readiness() -> tuple[str, list[str]]:
        state = rig.get("/api/state").raise_for_status().json()
        return state["unready"], state["legal_modes"]

    unready, legal = read_readiness()
    assert ("drives are switched off" in unready, legal) == (True, [])  # the cancelled step was executed by hand
    switch_on(rig)
    assert read_readiness() == ("", ["pretension"])
    begin(rig, "zero")
    confirmed(rig, "zero")
    rig.post("/api/faults/injection", json={"kind": "swapped_motors"}).raise_for_status()
    begin(rig, "direction")
    assert confirmed(rig, "direction")[0]["state"] == "failed"
    switch_on(rig)
    unready, legal = read_readiness()
    assert (directions_not_proven() in unready, legal) == (True, [])
    assert problem(rig.post("/api/mode", json={"mode": "pretension"}))["message"] == unready
    rig.request("DELETE", "/api/faults/injection").raise_for_status()
    begin(rig, "direction")
    assert confirmed(rig, "direction")[0]["state"] == "current"
    switch_on(rig)
    assert read_readiness() == ("", ["pretension"])


def test_homing_requires_a_position_of_the_end_switch(rig: httpx.Client) -> None:
    assert "home" not in {step["id"] for step in rig.get(URL).json()["steps"]}
    refused = problem(rig.post(f"{URL}/home", json={"values": {}}))
    assert "end_switch.position" in str(refused["message"])


def test_weights_that_differ_too_little_are_rejected(rig: httpx.Client) -> None:
    answer = rig.post(f"{URL}/calibrate", json={"values": {"weight_1_N": 10.0, "weight_2_N": 12.0}})
    assert answer.status_code == 422
    assert "at least 5 N apart" in str(problem(answer)["message"])


def played(client: httpx.Client, name: str, before: Callable[[str], None] = lambda _asked: None) -> dict[str, Any]:
    """Run a step, confirm its requests, and return it; call ``before`` at each request."""
    client.post(f"{URL}/{name}", json={"values": {}}).raise_for_status()

    def over() -> dict[str, Any] | None:
        step = step_of(client, name)
        if step["running"] is not None and step["running"]["confirm"]:
            before(step["running"]["confirm"])
            client.post(f"{URL}/confirm")
        return step if step["running"] is None else None

    return until(over)


def read_problems(client: httpx.Client) -> list[str]:
    """Return the problems of the commissioning in the state."""
    problems = client.get("/api/state").raise_for_status().json()["problems"]
    return [problem for problem in problems if "of the bring-up" in problem]


def test_a_tare_invalidates_the_zero_and_gives_the_reason(rig: httpx.Client) -> None:
    assert played(rig, "zero")["state"] == "current"
    step = played(rig, "tare")
    assert step["state"] == "current", step
    assert "zeros are lost" in step["instruction"]
    zero = step_of(rig, "zero")
    assert zero["state"] == "out_of_date"
    assert "lost their zero" in zero["why"]


def test_a_pending_tare_is_reported_and_takes_effect_at_the_next_start(rig: httpx.Client) -> None:
    def stop(asked: str) -> None:
        if "the control loop restarts" in asked:
            rig.post("/api/stop").raise_for_status()

    step = played(rig, "tare", before=stop)
    assert (step["state"], step["result"]["passed"]) == ("out_of_date", True)
    assert "at the next start of the control loop" in step["why"]
    (problem_told,) = read_problems(rig)
    assert "Tare of the bring-up takes effect at the next start of the control loop" in problem_told
    assert "tripped" in problem_told
    rig.post("/api/reset").raise_for_status()
    assert played(rig, "tare")["state"] == "current"
    assert read_problems(rig) == []


def test_a_result_that_cannot_be_stored_is_reported(rig: httpx.Client, folder: Path) -> None:
    def rename(old: str, new: str) -> None:
        with closing(sqlite3.connect(folder / "sinew.db", timeout=10.0)) as database:
            database.execute(f"ALTER TABLE {old} RENAME TO {new}")
            database.commit()

    rig.post(f"{URL}/zero", json={"values": {}}).raise_for_status()
    until(lambda: (step_of(rig, "zero")["running"] or {}).get("confirm"))
    rename("bring_up", "mislaid")
    try:
        rig.post(f"{URL}/confirm")
        (given_up,) = until(lambda: read_problems(rig))
    finally:
        rename("mislaid", "bring_up")
    assert "Zero of the bring-up failed and must be repeated" in given_up
    assert step_of(rig, "zero")["running"] is None


def test_a_tare_retains_the_stored_slope_even_if_it_is_not_active(rig: httpx.Client, folder: Path) -> None:
    wiring = load_wiring("pcie-6323")
    assert wiring.load_cell_A.slope == 10.0
    cells = tuple(CellCalibration(tendon, 20.0, 0.0, "calibrated") for tendon in "AB")
    with closing(open_database(folder)) as database:
        status.store_result(database, StepId.WIRING_TEST, wiring, StepFinding(True, "well"), "Ada")
        status.store_result(database, StepId.CALIBRATE, wiring, StepFinding(True, "well", (), cells), "Ada")
        assert played(rig, "zero")["state"] == "current"  # the loop has not been started since the calibration
        assert played(rig, "tare")["result"]["passed"]
        tared = status.load_newest_results(database)[StepId.TARE].calibrations
    assert [(found["tendon"], found["slope"]) for found in tared] == [("A", 20.0), ("B", 20.0)]


def test_a_restarted_service_keeps_the_drive_lockout_until_an_operator_ends_it(
    tmp_path: Path,
) -> None:
    plant = ("rig", "--virtual-card")
    with running_service(tmp_path, plant=plant) as running, client_with(running, "token") as client:
        assert client.get(URL).json()["drives_on"] is True
        view = client.post(f"{URL}/drives", json={"on": False}).raise_for_status().json()
        assert (view["drives_on"], view["drives_locked"], view["drives_left"]) == (False, True, None)
    with running_service(tmp_path, plant=plant) as running, client_with(running, "token") as client:
        view = client.get(URL).raise_for_status().json()
        assert (view["drives_on"], view["drives_locked"], view["drives_left"]["who"]) == (False, True, "operator")
        refused = problem(client.post("/api/mode", json={"mode": "pretension"}))
        assert "drives are switched off" in str(refused["message"])
        switch_on(client)
        view = client.get(URL).raise_for_status().json()
        assert (view["drives_locked"], view["drives_left"]) == (False, None)
        client.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
