"""``python -m tests.bench.experiment_runs RUNS CORE``: execute tracking experiments successively on one core.

Prints "ready" after loading, waits for the end of its input, and then prints the duration [s].
"""

import asyncio
import os
import sys
import tempfile
import time
from pathlib import Path

from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import find_experiment
from backend.experiments.plans import LoopSettings
from backend.storage.database import Database, open_database
from backend.storage.runs import EndState
from plant.parameters import PlantParameters, load_parameters


def main(count: int, core: int) -> None:
    """Execute the runs and print the duration."""
    os.sched_setaffinity(0, [core])
    parameters = load_parameters("lab")
    with tempfile.TemporaryDirectory() as folder:
        database = open_database(Path(folder))
        _play(database, parameters)
        print("ready", flush=True)
        sys.stdin.read()
        begun = time.perf_counter()
        for _ in range(count):
            _play(database, parameters)
        print(time.perf_counter() - begun)
        database.close()


def _play(database: Database, parameters: PlantParameters) -> None:
    settings = LoopSettings()
    order = RunRequest(find_experiment("tracking").default_plan, settings, "bench")
    with open_headless_rig(database, parameters, settings) as station:
        outcome = asyncio.run(run_experiment(station, order))
    if outcome.run.end_state != EndState.COMPLETED or outcome.evaluation.result is None:
        raise RuntimeError(f"the experiment was to be completed and evaluated: {outcome}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
