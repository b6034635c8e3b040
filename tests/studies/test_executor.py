"""Which points run at the same time after processes have died, with pools that break on request."""

from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, cast

import pytest

from backend.storage.studies import StudyPoint
from backend.studies.executor import LocalExecutor
from backend.studies.point import LOST, Point, StudyBase

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


def test_a_point_submitted_while_another_runs_alone_waits_for_its_end(executor: ExecutorWithFakePools) -> None:
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
