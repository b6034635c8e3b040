"""``python -m tests.bench.fast_loop PERIODS PERIOD_S``: mode Run on a simulator with a faster clock.

Laws and simulator use periods of 1 ms; only the deadlines are closer. Prints "ready", and at the end the 99th
percentile of the lateness [µs], the number of missed deadlines, and the processor load.
"""

import gc
import sys
import time

import numpy as np

from backend.realtime.timing import Pacer, request_real_time
from plant.parameters import load_parameters
from tests.bench.tick_bench import loop_in_run, require_run


def main(periods: int, period_s: float) -> None:
    """Run the loop and print the values."""
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
