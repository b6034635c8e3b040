"""Keeps what runs in the background running: a task or a thread that dies is logged, told, and started anew.

Nothing here can itself die unseen: a task's end calls back, whoever ended it, and threads are looked at by a timer of
the event loop. A part that dies again soon is started again later each time, LONGEST_PAUSE_S later at most.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any, NamedTuple

FIRST_PAUSE_S = 0.1
LONGEST_PAUSE_S = 10.0

WELL_S = 60.0
"""A part that has lived for so long [s] since it was started anew is well: its death is a matter for the journal."""

LOOK_S = 0.1
"""How often threads are looked at [s]."""

_LOG = logging.getLogger(__name__)


class Part(NamedTuple):
    """Something that runs in the background.

    ``name`` begins a sentence ("The live stream"); ``meaning`` is one for the operator: what is lost while the part is
    not there.
    """

    name: str
    meaning: str


@dataclass
class _Deaths:
    """How often a part has died lately, of what, when last [s], and when it is started anew."""

    part: Part
    cause: str = ""
    count: int = 0
    at: float = 0.0
    again_at: float = 0.0


class Supervision:
    """The parts of one service. Belongs to one asyncio event loop."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._deaths: dict[str, _Deaths] = {}
        self._threads: list[KeptThread] = []
        self._tasks: list[KeptTask] = []
        self._listeners: list[Callable[[str], None]] = []
        self._look_due: asyncio.TimerHandle | None = None

    def listen(self, told: Callable[[str], None]) -> None:
        """Call ``told`` with a sentence when a part dies that was well before."""
        self._listeners.append(told)

    def keep_task(
        self, part: Part, work: Callable[[], Coroutine[Any, Any, None]], on_death: Callable[[], None] | None = None
    ) -> "KeptTask":
        """Run ``work()`` as a task until it returns or is ended; ``on_death`` is called at once when it dies."""
        kept = KeptTask(part, work, self.died, on_death)
        self._tasks = [*(earlier for earlier in self._tasks if not earlier.is_over), kept]
        return kept

    def keep_thread(self, part: Part, work: Callable[[], None], tell: Callable[[], None]) -> "KeptThread":
        """Run ``work()`` in a thread until it returns; ``tell`` tells it to."""
        kept = KeptThread(part, work, tell, self.died)
        self._threads.append(kept)
        if self._look_due is None:
            self._look()
        return kept

    def died(self, part: Part, cause: str, error: BaseException | None = None) -> float:
        """Take note of a death; return after how long [s] the part may be started anew.

        Called by what was begun here, and by whoever starts something anew by itself.
        """
        now = self._clock()
        deaths = self._deaths.setdefault(part.name, _Deaths(part))
        was_well = not deaths.count or now - deaths.again_at >= WELL_S
        deaths.count = 1 if was_well else deaths.count + 1
        deaths.cause, deaths.at = cause, now
        pause = min(FIRST_PAUSE_S * 2.0 ** min(deaths.count - 1, 30), LONGEST_PAUSE_S)
        deaths.again_at = now + pause
        _LOG.error("%s died: %s", part.name, cause, exc_info=error)
        if was_well:
            self._tell(f"{part.name} died ({cause}) and is started anew.")
        return pause

    @property
    def problems(self) -> list[str]:
        """What has died lately and what that means, a few sentences per part."""
        now = self._clock()
        return [_sentence(deaths, now) for deaths in self._deaths.values() if now - deaths.again_at < WELL_S]

    async def close(self) -> None:
        """End the tasks that are left and look at threads no longer; those are ended by whoever began them."""
        if self._look_due is not None:
            self._look_due.cancel()
        for kept in self._tasks:
            await kept.end()

    def _tell(self, sentence: str) -> None:
        for told in self._listeners:
            try:
                told(sentence)
            except Exception:
                _LOG.exception("A listener failed on %r.", sentence)

    def _look(self) -> None:
        self._look_due = asyncio.get_running_loop().call_later(LOOK_S, self._look)
        now = self._clock()
        for kept in self._threads:
            kept.look(now)
        self._threads = [kept for kept in self._threads if not kept.done]


