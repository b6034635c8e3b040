"""Computes the points of a study in processes of this machine; a point is retried if its process dies."""

import os
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol

from backend.storage import StudyPoint
from backend.studies import messages
from backend.studies.point import LOST, Point, StudyBase, build_failed_point, run_point
from backend.workers import BACKGROUND_NICENESS, get_spawn_context, initialize_worker
from plant import ErrorCode, SinewError

CRASHES_MAX = 3
"""Number of times that the process of a point may die. The last attempt runs alone, which identifies the cause."""
_POINTS_PER_PROCESS = 2  # one runs, the next one waits for it

ComputePoint = Callable[[StudyBase, Point], StudyPoint]


class ExecutorUnavailableError(SinewError):
    """No process or worker can compute points; the message contains the remedy."""

    category = ErrorCode.UNAVAILABLE


class PointExecutor(Protocol):
    """Computes several points in parallel."""

    @property
    def capacity(self) -> int:
        """Number of points to have submitted at the same time."""
        ...

    def submit(self, point: Point) -> None:
        """Start or queue the computation of a point."""
        ...

    def collect_results(self, timeout_s: float) -> list[StudyPoint]:
        """Return the rows computed since the last call, in any order; wait up to ``timeout_s`` for the first."""
        ...

    def close(self) -> None:
        """End all computations at once."""
        ...


class LocalExecutor:
    """Computes points by ``compute_point`` in ``jobs`` processes of this machine, at low priority."""

    def __init__(self, base: StudyBase, jobs: int, compute_point: ComputePoint = run_point) -> None:
        self._base = base
        self._jobs = jobs
        self._compute_point = compute_point
        self._pool: ProcessPoolExecutor | None = None
        self._submitted: dict[Future[StudyPoint], tuple[Point, ProcessPoolExecutor]] = {}
        self._to_retry: list[Point] = []
        self._crashes: dict[int, int] = {}

    @property
    def capacity(self) -> int:
        """Two points per process, so that no process waits for its next one."""
        return _POINTS_PER_PROCESS * self._jobs

    def submit(self, point: Point) -> None:
        """Submit a point; it waits while points are retried or one runs alone."""
        if self._to_retry or self._runs_isolated_point():
            self._to_retry.append(point)
            return
        self._submit(point)

    def collect_results(self, timeout_s: float) -> list[StudyPoint]:
        """Return the rows computed since the last call; replace a broken pool and retry its points."""
        done, _ = wait(self._submitted, timeout_s, FIRST_COMPLETED)
        results: list[StudyPoint] = []
        for future in done:
            point, pool = self._submitted.pop(future)
            try:
                results.append(future.result())
            except BrokenProcessPool as died:
                self._discard_pool(pool)
                results += self._handle_crash(point, str(died))
        self._submit_retries()
        return results

    def close(self) -> None:
        """Kill the processes; no part of an unfinished point is stored."""
        if self._pool is not None:
            processes = list((self._pool._processes or {}).values())  # no public method ends them before they are done
            self._pool.shutdown(wait=False, cancel_futures=True)
            for process in processes:
                process.kill()
            self._pool = None

    def _submit(self, point: Point) -> None:
        pool = self._get_pool()
        try:
            future = pool.submit(self._compute_point, self._base, point)
        except BrokenProcessPool:  # broken by another point since the last check
            self._discard_pool(pool)
            pool = self._get_pool()
            future = pool.submit(self._compute_point, self._base, point)
        self._submitted[future] = point, pool

    def _get_pool(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = get_spawn_context()
            self._pool = ProcessPoolExecutor(self._jobs, context, initialize_worker, (BACKGROUND_NICENESS,))
        return self._pool

    def _discard_pool(self, broken: ProcessPoolExecutor) -> None:
        if self._pool is broken:  # its points report the failure one by one; the pool may be replaced already
            self._pool = None

    def _handle_crash(self, point: Point, words: str) -> list[StudyPoint]:
        self._crashes[point.number] = self._crashes.get(point.number, 0) + 1
        if self._crashes[point.number] >= CRASHES_MAX:
            return [build_failed_point(point, LOST, messages.process_died(times=CRASHES_MAX, reason=words))]
        self._to_retry.append(point)
        return []

    def _submit_retries(self) -> None:
        """Submit the points to retry; a point that may be the cause of the crashes runs alone."""
        while self._to_retry:
            if self._submitted and (self._needs_isolation(self._to_retry[0]) or self._runs_isolated_point()):
                return
            self._submit(self._to_retry.pop(0))

    def _runs_isolated_point(self) -> bool:
        return any(self._needs_isolation(point) for point, _ in self._submitted.values())

    def _needs_isolation(self, point: Point) -> bool:
        return self._crashes.get(point.number, 0) >= CRASHES_MAX - 1


def count_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))
