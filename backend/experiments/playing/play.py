"""Bring the loop up, play a program to its end, and say how it ended. The same for a live loop and a headless one."""

from dataclasses import dataclass

from backend.experiments.playing.progress import Doing, Notify
from backend.faults import Fault
from backend.loop.access import LoopAccess, LoopDied, LoopDiedError
from backend.loop.causes import Why
from backend.loop.commands import (
    Accepted,
    Event,
    ModeChanged,
    ProgramEnded,
    Refused,
    RunProgram,
    SetMode,
    Stop,
    Stopped,
)
from backend.loop.mode import MODES, Mode
from backend.loop.program import Program, mode_of_law, starts_from
from backend.sample import INDEX
from backend.storage.runs import EndState, end_state_of
from plant.interface import T_s

PRETENSION_TIMEOUT_S = 120.0
TRAVEL_ALLOWANCE_S = 60.0
"""A program of identification first travels to its point; a program longer than planned by this much hangs."""

SLICE_S = 0.1
"""How often progress is told [s of loop time]."""


class NotReadyError(Exception):
    """The loop is in a mode that no program can start from; the message says what to do first."""

    def __init__(self, reason: str, mode: Mode) -> None:
        super().__init__(reason)
        self.mode = mode


@dataclass(frozen=True)
class Ending:
    """How a program ended, as whoever watched it saw it."""

    end_state: EndState
    detail: str


def mode_of(loop: LoopAccess) -> Mode:
    """Return the mode of the newest sample; OFF before the first."""
    newest = loop.ring.newest()
    return Mode.OFF if newest is None else MODES[int(newest[INDEX["mode"]])]


def require_ready(loop: LoopAccess) -> None:
    """Raise NotReadyError unless a program could be started from the present mode."""
    mode = mode_of(loop)
    if mode in (Mode.IDENTIFY, Mode.EXPERIMENT):
        raise NotReadyError("another program is being played: wait for its end or stop it", mode)
    if mode in (Mode.STOPPING, Mode.TRIPPED):
        raise NotReadyError("the loop is stopped: reset it first", mode)


async def play(loop: LoopAccess, program: Program, run: int, notify: Notify) -> Ending:
    """Play ``program`` as ``run``; where it cannot start at once, wind up to pretension first.

    Never raises for what happens to the loop: that is the ending. A program that hangs is stopped.
    """
    watch = _Watch(run)
    end_listening = loop.listen(watch.hear)
    try:
        refused = await _start(loop, program, run, notify)
        if refused is None:
            await _until_ended(loop, program, watch, notify)
        return watch.ending(refused or "")
    except LoopDiedError as error:
        return watch.ending(str(error))
    finally:
        end_listening()


async def _start(loop: LoopAccess, program: Program, run: int, notify: Notify) -> str | None:
    """Bring the loop to where the program can start, and start it; return why it could not."""
    mode = mode_of_law(program.law)
    if not starts_from(program.law, mode_of(loop)):
        answer = await loop.send(SetMode(Mode.PRETENSION))
        if isinstance(answer, Refused):
            return answer.reason
    waited_s = 0.0
    while waited_s < PRETENSION_TIMEOUT_S:
        answer = await loop.send(RunProgram(program, run))
        if isinstance(answer, Accepted):
            return None
        if mode not in answer.legal:  # refused for good, not only until both tendons are taut
            return answer.reason
        notify(Doing.PRETENSION, waited_s)
        await loop.advance(SLICE_S)
        waited_s += SLICE_S
    return f"pretension was not reached within {PRETENSION_TIMEOUT_S:g} s"


async def _until_ended(loop: LoopAccess, program: Program, watch: "_Watch", notify: Notify) -> None:
    start_tick = loop.ring.count
    longest_s = program.duration_s + TRAVEL_ALLOWANCE_S
    while not watch.over:
        elapsed_s = (loop.ring.count - start_tick) * T_s
        notify(Doing.PROGRAM, elapsed_s)
        if elapsed_s > longest_s and not watch.hung:
            watch.hung = True
            await loop.send(Stop(hard=False))
        await loop.advance(SLICE_S)


class _Watch:
    """Hears the loop's events and tells from them whether and how the program ended."""

    def __init__(self, run: int) -> None:
        self.hung = False
        self._run = run
        self._ended: ProgramEnded | None = None
        self._stopped: Stopped | None = None
        self._died: LoopDied | None = None
        self._cause: Why | None = None

    def hear(self, event: Event | LoopDied) -> None:
        match event:
            case LoopDied():
                self._died = event
            case Stopped():
                self._stopped = event
            case ProgramEnded() if event.run == self._run:
                self._ended = event
            case ModeChanged() if self._ended is not None and self._cause is None:
                self._cause = event.cause

    @property
    def over(self) -> bool:
        """Whether the program has ended and, where a fault ended it, the stop is complete."""
        if self._died is not None:
            return True
        return self._cause is not None and (not isinstance(self._cause, Fault) or self._stopped is not None)

    def ending(self, reason: str) -> Ending:
        """Return how it ended; ``reason`` is what is known where no event tells."""
        if self._ended is not None and self._ended.completed:
            return Ending(EndState.COMPLETED, "")
        if self._died is not None:
            return Ending(EndState.LINK_LOST, self._died.reason)
        if self.hung:
            return Ending(EndState.STOPPED, "the program hung and was stopped")
        if self._stopped is not None:
            fault, detail = self._stopped.fault, self._stopped.detail
            if fault is Fault.SERVICE_ENDED:
                return Ending(end_state_of(fault), detail)
            return Ending(end_state_of(fault), f"{fault}: {detail}" if detail else fault)
        return Ending(EndState.STOPPED, reason or self._cause or "")
