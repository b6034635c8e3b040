"""What ``pip install .`` brings along: code, front end, parameters, migrations, report templates."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """Names in a wheel built from this tree, with the build hook that builds the front end."""
    target = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(target)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    (wheel,) = target.glob("sinew-*.whl")
    return set(zipfile.ZipFile(wheel).namelist())


def test_the_built_front_end_is_in_the_wheel(shipped: set[str]) -> None:
    assert "backend/static/index.html" in shipped
    page = (ROOT / "backend/static/index.html").read_text(encoding="utf-8")
    scripts = {name for name in shipped if name.startswith("backend/static/assets/") and name.endswith(".js")}
    assert any(Path(name).name in page for name in scripts)


def test_every_tracked_file_of_the_packages_is_in_the_wheel(shipped: set[str]) -> None:
    listed = subprocess.run(
        ["git", "ls-files", "plant", "backend", "migrations"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    tracked = {name for name in listed.stdout.splitlines() if (ROOT / name).is_file()}
    assert {"plant/parameters/lab.toml", "backend/reports/report.typ", "backend/__main__.py"} <= tracked
    assert tracked <= shipped


def test_nothing_else_is_in_the_wheel(shipped: set[str]) -> None:
    assert {name.split("/")[0].split("-")[0] for name in shipped} == {"plant", "backend", "migrations", "sinew"}
    assert not [name for name in shipped if "__pycache__" in name or name.endswith(".db")]
