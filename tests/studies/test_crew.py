"""Which points are computed beside each other after processes have died, by pools that die when they are told to."""

from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, cast

import pytest

from backend.storage.studies import StudyPoint
from backend.studies.crew import LocalCrew
from backend.studies.point import LOST, Point, StudyBase

GUILTY, INNOCENT, NEXT = (Point(number, {}, {}) for number in range(3))
BASE = StudyBase("", "", "", {}, {})


class Pool:
    """Computes nothing; all that it was given is lost when it dies."""

    def __init__(self) -> None:
        self.futures: list[Future[StudyPoint]] = []

    def submit(self, *_work: Any) -> Future[StudyPoint]:
        self.futures.append(Future())
        return self.futures[-1]

    def die(self, most: int = 2) -> None:
        for future in [future for future in self.futures if not future.done()][:most]:
            future.set_exception(BrokenProcessPool("killed"))


class Crew(LocalCrew):
    def __init__(self) -> None:
        super().__init__(BASE, 2)
        self.pools: list[Pool] = []

    def _present(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self.pools.append(Pool())
            self._pool = cast(ProcessPoolExecutor, self.pools[-1])
        return self._pool

    def under_way(self) -> list[int]:
        return [point.number for point, _ in self._given.values()]


@pytest.fixture
def crew() -> Crew:
    crew = Crew()
    crew.give(GUILTY)
    crew.give(INNOCENT)
    return crew


def test_what_is_given_while_a_point_is_alone_waits_for_its_end(crew: Crew) -> None:
    for _ in range(2):
        crew.pools[-1].die()
        assert crew.finished(1.0) == []
    assert len(crew.under_way()) == 1
    crew.pools[-1].die()
    (lost,) = crew.finished(1.0)
    assert lost.state == LOST
    crew.give(NEXT)
    assert crew.under_way() == [1 - lost.number]
    row = StudyPoint(1 - lost.number, "completed", "", True, {}, {})
    crew.pools[-1].futures[-1].set_result(row)
    assert crew.finished(1.0) == [row]
    assert crew.under_way() == [NEXT.number]


def test_a_pool_that_died_takes_no_new_one_with_it(crew: Crew) -> None:
    crew.pools[0].die(most=1)
    crew.finished(1.0)
    assert len(crew.pools) == 2
    crew.pools[0].die()
    crew.finished(1.0)
    assert len(crew.pools) == 2
    assert sorted(crew.under_way()) == [0, 1]
