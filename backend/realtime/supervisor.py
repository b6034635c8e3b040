"""The service's side of the loop process: starts it, commands it, notices its death, starts it anew."""

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
from backend.realtime import heartbeat
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
from backend.realtime.heartbeat import HEARTBEAT_S, HeartbeatSender, WatchdogMonitor
from backend.realtime.heartbeat import WATCHDOG_MONITOR_PART as GUARD
from backend.realtime.ipc import ChannelError, Failed, FromLoop, Ready, Setup, decode_from_loop, encode, packets
from backend.realtime.launching import LoopProcess, launch_loop
from backend.realtime.modes import MODES, Mode
from backend.realtime.ring_buffer import Ring
from backend.realtime.timing import RealTimeStatus
from backend.sample import INDEX
from backend.supervision import KeptTask, KeptThread, Part, Supervision
from plant import Card, ErrorCode, SinewError, T_s, select_calibration

# Access --------------------------------------------------------------------------------------------
#
# What whoever drives the loop may count on, be the loop live in its own process or stepped headless
# in this one.


@dataclass(frozen=True)
class LoopExited:
    """The loop process ended unasked; nothing controls the plant until it is started again."""

    reason: str


class LoopExitedError(SinewError):
    """There is no loop to command, or it died while it was waited for; the message says why."""

    category = ErrorCode.UNAVAILABLE


_Result = TypeVar("_Result")


async def wait_for_result(awaited: asyncio.Future[_Result], timeout_s: float) -> _Result:
    """Wait for a result. Raises TimeoutError only where there is none yet when this process gets to look.

    From Python 3.12 on ``asyncio.wait_for`` throws away a result that came while the event loop stood still for longer
    than the timeout; a loop process was killed for that although it had answered.
    """
    await asyncio.wait((awaited,), timeout=timeout_s)
    if not awaited.done():
        raise TimeoutError
    return awaited.result()


EventListener = Callable[[Event | LoopExited], None]


class LoopClient(Protocol):
    """Commands in, events and samples out. Not for several threads: all calls from one event loop."""

    @property
    def ring(self) -> Ring:
        """Samples of the loop that runs at present; another ring after a new start."""
        ...

    @property
    def granted(self) -> RealTimeStatus | None:
        """What the machine granted to the loop; None while there is no loop, and for one that keeps to no clock."""
        ...

    def listen(self, listener: EventListener) -> Callable[[], None]:
        """Call ``listener`` with each event from now on; return what to call to end that."""
        ...

    async def send(self, command: Command) -> Accepted | Refused:
        """Hand over a command and wait for the loop's answer. Raises LoopExitedError."""
        ...

    async def advance(self, seconds: float) -> None:
        """Let the loop tick for so many seconds of its own time. Raises LoopExitedError."""
        ...

    async def advance_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        """Let the loop tick until ``reached()``; raises TimeoutError after ``timeout_s`` of its time, LoopExitedError.

        Headless it is asked after every tick, live a few times per 0.1 s: ask for what lasts, not for a passing moment.
        """
        ...


# Answers -------------------------------------------------------------------------------------------
#
# Commands on their way to the loop process, each waiting for its answer.


Answer = asyncio.Future[Accepted | Refused]


class PendingReplies:
    """Numbers commands and hands each answer to whoever waits for it."""

    def __init__(self) -> None:
        self._waiting: dict[int, Answer] = {}
        self._sequence = 0

    @contextmanager
    def expected(self) -> Iterator[tuple[int, Answer]]:
        """Give a number and the answer that will come to it, for the block."""
        self._sequence += 1
        sequence = self._sequence
        answer: Answer = asyncio.get_running_loop().create_future()
        self._waiting[sequence] = answer
        try:
            yield sequence, answer
        finally:
            del self._waiting[sequence]

    def take(self, event: Event) -> None:
        """Hand on an event that is an answer."""
        if isinstance(event, Accepted | Refused):
            answer = self._waiting.get(event.sequence)
            if answer is not None and not answer.done():
                answer.set_result(event)

    def fail(self, died: LoopExitedError) -> None:
        """Tell all who wait that no answer will come."""
        for answer in self._waiting.values():
            if not answer.done():
                answer.set_exception(died)


