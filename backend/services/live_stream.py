"""The live stream: samples, state and event marks for all connected clients."""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import NamedTuple, Protocol, assert_never

import numpy as np
from numpy.typing import NDArray

from backend import wire
from backend.faults import FAULTS, Fault, Limit, describe_fault
from backend.realtime import (
    MODES,
    Accepted,
    BiasLost,
    ContactDetected,
    Event,
    LoopExited,
    ModeChanged,
    PlantAnswers,
    PlantFailing,
    PlayerMoved,
    PretensionReached,
    PushReleased,
    ReadinessChanged,
    Refused,
    RunEnded,
    Stopped,
    TuningChanged,
    WallChanged,
)
from backend.sample import STORED
from backend.schemas import EventMessage, LayoutMessage, MarkKind, StateMessage
from backend.services import messages
from backend.supervision import Part
from plant import T_s

# Event marks ---------------------------------------------------------------------------------------
# Marks of events of the control loop, for the time axis and the event log.


class Mark(NamedTuple):
    """One mark at ``tick``."""

    kind: MarkKind
    text: str
    tick: int


def build_mark(event: Event | LoopExited, now: int) -> Mark | None:
    """Return the mark of an event; None if the command that caused it adds one.

    ``now`` is the newest tick.
    """
    match event:
        case ModeChanged(tick, before, after):
            return Mark(MarkKind.MODE, messages.mode_changed(before=before, after=after), tick)
        case PretensionReached(tick):
            return Mark(MarkKind.MODE, messages.pretension_reached(), tick)
        case ContactDetected(tick, F_ext_hat, contact_N):
            return Mark(MarkKind.NOTE, messages.contact_detected(F_ext_hat=F_ext_hat, contact_N=contact_N), tick)
        case BiasLost(tick):
            return Mark(MarkKind.NOTE, messages.zeros_set_again(), tick)
        case PushReleased(tick, why):
            return Mark(MarkKind.NOTE, messages.push_released_by_loop(reason=why), tick)
        case TuningChanged(tick, 0, lam_q, lam_S):
            return Mark(MarkKind.TUNING, messages.tuning_after_program(lam_q=lam_q, lam_S=lam_S), tick)
        case TuningChanged(tick, _, lam_q, lam_S):
            return Mark(MarkKind.TUNING, messages.tuning_by_program(lam_q=lam_q, lam_S=lam_S), tick)
        case WallChanged(tick, number, wall) if number:
            return Mark(MarkKind.NOTE, messages.obstacle_by_program(wall=wall), tick)
        case Stopped(fault=Fault.STOP_PRESSED):
            return None
        case Stopped(fault=fault, arrived_tick=tick, detail=detail):
            return Mark(MarkKind.TRIP, describe_fault(fault, detail), tick)
        case PlantFailing(tick, reason):
            return Mark(MarkKind.FAULT, messages.plant_failing(reason=reason), tick)
        case PlantAnswers(tick):
            return Mark(MarkKind.NOTE, messages.plant_answers(), tick)
        case LoopExited(reason):
            return Mark(MarkKind.TRIP, messages.loop_died(reason=reason), now)
        case Accepted() | Refused() | RunEnded() | ReadinessChanged() | WallChanged() | PlayerMoved():
            return None
        case _:
            assert_never(event)


# Live stream ---------------------------------------------------------------------------------------
# Builds one frame of samples per period and shares it among all clients.
#
# A client that reads slowly loses frames but does not delay other clients. Its next frame contains
# the number of missed samples.


LIVE_STREAM_PART = Part("The live stream", "Charts and state were not updated during the failure; no sample was lost.")

RATE_HZ = 30.0
"""Frames per second."""

STATE_PERIOD_S = 0.5
HISTORY_S = 30.0
"""Samples [s] that a new client gets first."""

FRAME_SAMPLES = 4096
"""Samples of one frame at most."""

QUEUE_FRAMES = 60
"""Frames that wait for one client at most."""

MARKS = 200
"""Marks that are stored for new clients."""


class SampleSource(Protocol):
    """Source of samples: the ring buffer of the current loop process."""

    @property
    def count(self) -> int:
        """Number of samples written so far."""
        ...

    def read(self, since: int, limit: int) -> tuple[int, NDArray[np.float64], int]:
        """Return first tick, rows, and the number of samples overwritten before."""
        ...


