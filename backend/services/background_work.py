"""Work of users in worker processes: texts, tuning previews, chart sheets."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from threading import Lock
from typing import Any, ParamSpec, TypeVar

from backend.auth import User
from backend.banks import TuningSettings, list_point_models
from backend.errors import RequestRejectedError
from backend.reports import render_sheet_pdf
from backend.schemas import Motion, MotorPreview, RobustTuning, Role, TuningPreview
from backend.services import messages
from backend.services.tuning_state import ActiveTuning
from backend.storage import Bank
from backend.tuning import TuningPreviewer
from backend.workers import WorkerProcess
from plant import ErrorCode, PlantParameters

# Cancellation --------------------------------------------------------------------------------------
# Cancels work when its client disconnects, so that no worker process computes a result that no
# client receives.


P = ParamSpec("P")
T = TypeVar("T")

IsDisconnected = Callable[[], Awaitable[bool]]
"""Returns whether the client of a request has disconnected."""

POLL_S = 0.5


async def run_while_connected(work: Coroutine[Any, Any, T], is_disconnected: IsDisconnected) -> T:
    """Return the result of ``work``; cancel it when its client disconnects.

    The cancellation also ends the worker process. Raises RequestRejectedError after a disconnection.
    """
    task = asyncio.ensure_future(work)
    try:
        while not (await asyncio.wait({task}, timeout=POLL_S))[0]:
            if await is_disconnected():
                raise RequestRejectedError(ErrorCode.UNAVAILABLE, messages.computation_cancelled())
        return task.result()
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


# Limits --------------------------------------------------------------------------------------------
# Limits concurrent work: in total, of all viewers, and of each user. Viewers can use a part of the
# total only, so that operators are served.


RETRY_S = 1
"""Time [s] after which a rejected client may try again."""

_reserved_limiter: ContextVar["WorkLimiter | None"] = ContextVar("held", default=None)
"""Limiter in which the current request has reserved its work already."""


class WorkLimiter:
    """Limits concurrent work of users. Used in one event loop.

    A request with a large body reserves before the body is read; its work then uses the same reservation.
    """

    def __init__(self, work: str, works: str, total: int, viewers: int, per_user: int) -> None:
        """Limit work in total, of all viewers, and of each user.

        ``work`` and ``works`` name one and several pieces of work in messages.
        """
        self._work, self._works = work, works
        self._total, self._viewers, self._per_user = total, viewers, per_user
        self._active: list[User] = []

    @contextmanager
    def reserve(self, user: User) -> Iterator[None]:
        """Reserve work for the block, unless the request has reserved it already.

        Raises RequestRejectedError at a limit.
        """
        if _reserved_limiter.get() is self:
            yield
            return
        self._require_capacity(user)
        self._active.append(user)
        context = _reserved_limiter.set(self)
        try:
            yield
        finally:
            _reserved_limiter.reset(context)
            self._active.remove(user)

    def _require_capacity(self, user: User) -> None:
        own = sum(other.name == user.name and other.role == user.role for other in self._active)
        if own >= self._per_user:
            raise RequestRejectedError(
                ErrorCode.TOO_MANY,
                messages.own_work_at_limit(work=self._work, works=self._works, count=own, maximum=self._per_user),
                code="busy",
                retry_after_s=RETRY_S,
            )
        viewers = sum(not is_operator(other) for other in self._active)
        if len(self._active) >= self._total or (not is_operator(user) and viewers >= self._viewers):
            raise RequestRejectedError(
                ErrorCode.TOO_MANY,
                messages.work_at_limit(works=self._works, count=len(self._active)),
                code="busy",
                retry_after_s=RETRY_S,
            )


def is_operator(user: User) -> bool:
    """Return whether a user has the role of an operator."""
    return user.role is Role.OPERATOR


# Tuning previews -----------------------------------------------------------------------------------
# Computes previews of a tuning in a worker process, because a preview holds Python's interpreter
# lock for up to half a second. Each process caches the models of recent tunings, whose computation
# takes most of the time of a preview.


_MAX_RECENT = 6
_recent: list[ActiveTuning] = []
_recent_lock = Lock()


@dataclass(frozen=True)
class TuningSnapshot:
    """A tuning as it is sent to a worker process, without its models."""

    parameters: PlantParameters
    settings: TuningSettings
    bank: Bank | None
    ranges: Sequence[tuple[float, ...]]
    """Smallest λ_q and λ_S [s] at each operating point, which are slow to compute."""

    @classmethod
    def from_active(cls, tuning: ActiveTuning) -> "TuningSnapshot":
        """Return a snapshot of the active tuning."""
        return cls(tuning.parameters, tuning.settings, tuning.bank, tuning.previewer.ranges)

    def resolve(self) -> ActiveTuning:
        """Return the tuning with its models, from the cache if possible."""
        with _recent_lock:
            cached = next((one for one in _recent if self._has_models_of(one)), None)
            if cached is None:
                points = list_point_models(self.bank)
                lam_motor, b = self.settings.lam_motor, self.settings.b
                previewer = TuningPreviewer(self.parameters, points, lam_motor=lam_motor, b=b, ranges=self.ranges)
                cached = ActiveTuning(self.settings, self.bank, self.parameters, previewer)
                _recent.insert(0, cached)
                del _recent[_MAX_RECENT:]
        return ActiveTuning(self.settings, self.bank, self.parameters, cached.previewer)

    def _has_models_of(self, other: ActiveTuning) -> bool:
        return (
            (self.settings.lam_motor, self.settings.b) == (other.settings.lam_motor, other.settings.b)
            and self.bank == other.bank
            and self.parameters == other.parameters
        )


def preview_tuning(
    snapshot: TuningSnapshot,
    lam_q: float,
    lam_S: float,
    S: float,
    entry: float,
    motion: Motion | None,
    u_plan: float | None,
    k_ext: float | None,
    printed: bool,
) -> TuningPreview:
    """Return ``ActiveTuning.preview`` of a snapshot. Raises OutOfRangeError."""
    tuning = snapshot.resolve()
    return tuning.preview(lam_q, lam_S, S, entry, motion=motion, u_plan=u_plan, k_ext=k_ext, printed=printed)


def preview_motor(snapshot: TuningSnapshot, lam_motor: float) -> MotorPreview:
    """Return ``ActiveTuning.preview_motor`` of a snapshot. Raises OutOfRangeError."""
    return snapshot.resolve().preview_motor(lam_motor)


def compute_robust_tuning(snapshot: TuningSnapshot, M_s: float) -> RobustTuning:
    """Return ``ActiveTuning.compute_robust_tuning`` of a snapshot."""
    return snapshot.resolve().compute_robust_tuning(M_s)


# Chart sheets --------------------------------------------------------------------------------------
# Renders chart sheets, which users send, as PDF. They have their own worker process, so that
# reports do not wait for them.


MAX_SHEETS = 8
MAX_VIEWER_SHEETS = 6
MAX_SHEETS_PER_USER = 2


class ChartSheets:
    """Renders chart sheets. Runs in the event loop of the service."""

    def __init__(self, worker: WorkerProcess) -> None:
        self._worker = worker
        self.limiter = WorkLimiter("a chart sheet", "chart sheets", MAX_SHEETS, MAX_VIEWER_SHEETS, MAX_SHEETS_PER_USER)

    async def render(self, svg: str, user: User, is_disconnected: IsDisconnected) -> bytes:
        """Return a sheet as PDF.

        Raises RequestRejectedError for an invalid sheet or at a limit, WorkLimitError.
        """
        with self.limiter.reserve(user):
            return await run_while_connected(self._worker.run(render_sheet_pdf, svg), is_disconnected)


# Texts and previews --------------------------------------------------------------------------------
# Evaluates texts of users and previews in worker processes. A text may be slow on purpose, and a
# preview holds Python's interpreter lock: in the process of the service, both would delay STOP.
# Viewers and operators have separate processes, so that a viewer cannot delay an operator.


MAX_TEXTS = 32
MAX_VIEWER_TEXTS = 24
MAX_TEXTS_PER_USER = 8
"""Texts of one user: a browser sends six requests at a time."""

MAX_PREVIEWS = 32
MAX_VIEWER_PREVIEWS = 24
MAX_PREVIEWS_PER_USER = 12
"""Previews of one user: a moving slider requests the next one before the last one has arrived."""


Compute = Callable[..., Awaitable[Any]]
"""Runs ``function(*arguments)`` elsewhere, with the signature of ``asyncio.to_thread``."""


class TextWork:
    """Runs work of users in the worker processes of operators and viewers.

    Runs in the event loop of the service.
    """

    def __init__(self, operators: WorkerProcess, viewers: WorkerProcess) -> None:
        self._operators, self._viewers = operators, viewers
        self.limiter = WorkLimiter("a text", "texts", MAX_TEXTS, MAX_VIEWER_TEXTS, MAX_TEXTS_PER_USER)
        self.preview_limiter = WorkLimiter(
            "a preview", "previews", MAX_PREVIEWS, MAX_VIEWER_PREVIEWS, MAX_PREVIEWS_PER_USER
        )
        self._preview_locks = {operators: asyncio.Lock(), viewers: asyncio.Lock()}

    async def run(
        self,
        user: User,
        is_disconnected: IsDisconnected,
        work: Callable[P, T],
        *arguments: P.args,
        **keywords: P.kwargs,
    ) -> T:
        """Return ``work(*arguments)``, cancelled if the user disconnects.

        Raises errors of the work, WorkLimitError, and RequestRejectedError at a limit.
        """
        process = self._select_process(user)
        with self.limiter.reserve(user):
            return await run_while_connected(process.run(work, *arguments, **keywords), is_disconnected)

    def make_preview_runner(self, user: User, is_disconnected: IsDisconnected) -> Compute:
        """Return a function that computes previews of a user, one at a time per process.

        A preview whose user has disconnected while it waited is not computed. One that has started is finished, because
        its cancellation would end the process with its cache. The function raises errors of the work, WorkLimitError,
        and RequestRejectedError at a limit.
        """

        async def compute(work: Callable[..., T], *arguments: Any) -> T:
            process = self._select_process(user)
            lock = self._preview_locks[process]
            with self.preview_limiter.reserve(user):
                await _acquire(lock, is_disconnected)
                try:
                    return await process.run(work, *arguments)
                finally:
                    lock.release()

        return compute

    async def run_for_operator(self, work: Callable[P, T], *arguments: P.args, **keywords: P.kwargs) -> T:
        """Return ``work(*arguments)`` for a command of an operator.

        A disconnection does not cancel it. Raises the errors of ``run``.
        """
        return await self._operators.run(work, *arguments, **keywords)

    def _select_process(self, user: User) -> WorkerProcess:
        return self._operators if is_operator(user) else self._viewers


async def _acquire(lock: asyncio.Lock, is_disconnected: IsDisconnected) -> None:
    """Acquire a lock. Raises RequestRejectedError if the client disconnects meanwhile."""
    acquiring = asyncio.ensure_future(lock.acquire())
    try:
        while not (await asyncio.wait({acquiring}, timeout=POLL_S))[0]:
            if await is_disconnected():
                raise RequestRejectedError(ErrorCode.UNAVAILABLE, messages.computation_not_started())
    except BaseException:
        if not acquiring.cancel():  # the lock was acquired meanwhile
            lock.release()
        raise
