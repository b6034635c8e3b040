"""The loop process decides by itself when the service is silent or gone: stepped here on a clock of its own."""

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime import process
from backend.realtime.channel import MAX_BYTES
from backend.realtime.commands import (
    Accepted,
    Command,
    Heartbeat,
    ModeChanged,
    PretensionReached,
    Refused,
    RunProgram,
    SetMode,
    SetReferences,
    Shutdown,
    Stopped,
)
from backend.realtime.ipc import PART_SEGMENTS, Ready, ToLoop, decode_to_loop, packets
from backend.realtime.modes import Mode
from backend.realtime.process import BYTES_PER_TICK
from backend.realtime.program import MAX_SEGMENTS, Law, Program, Segment, SetTuning
from backend.realtime.timing import RealTimeStatus
from plant.parameters import PlantParameters
from tests.docs.faults_page import documented_ms
from tests.realtime.worker_bench import Bench

MS = 1_000_000


@pytest.fixture
def bench(ideal: PlantParameters, tuning: SetTuning) -> Iterator[Bench]:
    made = Bench(ideal, tuning)
    yield made
    made.service.close()
    made.ring.close()


def test_service_gone_while_moving_ends_in_zero_volts(bench: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench.say(SetMode(Mode.PRETENSION), 1)
        if tick == 300:
            bench.service.close()
        elif tick < 300 and tick % 100 == 0:
            bench.say(Heartbeat())

    bench.run(service)
    u_A, fault = bench.column("u_A"), bench.column("fault")
    assert np.any(u_A[:300] != 0)
    assert fault[299] == 0
    assert fault[301] == FAULT_CODE[Fault.SERVICE_LOST]
    assert (u_A[-1], bench.column("u_B")[-1]) == (0.0, 0.0)


def test_silence_is_answered_by_a_latched_soft_stop_within_half_a_second(bench: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench.say(SetMode(Mode.PRETENSION), 1)
        if tick == 1500:
            # The service is back: what it finds is latched, and the loop obeys again.
            bench.say(SetMode(Mode.RUN), 2)
            bench.say(Shutdown(), 3)
        elif tick <= 200 and tick % 100 == 0:
            bench.say(Heartbeat())

    bench.run(service)
    stops = np.flatnonzero(bench.column("fault") == FAULT_CODE[Fault.SERVICE_LOST])
    assert 300 < stops[0] - 200 <= 400
    assert stops[-1] == bench.ring.count - 1
    events = bench.hear()
    assert sum(isinstance(event, Stopped) for event in events) == 1
    assert any(isinstance(event, Refused) and event.sequence == 2 for event in events)
    assert Accepted(3, 1500) in events


def test_a_moving_joint_stands_within_half_a_second_of_the_last_word(bench: Bench) -> None:
    last_word = 0

    def service(tick: int) -> None:
        nonlocal last_word
        if tick == 0:
            bench.say(SetMode(Mode.PRETENSION), 1)
        if any(isinstance(event, PretensionReached) for event in bench.hear()) and not last_word:
            bench.say(SetMode(Mode.RUN), 2)
            bench.say(SetReferences(1.2, 12.0), 3)
            last_word = tick + 700
        if last_word and tick > last_word + 1500:
            bench.say(Shutdown(), 4)
        elif (not last_word or tick <= last_word) and tick % 50 == 0:
            bench.say(Heartbeat())

    bench.run(service)
    heard = last_word - last_word % 50
    q_dot = bench.column("q_dot")
    latched = int(np.argmax(bench.column("fault") == FAULT_CODE[Fault.SERVICE_LOST]))
    assert 0 < latched - heard <= documented_ms(Fault.SERVICE_LOST)
    assert abs(q_dot[heard]) > 0.5
    assert np.max(np.abs(q_dot[heard + 500 :])) < 0.05 * abs(q_dot[heard])
    assert (bench.column("u_A")[-1], bench.column("u_B")[-1]) == (0.0, 0.0)


def test_silence_while_nothing_moves_is_no_fault(bench: Bench) -> None:
    bench.run(lambda tick: bench.say(Shutdown()) if tick == 2000 else None)
    assert not np.any(bench.column("fault"))


def test_a_pause_of_the_whole_machine_is_not_silence(bench: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench.say(SetMode(Mode.PRETENSION), 1)
        if tick == 600:
            bench.say(Shutdown(), 2)
        elif tick % 100 == 0:
            bench.say(Heartbeat())
        if tick in (50, 150, 250, 350):
            bench.now_ns += 15 * MS

    bench.run(service)
    assert not np.any(bench.column("fault"))
    assert bench.column("overruns")[-1] == 4 * 14


def test_malformed_and_late_messages_are_refused_by_number(bench: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            bench.service.send(b'{"kind":"SetMode","sequence":4,"body":{"mode":"warp"}}')
            bench.say(bench.setup, 5)
        if tick == 3:
            bench.service.send(b'{"kind":"SetMode","sequence":6,"body":{"mode":"warp"}}')
            bench.say(Shutdown(), 7)

    bench.run(service)
    refusals = [event for event in bench.hear() if isinstance(event, Refused)]
    assert [(refusal.sequence, refusal.tick) for refusal in refusals] == [(4, 0), (5, 0), (6, 3)]
    assert "mode" in refusals[0].reason
    assert not any(isinstance(event, ModeChanged) for event in bench.hear())


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


def test_the_longest_program_arrives_in_ticks_that_decode_little(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a tick has to decode is bounded, and the program is whole when it is played."""
    decoded: dict[int, int] = {}

    def counting(packet: bytes) -> tuple[int, ToLoop]:
        tick = bench.ring.count
        decoded[tick] = decoded.get(tick, 0) + len(packet)
        return decode_to_loop(packet)

    monkeypatch.setattr(process, "decode_to_loop", counting)
    program = a_program(MAX_SEGMENTS)
    reached: list[int] = []

    def service(tick: int) -> None:
        if tick == 0:
            bench.say(SetMode(Mode.PRETENSION), 1)
        if tick % 100 == 50:
            bench.say(Heartbeat())
        if not reached and any(isinstance(event, PretensionReached) for event in bench.hear()):
            reached.append(tick)
            for packet in packets(program, 2):
                assert bench.service.send(packet)
        if reached and tick == reached[0] + 700:
            bench.say(Shutdown(), 3)

    bench.run(service)
    accepted = [event for event in bench.hear() if isinstance(event, Accepted) and event.sequence == 2]
    assert len(accepted) == 1
    assert accepted[0].tick <= reached[0] + len(packets(program, 2)) + 4  # a packet in each tick, in turn
    assert max(decoded.values()) <= BYTES_PER_TICK + MAX_BYTES
    assert sum(decoded.values()) > 100_000
    q_ref, run = bench.column("q_ref"), bench.column("run")
    played = np.unique(q_ref[run == 5])
    expected = [segment.q_ref for segment in program.program.segments]
    assert len(played) >= 5
    np.testing.assert_array_equal(played, expected[: len(played)])


def test_a_program_with_a_part_missing_is_refused_and_the_next_one_is_whole(bench: Bench) -> None:
    def service(tick: int) -> None:
        if tick == 0:
            _, *others = packets(a_program(200), 7)
            for packet in others:
                bench.service.send(packet)
        if tick == 10:
            bench.service.send(packets(a_program(200), 8)[0])  # the rest never comes
        if tick == 20:
            for packet in packets(a_program(200), 9):
                bench.service.send(packet)
        if tick == 40:
            bench.say(Shutdown(), 10)

    bench.run(service)
    reasons = {event.sequence: event.reason for event in bench.hear() if isinstance(event, Refused)}
    assert f"{200 - PART_SEGMENTS} of the program's 200 segments arrived" in reasons[7]
    assert 8 not in reasons
    assert "off cannot go to experiment" in reasons[9], "the whole program came to the loop, which is off"


def test_a_command_that_the_loop_does_not_know_is_refused(bench: Bench) -> None:
    told = []
    loop = bench.worker._loop
    loop.handle(4, cast(Command, object()))
    told += loop.drain_events()
    assert [(type(event), event.sequence) for event in told if isinstance(event, Accepted | Refused)] == [(Refused, 4)]
    bench.worker.terminate()


def test_a_burst_of_commands_is_spread_over_the_ticks_in_its_order(bench: Bench) -> None:
    """Four in a tick, whatever their size: forty at once would make that tick late."""

    def service(tick: int) -> None:
        if tick == 5:
            for sequence in range(1, 11):
                bench.say(SetMode(Mode.RUN), sequence)
        if tick == 20:
            bench.say(Shutdown(), 11)

    bench.run(service)
    answers = [(event.sequence, event.tick) for event in bench.hear() if isinstance(event, Refused)]
    assert answers == [(sequence, 5 + (sequence - 1) // 4) for sequence in range(1, 11)]


def test_events_wait_for_a_service_that_does_not_read(bench: Bench) -> None:
    """More events than the socket holds: none is lost, and no tick waits for them."""
    sent = 0

    def service(tick: int) -> None:
        nonlocal sent
        if tick < 2000:
            bench.say(SetMode(Mode.RUN), tick)
            sent += 1
        else:
            bench.hear()
        if tick == 2010:
            bench.say(Shutdown(), 9999)

    bench.worker.queue_message(Ready(RealTimeStatus(0, False, 0, ()), "simulator"))
    bench.run(service)
    numbers = [event.sequence for event in bench.hear() if isinstance(event, Refused)]
    assert isinstance(bench.told[0], Ready)
    assert numbers == list(range(sent))


def test_termination_ends_after_the_tick(bench: Bench) -> None:
    bench.run(lambda tick: bench.worker.terminate() if tick == 5 else None)
    assert bench.ring.count == 6
