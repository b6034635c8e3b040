"""The control loop: silence and loss of the service, late results, and the drive lockout."""

import asyncio
import socket
import time
from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime import messages, process
from backend.realtime.channel import MAX_BYTES
from backend.realtime.commands import (
    Accepted,
    Command,
    Heartbeat,
    ModeChanged,
    PretensionReached,
    ReadinessChanged,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    Shutdown,
    Stop,
    Stopped,
    SwitchDrives,
)
from backend.realtime.ipc import PART_SEGMENTS, Ready, Setup, ToLoop, decode_to_loop, encode, packets
from backend.realtime.modes import LEGAL, Mode
from backend.realtime.process import BYTES_PER_TICK
from backend.realtime.program import MAX_SEGMENTS, Law, Program, Segment, SetTuning
from backend.realtime.supervisor import Supervisor, wait_for_result
from backend.realtime.timing import RealTimeStatus
from plant.interface import PlantChoice, PlantKind
from plant.parameters import PlantParameters
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring
from tests.docs.faults_page import documented_ms
from tests.realtime.worker_bench import Bench

# The loop process decides by itself when the service is silent or gone: stepped here on a clock of its own.

MS = 1_000_000


@pytest.fixture
def bench_worker(ideal: PlantParameters, tuning: SetTuning) -> Iterator[Bench]:
    made = Bench(ideal, tuning)
    yield made
    made.service.close()
    made.ring.close()


