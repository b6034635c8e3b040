"""The real control loop: start, commands, kill, replacement, and its own stop when its service is killed."""

import asyncio
import os
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime import messages
from backend.realtime import supervisor as supervisor_module
from backend.realtime.commands import Accepted, Refused, SetMode, Stop, Stopped
from backend.realtime.heartbeat import HEARTBEAT_S
from backend.realtime.ipc import Setup
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.program import SetTuning
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import MAX_MISSED_BEATS, LoopExited, LoopExitedError, Supervisor
from backend.realtime.timing import compute_timing
from backend.sample import INDEX
from plant.interface import SIMULATOR, PlantChoice, PlantKind
from plant.messages import card_package_not_installed, driver_not_installed, wiring_unreadable
from plant.safety_card import WATCHDOG_S
from tests.reasons import assert_reason
from tests.refusals import refused

pytestmark = pytest.mark.live

SERVICE = Path(__file__).with_name("service_stand_in.py")
TIMEOUT_S = 120.0
NO_CARD = "|".join(re.escape(reason) for reason in (driver_not_installed(), card_package_not_installed()))
KILLED = messages.loop_killed(signal_name="SIGKILL")
HANGS = messages.loop_hangs(duration_s=MAX_MISSED_BEATS * HEARTBEAT_S)


@pytest.fixture
def setup(tuning: SetTuning) -> Setup:
    return Setup(plant=SIMULATOR, parameters="ideal", seed=0, tuning=tuning)


def loop_processes() -> set[int]:
    """PIDs of the control loops that this process has started and not yet reaped."""
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()
    found = set()
    for child in children:
        with suppress(OSError):
            if b"backend.realtime.process" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.add(int(child))
    return found


def test_start_command_kill_restart_hang_stop(setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    async def session() -> None:
        supervisor = Supervisor(setup)
        with refused(LoopExitedError, "loop_not_running", reason=messages.loop_never_started()):
            await supervisor.send(Stop())
        deaths: asyncio.Queue[LoopExited] = asyncio.Queue()
        events: list[object] = []
        supervisor.listen(lambda event: deaths.put_nowait(event) if isinstance(event, LoopExited) else None)
        supervisor.listen(events.append)

        granted = await supervisor.start()
        assert supervisor.granted == granted
        with refused(LoopExitedError, "loop_already_started"):
            await supervisor.start()
        answer = await supervisor.send(SetMode(Mode.RUN))
        assert isinstance(answer, Refused)
        assert answer.legal == (Mode.PRETENSION,)
        assert isinstance(await supervisor.send(SetMode(Mode.PRETENSION)), Accepted)
        await supervisor.advance(0.05)
        kept = compute_timing(supervisor.ring)
        assert 0 < kept.rate_Hz <= 1000.0 + 1e-6
        assert kept.lateness_p99_s >= kept.lateness_p50_s > 0

        # A service that stands still for longer than the loop has to answer: it has answered, and lives.
        with monkeypatch.context() as shorter:
            shorter.setattr(supervisor_module, "ANSWER_TIMEOUT_S", 0.1)
            asked = asyncio.create_task(supervisor.send(SetMode(Mode.RUN)))
            await asyncio.sleep(0)
            time.sleep(0.3)
            assert isinstance(await asked, Refused)
        was_alive = supervisor.is_alive
        assert was_alive

        (first,) = loop_processes()
        card = supervisor.card
        await supervisor.advance_until(lambda: card.state().u_A != 0.0, timeout_s=5.0)
        assert card.state().drive_enabled
        waiting = asyncio.create_task(supervisor.advance(3600.0))
        await asyncio.sleep(0)
        os.kill(first, signal.SIGKILL)
        assert_reason((await asyncio.wait_for(deaths.get(), TIMEOUT_S)).reason, "loop_killed", signal_name="SIGKILL")
        assert not supervisor.is_alive
        with refused(LoopExitedError, "loop_not_running", reason=KILLED):
            await asyncio.wait_for(waiting, TIMEOUT_S)
        with refused(LoopExitedError, "loop_not_running", reason=KILLED):
            await supervisor.send(Stop())
        # Nobody who could write zero volts is left but the card's watchdog.
        while not card.state().expired:
            await asyncio.sleep(0.01)
        assert (card.state().u_A, card.state().u_B, card.state().drive_enabled) == (0.0, 0.0, False)

        await supervisor.restart("for a test")
        (second,) = loop_processes()
        assert second != first
        newest = supervisor.ring.newest()
        assert newest is not None
        assert newest[INDEX["mode"]] == MODE_CODE[Mode.OFF]
        os.kill(second, signal.SIGSTOP)
        assert_reason((await asyncio.wait_for(deaths.get(), TIMEOUT_S)).reason, "loop_ended_for_reason", reason=HANGS)

        await supervisor.restart("for a test")
        await supervisor.send(SetMode(Mode.PRETENSION))
        await supervisor.advance(0.2)
        events.clear()
        await supervisor.stop()
        assert any(isinstance(event, Stopped) and not event.hard for event in events)
        assert deaths.empty()
        assert loop_processes() == set()
        last = supervisor.ring.newest()
        assert last is not None
        assert (last[INDEX["u_A"]], last[INDEX["u_B"]]) == (0.0, 0.0)
        await supervisor.stop()

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))


