"""A Dask cluster computes the points of a study: one task each. A worker that dies has its task done by another one.

The package ``distributed`` is an extra, ``cluster``: it is loaded by whoever names a scheduler.
"""

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

from backend.storage import StudyPoint
from backend.studies.crew import CrewGoneError, Work
from backend.studies.point import LOST, Point, StudyBase, run_point, without_run

CONNECT_S = 10.0
"""A scheduler that does not answer within this [s] is not there."""
_AHEAD = 2
_GONE = "the scheduler is gone: start it again, and go on with --resume"
_SET_UP = "; set up their machines like this one, and go on with --resume"


def use_cluster(address: str, work: Work = run_point) -> Callable[[StudyBase], "ClusterCrew"]:
    """Return what makes a crew of the workers of a scheduler, tcp://host:8786."""
    return lambda base: ClusterCrew(base, address, work)


class ClusterCrew:
    """The workers of one scheduler, however many there are at the moment. Raises CrewGoneError where there is none."""

    def __init__(self, base: StudyBase, address: str, work: Work = run_point) -> None:
        try:
            from distributed import Client, KilledWorker
        except ModuleNotFoundError:
            raise CrewGoneError("a cluster needs the extra cluster: pip install 'sinew[cluster]'") from None
        logging.getLogger("distributed").setLevel(logging.ERROR)
        try:
            self._client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise CrewGoneError(f"no Dask scheduler answers at {address}: {error}") from None
        self._killed = KilledWorker
        self._work = work
        self._base = base  # goes with each point: what lay on a worker would be gone with it
        self._given: dict[str, tuple[Any, Point]] = {}
        self._done: SimpleQueue[str] = SimpleQueue()

    @property
    def width(self) -> int:
        """Each thread of a worker has a point, and the next one lies ready; two where no worker is there yet."""
        threads: dict[str, int] = self._client.nthreads()
        return _AHEAD * max(1, sum(threads.values()))

    def give(self, point: Point) -> None:
        """Hand over a point."""
        future = self._client.submit(self._work, self._base, point, pure=False)
        self._given[future.key] = future, point
        future.add_done_callback(partial(_told, self._done))

    def finished(self, timeout_s: float) -> list[StudyPoint]:
        """Return what has been computed since. Raises CrewGoneError when the scheduler is gone."""
        results: list[StudyPoint] = []
        with suppress(Empty):
            results.append(self._result(self._done.get(timeout=timeout_s)))
            while True:
                results.append(self._result(self._done.get_nowait()))
        if self._client.status != "running":
            raise CrewGoneError(_GONE)
        return results

    def close(self) -> None:
        """Give back what is not computed yet, and leave the cluster to others."""
        with suppress(Exception):  # of a scheduler that is gone nothing is to be given back
            self._client.cancel([future for future, _ in self._given.values()])
        self._client.close()

    def _result(self, key: str) -> StudyPoint:
        future, point = self._given.pop(key)
        if future.status == "finished":
            result: StudyPoint = future.result()
            return result
        if future.status != "error" or self._client.status != "running":
            raise CrewGoneError(_GONE)
        error = future.exception()
        if not isinstance(error, self._killed):
            raise CrewGoneError(f"the workers cannot compute it: {type(error).__name__}: {error}{_SET_UP}")
        return without_run(point, LOST, f"the workers of the cluster died over it: {error}")


def _told(done: "SimpleQueue[str]", future: Any) -> None:
    done.put(future.key)
