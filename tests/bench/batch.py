"""Many simulated runs over all cores: grids of λ, parameter mismatch, seeds."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_Result = TypeVar("_Result")


def run_batch(runs: Iterable[Callable[[], _Result]], workers: int | None = None) -> list[_Result]:
    """Call each of ``runs`` and return their results in order; ``workers`` defaults to the number of cores.

    For runs that spend their time in ``backend.tuning.simulation`` and its like: compiled, they leave Python's lock to
    each other, so that threads use all cores and nothing has to be copied between processes. Let a run reduce its
    trajectory to what is wanted, for all results are kept. The result does not depend on ``workers``. The first error
    of a run is raised after the runs already begun have ended; the others are not begun.
    """
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        return list(pool.map(lambda run: run(), runs))
