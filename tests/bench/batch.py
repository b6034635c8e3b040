"""Many simulated runs over all cores: grids of λ, parameter mismatch, seeds."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_Result = TypeVar("_Result")


def run_batch(runs: Iterable[Callable[[], _Result]], workers: int | None = None) -> list[_Result]:
    """Call each of ``runs`` and return their results in order; ``workers`` defaults to the number of cores.

    For runs that use compiled code like ``backend.tuning.simulation``, which releases the lock of Python: threads use
    all cores, and no data are copied between processes. All results are retained, so a run should return only the
    required values. The result does not depend on ``workers``. The first error of a run is raised after the started
    runs have ended; the others are not started.
    """
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        return list(pool.map(lambda run: run(), runs))
