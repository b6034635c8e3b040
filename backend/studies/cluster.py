"""Computes the points of a study on a Dask cluster, one task per point; Dask retries the tasks of a dead worker.

The package ``distributed`` is optional (extra ``cluster``) and imported only when a scheduler is given.
"""

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

from backend.storage import StudyPoint
from backend.studies import messages
from backend.studies.executor import ComputePoint, ExecutorUnavailableError
from backend.studies.point import LOST, Point, StudyBase, build_failed_point, run_point

CONNECT_S = 10.0
"""Time [s] within which a scheduler must answer."""
_POINTS_PER_THREAD = 2  # one runs, the next one waits on the worker


def use_cluster(address: str, compute_point: ComputePoint = run_point) -> Callable[[StudyBase], "ClusterExecutor"]:
    """Return a factory of executors on the workers of a scheduler such as tcp://host:8786."""
    return lambda base: ClusterExecutor(base, address, compute_point)


class ClusterExecutor:
    """Computes points on the workers of one scheduler; workers may join and leave.

    Raises ExecutorUnavailableError if the package ``distributed`` or the scheduler is missing.
    """

    def __init__(self, base: StudyBase, address: str, compute_point: ComputePoint = run_point) -> None:
        try:
            from distributed import Client, KilledWorker
        except ModuleNotFoundError:
            raise ExecutorUnavailableError(messages.cluster_not_installed()) from None
        logging.getLogger("distributed").setLevel(logging.ERROR)
        try:
            self._client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise ExecutorUnavailableError(messages.no_scheduler(address=address, reason=str(error))) from None
        self._killed = KilledWorker
        self._compute_point = compute_point
        self._base = base  # sent with each point, as data stored on a worker is lost when it dies
        self._submitted: dict[str, tuple[Any, Point]] = {}
        self._done: SimpleQueue[str] = SimpleQueue()

    @property
    def capacity(self) -> int:
        """Two points per worker thread; two before the first worker has joined."""
        threads: dict[str, int] = self._client.nthreads()
        return _POINTS_PER_THREAD * max(1, sum(threads.values()))

    def submit(self, point: Point) -> None:
        """Submit a point to the scheduler."""
        future = self._client.submit(self._compute_point, self._base, point, pure=False)
        self._submitted[future.key] = future, point
        future.add_done_callback(partial(_enqueue_key, self._done))

    def collect_results(self, timeout_s: float) -> list[StudyPoint]:
        """Return the rows computed since the last call.

        Raises ExecutorUnavailableError if the scheduler is gone or the workers cannot compute.
        """
        results: list[StudyPoint] = []
        with suppress(Empty):
            results.append(self._take_result(self._done.get(timeout=timeout_s)))
            while True:
                results.append(self._take_result(self._done.get_nowait()))
        if self._client.status != "running":
            raise ExecutorUnavailableError(messages.scheduler_lost())
        return results

    def close(self) -> None:
        """Cancel the submitted points and disconnect from the scheduler."""
        with suppress(Exception):  # the scheduler may be gone
            self._client.cancel([future for future, _ in self._submitted.values()])
        self._client.close()

    def _take_result(self, key: str) -> StudyPoint:
        future, point = self._submitted.pop(key)
        if future.status == "finished":
            result: StudyPoint = future.result()
            return result
        if future.status != "error" or self._client.status != "running":
            raise ExecutorUnavailableError(messages.scheduler_lost())
        error = future.exception()
        if not isinstance(error, self._killed):
            raise ExecutorUnavailableError(
                messages.workers_cannot_compute(error=type(error).__name__, reason=str(error))
            )
        return build_failed_point(point, LOST, messages.workers_died(reason=str(error)))


def _enqueue_key(done: "SimpleQueue[str]", future: Any) -> None:
    done.put(future.key)  # called in a thread of Dask
