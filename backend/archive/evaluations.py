"""Runs evaluated again, because they have no result, or because somebody wants it computed anew."""

import asyncio
from collections.abc import Callable

from backend.analysis.evaluation import evaluate_again, require_evaluable
from backend.errors import Because, RefusalError
from backend.schemas.state import TaskView
from backend.storage import runs
from backend.storage.database import Database
from backend.storage.runs import Run
from backend.workers import Offload


class Evaluations:
    """One evaluation of a run at a time. ``task`` tells what the service is doing at present.

    ``done`` hears of each run that has its result.
    """

    def __init__(self, database: Database, offload: Offload, task: Callable[[], TaskView | None]) -> None:
        self.done: Callable[[int], None] = lambda _run_id: None
        self._database = database
        self._offload = offload
        self._task = task
        self._under_way: set[int] = set()

    def includes(self, run_id: int) -> bool:
        """Whether a run is being evaluated again."""
        return run_id in self._under_way

    async def again(self, run_id: int) -> None:
        """Compute and store the result of a run; what keeps it from that is kept with the run, and raised.

        Raises UnknownRecordError, NotEvaluableError, WorkerDiedError, RefusalError while it is being evaluated.
        """
        require_evaluable(await asyncio.to_thread(self._run, run_id))
        task = self._task()
        if self.includes(run_id) or (task is not None and task.run == run_id):
            raise RefusalError(Because.NOT_NOW, f"run {run_id} is being evaluated: its result follows in a moment")
        self._under_way.add(run_id)
        try:
            await self._offload.run(evaluate_again, self._database, run_id)
        except Exception as error:
            await asyncio.to_thread(self._keep_problem, run_id, f"{type(error).__name__}: {error}")
            raise
        finally:
            self._under_way.discard(run_id)
        self.done(run_id)

    def _run(self, run_id: int) -> Run:
        with self._database.reading() as session:
            return runs.get(session, run_id)

    def _keep_problem(self, run_id: int, problem: str) -> None:
        with self._database.session() as session:
            runs.set_evaluation_problem(session, run_id, problem)
