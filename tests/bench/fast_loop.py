"""``python -m tests.bench.fast_loop PERIODS PERIOD_S``: the loop in run on a simulator, its clock going faster.

The laws are those for 1 ms, as the periods of the simulator are: only deadlines come sooner. Says "ready", at the end
the 99th percentile of its lateness [µs], how many deadlines it missed, and in which part of the time it was busy.
"""

import gc
import sys
import time

import numpy as np

from backend.realtime.timing import Pacer, request_real_time
from plant.parameters import load_parameters
from tests.bench.tick_bench import loop_in_run, require_run


def main(periods: int, period_s: float) -> None:
    """Tick and tell."""
    loop = loop_in_run(load_parameters("lab"))
    gc.collect()
    gc.freeze()
    gc.disable()
    request_real_time()
    lateness = np.zeros(periods)
    print("ready", flush=True)
    pacer = Pacer(period_s)
    busy_s, begun = time.process_time(), time.monotonic()
    for k in range(periods):
        lateness[k] = pacer.wait()
        loop.tick(lateness[k], 0)
    busy_s, taken_s = time.process_time() - busy_s, time.monotonic() - begun
    require_run(loop)
    loop.close()
    print(1e6 * float(np.percentile(lateness, 99.0)), pacer.overruns, busy_s / taken_s)


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
