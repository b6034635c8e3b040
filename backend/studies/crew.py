"""Who computes the points of a study: processes of this machine. What dies over a point has it computed once more."""

import os
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol

from backend.storage import StudyPoint
from backend.studies.point import LOST, Point, StudyBase, run_point, without_run
from backend.workers import POLITE, begin_beside, spawning
from plant import ErrorCode, SinewError

DEATHS_MAX = 3
"""So often a process may die over a point: the last time it has the machine to itself, so that it was this point."""
_AHEAD = 2

Work = Callable[[StudyBase, Point], StudyPoint]


class CrewGoneError(SinewError):
    """Nobody is left who could compute; the message says what to do."""

    category = ErrorCode.UNAVAILABLE


class Crew(Protocol):
    """Computes points beside each other; ``width`` are in its hands at once, so that nobody waits for the next."""

    @property
    def width(self) -> int:
        """How many points to give at once."""
        ...

    def give(self, point: Point) -> None:
        """Hand over a point."""
        ...

    def finished(self, timeout_s: float) -> list[StudyPoint]:
        """Return what has been computed since, in whichever order; wait up to ``timeout_s`` for the first."""
        ...

    def close(self) -> None:
        """End all, whatever they compute."""
        ...


class LocalCrew:
    """``jobs`` processes of this machine, polite to all others. ``work`` is what they do."""

    def __init__(self, base: StudyBase, jobs: int, work: Work = run_point) -> None:
        self._base = base
        self._jobs = jobs
        self._work = work
        self._pool: ProcessPoolExecutor | None = None
        self._given: dict[Future[StudyPoint], tuple[Point, ProcessPoolExecutor]] = {}
        self._again: list[Point] = []
        self._deaths: dict[int, int] = {}

    @property
    def width(self) -> int:
        """Each process has a point, and the next one lies ready."""
        return _AHEAD * self._jobs

    def give(self, point: Point) -> None:
        """Hand over a point; it waits while there are some that a process died over."""
        if self._again or self._one_is_alone():
            self._again.append(point)
            return
        self._submit(point)

    def finished(self, timeout_s: float) -> list[StudyPoint]:
        """Return what has been computed since; a pool whose process has died is replaced, its points given again."""
        done, _ = wait(self._given, timeout_s, FIRST_COMPLETED)
        results: list[StudyPoint] = []
        for future in done:
            point, pool = self._given.pop(future)
            try:
                results.append(future.result())
            except BrokenProcessPool as died:
                self._drop(pool)
                results += self._died_over(point, str(died))
        self._give_again()
        return results

    def close(self) -> None:
        """End the processes at once: a point is computed whole or not at all."""
        if self._pool is not None:
            processes = list((self._pool._processes or {}).values())  # nothing public ends them before they are done
            self._pool.shutdown(wait=False, cancel_futures=True)
            for process in processes:
                process.kill()
            self._pool = None

    def _submit(self, point: Point) -> None:
        pool = self._present()
        try:
            future = pool.submit(self._work, self._base, point)
        except BrokenProcessPool:  # died since, over another point
            self._drop(pool)
            pool = self._present()
            future = pool.submit(self._work, self._base, point)
        self._given[future] = point, pool

    def _present(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = spawning()
            self._pool = ProcessPoolExecutor(self._jobs, context, begin_beside, (POLITE,))
        return self._pool

    def _drop(self, broken: ProcessPoolExecutor) -> None:
        if self._pool is broken:  # or there is another one already: not all points of one are told at once
            self._pool = None

    def _died_over(self, point: Point, words: str) -> list[StudyPoint]:
        self._deaths[point.number] = self._deaths.get(point.number, 0) + 1
        if self._deaths[point.number] >= DEATHS_MAX:
            return [without_run(point, LOST, f"the process that computes it died {DEATHS_MAX} times over it: {words}")]
        self._again.append(point)
        return []

    def _give_again(self) -> None:
        """Give once more what a process died over; what could be the reason comes alone."""
        while self._again:
            if self._given and (self._is_alone(self._again[0]) or self._one_is_alone()):
                return
            self._submit(self._again.pop(0))

    def _one_is_alone(self) -> bool:
        return any(self._is_alone(point) for point, _ in self._given.values())

    def _is_alone(self, point: Point) -> bool:
        return self._deaths.get(point.number, 0) >= DEATHS_MAX - 1


def count_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))
