"""Results of commissioning belong to the wiring that the loop used, and are stored completely."""

import asyncio
import threading
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

import plant
from backend.commissioning import status as commissioning_status
from backend.commissioning.messages import abandoned_after_motor_test
from backend.commissioning.procedure import StepFinding
from backend.commissioning.session import DriveLockout
from backend.commissioning.status import StepState
from backend.commissioning.steps import StepId
from backend.errors import RequestRejectedError
from backend.execution.runner import create_run
from backend.realtime.commands import Accepted, Command, Refused, TryMotor
from backend.realtime.ipc import Ready
from backend.realtime.modes import Mode
from backend.realtime.supervisor import Supervisor
from backend.realtime.timing import RealTimeStatus
from backend.schemas.commissioning import BringUpStep
from backend.schemas.identification import ActuatorRequest
from backend.services import actuator, messages
from backend.services.commissioning import CommissioningService
from backend.storage.commissioning import StoredStepResult
from backend.storage.database import open_database
from backend.storage.orm import StorageError
from backend.storage.runs import Run
from plant.calibration import CellCalibration, CommissioningResults
from plant.interface import PlantChoice, PlantKind
from plant.messages import directions_not_proven
from plant.parameters import load_parameters
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring
from tests.api.stepped_service import Parts, Stepped, stepped
from tests.refusals import refused

IDEAL = load_parameters("ideal")
VIRTUAL = PlantChoice(PlantKind.VIRTUAL_CARD)


