"""Replay of a recording: the sample of each tick, the commands, and no trips."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime.channel import Channel, channel_pair
from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    Command,
    Event,
    PlayerMoved,
    PlayRecording,
    Refused,
    Reset,
    SetMode,
    SetReferences,
    Shutdown,
    Stop,
    Stopped,
)
from backend.realtime.ipc import decode_from_loop, encode
from backend.realtime.modes import Mode
from backend.realtime.player import PlayerLoop
from backend.realtime.process import Worker
from backend.realtime.ring_buffer import Ring
from backend.realtime.timing import Pacer
from backend.sample import INDEX, NAMES
from plant.replay import Replay, load_replay
from tests.exports.written import to_csv
from tests.reasons import assert_reason

SAMPLES = 200


class Played:
    """A player and the ring buffer that it writes; ``told`` holds its events so far."""

    def __init__(self, folder: Path, **columns: np.ndarray) -> None:
        ticks = np.arange(float(SAMPLES))
        still = {name: np.zeros(SAMPLES) for name in ("theta_A", "theta_B", "F_A", "F_B")}
        file = folder / "run-7.csv"
        whole = {**still, "t": ticks / 1000.0, "q": ticks / 100.0, "u_A": ticks / 20.0, "u_B": -ticks / 40.0, **columns}
        file.write_bytes(to_csv(whole))
        self.ring = Ring.create()
        self.recording = load_replay(file)
        self.loop = PlayerLoop(self.recording, self.ring)
        self.told: list[Event] = []

    def advance(self, ticks: int) -> None:
        for _ in range(ticks):
            self.loop.tick()
        self.told += self.loop.drain_events()

    def say(self, command: Command) -> Event:
        self.loop.handle(1, command)
        events = self.loop.drain_events()
        self.told += events
        return next(event for event in events if isinstance(event, Accepted | Refused))

    def column(self, name: str) -> list[float]:
        values: list[float] = self.ring.read(0, 100_000)[1][:, INDEX[name]].tolist()
        return values

    @property
    def shown(self) -> list[int]:
        """Which sample each tick has shown."""
        return [round(100.0 * q) for q in self.column("q")]


@pytest.fixture
def played(tmp_path: Path) -> Iterator[Played]:
    made = Played(tmp_path)
    yield made
    made.ring.close()


def test_each_tick_shows_one_sample_with_its_voltages_until_the_last_sample(played: Played) -> None:
    played.advance(SAMPLES + 50)
    assert played.shown == [*range(SAMPLES), *[SAMPLES - 1] * 50]
    assert played.column("u_A") == pytest.approx([shown / 20.0 for shown in played.shown], rel=1e-6)
    assert played.column("u_B") == pytest.approx([-shown / 40.0 for shown in played.shown], rel=1e-6)
    assert set(played.column("fault")) == set(played.column("run")) == {0.0}
    assert played.told == [
        PlayerMoved(0, True, 1.0, 0.0, SAMPLES),
        PlayerMoved(SAMPLES - 1, False, 1.0, SAMPLES - 1, SAMPLES),
    ]


@pytest.mark.parametrize("speed", [0.25, 0.3, 1.0, 2.5, 4.0])
def test_player_events_identify_the_sample_of_every_tick(played: Played, speed: float) -> None:
    assert isinstance(played.say(PlayRecording(speed=speed)), Accepted)
    played.advance(40)
    played.say(PlayRecording(sample=20))
    played.advance(30)
    moves = [event for event in played.told if isinstance(event, PlayerMoved)]
    for tick, shown in enumerate(played.shown):
        told = [move for move in moves if move.tick <= tick][-1]
        gone = (tick - told.tick) * told.speed if told.playing else 0.0
        assert shown == int(min(told.sample + gone, SAMPLES - 1))


def test_the_player_pauses_resumes_and_seeks(played: Played) -> None:
    played.advance(10)
    played.say(PlayRecording(playing=False))
    played.advance(5)
    played.say(PlayRecording(sample=100))
    played.advance(2)
    played.say(PlayRecording(playing=True))
    played.advance(3)
    assert played.shown == [*range(10), *[10] * 5, 100, 100, 100, 101, 102]


def test_the_player_restarts_after_the_end(played: Played) -> None:
    played.say(PlayRecording(sample=SAMPLES - 1))
    played.advance(3)
    played.say(PlayRecording(playing=True))
    played.advance(3)
    assert played.shown == [SAMPLES - 1] * 3 + [0, 1, 2]


@pytest.mark.parametrize(("order", "code"), [
    (PlayRecording(sample=SAMPLES), "sample_outside_recording"),
    (PlayRecording(sample=-1), "sample_outside_recording"),
    (PlayRecording(speed=0.2), "speed_out_of_range"),
    (PlayRecording(speed=4.5), "speed_out_of_range"),
    (PlayRecording(playing=False, sample=5, speed=float("inf")), "speed_out_of_range"),
])  # fmt: skip
def test_an_impossible_command_is_rejected_as_a_whole(played: Played, order: PlayRecording, code: str) -> None:
    played.advance(3)
    answer = played.say(order)
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, code)
    played.advance(3)
    assert played.shown == list(range(6))


@pytest.mark.parametrize(
    "command", [SetMode(Mode.PRETENSION), SetMode(Mode.OFF), SetReferences(0.1, 9.0), ApplyPush(1.0, 1.0), Reset()]
)
def test_invalid_commands_are_rejected_with_the_reason_and_change_nothing(played: Played, command: Command) -> None:
    played.advance(5)
    answer = played.say(command)
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "not_a_replay_command")
    played.advance(5)
    assert played.shown == list(range(10))
    assert set(played.column("mode")) == {0.0}


def test_stop_pauses_and_is_reported_in_the_same_tick_without_a_fault(played: Played) -> None:
    played.advance(10)
    assert isinstance(played.say(Stop()), Accepted)
    played.advance(5)
    assert played.shown == [*range(10), *[10] * 5]
    (stopped,) = (event for event in played.told if isinstance(event, Stopped))
    assert (stopped.fault, stopped.arrived_tick, stopped.zero_tick) == (Fault.STOP_PRESSED, 10, 10)
    assert set(played.column("fault")) == {0.0}
    assert played.loop.mode is Mode.OFF


def test_a_trip_and_a_lost_sensor_of_the_recording_are_shown_and_trip_nothing(tmp_path: Path) -> None:
    fault, q, mode = np.zeros(SAMPLES), np.zeros(SAMPLES), np.full(SAMPLES, 2.0)
    fault[100:], q[100:], mode[100:] = FAULT_CODE[Fault.SAFETY_MODULE], np.nan, 7.0
    limits = np.full(SAMPLES, 3.0)
    played = Played(tmp_path, fault=fault, q=q, mode=mode, limits=limits, q_ref=np.full(SAMPLES, 0.5))
    played.advance(SAMPLES)
    assert np.isnan(played.column("q")[100:]).all()
    assert set(played.column("fault")) == set(played.column("mode")) == {0.0}
    assert set(played.column("limits")) == {3.0}
    assert set(played.column("q_ref")) == {0.5}
    assert all(isinstance(event, PlayerMoved) for event in played.told)
    played.ring.close()


def test_columns_missing_in_the_file_are_nan(played: Played) -> None:
    played.advance(1)
    row = dict(zip(NAMES, played.ring.read(0, 1)[1][0].tolist(), strict=True))
    assert all(np.isnan(row[name]) for name in ("S", "S_ref", "q_ref", "q_dot", "F_ext_hat", "lam_q"))


def test_the_control_loop_replays_in_its_ticks_and_ignores_a_silent_service(played: Played) -> None:
    service, theirs = channel_pair()
    worker = Worker(Replay(played.recording), played.loop, Channel(theirs))
    now_ns = 0

    def sleep_until(deadline_ns: int) -> None:
        nonlocal now_ns
        now_ns = deadline_ns
        if played.ring.count == 1000:
            assert service.send(encode(Shutdown(), 3))

    worker.run(Pacer(0.001, lambda: now_ns, sleep_until), lambda: now_ns * 1e-9)
    told = []
    while (packet := service.receive()) is not None:
        told.append(decode_from_loop(packet)[1])
    assert not [event for event in told if isinstance(event, Stopped)]
    assert [event.sample for event in told if isinstance(event, PlayerMoved)] == [0.0, SAMPLES - 1]
    assert played.ring.count >= 1000