class StreamClient:
    """Messages that wait for one websocket, and its number of missed samples."""

    def __init__(self) -> None:
        self._frames: deque[bytes] = deque()
        self._texts: deque[str] = deque(maxlen=MARKS)
        self._state: str | None = None
        self._missed = 0
        self._wake = asyncio.Event()

    def queue_frame(self, frame: bytes) -> None:
        """Queue a frame; drop it if the queue is full, and count its samples as missed."""
        if len(self._frames) >= QUEUE_FRAMES:
            self._missed += wire.read_sample_count(frame)
            return
        self._frames.append(wire.replace_missed_count(frame, self._missed) if self._missed else frame)
        self._missed = 0
        self._wake.set()

    def queue_state(self, state: str) -> None:
        """Queue the state in place of an older one that waits."""
        self._state = state
        self._wake.set()

    def queue_text(self, text: str) -> None:
        """Queue an event mark or a pong; these keep their order."""
        self._texts.append(text)
        self._wake.set()

    async def next(self) -> str | bytes:
        """Wait for the next message: first texts, then the state, then frames."""
        while True:
            if self._texts:
                return self._texts.popleft()
            if self._state is not None:
                state, self._state = self._state, None
                return state
            if self._frames:
                return self._frames.popleft()
            self._wake.clear()
            await self._wake.wait()


class LiveStream:
    """Sends samples, state and marks to all clients."""

    def __init__(self, samples: Callable[[], SampleSource], state: Callable[[], StateMessage]) -> None:
        """Read from the ring buffer that ``samples`` returns.

        It is another one after a restart of the loop process.
        """
        self._samples = samples
        self._state = state
        self._clients: set[StreamClient] = set()
        self._marks: deque[str] = deque(maxlen=MARKS)
        self._ring = samples()
        self._position = self._ring.count
        self._state_due = 0.0

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    def publish_mark(self, mark: EventMessage) -> None:
        """Send a mark to all clients, and store it for new ones."""
        text = mark.model_dump_json()
        self._marks.append(text)
        for client in self._clients:
            client.queue_text(text)

    def request_state(self) -> None:
        """Send the state with the next frame instead of after STATE_PERIOD_S."""
        self._state_due = 0.0

    async def run(self) -> None:
        """Stream until cancelled."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            due = max(due + 1.0 / RATE_HZ, clock())
            await asyncio.sleep(due - clock())
            self.step(clock())

    def step(self, now_s: float) -> None:
        """Queue new samples, and the state if it is due at ``now_s``, for all clients."""
        if self._samples() is not self._ring:
            self._restart()
        if now_s >= self._state_due:
            self._state_due = now_s + STATE_PERIOD_S
            self._broadcast_state()
        for frame in self._read_new_frames():
            for client in self._clients:
                client.queue_frame(frame)

    @contextmanager
    def connect(self) -> Iterator[tuple["StreamClient", Iterable[str | bytes]]]:
        """Register a client for the block.

        Yields it with its first messages: layout, state, marks and history.
        """
        client = StreamClient()
        first_messages = [build_layout().model_dump_json(), self._state().model_dump_json(), *self._marks]
        history = _read_frames(self._ring, max(0, self._position - round(HISTORY_S / T_s)), self._position)
        self._clients.add(client)
        try:
            yield client, chain(first_messages, history)
        finally:
            self._clients.discard(client)

    def _restart(self) -> None:
        self._ring = self._samples()
        self._position = 0
        self._marks.clear()
        text = build_layout().model_dump_json()
        for client in self._clients:
            client.queue_text(text)  # a page removes its marks and history at a layout

    def _broadcast_state(self) -> None:
        if self._clients:
            state = self._state().model_dump_json()
            for client in self._clients:
                client.queue_state(state)

    def _read_new_frames(self) -> Iterator[bytes]:
        end = self._ring.count
        yield from _read_frames(self._ring, self._position, end)
        self._position = end


def build_layout() -> LayoutMessage:
    """Return the message that describes the columns and codes of the frames."""
    return LayoutMessage(
        fields=list(STORED),
        period_s=T_s,
        modes=[str(mode) for mode in MODES],
        faults=[str(fault) for fault in FAULTS],
        limits={str(limit.name): limit.value for limit in Limit},
    )


def _read_frames(ring: SampleSource, since: int, end: int) -> Iterator[bytes]:
    while since < end:
        first, rows, missed = ring.read(since, min(FRAME_SAMPLES, end - since))
        if len(rows) == 0:
            return
        yield wire.pack_frame(first, rows, missed)
        since = first + len(rows)
