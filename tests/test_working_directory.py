"""No process of Sinew imports modules from the working directory."""

import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from tests.e2e.service import running_service

SINEW = str(Path(sys.executable).with_name("sinew"))
TRAP = "open(__file__ + '.imported', 'w').close()\nraise ImportError('this is not the module that was meant')\n"
NAMES = ("signal.py", "random.py", "numpy.py", "plant.py", "backend/__init__.py", "multiprocessing/__init__.py")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with files named as modules, which record their import."""
    directory = tmp_path / "trap"
    for name in NAMES:
        (directory / name).parent.mkdir(parents=True, exist_ok=True)
        (directory / name).write_text(TRAP)
    return directory


def imported(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*.imported"))


@pytest.mark.live
def test_the_service_imports_nothing_from_the_working_directory(folder: Path, tmp_path: Path) -> None:
    with running_service(tmp_path / "data", program=(SINEW,), folder=folder) as service:
        health = httpx.get(f"{service.url}/api/health").raise_for_status().json()
        assert health["alive"]
    assert imported(folder) == []


def test_an_experiment_imports_nothing_from_the_working_directory(folder: Path, tmp_path: Path) -> None:
    words = ["experiment", "sequence", "--set", 'segments=[{"duration_s": 0.5, "q_ref": 0.0, "S_ref": 10}]']
    ended = subprocess.run(
        [SINEW, *words, "--data", str(tmp_path / "data")], cwd=folder, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    assert imported(folder) == []


def test_spawned_processes_import_nothing_from_the_working_directory(folder: Path) -> None:
    program = (
        "from concurrent.futures import ProcessPoolExecutor\n"
        "import os, subprocess, sys\n"
        "from backend.workers import get_spawn_context\n"
        "with ProcessPoolExecutor(1, get_spawn_context()) as pool:\n"
        "    print(pool.submit(abs, -2).result())\n"
        "    print(pool.submit(subprocess.call, [sys.executable, '-c', 'import signal']).result())\n"
    )
    ended = subprocess.run([sys.executable, "-P", "-c", program], cwd=folder, capture_output=True, text=True)
    assert (ended.stdout.split(), ended.stderr) == (["2", "0"], "")
    assert imported(folder) == []