class KeptTask:
    """A task that is started anew when it dies: of an exception, or cancelled by anybody but ``end``."""

    def __init__(
        self,
        part: Part,
        work: Callable[[], Coroutine[Any, Any, None]],
        died: Callable[[Part, str, BaseException | None], float],
        on_death: Callable[[], None] | None = None,
    ) -> None:
        self._part, self._work, self._died, self._on_death = part, work, died, on_death
        self._loop = asyncio.get_running_loop()
        self._ending = False
        self._over = asyncio.Event()
        self._again: asyncio.TimerHandle | None = None
        self._task = self._start()

    @property
    def is_over(self) -> bool:
        """Whether the work has returned or was ended."""
        return self._over.is_set()

    async def ended(self) -> None:
        """Wait until the work has returned or was ended."""
        await self._over.wait()

    async def end(self) -> None:
        """Cancel the work and wait for its end."""
        self.cancel()
        await self._over.wait()

    def cancel(self) -> None:
        """Cancel the work, without waiting; it is not started anew."""
        self._ending = True
        if self._again is not None:
            self._again.cancel()
        if self._task.done():
            self._over.set()
        else:
            self._task.cancel()

    @property
    def is_current(self) -> bool:
        """Whether this is the task that asks."""
        return self._task is asyncio.current_task()

    def _start(self) -> asyncio.Task[None]:
        self._task = self._loop.create_task(self._work(), name=self._part.name)
        self._task.add_done_callback(self._ended)
        return self._task

    def _ended(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if self._ending or (error is None and not task.cancelled()):
            if error is not None:
                _LOG.error("%s failed while it ended.", self._part.name, exc_info=error)
            self._over.set()
            return
        try:
            pause = self._died(self._part, _cause(error, "it was cancelled"), error)
        except Exception:
            _LOG.exception("The supervision could not record that %s failed.", self._part.name)
            pause = LONGEST_PAUSE_S
        self._again = self._loop.call_later(pause, self._start)
        if self._on_death is not None:
            self._on_death()


class KeptThread:
    """A thread that is started anew when it dies of an exception, or without a word."""

    def __init__(
        self,
        part: Part,
        work: Callable[[], None],
        tell: Callable[[], None],
        died: Callable[[Part, str, BaseException | None], float],
    ) -> None:
        self._part, self._work, self._tell, self._died = part, work, tell, died
        self._error: BaseException | None = None
        self._returned = False
        self._ending = False
        self._again_at: float | None = None
        self._thread = self._start()

    @property
    def done(self) -> bool:
        """Whether nothing is left to keep."""
        return self._returned or (self._ending and not self._thread.is_alive())

    def end(self, timeout_s: float | None = None) -> None:
        """Tell the work to end and wait for that; it is not started anew."""
        self._ending = True
        self._tell()
        self._thread.join(timeout_s)

    def look(self, now: float) -> None:
        """Start the thread anew where it has died and its pause is over."""
        if self._returned or self._ending or self._thread.is_alive():
            return
        if self._again_at is None:
            self._again_at = now + self._died(self._part, _cause(self._error, "it ended without a word"), self._error)
        elif now >= self._again_at:
            self._error = self._again_at = None
            self._start()

    def _start(self) -> threading.Thread:
        self._thread = threading.Thread(target=self._run, name=self._part.name, daemon=True)
        self._thread.start()
        return self._thread

    def _run(self) -> None:
        try:
            self._work()
        except BaseException as error:  # SystemExit too: a thread that ends so says nothing by itself
            self._error = error
        else:
            self._returned = True


def _cause(error: BaseException | None, otherwise: str) -> str:
    return otherwise if error is None else f"{type(error).__name__}: {error}".removesuffix(": ")


def _sentence(deaths: _Deaths, now: float) -> str:
    being = "was" if now >= deaths.again_at else "is being"
    times = "" if deaths.count == 1 else f", {deaths.count} times in a row"
    return f"{deaths.part.name} died ({deaths.cause}) and {being} started anew{times}. {deaths.part.meaning}"