def test_a_planned_restart_and_end_without_voltages_are_no_trip(setup: Setup) -> None:
    """A loop in mode off has nothing to stop; a loop whose motors pull is brought to rest first."""

    async def session() -> None:
        supervisor = Supervisor(setup)
        heard: list[object] = []
        supervisor.listen(heard.append)
        await supervisor.start()
        before = supervisor.ring
        restarting = asyncio.create_task(supervisor.restart("with other parameters"))
        while supervisor.is_alive:
            await asyncio.sleep(0)
        assert getattr(supervisor.restarting, "purpose", "") == "with other parameters"
        await restarting
        assert supervisor.restarting is None
        assert not np.any(before.rows[: before.count, INDEX["fault"]])
        await supervisor.stop()
        last = supervisor.ring.newest()
        assert last is not None
        assert last[INDEX["fault"]] == FAULT_CODE[Fault.NONE]
        assert not [event for event in heard if isinstance(event, Stopped | LoopExited)]

        await supervisor.start()
        await supervisor.send(SetMode(Mode.PRETENSION))
        await supervisor.advance(0.2)
        await supervisor.restart("while the motors pull")
        assert [event.fault for event in heard if isinstance(event, Stopped)] == [Fault.SERVICE_ENDED]
        await supervisor.stop()

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))


def test_the_service_clears_the_outputs_when_watchdog_and_loop_are_both_dead(setup: Setup) -> None:
    """The last protection on the simulator; a reset starts and proof-tests a new watchdog before the drives go on."""

    async def session() -> None:
        supervisor = Supervisor(setup)
        await supervisor.start()
        await supervisor.send(SetMode(Mode.PRETENSION))
        card = supervisor.card
        await supervisor.advance_until(lambda: card.state().u_A != 0.0, timeout_s=5.0)
        (worker,) = loop_processes()
        children = Path(f"/proc/{worker}/task/{worker}/children").read_text(encoding="ascii").split()
        (watchdog,) = (
            int(child) for child in children if b"plant.safety_card" in Path(f"/proc/{child}/cmdline").read_bytes()
        )
        os.kill(watchdog, signal.SIGKILL)
        os.kill(worker, signal.SIGKILL)
        killed_s = time.monotonic()
        assert card.state().u_A != 0.0
        while card.state().drive_enabled:
            assert time.monotonic() - killed_s < 20.0, "the voltage stays on the motors"
            await asyncio.sleep(0.01)
        assert (card.state().u_A, card.state().u_B) == (0.0, 0.0)
        assert "watchdog" in supervisor.watchdog_monitor.problem
        await supervisor.restart("for a test")
        assert supervisor.watchdog_monitor.problem == ""
        assert supervisor.card is not card
        assert supervisor.card.state().drive_enabled
        assert not supervisor.watchdog_monitor.is_watchdog_lost
        await supervisor.stop()
        assert not supervisor.card.state().drive_enabled

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))


@pytest.mark.parametrize(
    ("plant", "parameters", "reason"),
    [
        (SIMULATOR, "no-such-set", "no-such-set"),
        (PlantChoice(PlantKind.RIG), "ideal", NO_CARD),
        (PlantChoice(PlantKind.RIG, wiring="no-such-file"), "ideal", f"no-such-file: file: {wiring_unreadable()}"),
    ],
)
def test_a_loop_that_cannot_start_reports_the_reason(
    setup: Setup, plant: PlantChoice, parameters: str, reason: str
) -> None:
    async def session() -> None:
        supervisor = Supervisor(replace(setup, plant=plant, parameters=parameters))
        with pytest.raises(LoopExitedError, match=reason):
            await supervisor.start()
        assert not supervisor.is_alive
        assert loop_processes() == set()
        await supervisor.stop()

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))


def test_a_slow_start_is_no_fault(setup: Setup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a busy machine: garbage collection takes longer than the timeout of the card's watchdog."""
    (tmp_path / "sitecustomize.py").write_text(f"import gc, time\ngc.collect = lambda: time.sleep({2 * WATCHDOG_S})\n")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:.")

    async def session() -> None:
        supervisor = Supervisor(setup)
        await supervisor.start()
        await supervisor.advance(0.05)
        newest = supervisor.ring.newest()
        await supervisor.stop()
        assert newest is not None
        assert newest[INDEX["fault"]] == FAULT_CODE[Fault.NONE]

    asyncio.run(session())


def test_a_killed_service_leaves_a_stopped_loop_with_zero_volts() -> None:
    """The service is killed during pretension; the control loop brings the joint to rest and ends."""
    service = subprocess.Popen([sys.executable, str(SERVICE)], stdout=subprocess.PIPE, text=True, env=_with_root())
    assert service.stdout is not None
    try:
        worker, ring_fd = map(int, service.stdout.readline().split())
        ring = Ring.attach(os.open(f"/proc/{worker}/fd/{ring_fd}", os.O_RDWR))
        end_of_worker = os.pidfd_open(worker)
        moving = ring.newest()
        assert moving is not None
        assert moving[INDEX["u_A"]] != 0.0
    finally:
        service.kill()
        service.wait()
        service.stdout.close()
    ended, _, _ = select.select([end_of_worker], [], [], TIMEOUT_S)
    os.close(end_of_worker)
    assert ended, "the loop process outlived its service"
    _, rows, _ = ring.read(0, ring.capacity)
    assert np.any(rows[:, INDEX["mode"]] == MODE_CODE[Mode.STOPPING])
    assert rows[-1, INDEX["mode"]] == MODE_CODE[Mode.TRIPPED]
    assert rows[-1, INDEX["fault"]] == FAULT_CODE[Fault.SERVICE_LOST]
    assert (rows[-1, INDEX["u_A"]], rows[-1, INDEX["u_B"]]) == (0.0, 0.0)
    ring.close()


def _with_root() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
