"""Pretension and trip of the safety module: invalid readings and other stops do not pass."""

import asyncio
import math

import numpy as np
import pytest

from backend.commissioning.procedure import Rows, StepFinding
from backend.commissioning.procedures import (
    DRIVEN_MIN_V,
    TURNED_BACK_MIN_RAD,
    compute_peaks,
    find_uncut_drive,
    has_tension_fallen,
    is_near_pretension,
)
from backend.commissioning.steps import StepId
from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Accepted, Refused, SetMode, SimulateManualInput, Stop, TryModule
from backend.realtime.modes import MODE_CODE, Mode
from backend.sample import INDEX
from plant.interface import InjectedFault, InjectedFaultKind, MotorCommand, Sensor
from plant.manual_input import ManualInput
from tests.commissioning.rigs import CommissionedRig, played

NAN = math.nan


@pytest.mark.parametrize("F", [(NAN, 10.0), (10.0, NAN), (NAN, NAN)])
def test_no_number_is_neither_the_pretension_nor_a_tendon_let_go_nor_within_bounds(F: tuple[float, float]) -> None:
    held = np.array([10.0, 10.0])
    assert is_near_pretension(held)
    assert not is_near_pretension(np.array(F))
    assert has_tension_fallen(held, np.array([2.0, 2.0]))
    assert not has_tension_fallen(held, np.array(F) - 8.0)
    assert (
        find_uncut_drive(
            2.0 * np.array([DRIVEN_MIN_V, DRIVEN_MIN_V]), -2.0 * np.array([TURNED_BACK_MIN_RAD, TURNED_BACK_MIN_RAD])
        )
        == ""
    )
    assert find_uncut_drive(np.array(F), held - 20.0) != ""
    assert find_uncut_drive(held, np.array(F) - 20.0) != ""
    highest, apart = compute_peaks(np.array([held, F]))
    assert math.isnan(highest)
    assert math.isnan(apart)


def test_a_load_cell_that_is_lost_at_the_trip_has_not_seen_the_motors_let_go() -> None:
    rig = CommissionedRig()

    def lose(phase: str) -> None:
        if phase == "waiting for the trip":
            rig.rig.inject(InjectedFault(InjectedFaultKind.SATURATION, Sensor.F_B))

    async def mend(words: str) -> None:
        if "Set the module's limit back" in words:
            rig.rig.inject(None)

    rig.in_phase, rig.meanwhile = lose, mend
    (finding,) = played(rig, StepId.SAFETY_MODULE)
    assert not finding.passed, finding.text


def test_a_loop_that_stopped_for_another_reason_is_not_reset() -> None:
    """A person presses STOP while the step waits for the module."""
    rig = CommissionedRig()

    async def press(words: str) -> None:
        if "Lower the tension limit" in words:
            await rig.loop.send(Stop(Fault.STOP_PRESSED))

    rig.meanwhile = press

    async def work() -> tuple[StepFinding, Mode]:
        finding = await rig.do(StepId.SAFETY_MODULE)
        await rig.loop.advance(0.01)
        return finding, rig.mode

    try:
        finding, mode = asyncio.run(work())
    finally:
        rig.loop.close()
    assert not finding.passed
    assert "not because of the safety module" in finding.text
    assert mode is Mode.TRIPPED
    assert not any("Set the module's limit back" in words for words in rig.asked)


@pytest.mark.parametrize(("cuts", "named"), [((False, False), "motor A"), ((True, False), "motor B")])
def test_a_module_that_signals_but_does_not_cut_is_found(cuts: tuple[bool, bool], named: str) -> None:
    """Zero volts from the loop release the motors as well, so only the time before that counts."""
    rig = CommissionedRig()
    rig.simulator.module_cuts = cuts
    tripped_at: list[float] = []
    write = rig.rig.write

    def watched(command: MotorCommand) -> None:
        write(command)
        newest = rig.loop.ring.newest()
        if rig.rig.card_state().safety_tripped and not tripped_at and newest is not None:
            tripped_at.append(newest[INDEX["tick"]] + 1)

    rig.rig.write = watched  # type: ignore[method-assign]  # when it trips is in no sample

    async def work() -> tuple[StepFinding, Rows]:
        first = rig.loop.ring.count
        finding = await rig.do(StepId.SAFETY_MODULE)
        await rig.loop.advance(0.01)
        return finding, rig.loop.ring.read(first, rig.loop.ring.capacity)[1]

    try:
        finding, rows = asyncio.run(work())
        assert rig.mode is Mode.TRIPPED
    finally:
        rig.loop.close()
    assert not finding.passed
    assert f"{named} did not let go" in finding.text
    # It was driven for 0.3 s after the trip and not longer, with little voltage.
    stopped = int(np.argmax(rows[:, INDEX["mode"]] == MODE_CODE[Mode.TRIPPED]))
    assert rows[stopped, INDEX["tick"]] - tripped_at[0] == pytest.approx(300, abs=2)
    volts = rows[:, [INDEX["u_A"], INDEX["u_B"]]]
    assert np.abs(volts[stopped - 300 : stopped]).max() <= 1.0
    assert not volts[stopped:].any()
    assert rows[:, [INDEX["F_A"], INDEX["F_B"]]].max() < 13.0


def test_the_other_checks_are_armed_while_the_loop_goes_on_to_command() -> None:
    rig = CommissionedRig()

    async def work() -> tuple[Refused, float, float]:
        await rig.loop.advance(0.01)
        early = await rig.loop.send(TryModule())
        assert isinstance(early, Refused)
        await rig.loop.send(SetMode(Mode.PRETENSION))
        await rig.loop.advance(12.0)
        assert isinstance(await rig.loop.send(TryModule()), Accepted)
        await rig.loop.send(SimulateManualInput(ManualInput(F_limit=5.0)))
        await rig.loop.advance(0.1)
        assert rig.mode is Mode.PRETENSION
        assert rig.rig.card_state().safety_tripped
        assert rig.rig.card_state().u_A > 0.0
        rig.rig.inject(InjectedFault(InjectedFaultKind.JUMP, Sensor.Q))
        await rig.loop.advance(0.002)
        newest = rig.loop.ring.newest()
        assert newest is not None
        return early, newest[INDEX["fault"]], newest[INDEX["u_A"]]

    try:
        early, fault, u_A = asyncio.run(work())
    finally:
        rig.loop.close()
    assert "both tendons hold the pretension" in early.reason
    assert fault == FAULT_CODE[Fault.SENSOR_JUMP]
    assert u_A == 0.0
