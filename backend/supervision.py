"""Runs background tasks and threads; logs, reports and restarts those that die.

The end of a task triggers a callback; a timer of the event loop checks the threads. The restart delay doubles with each
failure in a row, up to MAX_RESTART_DELAY_S.
"""

import asyncio
import logging
import threading
import time
import traceback
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any, NamedTuple

FIRST_RESTART_DELAY_S = 0.1
MAX_RESTART_DELAY_S = 10.0

STABLE_AFTER_S = 60.0
"""Time [s] after its restart at which a part counts as stable.

Listeners are notified when a stable part fails, not of each failure in a row.
"""

CHECK_PERIOD_S = 0.1
"""Period of the check of the threads [s]."""

_log = logging.getLogger(__name__)


class Part(NamedTuple):
    """A task, thread or process that runs in the background.

    ``name`` begins a sentence of a message ("The live stream"). ``consequence`` is a sentence for the operator: what
    does not work while the part is not running.
    """

    name: str
    consequence: str


@dataclass
class _FailureRecord:
    """Recent failures of one part: cause, number in a row, time of the restart [s]."""

    part: Part
    cause: str = ""
    count: int = 0
    restart_at: float = 0.0


class Supervision:
    """Starts and restarts the background parts of one service.

    Belongs to one asyncio event loop.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures: dict[str, _FailureRecord] = {}
        self._threads: list[SupervisedThread] = []
        self._tasks: list[SupervisedTask] = []
        self._listeners: list[Callable[[str], None]] = []
        self._check_timer: asyncio.TimerHandle | None = None

    def add_listener(self, listener: Callable[[str], None]) -> None:
        """Call ``listener`` with a message whenever a part fails that was stable."""
        self._listeners.append(listener)

    def start_task(
        self, part: Part, work: Callable[[], Coroutine[Any, Any, None]], on_death: Callable[[], None] | None = None
    ) -> "SupervisedTask":
        """Run ``work()`` as a task until it returns or is ended.

        ``on_death`` is called at once when the task fails; the task restarts after a delay.
        """
        task = SupervisedTask(part, work, self.record_failure, on_death)
        self._tasks = [*(earlier for earlier in self._tasks if not earlier.is_finished), task]
        return task

    def start_thread(
        self, part: Part, work: Callable[[], None], request_stop: Callable[[], None]
    ) -> "SupervisedThread":
        """Run ``work()`` in a thread until it returns; ``request_stop`` asks it to."""
        thread = SupervisedThread(part, work, request_stop, self.record_failure)
        self._threads.append(thread)
        if self._check_timer is None:
            self._check_threads()
        return thread

    def record_failure(self, part: Part, cause: str, error: BaseException | None = None) -> float:
        """Record that a part failed and return the delay [s] until its restart.

        Called by the tasks and threads of this module, and by parts that restart their own processes.
        """
        now = self._clock()
        record = self._failures.setdefault(part.name, _FailureRecord(part))
        was_stable = not record.count or now - record.restart_at >= STABLE_AFTER_S
        record.count = 1 if was_stable else record.count + 1
        record.cause = cause
        delay_s = min(FIRST_RESTART_DELAY_S * 2.0 ** min(record.count - 1, 30), MAX_RESTART_DELAY_S)
        record.restart_at = now + delay_s
        _log.error("%s failed: %s", part.name, cause, exc_info=error)
        if was_stable:
            self._notify(f"{part.name} failed ({cause}) and is being restarted.")
        return delay_s

    @property
    def problems(self) -> list[str]:
        """Messages on the parts that failed recently, one per part."""
        now = self._clock()
        return [
            _describe_failure(record, now)
            for record in self._failures.values()
            if now - record.restart_at < STABLE_AFTER_S
        ]

    async def close(self) -> None:
        """End the tasks and stop checking the threads, which their owners end."""
        if self._check_timer is not None:
            self._check_timer.cancel()
        for task in self._tasks:
            await task.end()

    def _notify(self, message: str) -> None:
        for listener in self._listeners:
            try:
                listener(message)
            except Exception:
                _log.exception("A listener failed on %r.", message)

    def _check_threads(self) -> None:
        self._check_timer = asyncio.get_running_loop().call_later(CHECK_PERIOD_S, self._check_threads)
        now = self._clock()
        for thread in self._threads:
            thread.check(now)
        self._threads = [thread for thread in self._threads if not thread.is_done]


class SupervisedTask:
    """A task that restarts when it raises, or is cancelled by anyone but ``end``."""

    def __init__(
        self,
        part: Part,
        work: Callable[[], Coroutine[Any, Any, None]],
        on_failure: Callable[[Part, str, BaseException | None], float],
        on_death: Callable[[], None] | None = None,
    ) -> None:
        self._part, self._work, self._on_failure, self._on_death = part, work, on_failure, on_death
        self._loop = asyncio.get_running_loop()
        self._ending = False
        self._finished = asyncio.Event()
        self._restart_timer: asyncio.TimerHandle | None = None
        self._task = self._start()

    @property
    def is_finished(self) -> bool:
        """Whether the work has returned or was ended."""
        return self._finished.is_set()

    async def wait(self) -> None:
        """Wait until the work has returned or was ended."""
        await self._finished.wait()

    async def end(self) -> None:
        """Cancel the work and wait for its end."""
        self.cancel()
        await self._finished.wait()

    def cancel(self) -> None:
        """Cancel the work without waiting; it does not restart."""
        self._ending = True
        if self._restart_timer is not None:
            self._restart_timer.cancel()
        if self._task.done():
            self._finished.set()
        else:
            self._task.cancel()

    @property
    def is_current(self) -> bool:
        """Whether the caller runs in this task."""
        return self._task is asyncio.current_task()

    def _start(self) -> asyncio.Task[None]:
        self._task = self._loop.create_task(self._work(), name=self._part.name)
        self._task.add_done_callback(self._on_done)
        return self._task

    def _on_done(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            _release_locals(error)
        if self._ending or (error is None and not task.cancelled()):
            if error is not None:
                _log.error("%s failed during shutdown.", self._part.name, exc_info=error)
            self._finished.set()
            return
        try:
            delay_s = self._on_failure(self._part, _describe_cause(error, "it was cancelled"), error)
        except Exception:
            _log.exception("The supervisor could not record that %s failed.", self._part.name)
            delay_s = MAX_RESTART_DELAY_S
        self._restart_timer = self._loop.call_later(delay_s, self._start)
        if self._on_death is not None:
            self._on_death()


class SupervisedThread:
    """A thread that restarts when it raises or ends without returning."""

    def __init__(
        self,
        part: Part,
        work: Callable[[], None],
        request_stop: Callable[[], None],
        on_failure: Callable[[Part, str, BaseException | None], float],
    ) -> None:
        self._part, self._work, self._request_stop, self._on_failure = part, work, request_stop, on_failure
        self._error: BaseException | None = None
        self._returned = False
        self._ending = False
        self._restart_at: float | None = None
        self._thread = self._start()

    @property
    def is_done(self) -> bool:
        """Whether the work has returned, or the thread was ended."""
        return self._returned or (self._ending and not self._thread.is_alive())

    def end(self, timeout_s: float | None = None) -> None:
        """Ask the work to stop and wait for that; it does not restart."""
        self._ending = True
        self._request_stop()
        self._thread.join(timeout_s)

    def check(self, now: float) -> None:
        """Restart the thread when it has died and its delay is over; ``now`` in s."""
        if self._returned or self._ending or self._thread.is_alive():
            return
        if self._restart_at is None:
            self._restart_at = now + self._on_failure(
                self._part, _describe_cause(self._error, "it ended without an error message"), self._error
            )
        elif now >= self._restart_at:
            self._error = self._restart_at = None
            self._start()

    def _start(self) -> threading.Thread:
        self._thread = threading.Thread(target=self._run, name=self._part.name, daemon=True)
        self._thread.start()
        return self._thread

    def _run(self) -> None:
        try:
            self._work()
        except BaseException as error:  # SystemExit too: it would end the thread silently
            _release_locals(error)
            self._error = error
        else:
            self._returned = True


def _release_locals(error: BaseException) -> None:
    """Clear the local variables of the frames that raised an error; its traceback remains printable.

    Whoever keeps the error would keep them too: a cursor of a transaction that was cut short locks the database.
    """
    traceback.clear_frames(error.__traceback__)


def _describe_cause(error: BaseException | None, otherwise: str) -> str:
    return otherwise if error is None else f"{type(error).__name__}: {error}".removesuffix(": ")


def _describe_failure(record: _FailureRecord, now: float) -> str:
    being = "was" if now >= record.restart_at else "is being"
    times = "" if record.count == 1 else f", {record.count} times in a row"
    return f"{record.part.name} failed ({record.cause}) and {being} restarted{times}. {record.part.consequence}"
