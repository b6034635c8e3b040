"""Running studies: their order, processes and waiting places."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, cast

import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.errors import RequestRejectedError
from backend.services.background_work import TextWork
from backend.services.studies import MAX_WAITING, Studies, StudyScheduler
from backend.storage import studies
from backend.storage.database import Database, open_database
from backend.storage.studies import StudyPoint
from backend.studies.executor import LocalExecutor
from backend.studies.point import LOST, Point, StudyBase
from backend.workers import WorkerProcess
from plant.parameters import load_parameters
from tests.studies.studying import SHORT

# Simultaneous points after the death of processes, with pools that fail on request.

GUILTY, INNOCENT, NEXT = (Point(number, {}, {}) for number in range(3))
BASE = StudyBase("", "", "", {}, {})


class FakePool:
    """Computes nothing; loses its submitted points when it dies."""

    def __init__(self) -> None:
        self.futures: list[Future[StudyPoint]] = []

    def submit(self, *_work: Any) -> Future[StudyPoint]:
        self.futures.append(Future())
        return self.futures[-1]

    def die(self, most: int = 2) -> None:
        for future in [future for future in self.futures if not future.done()][:most]:
            future.set_exception(BrokenProcessPool("killed"))


class ExecutorWithFakePools(LocalExecutor):
    def __init__(self) -> None:
        super().__init__(BASE, 2)
        self.pools: list[FakePool] = []

    def _get_pool(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self.pools.append(FakePool())
            self._pool = cast(ProcessPoolExecutor, self.pools[-1])
        return self._pool

    def list_submitted_numbers(self) -> list[int]:
        return [point.number for point, _ in self._submitted.values()]


@pytest.fixture
def executor() -> ExecutorWithFakePools:
    executor = ExecutorWithFakePools()
    executor.submit(GUILTY)
    executor.submit(INNOCENT)
    return executor


def test_a_submitted_point_waits_while_another_point_runs_alone(executor: ExecutorWithFakePools) -> None:
    for _ in range(2):
        executor.pools[-1].die()
        assert executor.collect_results(1.0) == []
    assert len(executor.list_submitted_numbers()) == 1
    executor.pools[-1].die()
    (lost,) = executor.collect_results(1.0)
    assert lost.state == LOST
    executor.submit(NEXT)
    assert executor.list_submitted_numbers() == [1 - lost.number]
    row = StudyPoint(1 - lost.number, "completed", "", True, {}, {})
    executor.pools[-1].futures[-1].set_result(row)
    assert executor.collect_results(1.0) == [row]
    assert executor.list_submitted_numbers() == [NEXT.number]


def test_late_reports_of_a_broken_pool_do_not_discard_its_replacement(executor: ExecutorWithFakePools) -> None:
    executor.pools[0].die(most=1)
    executor.collect_results(1.0)
    assert len(executor.pools) == 2
    executor.pools[0].die()
    executor.collect_results(1.0)
    assert len(executor.pools) == 2
    assert sorted(executor.list_submitted_numbers()) == [0, 1]


# Studies of the page: their order, stops and waiting places, with a process that the test controls.


class Process:
    """Replaces a WorkerProcess: executes jobs in a thread after ``gate`` opens, and counts them."""

    def __init__(self) -> None:
        self.gate = asyncio.Event()
        self.calls = 0

    async def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        self.calls += 1
        await self.gate.wait()
        return await asyncio.to_thread(work, *arguments)


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return open_database(tmp_path / "data")


def under_way(database: Database) -> tuple[StudyScheduler, Process, Process]:
    computing, reading = Process(), Process()
    processes = (cast(WorkerProcess, computing), cast(WorkerProcess, reading))
    texts = TextWork(processes[1], processes[1])
    return StudyScheduler(database, load_parameters("lab"), TuningSettings, *processes, texts), computing, reading


def test_a_stop_request_during_the_start_of_the_process_is_executed(database: Database) -> None:
    async def go() -> None:
        page, computing, reading = under_way(database)
        reading.gate.set()
        study = await page.start(SHORT, "Ana")
        await asyncio.sleep(0)
        assert (study.state, computing.calls) == ("waiting", 1)
        assert (await page.stop(study.id)).state == "stopped"
        computing.gate.set()
        assert [found.state for found in (await page.list_newest()).studies] == ["stopped"]
        assert (await page.resume(study.id)).state == "waiting"
        await page.close()

    asyncio.run(go())


def test_a_study_is_resumed_after_the_end_of_its_previous_attempt(database: Database) -> None:
    async def go() -> None:
        page, computing, reading = under_way(database)
        reading.gate.set()
        study = await page.start(SHORT, "Ana")
        await asyncio.sleep(0)
        await asyncio.to_thread(
            Studies(database).request_stop, study.id
        )  # by another service: this one is not notified
        await page.resume(study.id)
        with database.reading() as session:
            assert not studies.get(session, study.id).stop_asked
        assert (computing.calls, list(page._waiting)) == (1, [study.id])
        await page.close()

    asyncio.run(go())


def test_the_number_of_waiting_studies_is_bounded_for_simultaneous_requests(database: Database) -> None:
    async def go() -> None:
        page, _, reading = under_way(database)
        begins = [asyncio.ensure_future(page.start(SHORT, "Ana")) for _ in range(MAX_WAITING + 3)]
        await asyncio.sleep(0)
        reading.gate.set()
        ends = await asyncio.gather(*begins, return_exceptions=True)
        assert [isinstance(end, RequestRejectedError) for end in ends] == [False] * MAX_WAITING + [True] * 3
        await page.close()

    asyncio.run(go())


def test_the_table_of_a_running_study_is_cached_between_requests(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def go() -> None:
        page, _, reading = under_way(database)
        reading.gate.set()
        study = (await page.start(SHORT, "Ana")).id
        with database.session() as session:
            studies.claim(session, study, "elsewhere:1")
        before = reading.calls
        monkeypatch.setattr("backend.services.studies.REFRESH_FACTOR", 1e6)
        shown = [(await page.build_detail(study, "worst")).study.state for _ in range(3)]
        assert (shown, reading.calls - before) == (["running"] * 3, 1)
        with database.session() as session:
            studies.release(session, study, "elsewhere:1")
        await page.build_detail(study, "worst")
        assert reading.calls - before == 2
        await page.close()

    asyncio.run(go())
