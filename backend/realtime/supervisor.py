"""Supervisor of the loop process in the service: start, commands, restart."""

import asyncio
import logging
import signal
import time
from asyncio.subprocess import Process
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, TypeVar

from backend.faults import Fault
from backend.realtime import heartbeat, messages
from backend.realtime.channel import Channel, ChannelClosedError
from backend.realtime.commands import (
    Accepted,
    Command,
    Event,
    ReadinessChanged,
    Refused,
    Shutdown,
    Stop,
    Stopped,
    SwitchDrives,
)
from backend.realtime.heartbeat import HEARTBEAT_S, WATCHDOG_MONITOR_PART, HeartbeatSender, WatchdogMonitor
from backend.realtime.ipc import ChannelError, Failed, FromLoop, Ready, Setup, decode_from_loop, encode, packets
from backend.realtime.launching import LoopProcess, launch_loop
from backend.realtime.modes import MODES, Mode
from backend.realtime.ring_buffer import Ring
from backend.realtime.timing import RealTimeStatus
from backend.sample import INDEX
from backend.supervision import Part, SupervisedTask, SupervisedThread, Supervision
from plant import Card, ErrorCode, SinewError, T_s, select_calibration

# Loop interface ------------------------------------------------------------------------------------
# Interface to the loop, whether live in its own process or headless in this one.


@dataclass(frozen=True)
class LoopExited:
    """The loop process ended unexpectedly; nothing controls the plant until a restart."""

    reason: str


class LoopExitedError(SinewError):
    """There is no loop, or it ended while a reply was awaited.

    The message says why.
    """

    category = ErrorCode.UNAVAILABLE


_Result = TypeVar("_Result")


async def wait_for_result(awaited: asyncio.Future[_Result], timeout_s: float) -> _Result:
    """Wait for a result. Raises TimeoutError only if none is there afterwards.

    Since Python 3.12 ``asyncio.wait_for`` discards a result that arrived while the event loop was blocked for longer
    than the timeout; a loop process was killed for that although it had replied.
    """
    await asyncio.wait((awaited,), timeout=timeout_s)
    if not awaited.done():
        raise TimeoutError
    return awaited.result()


EventListener = Callable[[Event | LoopExited], None]


class LoopClient(Protocol):
    """Client of the loop: commands, events and samples.

    Not thread-safe: all calls must come from one event loop.
    """

    @property
    def ring(self) -> Ring:
        """Samples of the current loop; a new ring after each start."""
        ...

    @property
    def granted(self) -> RealTimeStatus | None:
        """What the machine granted to the loop; None without a loop or real time."""
        ...

    def listen(self, listener: EventListener) -> Callable[[], None]:
        """Call ``listener`` with each event; return a function that removes it."""
        ...

    async def send(self, command: Command) -> Accepted | Refused:
        """Send a command and wait for the loop's reply. Raises LoopExitedError."""
        ...

    async def advance(self, seconds: float) -> None:
        """Wait for a duration of the loop's time [s]. Raises LoopExitedError."""
        ...

    async def advance_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        """Wait until ``reached()``. Raises TimeoutError or LoopExitedError.

        ``timeout_s`` is in the loop's time. A headless loop calls ``reached`` after every tick, a live one a few times
        per 0.1 s: a short condition may be missed.
        """
        ...


# Pending commands ----------------------------------------------------------------------------------
# Pending commands to the loop process.


Answer = asyncio.Future[Accepted | Refused]


class PendingReplies:
    """Numbers commands and assigns their replies."""

    def __init__(self) -> None:
        self._waiting: dict[int, Answer] = {}
        self._sequence = 0

    @contextmanager
    def expect(self) -> Iterator[tuple[int, Answer]]:
        """Return a number and the future of its reply, for the block."""
        self._sequence += 1
        sequence = self._sequence
        answer: Answer = asyncio.get_running_loop().create_future()
        self._waiting[sequence] = answer
        try:
            yield sequence, answer
        finally:
            del self._waiting[sequence]

    def take(self, event: Event) -> None:
        """Assign an event that is a reply."""
        if isinstance(event, Accepted | Refused):
            answer = self._waiting.get(event.sequence)
            if answer is not None and not answer.done():
                answer.set_result(event)

    def fail(self, died: LoopExitedError) -> None:
        """Fail all pending replies."""
        for answer in self._waiting.values():
            if not answer.done():
                answer.set_exception(died)


# Hang detection ------------------------------------------------------------------------------------
# Detection of a hung loop process, from the ring buffer.


