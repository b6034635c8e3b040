"""Work of persons in worker processes, within limits: texts, previews, sheets."""

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
from backend.services.tuning_state import ActiveTuning
from backend.storage import Bank
from backend.tuning import TuningPreviewer
from backend.workers import WorkerProcess
from plant import ErrorCode, PlantParameters

# Departure -----------------------------------------------------------------------------------------
#
# Work that ends when whoever asked for it leaves, so that nobody keeps a process busy whom nobody
# waits for.


T = TypeVar("T")

IsDisconnected = Callable[[], Awaitable[bool]]
"""Tells whether the connection of whoever asked is closed."""

POLL_S = 0.5


async def run_while_connected(work: Coroutine[Any, Any, T], is_disconnected: IsDisconnected) -> T:
    """Return what ``work`` returns; cancel it when whoever waits for it has left.

    Work in a process beside the service ends with that process. Raises RequestRejectedError after whoever asked has
    left.
    """
    working = asyncio.ensure_future(work)
    try:
        while not (await asyncio.wait({working}, timeout=POLL_S))[0]:
            if await is_disconnected():
                raise RequestRejectedError(
                    ErrorCode.UNAVAILABLE, "whoever asked for this has left: its computation was ended"
                )
        return working.result()
    finally:
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)


# Tuning previews -----------------------------------------------------------------------------------
#
# What a tuning would do, computed beside the service: a preview holds the interpreter for up to
# half a second.
#
# A process keeps the models of the tunings that it was asked for last, which take longer than all
# else of a preview.


_MAX_RECENT = 6
_recent: list[ActiveTuning] = []
_recent_lock = Lock()


