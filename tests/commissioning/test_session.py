"""The drive lockout: drives that stay off, also after a restart."""

import asyncio
from contextlib import closing, suppress
from pathlib import Path

import pytest
from nidaqmx.error_codes import DAQmxErrors

from backend.commissioning.session import DriveLockout, switch_drives
from backend.commissioning.steps import StepId
from backend.faults import Fault
from backend.realtime.commands import (
    Accepted,
    Command,
    Home,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    Stop,
    SwitchDrives,
    TryMotor,
)
from backend.realtime.gains import make_tuning_command
from backend.realtime.ipc import Setup
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment, SetTuning
from backend.realtime.supervisor import LoopExitedError, Supervisor
from backend.storage.database import open_database
from backend.tuning.gains import TuningParameters
from plant.interface import SIMULATOR, InjectedFaultKind, PlantChoice, PlantKind
from plant.message import Message
from plant.messages import drive_enable_not_switched
from plant.parameters import load_parameters
from plant.safety_card import CardState
from plant.virtual_daq import CardError
from tests.commissioning.rigs import CommissionedRig

# While people work at the rig, its drives are off and no motion starts, until a person switches the drives on.

BY_HAND = (StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.ZERO)
STARTING: tuple[Command, ...] = (
    SetMode(Mode.PRETENSION),
    TryMotor("A"),
    Home(0.9),
    RunProgram(Program(Law.CASCADE, (Segment(duration_s=0.1, q_ref=0.0, S_ref=0.5),))),
)


@pytest.mark.parametrize("step", BY_HAND)
def test_the_drives_are_off_during_manual_actions_and_nothing_starts(step: StepId) -> None:
    rig = CommissionedRig()
    seen: list[CardState] = []
    refused: list[bool] = []

    async def look(_words: str) -> None:
        seen.append(rig.rig.card_state())
        refused.extend([isinstance(await rig.loop.send(command), Refused) for command in STARTING])

    async def work() -> None:
        await rig.loop.advance(0.01)
        assert rig.rig.unready == ""  # wired as it says: without the drives it would start
        assert rig.rig.card_state().drive_enabled
        rig.meanwhile = look
        finding = await rig.do(step)
        assert finding.passed, finding.text
        # Over, and still off: whoever is at the rig is not to be surprised.
        assert not rig.rig.card_state().drive_enabled
        assert isinstance(await rig.loop.send(SetMode(Mode.PRETENSION)), Refused)
        assert isinstance(await rig.loop.send(SwitchDrives(on=True)), Accepted)
        assert rig.rig.card_state().drive_enabled
        assert isinstance(await rig.loop.send(SetMode(Mode.PRETENSION)), Accepted)

    run(rig, work())
    assert seen
    assert not any(card.drive_enabled or card.expired for card in seen)
    assert all(refused)


def test_motors_are_turned_by_hand_without_drives_and_tested_with_them() -> None:
    rig = CommissionedRig()
    seen: list[bool] = []

    async def look(_words: str) -> None:
        seen.append(rig.rig.card_state().drive_enabled)

    async def work() -> None:
        rig.meanwhile = look
        assert (await rig.do(StepId.DIRECTION)).passed

    run(rig, work())
    assert seen == [False]
    assert rig.rig.card_state().drive_enabled is False  # the rig is let go of


def test_manual_actions_are_not_requested_while_the_line_stays_on() -> None:
    rig = CommissionedRig()
    rig.rig.card.faults.enable_held = True

    async def work() -> None:
        finding = await rig.do(StepId.WIRING_TEST)
        assert not finding.passed
        assert drive_enable_not_switched(on=False) in finding.text
        assert rig.asked == []
        # Nobody knows about the drives: nothing starts.
        assert isinstance(await rig.loop.send(SetMode(Mode.PRETENSION)), Refused)

    run(rig, work())


def test_an_unreadable_drive_enable_line_is_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = CommissionedRig()
    faults = rig.rig.card.faults

    def lost(method: str) -> None:
        if method == "ReadDigitalLines":
            raise CardError(DAQmxErrors.DEV_CANNOT_BE_ACCESSED, "the cable was pulled")

    async def work() -> None:
        monkeypatch.setattr(faults, "refuse", lost)
        assert isinstance(await rig.loop.send(SwitchDrives(on=False)), Accepted)
        faults.kind = InjectedFaultKind.DEVICE_GONE  # of it, only that no line is read
        refused = await rig.loop.send(SwitchDrives(on=True))
        assert isinstance(refused, Refused)
        assert "cable was pulled" in refused.reason
        assert not rig.rig.card_state().drive_enabled
        faults.kind = None
        assert isinstance(await rig.loop.send(SwitchDrives(on=True)), Accepted)
        assert rig.rig.card_state().drive_enabled

    run(rig, work())


def test_a_reset_leaves_the_drives_off() -> None:
    rig = CommissionedRig()

    async def work() -> None:
        await rig.loop.advance(0.01)
        assert isinstance(await rig.loop.send(SwitchDrives(on=False)), Accepted)
        await rig.loop.send(Stop(Fault.STOP_PRESSED))
        await rig.loop.advance(0.01)
        assert isinstance(await rig.loop.send(SwitchDrives(on=True)), Refused)
        assert isinstance(await rig.loop.send(Reset()), Accepted)
        await rig.loop.advance(0.01)
        assert rig.mode is Mode.OFF
        assert not rig.rig.card_state().drive_enabled
        assert isinstance(await rig.loop.send(SetMode(Mode.PRETENSION)), Refused)

    run(rig, work())