def test_a_step_cannot_be_cancelled_while_its_result_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a person nor the end of the service cancels it: the loop may be restarting with the result."""
    database = open_database(tmp_path)
    release, keep = threading.Event(), commissioning_status.store_result

    def slowly(*arguments: Any) -> StoredStepResult:
        assert release.wait(60.0)
        return keep(*arguments)

    async def work(parts: Parts) -> None:
        parts.supervisor.setup = replace(parts.supervisor.setup, plant=VIRTUAL)
        parts.supervisor.started_with = commissioning_status.find_completed_commissioning(
            database, parts.supervisor.setup.plant
        )
        bring_up = CommissioningService(
            parts.actuator, parts.supervisor, database, IDEAL, DriveLockout(database, VIRTUAL)
        )
        await bring_up.start(StepId.WIRING_TEST, {}, "Ada")  # it fails: a simulator has no drives to disable
        while (running := (await bring_up.view()).steps[0].running) and running.phase != "storing the result":
            await asyncio.sleep(0.0)
        with refused(RequestRejectedError, "step_is_being_stored", title="Wiring test"):
            await bring_up.cancel()
        closing_down = asyncio.create_task(bring_up.close())
        await asyncio.sleep(0.0)
        release.set()
        await closing_down
        assert commissioning_status.load_newest_results(database)[StepId.WIRING_TEST].who == "Ada"

    monkeypatch.setattr(commissioning_status, "store_result", slowly)
    try:
        stepped(database, IDEAL, work)
    finally:
        release.set()
        database.close()


def test_a_changed_wiring_file_is_rejected_by_every_step_and_starts_unproven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database, file = open_database(tmp_path), tmp_path / "rig.toml"
    source_text = (Path(plant.__file__).parent / "wirings" / "pcie-6323.toml").read_text(encoding="utf-8")
    file.write_text(source_text, encoding="utf-8")
    for step in (StepId.WIRING_TEST, StepId.DIRECTION):
        commissioning_status.store_result(database, step, load_wiring(str(file)), StepFinding(True, "well"), "Ada")
    started: list[bool] = []

    async def restart(supervisor: Supervisor, _purpose: str) -> None:
        started.append(supervisor.setup.commissioning_results.directions_proven)
        supervisor.started_with = supervisor.setup.commissioning_results  # it has read the present file

    async def work(parts: Parts) -> None:
        choice = PlantChoice(PlantKind.VIRTUAL_CARD, str(file))
        parts.supervisor.started_with = commissioning_status.find_completed_commissioning(database, choice)
        parts.supervisor.setup = replace(
            parts.supervisor.setup, plant=choice, commissioning_results=parts.supervisor.started_with
        )
        bring_up = CommissioningService(
            parts.actuator, parts.supervisor, database, IDEAL, DriveLockout(database, VIRTUAL)
        )
        assert (await bring_up.view()).steps[0].blocked == ""
        parts.supervisor.dead = True
        await parts.actuator.reset("Ada")
        file.write_text(source_text.replace("gain = { value = 1.0", "gain = { value = -1.0", 1), encoding="utf-8")
        parts.supervisor.dead = False
        assert (await bring_up.view()).steps[0].blocked == messages.wiring_has_changed()
        with refused(RequestRejectedError, "wiring_has_changed"):
            await bring_up.start(StepId.WIRING_TEST, {}, "Ada")
        parts.supervisor.dead = True
        await parts.actuator.reset("Ada")
        assert started == [True, False]
        parts.supervisor.dead = False
        assert (await bring_up.view()).steps[0].blocked == ""

    monkeypatch.setattr(Supervisor, "restart", restart)
    try:
        stepped(database, IDEAL, work)
    finally:
        database.close()


def test_the_wiring_that_the_loop_has_read_is_the_valid_one(tmp_path: Path) -> None:
    """The file was edited during the start of the loop, and edited back."""
    database = open_database(tmp_path)
    wiring = load_wiring(VIRTUAL.wiring)
    commissioning_status.store_result(database, StepId.DIRECTION, wiring, StepFinding(True, "well"), "Ada")

    async def work(parts: Parts) -> None:
        known = commissioning_status.find_completed_commissioning(database, VIRTUAL)
        parts.supervisor.setup = replace(parts.supervisor.setup, plant=VIRTUAL, commissioning_results=known)
        parts.supervisor.started_with = known
        bring_up = CommissioningService(
            parts.actuator, parts.supervisor, database, IDEAL, DriveLockout(database, VIRTUAL)
        )
        granted = RealTimeStatus(0, False, 1, ())
        for wired, proven, blocked in ((known.wired, True, False), ("of another file", False, True)):
            parts.supervisor._take(Ready(granted, "a virtual card", wired))
            assert parts.supervisor.started_with.directions_proven is proven
            reason = (await bring_up.view()).steps[0].blocked
            assert (messages.wiring_has_changed() in reason) is blocked

    try:
        stepped(database, IDEAL, work)
    finally:
        database.close()


def test_a_cancelled_direction_step_leaves_the_directions_unproven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database = open_database(tmp_path)
    wiring = load_wiring(VIRTUAL.wiring)
    for step in (StepId.WIRING_TEST, StepId.ZERO, StepId.DIRECTION):
        commissioning_status.store_result(database, step, wiring, StepFinding(True, "well"), "Ada")
    known = commissioning_status.load_commissioning_results(database, wiring)
    assert known.directions_proven
    # wired differently from the file, so that the proof matters
    true = replace(wiring, load_cell_A=replace(wiring.load_cell_A, slope=10.5))
    rig = VirtualRig(wiring, Simulator(IDEAL, 0), None, true, directions_proven=True, load_cells_measured=True)
    tried: list[Command] = []
    send = Stepped.send

    async def sent(supervisor: Stepped, command: Command) -> Accepted | Refused:
        answer = await send(supervisor, command)
        if isinstance(command, TryMotor):
            tried.append(command)
            await asyncio.Event().wait()  # until it is cancelled
        return answer

    monkeypatch.setattr(Stepped, "send", sent)

    async def work(parts: Parts) -> None:
        parts.supervisor.setup = replace(parts.supervisor.setup, plant=VIRTUAL, commissioning_results=known)
        parts.supervisor.started_with = known
        bring_up = CommissioningService(
            parts.actuator, parts.supervisor, database, IDEAL, DriveLockout(database, VIRTUAL)
        )
        bring_up._loop_start = 1, datetime.min.replace(tzinfo=UTC)  # the zero belongs to this loop
        await parts.supervisor.advance(0.01)
        assert rig.unproven == ""
        await bring_up.start(StepId.DIRECTION, {}, "Ada")

        async def shown() -> BringUpStep:
            steps = {step.id: step for step in (await bring_up.view()).steps}
            return steps[StepId.DIRECTION]

        while not tried:
            with suppress(RequestRejectedError):  # no step waits for it yet
                await bring_up.confirm()
            await asyncio.sleep(0.001)
        await bring_up.cancel()
        step = await shown()
        assert (step.running, step.state) == (None, StepState.FAILED)
        assert step.result is not None
        assert abandoned_after_motor_test() in step.result.text
        assert directions_not_proven() in rig.unproven
        assert not parts.supervisor.setup.commissioning_results.directions_proven  # nor at the next start

    try:
        stepped(database, IDEAL, work, rig)
    finally:
        database.close()


def test_a_step_cannot_begin_during_the_start_of_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run creates a database entry between its check that the rig is free and its display."""
    database, wiring = open_database(tmp_path), load_wiring(VIRTUAL.wiring)
    cells = tuple(CellCalibration(tendon, 10.0, 0.0, "calibrated") for tendon in "AB")
    for step in (StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.ZERO, StepId.DIRECTION):
        commissioning_status.store_result(database, step, wiring, StepFinding(True, "well", (), cells), "Ada")
    asked, release = threading.Event(), threading.Event()

    def slowly(*arguments: Any) -> Run:
        asked.set()
        assert release.wait(60.0)
        return create_run(*arguments)

    async def work(parts: Parts) -> None:
        known = commissioning_status.load_commissioning_results(database, wiring)
        parts.supervisor.setup = replace(parts.supervisor.setup, plant=VIRTUAL, commissioning_results=known)
        parts.supervisor.started_with = known
        bring_up = CommissioningService(
            parts.actuator, parts.supervisor, database, IDEAL, DriveLockout(database, VIRTUAL)
        )
        bring_up._loop_start = 1, datetime.min.replace(tzinfo=UTC)
        await parts.supervisor.advance(0.01)
        request = ActuatorRequest(tension_N=20.0, bits=6)
        run = asyncio.create_task(parts.ordered_runs.start_identification(request, "Ada"))
        while not asked.is_set():
            await asyncio.sleep(0.001)
        step = asyncio.create_task(bring_up.start(StepId.PRETENSION, {}, "Bob"))
        mode = asyncio.create_task(parts.actuator.set_mode(Mode.PRETENSION, "Cleo"))
        await asyncio.wait((step, mode), timeout=0.5)  # neither can be answered yet
        assert not step.done()
        assert not mode.done()
        release.set()
        assert await run > 0
        with refused(RequestRejectedError, "run_in_progress", run=1):
            await step
        await asyncio.gather(mode, return_exceptions=True)
        await parts.ordered_runs.close()

    monkeypatch.setattr("backend.services.jobs.create_run", slowly)
    try:
        stepped(database, IDEAL, work, VirtualRig(wiring, Simulator(IDEAL, 0)))
    finally:
        release.set()
        database.close()


def test_the_drive_lockout_starts_before_waiting_requests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer waits for a start of the loop or a slow disk; the drives do not."""
    database = open_database(tmp_path)
    rig = VirtualRig(load_wiring("pcie-6323"), Simulator(IDEAL, 0))
    asked, release = threading.Event(), threading.Event()

    def slowly(*_arguments: Any) -> CommissioningResults:
        asked.set()
        assert release.wait(60.0)
        raise StorageError("the disk has failed")

    async def work(parts: Parts) -> None:
        start = asyncio.create_task(parts.actuator.restart_loop_with(lambda: None, "nothing new", "Ada"))
        while not asked.is_set():
            await asyncio.sleep(0.001)
        assert rig.card_state().drive_enabled
        off = asyncio.create_task(parts.actuator.switch_drives(False, "Bob"))
        while rig.card_state().drive_enabled:
            await asyncio.sleep(0.001)
            assert not off.done()
        release.set()
        with pytest.raises(StorageError):
            await start
        await off
        assert not rig.card_state().drive_enabled

    monkeypatch.setattr(actuator, "find_for_next_start", slowly)
    try:
        stepped(database, IDEAL, work, rig)
    finally:
        release.set()
        database.close()