def test_service_gone_while_moving_ends_in_zero_volts(bench_worker: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench_worker.say(SetMode(Mode.PRETENSION), 1)
        if tick == 300:
            bench_worker.service.close()
        elif tick < 300 and tick % 100 == 0:
            bench_worker.say(Heartbeat())

    bench_worker.run(service)
    u_A, fault = bench_worker.column("u_A"), bench_worker.column("fault")
    assert np.any(u_A[:300] != 0)
    assert fault[299] == 0
    assert fault[301] == FAULT_CODE[Fault.SERVICE_LOST]
    assert (u_A[-1], bench_worker.column("u_B")[-1]) == (0.0, 0.0)


def test_silence_causes_a_latched_soft_stop_within_half_a_second(bench_worker: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench_worker.say(SetMode(Mode.PRETENSION), 1)
        if tick == 1500:
            # The service is back: what it finds is latched, and the loop obeys again.
            bench_worker.say(SetMode(Mode.RUN), 2)
            bench_worker.say(Shutdown(), 3)
        elif tick <= 200 and tick % 100 == 0:
            bench_worker.say(Heartbeat())

    bench_worker.run(service)
    stops = np.flatnonzero(bench_worker.column("fault") == FAULT_CODE[Fault.SERVICE_LOST])
    assert 300 < stops[0] - 200 <= 400
    assert stops[-1] == bench_worker.ring.count - 1
    events = bench_worker.hear()
    assert sum(isinstance(event, Stopped) for event in events) == 1
    assert any(isinstance(event, Refused) and event.sequence == 2 for event in events)
    assert Accepted(3, 1500) in events


def test_a_moving_joint_stops_within_half_a_second_of_the_last_heartbeat(bench_worker: Bench) -> None:
    last_word = 0

    def service(tick: int) -> None:
        nonlocal last_word
        if tick == 0:
            bench_worker.say(SetMode(Mode.PRETENSION), 1)
        if any(isinstance(event, PretensionReached) for event in bench_worker.hear()) and not last_word:
            bench_worker.say(SetMode(Mode.RUN), 2)
            bench_worker.say(SetReferences(1.2, 12.0), 3)
            last_word = tick + 700
        if last_word and tick > last_word + 1500:
            bench_worker.say(Shutdown(), 4)
        elif (not last_word or tick <= last_word) and tick % 50 == 0:
            bench_worker.say(Heartbeat())

    bench_worker.run(service)
    heard = last_word - last_word % 50
    q_dot = bench_worker.column("q_dot")
    latched = int(np.argmax(bench_worker.column("fault") == FAULT_CODE[Fault.SERVICE_LOST]))
    assert 0 < latched - heard <= documented_ms(Fault.SERVICE_LOST)
    assert abs(q_dot[heard]) > 0.5
    assert np.max(np.abs(q_dot[heard + 500 :])) < 0.05 * abs(q_dot[heard])
    assert (bench_worker.column("u_A")[-1], bench_worker.column("u_B")[-1]) == (0.0, 0.0)


def test_silence_at_rest_is_no_fault(bench_worker: Bench) -> None:
    bench_worker.run(lambda tick: bench_worker.say(Shutdown()) if tick == 2000 else None)
    assert not np.any(bench_worker.column("fault"))


def test_a_pause_of_the_whole_machine_is_not_silence(bench_worker: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench_worker.say(SetMode(Mode.PRETENSION), 1)
        if tick == 600:
            bench_worker.say(Shutdown(), 2)
        elif tick % 100 == 0:
            bench_worker.say(Heartbeat())
        if tick in (50, 150, 250, 350):
            bench_worker.now_ns += 15 * MS

    bench_worker.run(service)
    assert not np.any(bench_worker.column("fault"))
    assert bench_worker.column("overruns")[-1] == 4 * 14


def test_malformed_and_late_messages_are_rejected_with_their_number(bench_worker: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench_worker.service.send(b'{"kind":"SetMode","sequence":4,"body":{"mode":"warp"}}')
            bench_worker.say(bench_worker.setup, 5)
        if tick == 3:
            bench_worker.service.send(b'{"kind":"SetMode","sequence":6,"body":{"mode":"warp"}}')
            bench_worker.say(Shutdown(), 7)

    bench_worker.run(service)
    refusals = [event for event in bench_worker.hear() if isinstance(event, Refused)]
    assert [(refusal.sequence, refusal.tick) for refusal in refusals] == [(4, 0), (5, 0), (6, 3)]
    assert "mode" in refusals[0].reason
    assert not any(isinstance(event, ModeChanged) for event in bench_worker.hear())


def a_program(segments: int) -> RunProgram:
    """So many segments, every number with all its digits."""
    return RunProgram(
        Program(
            Law.CASCADE,
            tuple(
                Segment(0.1234567890123, 0.4 + 1e-9 * position / 3.0, 10.123456789012345, 1e-9 / (position + 3.0))
                for position in range(segments)
            ),
        ),
        run=5,
    )


def test_the_longest_program_is_decoded_in_many_ticks(bench_worker: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The work of one tick is bounded, and the program is complete when it runs."""
    decoded: dict[int, int] = {}

    def counting(packet: bytes) -> tuple[int, ToLoop]:
        tick = bench_worker.ring.count
        decoded[tick] = decoded.get(tick, 0) + len(packet)
        return decode_to_loop(packet)

    monkeypatch.setattr(process, "decode_to_loop", counting)
    program = a_program(MAX_SEGMENTS)
    reached: list[int] = []

    def service(tick: int) -> None:
        if tick == 0:
            bench_worker.say(SetMode(Mode.PRETENSION), 1)
        if tick % 100 == 50:
            bench_worker.say(Heartbeat())
        if not reached and any(isinstance(event, PretensionReached) for event in bench_worker.hear()):
            reached.append(tick)
            for packet in packets(program, 2):
                assert bench_worker.service.send(packet)
        if reached and tick == reached[0] + 700:
            bench_worker.say(Shutdown(), 3)

    bench_worker.run(service)
    accepted = [event for event in bench_worker.hear() if isinstance(event, Accepted) and event.sequence == 2]
    assert len(accepted) == 1
    assert accepted[0].tick <= reached[0] + len(packets(program, 2)) + 4  # a packet in each tick, in turn
    assert max(decoded.values()) <= BYTES_PER_TICK + MAX_BYTES
    assert sum(decoded.values()) > 100_000
    q_ref, run = bench_worker.column("q_ref"), bench_worker.column("run")
    played = np.unique(q_ref[run == 5])
    expected = [segment.q_ref for segment in program.program.segments]
    assert len(played) >= 5
    np.testing.assert_array_equal(played, expected[: len(played)])


def test_a_program_with_a_missing_packet_is_rejected_and_the_next_is_accepted(bench_worker: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            _, *others = packets(a_program(200), 7)
            for packet in others:
                bench_worker.service.send(packet)
        if tick == 10:
            bench_worker.service.send(packets(a_program(200), 8)[0])  # the rest never comes
        if tick == 20:
            for packet in packets(a_program(200), 9):
                bench_worker.service.send(packet)
        if tick == 40:
            bench_worker.say(Shutdown(), 10)

    bench_worker.run(service)
    reasons = {event.sequence: event.reason for event in bench_worker.hear() if isinstance(event, Refused)}
    assert reasons[7] == messages.program_parts_missing(parts="segments", arrived=200 - PART_SEGMENTS, expected=200)
    assert 8 not in reasons
    off = messages.mode_change_not_legal(current=Mode.OFF, wanted=Mode.EXPERIMENT, legal=LEGAL[Mode.OFF])
    assert reasons[9] == off, "the whole program came to the loop, which is off"


def test_an_unknown_command_is_rejected(bench_worker: Bench) -> None:
    told = []
    loop = bench_worker.worker._loop
    loop.handle(4, cast(Command, object()))
    told += loop.drain_events()
    assert [(type(event), event.sequence) for event in told if isinstance(event, Accepted | Refused)] == [(Refused, 4)]
    bench_worker.worker.terminate()


def test_a_burst_of_commands_is_spread_over_ticks_in_order(bench_worker: Bench) -> None:
    """Four per tick, whatever their size: forty at once would make the tick late."""

    def service(tick: int) -> None:
        if tick == 5:
            for sequence in range(1, 11):
                bench_worker.say(SetMode(Mode.RUN), sequence)
        if tick == 20:
            bench_worker.say(Shutdown(), 11)

    bench_worker.run(service)
    answers = [(event.sequence, event.tick) for event in bench_worker.hear() if isinstance(event, Refused)]
    assert answers == [(sequence, 5 + (sequence - 1) // 4) for sequence in range(1, 11)]


def test_events_are_buffered_while_the_service_does_not_read(bench_worker: Bench) -> None:
    """More events than the socket holds: none is lost, and no tick waits for them."""
    sent = 0

    def service(tick: int) -> None:
        nonlocal sent
        if tick < 2000:
            bench_worker.say(SetMode(Mode.RUN), tick)
            sent += 1
        else:
            bench_worker.hear()
        if tick == 2010:
            bench_worker.say(Shutdown(), 9999)

    bench_worker.worker.queue_message(Ready(RealTimeStatus(0, False, 0, ()), "simulator"))
    bench_worker.run(service)
    numbers = [event.sequence for event in bench_worker.hear() if isinstance(event, Refused)]
    assert isinstance(bench_worker.told[0], Ready)
    assert numbers == list(range(sent))


def test_sigterm_ends_the_loop_after_the_tick(bench_worker: Bench) -> None:
    bench_worker.run(lambda tick: bench_worker.worker.terminate() if tick == 5 else None)
    assert bench_worker.ring.count == 6


# A result that came while the event loop stood still counts, on every version of Python.


def test_a_heartbeat_in_the_socket_counts_after_a_stall_beyond_the_timeout() -> None:
    ours, theirs = socket.socketpair()
    ours.setblocking(False)

    async def session() -> bytes:
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[bytes] = loop.create_future()
        loop.add_reader(ours, lambda: answer.set_result(ours.recv(10)))
        waiting = asyncio.create_task(wait_for_result(answer, 0.05))
        await asyncio.sleep(0)
        theirs.send(b"answer")
        time.sleep(0.2)  # the service stands still
        try:
            return await waiting
        finally:
            loop.remove_reader(ours)

    with ours, theirs:
        assert asyncio.run(session()) == b"answer"


def test_a_stall_without_a_heartbeat_is_a_timeout() -> None:
    async def session() -> None:
        await wait_for_result(asyncio.get_running_loop().create_future(), 0.01)

    with pytest.raises(TimeoutError):
        asyncio.run(session())


# A loop that ends while hands are at the rig hands its lock of the drives on to the next one.

VIRTUAL = PlantChoice(PlantKind.VIRTUAL_CARD)


def life(
    setup: Setup, parameters: PlantParameters, tuning: SetTuning, *orders: Command
) -> tuple[Setup, list[object], list[bool]]:
    """Run one control loop that starts with ``setup`` and receives one of ``orders`` per tick.

    Return the setup for the next loop, its events, and the drive-enable line at each tick.
    """
    rig = VirtualRig(load_wiring("pcie-6323"), Simulator(parameters, 0))
    _, received = decode_to_loop(encode(setup))
    assert isinstance(received, Setup)
    bench = Bench(parameters, tuning, rig, drives_off=received.drives_off)
    line: list[bool] = []

    def service(tick: int) -> None:
        line.append(rig.card_state().drive_enabled)
        if tick < len(orders):
            bench.say(orders[tick], tick + 1)
        if tick == len(orders) + 1:
            bench.say(Shutdown(), 99)

    bench.run(service)
    told = bench.hear()
    supervisor = Supervisor(setup)
    for message in told:
        supervisor._take(message)  # type: ignore[arg-type]  # what decode_from_loop gave
    supervisor.ring.close()
    bench.service.close()
    bench.ring.close()
    return supervisor.setup, told, line


def answers(told: list[object]) -> list[type]:
    return [type(event) for event in told if isinstance(event, Accepted | Refused) and 0 < event.sequence < 99]


def test_a_new_loop_stays_locked_until_a_person_enables_the_drives(ideal: PlantParameters, tuning: SetTuning) -> None:
    first = Setup(VIRTUAL, "ideal", 0, tuning)
    locked, told, line = life(first, ideal, tuning, SwitchDrives(on=False))
    assert (line[0], line[-1], locked.drives_off) == (True, False, True)
    orders = SetMode(Mode.PRETENSION), Stop(Fault.STOP_PRESSED), Reset(), SetMode(Mode.PRETENSION)
    still, told, line = life(locked, ideal, tuning, *orders)
    assert not any(line)
    assert answers(told) == [Refused, Accepted, Accepted, Refused]
    assert [event.drives_off for event in told if isinstance(event, ReadinessChanged)] == [True]
    assert still == locked  # nobody has said that the hands are away
    free, told, line = life(still, ideal, tuning, SwitchDrives(on=True), SetMode(Mode.PRETENSION))
    assert answers(told) == [Accepted, Accepted]
    assert (line[0], line[-1]) == (False, True)
    assert free == first
    assert life(free, ideal, tuning)[2][0]


def test_enabling_the_drives_causes_no_overrun(ideal: PlantParameters, tuning: SetTuning) -> None:
    """The proof test of the card's watchdog waits on purpose; an unintended pause still counts."""
    trial_ns, pause_ns = 600_000_000, 5_000_000

    class Unhurried(VirtualRig):
        def switch_drives(self, *, on: bool) -> None:
            bench.now_ns += trial_ns
            super().switch_drives(on=on)

    bench = Bench(ideal, tuning, Unhurried(load_wiring("pcie-6323"), Simulator(ideal, 0)))

    def service(tick: int) -> None:
        if tick == 10:
            bench.say(SwitchDrives(on=True), 1)
        if tick == 30:
            bench.now_ns += pause_ns
        if tick == 50:
            bench.say(Shutdown(), 2)

    bench.run(service)
    overruns = bench.column("overruns")
    assert (overruns[20], overruns[-1]) == (0, pause_ns // 1_000_000 - 1)
    assert bench.now_ns > trial_ns
    bench.service.close()
    bench.ring.close()