@pytest.mark.parametrize("moving", [False, True], ids=["tripped", "winding up"])
def test_the_drives_can_be_switched_off_in_every_mode(moving: bool) -> None:
    rig = CommissionedRig()

    async def work() -> None:
        await rig.loop.advance(0.01)
        assert isinstance(await rig.loop.send(SetMode(Mode.PRETENSION)), Accepted)
        await rig.loop.advance(0.3)
        assert rig.rig.card_state().u_A != 0.0
        if not moving:
            await rig.loop.send(Stop(Fault.FORCE_LIMIT))
            await rig.loop.advance(0.01)
            assert rig.rig.card_state().drive_enabled
        assert isinstance(await rig.loop.send(SwitchDrives(on=False)), Accepted)
        assert not rig.rig.card_state().drive_enabled
        await rig.loop.advance(0.01)
        assert rig.mode is Mode.TRIPPED
        assert (rig.rig.card_state().u_A, rig.rig.card_state().u_B) == (0.0, 0.0)
        assert isinstance(await rig.loop.send(Reset()), Accepted)
        await rig.loop.advance(0.01)
        assert not rig.rig.card_state().drive_enabled
        assert isinstance(await rig.loop.send(SetMode(Mode.PRETENSION)), Refused)

    run(rig, work())


def run(rig: CommissionedRig, work: object) -> None:
    assert asyncio.iscoroutine(work)
    try:
        asyncio.run(work)
    finally:
        rig.loop.close()


# The drive lockout is stored for the next start of the service, separately for each rig.

RIG, VIRTUAL = PlantChoice(PlantKind.RIG), PlantChoice(PlantKind.VIRTUAL_CARD)


@pytest.fixture(scope="module")
def tuning() -> SetTuning:
    return make_tuning_command(load_parameters("ideal"), TuningParameters())


def test_the_lockout_is_known_after_a_restart_until_it_is_released(tmp_path: Path) -> None:
    def left(plant: PlantChoice) -> str:
        with closing(open_database(tmp_path)) as database:
            lockout = DriveLockout(database, plant).previous_lock
            return "" if lockout is None else lockout.who

    def said(plant: PlantChoice, is_locked: bool, who: str) -> None:
        with closing(open_database(tmp_path)) as database:
            lockout = DriveLockout(database, plant)
            asyncio.run(lockout.store(is_locked, who))
            assert (lockout.previous_lock, lockout.problem) == (
                None,
                "",
            )  # it was in this run of the service, and the page shows it

    assert left(RIG) == ""
    said(RIG, True, "Ada")
    assert left(RIG) == "Ada"
    assert left(VIRTUAL) == left(SIMULATOR) == ""
    said(VIRTUAL, True, "Bob")
    said(VIRTUAL, False, "Bob")  # to practise says nothing of the rig
    assert left(RIG) == "Ada"
    said(RIG, False, "Cleo")
    assert left(RIG) == ""


def test_a_lockout_that_cannot_be_stored_is_reported(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    lockout = DriveLockout(database, RIG)
    for file in tmp_path.iterdir():
        file.unlink()
    tmp_path.rmdir()
    database.close()
    asyncio.run(lockout.store(True, "Ada"))
    assert isinstance(lockout.problem, Message)
    assert (lockout.problem.code, lockout.problem.values["state"]) == ("lockout_not_stored", "off")


class NeverAnswers(Supervisor):
    """A loop that never replies to a command."""

    async def send(self, command: Command) -> Accepted | Refused:
        return await asyncio.Future()


def test_a_lockout_is_stored_without_a_reply_of_the_loop(tmp_path: Path, tuning: SetTuning) -> None:
    async def given_up(on: bool) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(switch_drives(supervisor, DriveLockout(database, RIG), on, "Ada"), 0.05)

    with closing(open_database(tmp_path)) as database:
        supervisor = NeverAnswers(Setup(RIG, "ideal", 0, tuning))
        asyncio.run(given_up(False))
        assert DriveLockout(database, RIG).previous_lock is not None
        asyncio.run(given_up(True))  # not known whether they came on: hands may be is_locked
        assert DriveLockout(database, RIG).previous_lock is not None
        supervisor.ring.close()


def test_without_a_loop_the_drives_can_only_be_switched_off(tmp_path: Path, tuning: SetTuning) -> None:
    """They are off already, and the next loop starts with locked drives."""
    with closing(open_database(tmp_path)) as database:
        supervisor, lockout = Supervisor(Setup(RIG, "ideal", 0, tuning)), DriveLockout(database, RIG)
        asyncio.run(switch_drives(supervisor, lockout, False, "Ada"))
        assert supervisor.setup.drives_off
        assert DriveLockout(database, RIG).previous_lock is not None
        with pytest.raises(LoopExitedError):
            asyncio.run(switch_drives(supervisor, lockout, True, "Ada"))
        assert DriveLockout(database, RIG).previous_lock is not None
        supervisor.ring.close()
