"""The problem that a paused queue shows, without motion."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from backend.errors import RequestRejectedError
from backend.schemas.experiment import ExperimentRequest
from backend.services import messages
from backend.services.queue import ExperimentQueue, Start
from backend.storage.database import Database, open_database
from backend.storage.messages import record_not_found
from backend.storage.runs import EndState
from backend.supervision import Supervision
from plant.errors import ErrorCode

SHORT = ExperimentRequest(name="sequence", settings={})
WITHOUT_BANK = ExperimentRequest(name="sequence", settings={"bank": 99})


async def start(request: ExperimentRequest, _who: str) -> int:
    """Start every experiment except those with bank 99."""
    if request.settings:
        raise RequestRejectedError(ErrorCode.UNKNOWN, "there is no bank 99")
    return 5


def held(session: Callable[[ExperimentQueue], Awaitable[None]], start: Start = start) -> None:
    """Run a session on a queue without a plant."""

    async def check(request: ExperimentRequest) -> ExperimentRequest:
        return request

    async def whole(database: Database) -> None:
        supervision = Supervision()
        await session(ExperimentQueue(start, check, supervision, database))
        await supervision.close()

    with TemporaryDirectory() as folder, closing(open_database(Path(folder))) as database:
        asyncio.run(whole(database))


async def refused(queue: ExperimentQueue) -> None:
    while not queue.view().problem:
        await asyncio.sleep(0.001)


def test_problem_is_cleared_with_the_refused_experiment() -> None:
    async def session(queue: ExperimentQueue) -> None:
        for request in (SHORT, WITHOUT_BANK, SHORT):
            await queue.add(request, "Ana")
        await queue.run()
        queue.handle_run_end(5, EndState.COMPLETED)
        await refused(queue)
        assert "there is no bank 99" in queue.view().problem
        refused_one, waiting = queue.view().items
        await queue.add(SHORT, "Ana")
        assert queue.view().problem
        assert (await queue.remove(refused_one.id)).problem == ""
        assert (await queue.remove(waiting.id)).problem == ""

    held(session)


def test_operator_pauses_before_the_next_start() -> None:
    async def session(queue: ExperimentQueue) -> None:
        for _ in range(2):
            await queue.add(SHORT, "Ana")
        await queue.run()
        queue.handle_run_end(5, EndState.COMPLETED)
        queue.hold()
        await asyncio.sleep(0.01)
        assert (len(queue.view().items), queue.view().run) == (1, None)
        await queue.run()
        await queue.add(WITHOUT_BANK, "Ana")
        queue.handle_run_end(5, EndState.COMPLETED)
        await queue.remove(queue.view().items[0].id)
        await asyncio.sleep(0.01)
        view = queue.view()
        assert (view.items, view.running, view.problem) == ([], False, "")

    held(session)


def test_experiment_removed_during_its_refusal_leaves_the_queue_unchanged() -> None:
    asked, reported = asyncio.Event(), asyncio.Event()

    async def start(request: ExperimentRequest, _who: str) -> int:
        if request.settings:
            asked.set()
            await reported.wait()
            raise RequestRejectedError(ErrorCode.UNKNOWN, "there is no bank 99")
        return 5

    async def session(queue: ExperimentQueue) -> None:
        for request in (SHORT, WITHOUT_BANK):
            await queue.add(request, "Ana")
        await queue.run()
        queue.handle_run_end(5, EndState.COMPLETED)
        await asked.wait()
        await queue.remove(queue.view().items[0].id)
        reported.set()
        await refused(queue)
        view = queue.view()
        assert (view.items, view.running) == ([], False)
        reason = record_not_found(record="bank", number=99)
        assert view.problem == messages.queue_paused(
            cause=messages.removed_experiment_refused(reason=reason), waiting=0
        )

    held(session, start)


def test_empty_queue_is_not_paused() -> None:
    async def session(queue: ExperimentQueue) -> None:
        for request in (SHORT, SHORT, SHORT):
            await queue.add(request, "Ana")
        await queue.run()
        queue.handle_run_end(5, EndState.STOPPED)
        stopped = messages.run_not_completed(run=5, end_state=EndState.STOPPED)
        paused = messages.queue_paused(cause=stopped, waiting=2)
        assert queue.view().problem == paused
        first, second = queue.view().items
        assert (await queue.remove(first.id)).problem == paused
        assert (await queue.remove(second.id)).problem == ""
        await queue.add(SHORT, "Ana")
        await queue.run()
        queue.handle_run_end(5, EndState.STOPPED)
        assert queue.view().problem == messages.queue_paused(cause=stopped, waiting=0)
        await queue.add(SHORT, "Ana")
        assert queue.view().problem == ""

    held(session)