# Ticking -------------------------------------------------------------------------------------------
#
# Whether the loop process ticks, as the service sees it in the ring.


HUNG_BEATS = 16
"""A loop that has not ticked for so many heartbeats hangs; it is killed, so that the card's watchdog takes over."""


class LivenessMonitor:
    """Looks at one loop process once a heartbeat."""

    def __init__(self) -> None:
        self._count = -1
        self._still = 0
        self._excused = 0

    @contextmanager
    def excused(self, command: Command) -> Iterator[None]:
        """Bear that it does not tick until it has answered: before drives come on it may have to try its watchdog.

        It waits for its card then, at zero volts; that it answers in time is seen to by whoever has sent the command.
        """
        waits = isinstance(command, SwitchDrives) and command.on
        self._excused += waits
        try:
            yield
        finally:
            self._excused -= waits

    def hangs(self, count: int) -> bool:
        """Look at the number of samples so far, and tell whether it has stood still for too long."""
        self._still = self._still + 1 if count == self._count and not self._excused else 0
        self._count = count
        return self._still >= HUNG_BEATS


# Supervisor ----------------------------------------------------------------------------------------
#
# The service's side of the loop process: start it, command it, notice its death, start it anew.


START_TIMEOUT_S = 120.0
"""Long enough to compile the control laws on a machine that has never done so."""

ANSWER_TIMEOUT_S = 2.0
STOP_TIMEOUT_S = 3.0

_WATCH = Part("The watch over the loop process", "A loop process that ends now is told late.")
_SHOWING = Part("The sign of life to the loop process", "Without it the loop stops by itself within 4 s.")
_HEARTBEAT = Part("The heartbeat to the loop process", "The loop stops by itself when it hears nothing for 0.34 s.")
PARTS_AT_ONCE = 8
"""Packets of a long program that are sent without waiting; the loop takes one in each tick, and a stop finds room."""

_POLL_S = 0.02
_VOLTAGELESS = (Mode.OFF, Mode.TRIPPED)
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Restart:
    """A planned restart of the loop process: its purpose in words, and when it began (monotonic clock, s)."""

    purpose: str
    began_s: float


