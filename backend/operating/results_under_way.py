"""Results of the runs of one order, computed while the next one plays."""

import asyncio

from backend.analysis.evaluation import Evaluation
from backend.storage.runs import EndState


class ResultsUnderWay:
    """Belongs to the service's event loop. ``problem`` says why ``without``, a complete run, has no result."""

    def __init__(self) -> None:
        self._under_way: dict[int, tuple[EndState, asyncio.Task[Evaluation]]] = {}
        self.without: int | None = None
        self.problem = ""

    def __contains__(self, run_id: int) -> bool:
        return run_id in self._under_way

    def add(self, run_id: int, end_state: EndState, work: asyncio.Task[Evaluation]) -> None:
        """Take over the work on the result of a run that ended so."""
        self._under_way[run_id] = end_state, work

    def forget(self) -> None:
        """Say no more of a run without a result: another one began, or it has one after all."""
        self.without, self.problem = None, ""

    async def any_missing(self) -> bool:
        """Wait for the results under way; whether a run that completed came to none."""
        missing = False
        for run_id, (end_state, work) in tuple(self._under_way.items()):
            evaluation = await work
            del self._under_way[run_id]
            if evaluation.result is None and end_state is EndState.COMPLETED:
                self.without, missing = run_id, True
                self.problem = f"Run {run_id} is complete, but {evaluation.problem}. Evaluate it again."
        return missing

    async def end(self, *, giving_up: bool) -> None:
        """Wait for results under way after a run failed, or give them up: each run keeps why."""
        waiting = [work for _, work in self._under_way.values()]
        for work in waiting if giving_up else ():
            work.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
        self._under_way.clear()
