"""Speed-up of a study of many tracking runs by two cores.

``python -m tests.bench.study_bench RUNS`` uses this number of runs, and also prints the times.
"""

import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

from rich.console import Console

from backend.banks.tuning_settings import TuningSettings
from backend.services.studies import Studies
from backend.storage import studies
from backend.storage.database import Database, open_database
from backend.studies.runner import run_study, use_local_processes
from plant.parameters import load_parameters
from tests.bench.table import Ratio, print_ratios

RUNS = 2000
FASTER = 1.7
STUDY = """
format: 1
name: bench
title: Bench
settings: {{q_duration_s: 1.0, S_duration_s: 1.0}}
spread:
  - {{of: motor.c0, relative: 0.2}}
  - {{of: asymmetry.spring_A, relative: 0.05}}
draws: {runs}
"""


def bench(console: Console, runs: int = RUNS) -> bool:
    """Print the ratio; return whether it is above its bound."""
    with tempfile.TemporaryDirectory() as folder, closing(open_database(Path(folder))) as database:
        one_s, two_s = (_took_s(database, runs, jobs) for jobs in (1, 2))
    told = f"{runs} runs, {one_s:.0f} s and {two_s:.0f} s"
    return print_ratios(console, "Studies", [Ratio.at_least("one core / two cores", one_s / two_s, FASTER, told)])


def _took_s(database: Database, runs: int, jobs: int) -> float:
    text = STUDY.format(runs=runs)
    study = Studies(database).create(text, "bench", load_parameters("lab"), TuningSettings().to_document()).id
    begun = time.perf_counter()
    run_study(database, study, use_local_processes(jobs))
    took_s = time.perf_counter() - begun
    with database.reading() as session:
        if studies.states(session, study) != {"completed": runs}:
            raise RuntimeError(f"all runs were to be completed: {studies.states(session, study)}")
    return took_s


if __name__ == "__main__":
    sys.exit(not bench(Console(), int(sys.argv[1])))