class Supervisor:
    """A ``LoopClient`` to the loop process. Lives in one asyncio event loop.

    ``card`` holds the registers of the simulated card that the present loop process writes, or the last one wrote;
    ``guard`` looks at them, ``supervision`` keeps what watches running. It goes by ``started_with`` of a bring-up.
    """

    def __init__(
        self, setup: Setup, supervision: Supervision | None = None, launched: LoopProcess | None = None
    ) -> None:
        self.setup = setup
        self._launched = launched
        self.started_with = setup.brought_up
        self.ring = Ring.create()
        self.card = Card.create()
        self.guard = WatchdogMonitor(self.card)
        self.granted: RealTimeStatus | None = None
        self.driven = ""
        self.restarting: Restart | None = None
        """The planned restart that is under way."""
        self._process: Process | None = None
        self._supervision = supervision or Supervision()
        self._heart: HeartbeatSender | None = None
        self._beating: KeptThread | None = None
        self._channel: Channel | None = None
        self._kept: list[KeptTask] = []
        self._ready: asyncio.Future[RealTimeStatus] | None = None
        self._answers = PendingReplies()
        self._ticking = LivenessMonitor()
        self._listeners: list[EventListener] = []
        self._reason = "it has not been started"
        self._ending = False
        self._one_at_a_time = asyncio.Lock()

    @property
    def alive(self) -> bool:
        """Whether the loop process is there and ticking."""
        return self.granted is not None

    @property
    def beat_age_s(self) -> float | None:
        """Time since the last heartbeat was sent to the loop process [s], None where there is none."""
        return None if self._heart is None else self._heart.age_s

    def fall_silent(self, duration_s: float) -> None:
        """Send no heartbeat for a while: what a service that hangs would be like."""
        if self._heart is not None:
            self._heart.pause(duration_s)

    def listen(self, listener: EventListener) -> Callable[[], None]:
        """Call ``listener`` with each event from now on; return what to call to end that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    async def start(self) -> RealTimeStatus:
        """Start the loop process, outputs at zero volts, and wait until it ticks. Raises LoopExitedError."""
        async with self._one_at_a_time:
            return await self._start()

    async def stop(self, cause: str = "service ended") -> None:
        """Bring the joint to rest, outputs to zero volts, and end the process; ``cause`` is put on record."""
        async with self._one_at_a_time:
            await self._stop(cause)

    async def restart(self, purpose: str) -> RealTimeStatus:
        """End the loop process, if it is there, and start another one with the present ``setup``.

        ``purpose`` describes the restart to people while it takes place. Raises LoopExitedError.
        """
        async with self._one_at_a_time:
            self.restarting = Restart(purpose, time.monotonic())
            try:
                await self._stop("the loop process is replaced")
                return await self._start()
            finally:
                self.restarting = None

    async def _start(self) -> RealTimeStatus:
        if self._process is not None:
            raise LoopExitedError("the loop process is there already: stop it first")
        self.card.expire()  # the loop before may have been killed a moment ago, and it is one and the same card
        if self._launched is None or (launched := self._launched.take()) is None:
            launched = await launch_loop(self.setup.parameters)
        self.ring, self.card = launched.ring, launched.card
        self.guard = WatchdogMonitor(self.card)
        self._ending, self._reason = False, "it is still starting"
        self._ready = asyncio.get_running_loop().create_future()
        self._ready.add_done_callback(lambda ready: ready.cancelled() or ready.exception())  # a start may be given up
        self._process, self._channel = launched.process, (channel := launched.channel)
        self.started_with = self.setup.brought_up
        _LOG.info("Loop process %d started.", self._process.pid)
        with suppress(ChannelClosedError):  # its end is noticed and told by _watch
            channel.send(encode(self.setup))
        asyncio.get_running_loop().add_reader(channel.fileno(), self._receive)
        self._heart = HeartbeatSender(channel)
        self._beating = self._supervision.keep_thread(_HEARTBEAT, self._heart.run, self._heart.stop)
        keep = self._supervision.keep_task
        self._kept = [
            keep(_WATCH, partial(self._watch, self._process)),
            keep(_SHOWING, partial(self._show_alive, channel, self._heart)),
            keep(GUARD, partial(self.guard.run, self._process)),
        ]
        await asyncio.to_thread(heartbeat.prepare)  # before anybody commands: the loop is off, and waits for no beat
        try:
            return await wait_for_result(self._ready, START_TIMEOUT_S)
        except TimeoutError:
            self._kill(f"it was not ready within {START_TIMEOUT_S:g} s")
            return await self._ready

    async def _stop(self, cause: str) -> None:
        if (process := self._process) is None:
            await self.guard.run(None)  # a loop that was killed a moment ago: not before its outputs are off
            return
        self._ending = True
        try:
            if self.alive:
                if not self._is_voltageless():  # else there is nothing to stop, and a planned end is no trip
                    await self._come_to_rest(cause)
                await self.send(Shutdown())
            else:
                process.terminate()
            await wait_for_result(asyncio.ensure_future(process.wait()), STOP_TIMEOUT_S)
        except (LoopExitedError, TimeoutError, ProcessLookupError):
            self._kill("it did not end when told to")
        for kept in self._kept:
            await kept.ended()

    async def send(self, command: Command) -> Accepted | Refused:
        """Hand over a command and wait for the loop's answer.

        Raises LoopExitedError; OutOfRangeError or ChannelError when it is too long.
        """
        channel = self._require_alive()
        with self._answers.expected() as (sequence, answer), self._ticking.excused(command):
            parts = packets(command, sequence)
            with suppress(ChannelClosedError):  # its end is noticed and told by _watch
                for part, packet in enumerate(parts):
                    if part and part % PARTS_AT_ONCE == 0:
                        await asyncio.sleep(PARTS_AT_ONCE * T_s)
                    if not channel.send(packet):
                        self._kill("it does not take commands any more")
                        break
            try:
                return await wait_for_result(answer, ANSWER_TIMEOUT_S)
            except TimeoutError:
                self._kill(f"it did not answer within {ANSWER_TIMEOUT_S:g} s")
                raise LoopExitedError(f"the control loop is not running: {self._reason}") from None

    async def advance(self, seconds: float) -> None:
        """Wait while the loop ticks for so many seconds of its time. Raises LoopExitedError."""
        end = self.ring.count + round(seconds / T_s)
        while self.ring.count < end:
            self._require_alive()
            await asyncio.sleep(_POLL_S)

    async def advance_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        """Wait until ``reached()``. Raises TimeoutError after ``timeout_s`` of the loop's time, LoopExitedError."""
        end = self.ring.count + round(timeout_s / T_s)
        while not reached():
            self._require_alive()
            if self.ring.count >= end:
                raise TimeoutError(f"not reached within {timeout_s:g} s of loop time")
            await asyncio.sleep(_POLL_S)

    def _require_alive(self) -> Channel:
        if self._channel is None or not self.alive:
            raise LoopExitedError(f"the control loop is not running: {self._reason}")
        return self._channel

    def _is_voltageless(self) -> bool:
        """Whether the newest sample is of a mode without voltages: off or tripped."""
        newest = self.ring.newest()
        return newest is not None and MODES[int(newest[INDEX["mode"]])] in _VOLTAGELESS

    async def _come_to_rest(self, cause: str) -> None:
        stopped: asyncio.Future[Stopped] = asyncio.get_running_loop().create_future()

        def hear(event: Event | LoopExited) -> None:
            if isinstance(event, Stopped) and not stopped.done():
                stopped.set_result(event)

        forget = self.listen(hear)
        try:
            await self.send(Stop(Fault.SERVICE_ENDED, hard=False, detail=cause))
            await wait_for_result(stopped, STOP_TIMEOUT_S)
        finally:
            forget()

    def _kill(self, reason: str) -> None:
        self._reason = reason
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()

    def _receive(self) -> None:
        """Take all packets that have arrived; called by the event loop."""
        channel = self._channel
        if channel is None:
            return
        try:
            while (packet := channel.receive()) is not None:
                try:
                    _, message = decode_from_loop(packet)
                except ChannelError:
                    _LOG.exception("The service cannot decode a packet of the loop process: %r", packet[:200])
                else:
                    self._take(message)
        except ChannelClosedError:
            asyncio.get_running_loop().remove_reader(channel.fileno())

    def _take(self, message: FromLoop) -> None:
        match message:
            case Ready(granted, driven, wired):
                self.started_with = select_calibration(wired, self.started_with)
                self.granted, self.driven, self._reason = granted, driven, ""
                if self._ready is not None and not self._ready.done():
                    self._ready.set_result(granted)
            case Failed(reason):
                self._reason = reason
            case event:
                if isinstance(event, ReadinessChanged):  # hands may be at the rig: the next loop has to know it, too
                    self.setup = replace(self.setup, drives_off=event.drives_off)
                self._answers.take(event)
                self._tell(event)

    def _tell(self, event: Event | LoopExited) -> None:
        for listener in tuple(self._listeners):
            try:
                listener(event)
            except Exception:
                _LOG.exception("A listener failed on event %s.", event)

    async def _show_alive(self, channel: Channel, heart: HeartbeatSender) -> None:
        ticking = self._ticking = LivenessMonitor()
        while self._channel is channel:
            heart.shown()
            if self.alive and ticking.hangs(self.ring.count):
                self._kill(f"it has not ticked for {HUNG_BEATS * HEARTBEAT_S:.1f} s")
            await asyncio.sleep(HEARTBEAT_S)

    async def _watch(self, process: Process) -> None:
        """Wait for the end of the process and clear up after it."""
        status = await process.wait()
        self._receive()
        channel, self._channel = self._channel, None
        if self._beating is not None:
            self._beating.end()
            self._heart = self._beating = None
        if channel is not None:
            asyncio.get_running_loop().remove_reader(channel.fileno())
            channel.close()
        was_alive, self.granted, self._process = self.alive, None, None
        self._reason = _reason_of_end(status, self._reason)
        _LOG.info("Loop process %d: %s", process.pid, self._reason)
        died = LoopExitedError(f"the control loop is not running: {self._reason}")
        if self._ready is not None and not self._ready.done():
            self._ready.set_exception(died)
        self._answers.fail(died)
        if was_alive and not self._ending:
            self._tell(LoopExited(self._reason))


def _reason_of_end(status: int, known: str) -> str:
    how = f"killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"
    return f"{known} ({how})" if known else how
