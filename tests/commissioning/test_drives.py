"""While people work at the rig, its drives are off and no motion starts, until a person switches the drives on."""

import asyncio

import pytest
from nidaqmx.error_codes import DAQmxErrors

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
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment
from plant.interface import InjectedFaultKind
from plant.safety_card import CardState
from plant.virtual_daq import CardError
from tests.commissioning.rigs import CommissionedRig

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


def test_motors_are_turned_by_hand_without_drives_and_tried_with_them() -> None:
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


def test_no_hand_is_asked_for_while_the_line_does_not_fall() -> None:
    rig = CommissionedRig()
    rig.rig.card.faults.enable_held = True

    async def work() -> None:
        finding = await rig.do(StepId.WIRING_TEST)
        assert not finding.passed
        assert "drive-enable line did not go off" in finding.text
        assert rig.asked == []
        # Nobody knows about the drives: nothing starts.
        assert isinstance(await rig.loop.send(SetMode(Mode.PRETENSION)), Refused)

    run(rig, work())


def test_a_line_that_cannot_be_read_back_is_not_left_on(monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_to_switch_the_drives_off_is_refused_in_no_mode(moving: bool) -> None:
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
