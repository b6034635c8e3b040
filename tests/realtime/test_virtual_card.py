"""The real control loop on the virtual card: faults of the card in real time, and a killed loop."""

import asyncio
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Accepted, Inject, Refused, Reset, SetMode, SwitchDrives
from backend.realtime.ipc import Setup
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.program import SetTuning
from backend.realtime.supervisor import Supervisor
from backend.sample import INDEX
from plant.calibration import wiring_fingerprint
from plant.interface import InjectedFault, InjectedFaultKind, PlantChoice, PlantKind
from plant.messages import timed_by_card
from plant.wiring import load_wiring
from tests.realtime.test_supervisor import TIMEOUT_S, loop_processes

pytestmark = pytest.mark.live

KILLS = 2
VIRTUAL = PlantChoice(PlantKind.VIRTUAL_CARD)
WIRINGS = Path(__file__).parents[2] / "plant" / "wirings"


def on(plant: PlantChoice, tuning: SetTuning) -> Supervisor:
    return Supervisor(Setup(plant=plant, parameters="ideal", seed=0, tuning=tuning))


async def until_off(supervisor: Supervisor) -> None:
    """Wait until no voltage reaches the motors, whatever the cause."""
    while (state := supervisor.card.state()).drive_enabled or (state.u_A, state.u_B) != (0.0, 0.0):
        await asyncio.sleep(0.005)


async def wound_up(supervisor: Supervisor) -> None:
    assert isinstance(await supervisor.send(SetMode(Mode.PRETENSION)), Accepted)
    await supervisor.advance_until(lambda: supervisor.card.state().u_A != 0.0, timeout_s=20.0)


def newest(supervisor: Supervisor, name: str) -> float:
    row = supervisor.ring.newest()
    assert row is not None
    return float(row[INDEX[name]])


def test_a_loop_that_is_killed_leaves_zero_volts_and_drives_off(tuning: SetTuning) -> None:
    async def session() -> None:
        supervisor = on(VIRTUAL, tuning)
        await supervisor.start()
        for _ in range(KILLS):
            await wound_up(supervisor)
            (loop,) = loop_processes()
            os.kill(loop, signal.SIGKILL)
            await until_off(supervisor)
            await supervisor.restart("for a test")
            assert supervisor.card.state().drive_enabled  # tried and enabled anew, at zero volts
            assert newest(supervisor, "u_A") == 0.0
        await supervisor.stop()
        await until_off(supervisor)

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))


def test_a_loop_started_during_a_drive_lockout_keeps_the_line_off_until_its_release(tuning: SetTuning) -> None:
    """The proof test of the watchdog starts only then, and takes its timeout: 0.5 s without a tick."""

    async def session() -> None:
        supervisor = Supervisor(Setup(plant=VIRTUAL, parameters="ideal", seed=0, tuning=tuning, drives_off=True))
        seen: list[bool] = []

        async def look() -> None:
            while True:
                seen.append(supervisor.card.state().drive_enabled)
                await asyncio.sleep(0.01)

        looking = asyncio.create_task(look())
        await supervisor.start()
        await supervisor.advance(0.1)
        looking.cancel()
        assert supervisor.started_with.wired == wiring_fingerprint(load_wiring(VIRTUAL.wiring))
        assert len(seen) > 10
        assert not any(seen)
        assert isinstance(await supervisor.send(SetMode(Mode.PRETENSION)), Refused)
        assert isinstance(await supervisor.send(SwitchDrives(on=True)), Accepted)
        assert supervisor.card.state().drive_enabled
        await supervisor.advance(0.1)
        assert newest(supervisor, "mode") == MODE_CODE[Mode.OFF]  # no fault of all that
        await wound_up(supervisor)
        await supervisor.stop()

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))


def test_the_watchdog_disables_the_drives_of_a_disconnected_card(tuning: SetTuning) -> None:
    """The loop runs but cannot write zero volts. After the card has returned, a reset is sufficient."""

    async def session() -> None:
        supervisor = on(VIRTUAL, tuning)
        await supervisor.start()
        await wound_up(supervisor)
        await supervisor.send(Inject(InjectedFault(InjectedFaultKind.DEVICE_GONE)))
        await supervisor.advance_until(lambda: newest(supervisor, "mode") == MODE_CODE[Mode.TRIPPED], timeout_s=20.0)
        assert newest(supervisor, "fault") == FAULT_CODE[Fault.PLANT_ERROR]
        await until_off(supervisor)
        assert supervisor.card.state().expired
        assert supervisor.is_alive
        await supervisor.send(Inject(None))
        while not isinstance(await supervisor.send(Reset()), Accepted):
            await supervisor.advance(0.01)
        assert supervisor.card.state().drive_enabled
        await supervisor.stop()

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))


def test_the_cards_clock_paces_a_loop_whose_wiring_asks_for_it(tuning: SetTuning, tmp_path: Path) -> None:
    shipped = (WIRINGS / "pcie-6323.toml").read_text(encoding="utf-8")
    wiring = tmp_path / "clocked.toml"
    wiring.write_text(shipped.replace('timing = "on-demand"', 'timing = "hardware"'), encoding="utf-8")

    async def session() -> None:
        supervisor = on(replace(VIRTUAL, wiring=str(wiring)), tuning)
        ready = await supervisor.start()
        assert timed_by_card() in supervisor.plant_description
        assert ready == supervisor.granted
        begun = supervisor.ring.count
        await supervisor.advance(0.3)
        _, rows, _ = supervisor.ring.read(begun, 300)
        assert np.array_equal(np.diff(rows[:, INDEX["tick"]]), np.ones(len(rows) - 1))
        assert rows[:, INDEX["lateness_s"]].max() > 0.0
        await supervisor.stop()

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))
