"""The queue of experiments, and dry runs beside the service."""

import asyncio
import logging
import shutil
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import mkdtemp

from backend.auth import User
from backend.errors import RequestRejectedError, check_range
from backend.execution import RunPhase, RunRequest, dry_run, read_progress, warm_up_dry_run
from backend.experiments import LoopSettings, list_setting_values
from backend.schemas import DryRunProgress, DryRunView, ExperimentRequest, QueuedView, QueueView
from backend.services.background_work import IsDisconnected, WorkLimiter, run_while_connected
from backend.services.runs import build_dry_run_view
from backend.services.tuning_state import RobustnessCache
from backend.storage import Bank, Database, EndState, StorageError, queue
from backend.supervision import Part, Supervision
from backend.workers import WorkerProcess
from plant import ErrorCode, PlantParameters

# Dry runs ------------------------------------------------------------------------------------------
#
# Experiments played on a simulator beside the service: one after the other, in a process of their
# own.
#
# Who asks for many of them waits for oneself only: reports, exports and evaluations have other
# processes.


SIGNALS = ("q", "q_ref", "S", "S_ref", "F_A", "F_B", "u_A", "u_B")
POINTS = 1200

LONGEST_S = 600.0
"""Longest program that is played dry [s]. What is longer is played with ``sinew experiment``."""

MAX_DRY_RUNS = 4
"""Dry runs under way or waiting."""

MAX_VIEWER_DRY_RUNS = 2
"""So many of them for viewers, so that an operator always finds one."""


class DryRuns:
    """One dry run per person, MAX_DRY_RUNS in all. Belongs to the service's event loop."""

    def __init__(self, worker: WorkerProcess) -> None:
        self._worker = worker
        self.limiter = WorkLimiter("a dry run", "dry runs", MAX_DRY_RUNS, MAX_VIEWER_DRY_RUNS, per_user=1)
        self._running_folders: dict[User, tuple[Path, float]] = {}

    def prepare(self, parameters: PlantParameters, settings: LoopSettings) -> None:
        """Let the process load what a dry run takes, once, so that the first one is as soon there as those after it."""
        self._worker.warm_up(_prepare_process, parameters, settings)

    async def progress(self, person: User) -> DryRunProgress:
        """Return how far the dry run of a person is."""
        if person not in self._running_folders:
            return DryRunProgress(under_way=False, doing=RunPhase.STARTING, played_s=0.0, duration_s=0.0)
        folder, duration_s = self._running_folders[person]
        doing, elapsed_s = await asyncio.to_thread(read_progress, folder)
        played_s = {RunPhase.PROGRAM: min(elapsed_s, duration_s), RunPhase.EVALUATION: duration_s}.get(doing, 0.0)
        return DryRunProgress(under_way=True, doing=doing, played_s=played_s, duration_s=duration_s)

    async def play(
        self,
        parameters: PlantParameters,
        order: RunRequest,
        used: Sequence[Bank],
        person: User,
        is_disconnected: IsDisconnected,
    ) -> DryRunView:
        """Play an order with the banks that it uses, until whoever asked has left.

        Raises OutOfRangeError when it takes too long, RequestRejectedError where there is no place, WorkerDiedError.
        """
        duration_s = order.plan.program().duration_s
        remedy = "play it with `sinew experiment` on the command line"
        check_range(
            "duration_s",
            duration_s,
            minimum=None,
            maximum=LONGEST_S,
            unit="s",
            remedy=remedy,
            words="length of a dry run",
            path=(),
        )
        with self.limiter.reserve(person):
            folder = await asyncio.to_thread(mkdtemp, prefix="sinew-dry-run-")
            self._running_folders[person] = Path(folder), duration_s
            try:
                played = await run_while_connected(
                    self._worker.run(dry_run, parameters, order, used, SIGNALS, POINTS, Path(folder)), is_disconnected
                )
            finally:
                self._running_folders.pop(person, None)
                # Here, not in the process: one that is killed clears up nothing.
                shutil.rmtree(folder, ignore_errors=True)
        settings = {**list_setting_values(order.plan), **asdict(order.loop_settings)}
        return build_dry_run_view(played.run, played.result, played.curves, duration_s, settings)


def _prepare_process(parameters: PlantParameters, settings: LoopSettings) -> None:
    """Take over what was computed for a tuning before, which loads half of SciPy, and load the rest."""
    RobustnessCache().load()
    warm_up_dry_run(parameters, settings)


# Experiment queue ----------------------------------------------------------------------------------
#
# Experiments that wait for their turn: one after the other, until one does not complete.


_log = logging.getLogger(__name__)

LONGEST = 50
_PART = Part("The step to the next experiment of the queue", "Look at the queue: it goes on, or says why it is held.")

Start = Callable[[ExperimentRequest, str], Awaitable[int]]
Check = Callable[[ExperimentRequest], Awaitable[ExperimentRequest]]


