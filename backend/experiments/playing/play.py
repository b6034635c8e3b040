"""Bring the loop up and play a program to its end. The same for a live loop and a headless one."""

from backend.experiments.playing.progress import Doing, Notify
from backend.faults import Fault
from backend.realtime.commands import Accepted, Event, Refused, RunEnded, RunProgram, SetMode, Stop, Stopped
from backend.realtime.program import MODES, Mode, Program, mode_of_law, starts_from
from backend.realtime.supervisor import LoopAccess, LoopDied, LoopDiedError
from backend.sample import INDEX
from plant.interface import T_s

PRETENSION_TIMEOUT_S = 120.0
TRAVEL_ALLOWANCE_S = 60.0
"""A program of identification first travels to its point; a program longer than planned by this much hangs."""

SLICE_S = 0.1
"""How often progress is told [s of loop time]."""


class NotPlayedError(Exception):
    """The loop did not take the program, for the reason that the message says."""


class NotReadyError(Exception):
    """The loop is in a mode that no program can start from; the message says what to do first."""

    def __init__(self, reason: str, mode: Mode) -> None:
        super().__init__(reason)
        self.mode = mode


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


async def play(loop: LoopAccess, program: Program, run: int, notify: Notify) -> None:
    """Play ``program`` as ``run``; where it cannot start at once, wind up to pretension first.

    How it ended, the loop has told its recorder. A program that hangs is stopped. Raises NotPlayedError where the loop
    never took it, LoopDiedError.
    """
    watch = _Watch(run)
    end_listening = loop.listen(watch.hear)
    try:
        await _start(loop, program, run, notify)
        await _until_ended(loop, program, watch, notify)
        if watch.died is not None:
            raise LoopDiedError(watch.died.reason)
    finally:
        end_listening()


async def _start(loop: LoopAccess, program: Program, run: int, notify: Notify) -> None:
    """Bring the loop to where the program can start, and start it. Raises NotPlayedError."""
    mode = mode_of_law(program.law)
    if not starts_from(program.law, mode_of(loop)):
        answer = await loop.send(SetMode(Mode.PRETENSION))
        if isinstance(answer, Refused):
            raise NotPlayedError(answer.reason)
    waited_s = 0.0
    while waited_s < PRETENSION_TIMEOUT_S:
        answer = await loop.send(RunProgram(program, run))
        if isinstance(answer, Accepted):
            return
        if mode not in answer.legal:  # refused for good, not only until both tendons are taut
            raise NotPlayedError(answer.reason)
        notify(Doing.PRETENSION, waited_s)
        await loop.advance(SLICE_S)
        waited_s += SLICE_S
    raise NotPlayedError(f"pretension was not reached within {PRETENSION_TIMEOUT_S:g} s")


async def _until_ended(loop: LoopAccess, program: Program, watch: "_Watch", notify: Notify) -> None:
    start_tick = loop.ring.count
    longest_s = program.duration_s + TRAVEL_ALLOWANCE_S
    while not watch.over:
        elapsed_s = (loop.ring.count - start_tick) * T_s
        notify(Doing.PROGRAM, elapsed_s)
        if elapsed_s > longest_s and not watch.hung:
            watch.hung = True
            await loop.send(Stop(hard=False, detail="the program hung and was stopped"))
        await loop.advance(SLICE_S)


class _Watch:
    """Hears from the loop whether a program is over."""

    def __init__(self, run: int) -> None:
        self.hung = False
        self._run = run
        self._ended: RunEnded | None = None
        self._at_rest = False
        self.died: LoopDied | None = None

    def hear(self, event: Event | LoopDied) -> None:
        match event:
            case LoopDied():
                self.died = event
            case Stopped():
                self._at_rest = True
            case RunEnded() if event.run == self._run:
                self._ended = event

    @property
    def over(self) -> bool:
        """Whether the program has ended and, where a fault ended it, the stop is complete."""
        ended = self._ended is not None and (not isinstance(self._ended.why, Fault) or self._at_rest)
        return ended or self.died is not None
