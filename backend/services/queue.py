"""The queue of experiments, and dry runs in a worker process."""

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
from backend.services import messages
from backend.services.background_work import IsDisconnected, WorkLimiter, run_while_connected
from backend.services.runs import build_dry_run_view
from backend.services.tuning_state import RobustnessCache
from backend.storage import Bank, Database, EndState, StorageError, queue
from backend.supervision import Part, Supervision
from backend.workers import WorkerProcess
from plant import ErrorCode, PlantParameters

# Dry runs ------------------------------------------------------------------------------------------
# Runs experiments on a simulator in a worker process, one after the other. Reports, exports and
# evaluations have other processes, so that they do not wait for dry runs.


SIGNALS = ("q", "q_ref", "S", "S_ref", "F_A", "F_B", "u_A", "u_B")
POINTS = 1200
"""Points of each curve of the result."""

LONGEST_S = 600.0
"""Longest program of a dry run [s]. ``sinew experiment`` runs longer ones."""

MAX_DRY_RUNS = 4
"""Dry runs in progress or waiting."""

MAX_VIEWER_DRY_RUNS = 2
"""Dry runs of viewers among them, so that operators are served."""


class DryRuns:
    """Dry runs of users, at most one of each. Runs in the event loop of the service."""

    def __init__(self, worker: WorkerProcess) -> None:
        self._worker = worker
        self.limiter = WorkLimiter("a dry run", "dry runs", MAX_DRY_RUNS, MAX_VIEWER_DRY_RUNS, per_user=1)
        self._in_progress: dict[User, tuple[Path, float]] = {}

    def prepare(self, parameters: PlantParameters, settings: LoopSettings) -> None:
        """Warm up the worker process, so that the first dry run is not slower."""
        self._worker.warm_up(_prepare_process, parameters, settings)

    async def progress(self, user: User) -> DryRunProgress:
        """Return the progress of the dry run of a user."""
        if user not in self._in_progress:
            return DryRunProgress(under_way=False, doing=RunPhase.STARTING, played_s=0.0, duration_s=0.0)
        folder, duration_s = self._in_progress[user]
        phase, elapsed_s = await asyncio.to_thread(read_progress, folder)
        simulated_s = {RunPhase.PROGRAM: min(elapsed_s, duration_s), RunPhase.EVALUATION: duration_s}.get(phase, 0.0)
        return DryRunProgress(under_way=True, doing=phase, played_s=simulated_s, duration_s=duration_s)

    async def play(
        self,
        parameters: PlantParameters,
        request: RunRequest,
        used: Sequence[Bank],
        user: User,
        is_disconnected: IsDisconnected,
    ) -> DryRunView:
        """Run a request with the banks that it uses; cancelled if the user disconnects.

        Raises OutOfRangeError for a program longer than LONGEST_S, RequestRejectedError at a limit, WorkerDiedError.
        """
        duration_s = request.plan.program().duration_s
        remedy = messages.run_on_command_line()
        check_range(
            "duration_s",
            duration_s,
            minimum=None,
            maximum=LONGEST_S,
            unit="s",
            remedy=remedy,
            label="duration of a dry run",
            path=(),
        )
        with self.limiter.reserve(user):
            folder = await asyncio.to_thread(mkdtemp, prefix="sinew-dry-run-")
            self._in_progress[user] = Path(folder), duration_s
            try:
                played = await run_while_connected(
                    self._worker.run(dry_run, parameters, request, used, SIGNALS, POINTS, Path(folder)), is_disconnected
                )
            finally:
                self._in_progress.pop(user, None)
                # Not in the worker process, which a cancellation kills.
                shutil.rmtree(folder, ignore_errors=True)
        settings = {**list_setting_values(request.plan), **asdict(request.loop_settings)}
        return build_dry_run_view(played.run, played.result, played.curves, duration_s, settings)


def _prepare_process(parameters: PlantParameters, settings: LoopSettings) -> None:
    """Load cached robustness, which avoids half of SciPy, and warm up the rest."""
    RobustnessCache().load()
    warm_up_dry_run(parameters, settings)


# Experiment queue ----------------------------------------------------------------------------------
# Experiments that wait for execution. They run one after the other until one does not complete.


_log = logging.getLogger(__name__)

LONGEST = 50
"""Experiments that may wait."""

_PART = Part("The start of the next queued experiment", "Check the queue: it continues, or shows why it is paused.")

Start = Callable[[ExperimentRequest, str], Awaitable[int]]
Check = Callable[[ExperimentRequest], Awaitable[ExperimentRequest]]