MAX_MISSED_BEATS = 16
"""Heartbeat periods without a tick after which the loop counts as hung and is killed, so that the card's watchdog
acts."""


class LivenessMonitor:
    """Checks one loop process once per heartbeat."""

    def __init__(self) -> None:
        self._count = -1
        self._unchanged = 0
        self._suspensions = 0

    @contextmanager
    def suspend(self, command: Command) -> Iterator[None]:
        """Suspend detection until the command is answered.

        Before the drives are enabled the loop may have to run the proof test of the watchdog, during which it waits for
        its card at zero volts. The sender of the command enforces the timeout.
        """
        is_blocking = isinstance(command, SwitchDrives) and command.on
        self._suspensions += is_blocking
        try:
            yield
        finally:
            self._suspensions -= is_blocking

    def is_hung(self, count: int) -> bool:
        """Return whether the sample ``count`` has not changed for too long."""
        self._unchanged = self._unchanged + 1 if count == self._count and not self._suspensions else 0
        self._count = count
        return self._unchanged >= MAX_MISSED_BEATS


# Supervisor ----------------------------------------------------------------------------------------
# Supervisor of the loop process: start, commands, detection of its end, restart.


START_TIMEOUT_S = 120.0
"""Time for a start [s], including a first compilation of the control laws."""

ANSWER_TIMEOUT_S = 2.0
STOP_TIMEOUT_S = 3.0

_WATCH_PART = Part(messages.loop_monitor(), messages.end_detected_late())
_LIVENESS_PART = Part(messages.liveness_signal(), messages.loop_stops_without_signal())
_HEARTBEAT_PART = Part(messages.heartbeat(), messages.loop_stops_without_heartbeat())
PACKETS_AT_ONCE = 8
"""Packets of a long program sent without a pause; the loop receives one per tick, and a stop still fits in the
queue."""

_POLL_S = 0.02
_VOLTAGE_FREE_MODES = (Mode.OFF, Mode.TRIPPED)
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Restart:
    """Planned restart of the loop process: its purpose and start time.

    ``began_s`` is on the monotonic clock [s].
    """

    purpose: str
    began_s: float


