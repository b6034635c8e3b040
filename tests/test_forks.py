"""Processes that the service may start; the restriction is permanent."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
REFUSED = "the service does not fork"
BEGIN = "import multiprocessing, os, pty, subprocess, sys\nfrom backend.workers import forbid_forks\nforbid_forks()\n"


def run_program(lines: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BEGIN + lines], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.parametrize(
    "fork",
    ["os.fork()", "os.forkpty()", "pty.fork()", "multiprocessing.get_context('fork').Process(target=id).start()"],
)
def test_forks_are_rejected(fork: str) -> None:
    outcome = run_program(f"{fork}\nprint('forked')")
    assert outcome.returncode == 1
    assert REFUSED in outcome.stderr
    assert "forked" not in outcome.stdout


def test_programs_and_spawned_processes_are_permitted() -> None:
    outcome = run_program(
        "subprocess.run([sys.executable, '-c', 'print(1)'], check=True)\n"
        "assert multiprocessing.get_start_method() == 'spawn'\n"
        "with multiprocessing.Pool(1) as pool:\n"
        "    print(pool.apply(abs, (-2,)))\n"
    )
    assert outcome.stdout.split() == ["1", "2"], outcome.stderr