class ExperimentQueue:
    """Belongs to the service's event loop. ``start`` starts one experiment.

    ``check`` raises for one that cannot be, and returns it with all its settings: what is shown of one that waits is
    what it will run with, whatever is in force by then. What waits is in ``database`` too, and is there again, held,
    after a restart of the service: nothing starts by itself then.
    """

    def __init__(self, start: Start, check: Check, supervision: Supervision, database: Database) -> None:
        self._supervision = supervision
        self._database = database
        self._change_lock = asyncio.Lock()
        self._start = start
        self._check = check
        self._items: list[QueuedView] = []
        self._running = False
        self._problem = ""
        self._rejected_item: int | None = None
        self._run: int | None = None
        self._restore()

    def view(self) -> QueueView:
        """Return what waits and whether the queue goes on by itself."""
        return QueueView(items=list(self._items), running=self._running, run=self._run, problem=self._problem)

    async def add(self, request: ExperimentRequest, who: str) -> QueueView:
        """Put an experiment at the end; nothing starts yet.

        Raises what a start with these settings would raise, and StorageError where it cannot be kept.
        """
        self._require_space()
        whole = await self._check(request)
        async with self._change_lock:
            self._require_space()  # others may have been added meanwhile
            kept = await asyncio.to_thread(self._store, whole, who)
            if not self._items:
                self._set_problem("")  # what once held the queue, with nothing left in it, says nothing about this one
            self._items.append(QueuedView(id=kept.id, name=whole.name, settings=whole.settings, who=who))
        return self.view()

    async def remove(self, item_id: int) -> QueueView:
        """Take an experiment out. Raises RequestRejectedError when it does not wait any more, StorageError."""
        async with self._change_lock:
            self._find_waiting(item_id)
            await asyncio.to_thread(self._delete, item_id)
            self._items = [item for item in self._items if item.id != item_id]
            if not self._items or item_id == self._rejected_item:
                self._set_problem("")
        return self.view()

    async def move(self, item_id: int, place: int) -> QueueView:
        """Let an experiment wait at a place, counted from 0.

        Raises RequestRejectedError when it does not wait any more, OutOfRangeError, StorageError.
        """
        async with self._change_lock:
            moved = self._find_waiting(item_id)
            words = "place in the queue"
            check_range("place", place, 0, len(self._items) - 1, "1", words=words)
            order = [item.id for item in self._items if item.id != item_id]
            order.insert(place, item_id)
            await asyncio.to_thread(self._store_order, order)
            others = [item for item in self._items if item.id != item_id]  # one may have started meanwhile
            if len(others) < len(self._items):
                self._items = [*others[:place], moved, *others[place:]]
        return self.view()

    def _find_waiting(self, item_id: int) -> QueuedView:
        found = next((item for item in self._items if item.id == item_id), None)
        if found is None:
            raise RequestRejectedError(ErrorCode.UNKNOWN, f"experiment {item_id} does not wait in the queue")
        return found

    def _require_space(self) -> None:
        if len(self._items) >= LONGEST:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, f"the queue is full: it holds {LONGEST} experiments; remove one first"
            )

    async def run(self) -> QueueView:
        """Start the first one and go on until the queue is empty, held, or an experiment does not complete."""
        if not self._items:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "the queue is empty: add an experiment first")
        if not self._running:
            self._set_problem("")
            await self._start_first()
            self._running = True
        return self.view()

    def hold(self) -> QueueView:
        """Start no further experiment; the one that runs goes on."""
        self._running = False
        return self.view()

    def handle_run_end(self, run_id: int, end_state: EndState | None) -> None:
        """Go on after an experiment; None when it failed without an end state."""
        if run_id != self._run:
            return
        self._run = None
        if end_state is not EndState.COMPLETED:
            how = "failed" if end_state is None else f"ended as {end_state.replace('_', ' ')}"
            self._pause(f"run {run_id} {how}")
        elif not self._items:
            self._running = False
        elif self._running:
            self._supervision.start_task(_PART, self._start_next)

    def _set_problem(self, problem: str, refused: int | None = None) -> None:
        """Say why the queue is held: until it runs, is empty, or what was ``refused`` does not wait any more."""
        self._problem, self._rejected_item = problem, refused

    async def _start_next(self) -> None:
        if not (self._running and self._items):  # a person was quicker: held, or nothing waits any more
            self._running = False
            return
        next_item = self._items[0]
        try:
            await self._start_first()
        except Exception as error:
            # Whatever refuses the next one is for a person to read; those that wait stay.
            _log.warning("The queue is paused: %s", error)
            if next_item in self._items:
                self._pause(f"the next one was refused: {error}", next_item.id)
            else:
                self._pause(f"the one that a person has taken out meanwhile was refused: {error}")

    def _pause(self, cause: str, refused: int | None = None) -> None:
        """Stop here, and say how to go on; ``refused`` is the experiment that the cause lies with."""
        count = len(self._items)
        remedy = "nothing waits any more" if count == 0 else "start the queue again to go on with the first that waits"
        self._set_problem(f"held because {cause}; {remedy}", refused)
        self._running = False

    async def _start_first(self) -> None:
        item = self._items[0]
        self._run = await self._start(ExperimentRequest(name=item.name, settings=item.settings), item.who)
        self._items = [waiting for waiting in self._items if waiting.id != item.id]
        try:
            await asyncio.to_thread(self._delete, item.id)
        except StorageError as error:  # it plays: that it may wait again after a restart is no reason to stop it
            _log.warning(
                "Run %s has started, but the service could not remove its entry from the stored queue: %s",
                self._run,
                error,
            )

    def _restore(self) -> None:
        """Take what waited when the service ended, and hold it: a person says when it goes on."""
        try:
            with self._database.reading() as session:
                kept = queue.load_waiting(session)
        except StorageError as error:
            _log.warning("The service cannot read the stored queue: %s", error)
            self._set_problem(f"held because what waited in it cannot be read: {error}")
            return
        self._items = [QueuedView(id=it.id, name=it.name, settings=it.settings, who=it.who, kept=True) for it in kept]
        if kept:
            _log.warning("%d experiments wait in the stored queue. An operator starts them.", len(kept))
            self._pause("the service was started again")

    def _store(self, whole: ExperimentRequest, who: str) -> queue.StoredQueued:
        with self._database.session() as session:
            return queue.add(session, whole.name, dict(whole.settings), who)

    def _delete(self, item_id: int) -> None:
        with self._database.session() as session:
            queue.remove(session, item_id)

    def _store_order(self, order: list[int]) -> None:
        with self._database.session() as session:
            queue.arrange(session, order)