class Supervisor:
    """A ``LoopClient`` of the loop process. Bound to one asyncio event loop.

    ``card`` holds the registers of the simulated card of the current or last loop process; ``watchdog_monitor``
    monitors them, ``supervision`` restarts the monitoring tasks. ``started_with`` are the commissioning results that
    apply.
    """

    def __init__(
        self, setup: Setup, supervision: Supervision | None = None, launched: LoopProcess | None = None
    ) -> None:
        self.setup = setup
        self._prepared = launched
        self.started_with = setup.commissioning_results
        self.ring = Ring.create()
        self.card = Card.create()
        self.watchdog_monitor = WatchdogMonitor(self.card)
        self.granted: RealTimeStatus | None = None
        self.plant_description = ""
        self.restarting: Restart | None = None
        """The active planned restart."""
        self._process: Process | None = None
        self._supervision = supervision or Supervision()
        self._heartbeat: HeartbeatSender | None = None
        self._heartbeat_thread: SupervisedThread | None = None
        self._channel: Channel | None = None
        self._tasks: list[SupervisedTask] = []
        self._ready: asyncio.Future[RealTimeStatus] | None = None
        self._answers = PendingReplies()
        self._liveness = LivenessMonitor()
        self._listeners: list[EventListener] = []
        self._reason: str = messages.loop_never_started()
        self._ending = False
        self._lock = asyncio.Lock()

    @property
    def is_alive(self) -> bool:
        """Whether the loop process is running and ready."""
        return self.granted is not None

    @property
    def heartbeat_age_s(self) -> float | None:
        """Time since the last heartbeat to the loop process [s], None without one."""
        return None if self._heartbeat is None else self._heartbeat.age_s

    def fall_silent(self, duration_s: float) -> None:
        """Send no heartbeat for a while, as if the service hung."""
        if self._heartbeat is not None:
            self._heartbeat.pause(duration_s)

    def listen(self, listener: EventListener) -> Callable[[], None]:
        """Call ``listener`` with each event; return a function that removes it."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    async def start(self) -> RealTimeStatus:
        """Start the loop process and wait until it is ready. Raises LoopExitedError.

        Outputs are at zero volts.
        """
        async with self._lock:
            return await self._start()

    async def stop(self, cause: str = "") -> None:
        """Bring the joint to rest, set zero volts, end the process.

        ``cause`` is recorded; empty: the service ended.
        """
        async with self._lock:
            await self._stop(cause or messages.service_ended())

    async def restart(self, purpose: str) -> RealTimeStatus:
        """End the loop process, if there is one, and start another with ``setup``.

        ``purpose`` describes the restart to people while it takes place. Raises LoopExitedError.
        """
        async with self._lock:
            self.restarting = Restart(purpose, time.monotonic())
            try:
                await self._stop(messages.loop_restarted())
                return await self._start()
            finally:
                self.restarting = None

    async def _start(self) -> RealTimeStatus:
        if self._process is not None:
            raise LoopExitedError(messages.loop_already_started())
        self.card.expire()  # the previous loop on the same card may have been killed a moment ago
        if self._prepared is None or (launched := self._prepared.take()) is None:
            launched = await launch_loop(self.setup.parameters)
        self.ring, self.card = launched.ring, launched.card
        self.watchdog_monitor = WatchdogMonitor(self.card)
        self._ending, self._reason = False, messages.loop_still_starting()
        self._ready = asyncio.get_running_loop().create_future()
        self._ready.add_done_callback(lambda ready: ready.cancelled() or ready.exception())  # a start may be abandoned
        self._process, self._channel = launched.process, (channel := launched.channel)
        self.started_with = self.setup.commissioning_results
        _LOG.info("Control loop process %d started.", self._process.pid)
        with suppress(ChannelClosedError):  # _watch detects and reports its end
            channel.send(encode(self.setup))
        asyncio.get_running_loop().add_reader(channel.fileno(), self._receive)
        self._heartbeat = HeartbeatSender(channel)
        self._heartbeat_thread = self._supervision.start_thread(
            _HEARTBEAT_PART, self._heartbeat.run, self._heartbeat.stop
        )
        start_task = self._supervision.start_task
        self._tasks = [
            start_task(_WATCH_PART, partial(self._watch, self._process)),
            start_task(_LIVENESS_PART, partial(self._refresh_heartbeat, channel, self._heartbeat)),
            start_task(WATCHDOG_MONITOR_PART, partial(self.watchdog_monitor.run, self._process)),
        ]
        await asyncio.to_thread(
            heartbeat.compile_heartbeat
        )  # before any command: the loop is off and needs no heartbeat
        try:
            return await wait_for_result(self._ready, START_TIMEOUT_S)
        except TimeoutError:
            self._kill(messages.loop_not_ready_in_time(timeout_s=START_TIMEOUT_S))
            return await self._ready

    async def _stop(self, cause: str) -> None:
        if (process := self._process) is None:
            await self.watchdog_monitor.run(None)  # the outputs of a loop that was killed must be off first
            return
        self._ending = True
        try:
            if self.is_alive:
                if not self._is_voltageless():  # otherwise there is nothing to stop, and a planned end is no trip
                    await self._stop_softly(cause)
                await self.send(Shutdown())
            else:
                process.terminate()
            await wait_for_result(asyncio.ensure_future(process.wait()), STOP_TIMEOUT_S)
        except (LoopExitedError, TimeoutError, ProcessLookupError):
            self._kill(messages.loop_did_not_end())
        for task in self._tasks:
            await task.wait()

    async def send(self, command: Command) -> Accepted | Refused:
        """Send a command and wait for the loop's reply.

        Raises LoopExitedError; OutOfRangeError or ChannelError if it is too long.
        """
        channel = self._require_alive()
        with self._answers.expect() as (sequence, answer), self._liveness.suspend(command):
            parts = packets(command, sequence)
            with suppress(ChannelClosedError):  # _watch detects and reports its end
                for part, packet in enumerate(parts):
                    if part and part % PACKETS_AT_ONCE == 0:
                        await asyncio.sleep(PACKETS_AT_ONCE * T_s)
                    if not channel.send(packet):
                        self._kill(messages.loop_accepts_no_commands())
                        break
            try:
                return await wait_for_result(answer, ANSWER_TIMEOUT_S)
            except TimeoutError:
                self._kill(messages.loop_did_not_answer(timeout_s=ANSWER_TIMEOUT_S))
                raise LoopExitedError(messages.loop_not_running(reason=self._reason)) from None

    async def advance(self, seconds: float) -> None:
        """Wait for a duration of the loop's time [s]. Raises LoopExitedError."""
        end = self.ring.count + round(seconds / T_s)
        while self.ring.count < end:
            self._require_alive()
            await asyncio.sleep(_POLL_S)

    async def advance_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        """Wait until ``reached()``. Raises TimeoutError or LoopExitedError.

        ``timeout_s`` is in the loop's time.
        """
        end = self.ring.count + round(timeout_s / T_s)
        while not reached():
            self._require_alive()
            if self.ring.count >= end:
                raise TimeoutError(messages.state_not_reached(timeout_s=timeout_s))
            await asyncio.sleep(_POLL_S)

    def _require_alive(self) -> Channel:
        if self._channel is None or not self.is_alive:
            raise LoopExitedError(messages.loop_not_running(reason=self._reason))
        return self._channel

    def _is_voltageless(self) -> bool:
        """Return whether the newest sample is of a mode without voltages: off or tripped."""
        newest = self.ring.newest()
        return newest is not None and MODES[int(newest[INDEX["mode"]])] in _VOLTAGE_FREE_MODES

    async def _stop_softly(self, cause: str) -> None:
        stopped: asyncio.Future[Stopped] = asyncio.get_running_loop().create_future()

        def on_event(event: Event | LoopExited) -> None:
            if isinstance(event, Stopped) and not stopped.done():
                stopped.set_result(event)

        remove_listener = self.listen(on_event)
        try:
            await self.send(Stop(Fault.SERVICE_ENDED, hard=False, detail=cause))
            await wait_for_result(stopped, STOP_TIMEOUT_S)
        finally:
            remove_listener()

    def _kill(self, reason: str) -> None:
        self._reason = reason
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()

    def _receive(self) -> None:
        """Handle all packets that have arrived; called by the event loop."""
        channel = self._channel
        if channel is None:
            return
        try:
            while (packet := channel.receive()) is not None:
                try:
                    _, message = decode_from_loop(packet)
                except ChannelError:
                    _LOG.exception("The service cannot decode a packet of the control loop: %r", packet[:200])
                else:
                    self._take(message)
        except ChannelClosedError:
            asyncio.get_running_loop().remove_reader(channel.fileno())

    def _take(self, message: FromLoop) -> None:
        match message:
            case Ready(granted, driven, wired):
                self.started_with = select_calibration(wired, self.started_with)
                self.granted, self.plant_description, self._reason = granted, driven, ""
                if self._ready is not None and not self._ready.done():
                    self._ready.set_result(granted)
            case Failed(reason):
                self._reason = reason
            case event:
                if isinstance(event, ReadinessChanged):  # people may be working at the rig: a restarted loop must know
                    self.setup = replace(self.setup, drives_off=event.drives_off)
                self._answers.take(event)
                self._notify(event)

    def _notify(self, event: Event | LoopExited) -> None:
        for listener in tuple(self._listeners):
            try:
                listener(event)
            except Exception:
                _LOG.exception("A listener failed on event %s.", event)

    async def _refresh_heartbeat(self, channel: Channel, heartbeat_sender: HeartbeatSender) -> None:
        liveness = self._liveness = LivenessMonitor()
        while self._channel is channel:
            heartbeat_sender.refresh()
            if self.is_alive and liveness.is_hung(self.ring.count):
                self._kill(messages.loop_hangs(duration_s=MAX_MISSED_BEATS * HEARTBEAT_S))
            await asyncio.sleep(HEARTBEAT_S)

    async def _watch(self, process: Process) -> None:
        """Wait for the end of the process and clean up."""
        status = await process.wait()
        self._receive()
        channel, self._channel = self._channel, None
        if self._heartbeat_thread is not None:
            self._heartbeat_thread.end()
            self._heartbeat = self._heartbeat_thread = None
        if channel is not None:
            asyncio.get_running_loop().remove_reader(channel.fileno())
            channel.close()
        was_alive, self.granted, self._process = self.is_alive, None, None
        self._reason = _reason_of_end(status, self._reason)
        _LOG.info("Control loop process %d: %s", process.pid, self._reason)
        died = LoopExitedError(messages.loop_not_running(reason=self._reason))
        if self._ready is not None and not self._ready.done():
            self._ready.set_exception(died)
        self._answers.fail(died)
        if was_alive and not self._ending:
            self._notify(LoopExited(self._reason))


def _reason_of_end(status: int, known: str) -> str:
    if status < 0:
        ending = messages.loop_killed(signal_name=signal.Signals(-status).name)
    else:
        ending = messages.loop_ended(status=status)
    return messages.loop_ended_for_reason(reason=known, ending=ending) if known else ending