class ExperimentQueue:
    """The queue of experiments, which is also stored in the database.

    Runs in the event loop of the service. After a restart of the service the queue is paused, so that no experiment
    starts without an operator.
    """

    def __init__(self, start: Start, check: Check, supervision: Supervision, database: Database) -> None:
        """Start experiments with ``start``, which returns the run.

        ``check`` raises errors for a request that cannot start, and returns it with all its settings, so that a waiting
        experiment runs with the settings that were active when it was added.
        """
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
        self._load()

    def view(self) -> QueueView:
        """Return the waiting experiments and whether the queue runs."""
        return QueueView(items=list(self._items), running=self._running, run=self._run, problem=self._problem)

    async def add(self, request: ExperimentRequest, who: str) -> QueueView:
        """Add an experiment at the end, without starting it.

        Raises the errors of a start with these settings, and StorageError.
        """
        self._require_space()
        complete = await self._check(request)
        async with self._change_lock:
            self._require_space()  # others may have been added meanwhile
            stored = await asyncio.to_thread(self._store, complete, who)
            if not self._items:
                self._set_problem("")  # the problem of an earlier, now empty queue
            self._items.append(QueuedView(id=stored.id, name=complete.name, settings=complete.settings, who=who))
        return self.view()

    async def remove(self, item_id: int) -> QueueView:
        """Remove an experiment.

        Raises RequestRejectedError if it is not waiting, StorageError.
        """
        async with self._change_lock:
            self._find_waiting(item_id)
            await asyncio.to_thread(self._delete, item_id)
            self._items = [item for item in self._items if item.id != item_id]
            if not self._items or item_id == self._rejected_item:
                self._set_problem("")
        return self.view()

    async def move(self, item_id: int, place: int) -> QueueView:
        """Move an experiment to a place, counted from 0.

        Raises RequestRejectedError if it is not waiting, OutOfRangeError, StorageError.
        """
        async with self._change_lock:
            moved = self._find_waiting(item_id)
            words = "position in the queue"
            check_range("place", place, 0, len(self._items) - 1, "1", label=words)
            order = [item.id for item in self._items if item.id != item_id]
            order.insert(place, item_id)
            await asyncio.to_thread(self._store_order, order)
            others = [item for item in self._items if item.id != item_id]  # one may have started meanwhile
            if len(others) < len(self._items):
                self._items = [*others[:place], moved, *others[place:]]
        return self.view()

    async def run(self) -> QueueView:
        """Start the first experiment.

        The others follow until the queue is empty or paused, or one does not complete. Raises RequestRejectedError for
        an empty queue, and the errors of the start.
        """
        if not self._items:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.queue_is_empty())
        if not self._running:
            self._set_problem("")
            await self._start_first()
            self._running = True
        return self.view()

    def hold(self) -> QueueView:
        """Start no further experiment; the current one continues."""
        self._running = False
        return self.view()

    def handle_run_end(self, run_id: int, end_state: EndState | None) -> None:
        """Start the next experiment after a completed run, else pause.

        ``end_state`` is None for a run that failed.
        """
        if run_id != self._run:
            return
        self._run = None
        if end_state is not EndState.COMPLETED:
            self._pause(messages.run_not_completed(run=run_id, end_state=end_state))
        elif not self._items:
            self._running = False
        elif self._running:
            self._supervision.start_task(_PART, self._start_next)

    async def _start_next(self) -> None:
        if not (self._running and self._items):  # an operator has paused or emptied the queue meanwhile
            self._running = False
            return
        next_item = self._items[0]
        try:
            await self._start_first()
        except Exception as error:
            # Any error pauses the queue and is shown to an operator; the experiments stay in the queue.
            _log.warning("The queue is paused: %s", error)
            if next_item in self._items:
                self._pause(messages.next_experiment_refused(reason=str(error)), next_item.id)
            else:
                self._pause(messages.removed_experiment_refused(reason=str(error)))

    async def _start_first(self) -> None:
        item = self._items[0]
        self._run = await self._start(ExperimentRequest(name=item.name, settings=item.settings), item.who)
        self._items = [waiting for waiting in self._items if waiting.id != item.id]
        try:
            await asyncio.to_thread(self._delete, item.id)
        except StorageError as error:  # no reason to stop the run: the experiment only waits again after a restart
            _log.warning(
                "Run %s has started, but the service could not remove its entry from the stored queue: %s",
                self._run,
                error,
            )

    def _pause(self, cause: str, rejected_item: int | None = None) -> None:
        """Pause the queue and show ``cause``.

        ``rejected_item`` is the experiment that has caused it.
        """
        self._set_problem(messages.queue_paused(cause=cause, waiting=len(self._items)), rejected_item)
        self._running = False

    def _set_problem(self, problem: str, rejected_item: int | None = None) -> None:
        """Show why the queue is paused.

        The problem is cleared when the queue runs or is empty, or ``rejected_item`` is removed.
        """
        self._problem, self._rejected_item = problem, rejected_item

    def _find_waiting(self, item_id: int) -> QueuedView:
        item = next((item for item in self._items if item.id == item_id), None)
        if item is None:
            raise RequestRejectedError(ErrorCode.UNKNOWN, messages.not_in_the_queue(item=item_id))
        return item

    def _require_space(self) -> None:
        if len(self._items) >= LONGEST:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.queue_is_full(maximum=LONGEST))

    def _load(self) -> None:
        """Load the stored queue and pause it."""
        try:
            with self._database.reading() as session:
                stored = queue.load_waiting(session)
        except StorageError as error:
            _log.warning("The service cannot read the stored queue: %s", error)
            self._set_problem(messages.stored_queue_not_readable(reason=error.message))
            return
        self._items = [QueuedView(id=it.id, name=it.name, settings=it.settings, who=it.who, kept=True) for it in stored]
        if stored:
            _log.warning("The stored queue waits until an operator starts it. Number of experiments: %d", len(stored))
            self._pause(messages.service_was_restarted())

    def _store(self, request: ExperimentRequest, who: str) -> queue.StoredQueued:
        with self._database.session() as session:
            return queue.add(session, request.name, dict(request.settings), who)

    def _delete(self, item_id: int) -> None:
        with self._database.session() as session:
            queue.remove(session, item_id)

    def _store_order(self, order: list[int]) -> None:
        with self._database.session() as session:
            queue.arrange(session, order)