@dataclass(frozen=True)
class TuningSnapshot:
    """A tuning as it goes from one process to another: ``ranges`` are the smallest λ_q and λ_S [s] of each entry."""

    parameters: PlantParameters
    choice: TuningSettings
    bank: Bank | None
    ranges: Sequence[tuple[float, ...]]

    @classmethod
    def from_active(cls, tuning: ActiveTuning) -> "TuningSnapshot":
        """Return what is asked of a tuning in use."""
        return cls(tuning.parameters, tuning.choice, tuning.bank, tuning.previewer.ranges)

    def resolve(self) -> ActiveTuning:
        """Return the tuning with its models, which are kept where they were made before."""
        with _recent_lock:
            same = next((one for one in _recent if self._has_models_of(one)), None)
            if same is None:
                points = list_point_models(self.bank)
                lam_motor, b = self.choice.lam_motor, self.choice.b
                previewer = TuningPreviewer(self.parameters, points, lam_motor=lam_motor, b=b, ranges=self.ranges)
                same = ActiveTuning(self.choice, self.bank, self.parameters, previewer)
                _recent.insert(0, same)
                del _recent[_MAX_RECENT:]
        return ActiveTuning(self.choice, self.bank, self.parameters, same.previewer)

    def _has_models_of(self, other: ActiveTuning) -> bool:
        mine, its = self.choice, other.choice
        return (
            (mine.lam_motor, mine.b) == (its.lam_motor, its.b)
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
    """Return what ``ActiveTuning.preview`` does. Raises OutOfRangeError."""
    made = snapshot.resolve()
    return made.preview(lam_q, lam_S, S, entry, motion=motion, u_plan=u_plan, k_ext=k_ext, printed=printed)


def preview_motor(snapshot: TuningSnapshot, lam_motor: float) -> MotorPreview:
    """Return what ``ActiveTuning.motor`` does. Raises OutOfRangeError."""
    return snapshot.resolve().preview_motor(lam_motor)


def compute_robust_tuning(snapshot: TuningSnapshot, M_s: float) -> RobustTuning:
    """Return what ``ActiveTuning.robust`` does."""
    return snapshot.resolve().compute_robust_tuning(M_s)


# Work places ---------------------------------------------------------------------------------------
#
# Places for work that people order: so many at a time, so many of each person, and some that
# viewers cannot take.


RETRY_S = 1
"""How long to wait before asking again where there was no place [s]."""

_reserved_by: ContextVar["WorkLimiter | None"] = ContextVar("held", default=None)
"""Where the request under way has had its place from its head on."""


class WorkLimiter:
    """``places`` in all, ``viewers`` of them for viewers, ``each`` for one person. Belongs to one event loop.

    ``work`` names one such work, and ``works`` several, in refusals. A request whose body is large takes its place
    before the body is read, and its work then has it.
    """

    def __init__(self, work: str, works: str, places: int, viewers: int, each: int) -> None:
        self._work, self._works = work, works
        self._places, self._viewers, self._each = places, viewers, each
        self._active: list[User] = []

    @contextmanager
    def reserve(self, person: User) -> Iterator[None]:
        """Hold a place for a person, that of the request where it has one. Raises RequestRejectedError for none."""
        if _reserved_by.get() is self:
            yield
            return
        self._require_capacity(person)
        self._active.append(person)
        before = _reserved_by.set(self)
        try:
            yield
        finally:
            _reserved_by.reset(before)
            self._active.remove(person)

    def _require_capacity(self, person: User) -> None:
        own = sum(other.name == person.name and other.role == person.role for other in self._active)
        if own >= self._each:
            number = f"{self._work} of yours is" if self._each == 1 else f"{own} {self._works} of yours are"
            raise RequestRejectedError(
                ErrorCode.TOO_MANY,
                f"{number} under way or waiting, at most {self._each}: wait for one, or leave it",
                code="busy",
                retry_after_s=RETRY_S,
            )
        viewers = sum(not is_operator(other) for other in self._active)
        if len(self._active) >= self._places or (not is_operator(person) and viewers >= self._viewers):
            raise RequestRejectedError(
                ErrorCode.TOO_MANY,
                f"{len(self._active)} {self._works} are under way or wait: try again later",
                code="busy",
                retry_after_s=RETRY_S,
            )


def is_operator(person: User) -> bool:
    """Whether a person may do what operators may."""
    return person.role is Role.OPERATOR


# Chart sheets --------------------------------------------------------------------------------------
#
# Sheets of charts that people send to be made PDFs of: in a process of their own, which reports do
# not wait for.


SHEET_PLACES = 8
VIEWERS_SHEET_PLACES = 6
SHEET_PLACES_EACH = 2


class ChartSheets:
    """Belongs to the service's event loop; nothing is kept."""

    def __init__(self, worker: WorkerProcess) -> None:
        self._worker = worker
        self.places = WorkLimiter(
            "a sheet of charts", "sheets of charts", SHEET_PLACES, VIEWERS_SHEET_PLACES, SHEET_PLACES_EACH
        )

    async def render(self, svg: str, person: User, is_disconnected: IsDisconnected) -> bytes:
        """Return a sheet as PDF. Raises RequestRejectedError for what is no sheet or finds no place, WorkLimitError."""
        with self.places.reserve(person):
            return await run_while_connected(self._worker.run(render_sheet_pdf, svg), is_disconnected)


# Text work -----------------------------------------------------------------------------------------
#
# What is computed for whoever asks, in processes of their own, within limits: texts that people
# write, and previews.
#
# A text may be made to be slow, a preview holds Python's lock for up to half a second, and what
# holds it holds STOP up. What viewers ask has another process than what operators do, so that
# nobody without the right to operate makes an operator wait.


P = ParamSpec("P")

TEXT_PLACES = 32
VIEWERS_TEXT_PLACES = 24
TEXT_PLACES_EACH = 8
"""Texts of one person under way or waiting: a browser sends six requests at a time."""

PREVIEWS = 32
VIEWERS_PREVIEWS = 24
PREVIEWS_EACH = 12
"""Previews of one person: a slider that moves asks for the next one before the last one is there."""


Compute = Callable[..., Awaitable[Any]]
"""Computes ``work(*asked)`` somewhere, as ``asyncio.to_thread`` does in a thread."""


class TextWork:
    """Belongs to the service's event loop."""

    def __init__(self, operators: WorkerProcess, viewers: WorkerProcess) -> None:
        self._operators, self._viewers = operators, viewers
        self.places = WorkLimiter("a text", "texts", TEXT_PLACES, VIEWERS_TEXT_PLACES, TEXT_PLACES_EACH)
        self.previews = WorkLimiter("a preview", "previews", PREVIEWS, VIEWERS_PREVIEWS, PREVIEWS_EACH)
        self._locks = {operators: asyncio.Lock(), viewers: asyncio.Lock()}

    async def run(
        self, person: User, is_disconnected: IsDisconnected, work: Callable[P, T], *asked: P.args, **_none: P.kwargs
    ) -> T:
        """Return ``work(*asked)``, as long as the person who asked has not left.

        Raises what the work raises, WorkLimitError, and RequestRejectedError where there is no place.
        """
        process = self._operators if is_operator(person) else self._viewers
        with self.places.reserve(person):
            return await run_while_connected(process.run(work, *asked, **_none), is_disconnected)

    def make_preview_runner(self, person: User, is_disconnected: IsDisconnected) -> Compute:
        """Return what computes previews for a person.

        One whose asker has left before its turn is not computed; one that is under way ends, with its process kept.
        Raises what the work raises, WorkLimitError, and RequestRejectedError where there is no place.
        """

        async def compute(work: Callable[..., T], *asked: Any) -> T:
            process = self._operators if is_operator(person) else self._viewers
            with self.previews.reserve(person):
                await _acquire(self._locks[process], is_disconnected)
                try:
                    return await process.run(work, *asked)
                finally:
                    self._locks[process].release()

        return compute

    async def run_for_operator(self, work: Callable[P, T], *asked: P.args, **_none: P.kwargs) -> T:
        """Return ``work(*asked)`` for an order of an operator, which goes on whoever leaves. Raises as ``run`` does."""
        return await self._operators.run(work, *asked, **_none)


async def _acquire(turn: asyncio.Lock, is_disconnected: IsDisconnected) -> None:
    """Wait for a turn and take it. Raises RequestRejectedError where whoever asked has left meanwhile."""
    waiting = asyncio.ensure_future(turn.acquire())
    try:
        while not (await asyncio.wait({waiting}, timeout=POLL_S))[0]:
            if await is_disconnected():
                raise RequestRejectedError(ErrorCode.UNAVAILABLE, "whoever asked for this has left: it is not computed")
    except BaseException:
        if not waiting.cancel():  # it is there after all
            turn.release()
        raise
