"""Machine code on disk: parallel processes neither lose nor mix up the code of other processes."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROCESSES, EACH = 3, 12

COMPILES = """
import sys
from plant.compilation import compiled

@compiled
def weighted(numbers):
    return numbers[0] * len(numbers)

print("ready", flush=True)
sys.stdin.readline()
for size in range(int(sys.argv[1]), int(sys.argv[2])):
    assert weighted((2.5,) * size) == 2.5 * size
print(sum(weighted.stats.cache_misses.values()))
"""


def test_code_compiled_by_parallel_processes_is_complete_for_the_next_process(tmp_path: Path) -> None:
    (tmp_path / "compiles.py").write_text(COMPILES)
    borders = range(1, 2 + PROCESSES * EACH, EACH)
    assert compiled_by([started(tmp_path, low, low + EACH) for low in borders[:-1]]) == [EACH] * PROCESSES
    assert compiled_by([started(tmp_path, borders[0], borders[-1])]) == [0]


def started(folder: Path, low: int, high: int) -> subprocess.Popen[str]:
    """Start a process that will call the function with tuples of these lengths and this cache folder."""
    command = [sys.executable, str(folder / "compiles.py"), str(low), str(high)]
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder), "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def compiled_by(processes: list[subprocess.Popen[str]]) -> list[int]:
    """Start the calls once all processes are ready; return how many functions each had to compile."""
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    return [int(process.communicate()[0]) for process in processes]
