"""Contents of the wheel: code, page, parameters, migrations, report templates."""

import os
import re
import signal
import subprocess
import sys
import sysconfig
import tomllib
import urllib.request
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a wheel built from this tree, including the front end."""
    target = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(target)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    (built_wheel,) = target.glob("sinew-*.whl")
    return built_wheel


@pytest.fixture(scope="module")
def wheel_files(wheel: Path) -> set[str]:
    """Return the names of the files in the wheel."""
    return set(zipfile.ZipFile(wheel).namelist())


def test_the_built_front_end_is_in_the_wheel(wheel_files: set[str]) -> None:
    assert "backend/static/index.html" in wheel_files
    page = (ROOT / "backend/static/index.html").read_text(encoding="utf-8")
    scripts = {name for name in wheel_files if name.startswith("backend/static/assets/") and name.endswith(".js")}
    assert any(Path(name).name in page for name in scripts)


def test_every_tracked_file_of_the_packages_is_in_the_wheel(wheel_files: set[str]) -> None:
    listed = subprocess.run(
        ["git", "ls-files", "plant", "backend", "migrations"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    tracked = {name for name in listed.stdout.splitlines() if (ROOT / name).is_file()}
    assert {"plant/parameters/lab.toml", "backend/reports/report.typ", "backend/__main__.py"} <= tracked
    assert tracked <= wheel_files


def test_nothing_else_is_in_the_wheel(wheel_files: set[str]) -> None:
    assert {name.split("/")[0].split("-")[0] for name in wheel_files} == {"plant", "backend", "migrations", "sinew"}
    assert not [name for name in wheel_files if "__pycache__" in name or name.endswith(".db")]


@pytest.mark.live
def test_the_wheel_starts_in_a_separate_environment(wheel: Path, tmp_path: Path) -> None:
    """The environment uses the libraries of this one, but nothing of this source tree."""
    venv.create(tmp_path / "own", symlinks=True)
    python = tmp_path / "own/bin/python"
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(python), "install"]
    subprocess.run([*command, "--quiet", "--no-deps", "--no-index", str(wheel)], check=True, cwd=tmp_path)
    (packages,) = (tmp_path / "own/lib").glob("python*/site-packages")
    (packages / "libraries.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    code = "import backend, plant, migrations; print(backend.__file__, plant.__file__, migrations.__file__)"
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    found = subprocess.run([python, "-c", code], cwd=tmp_path, env=own, check=True, capture_output=True, text=True)
    assert all(str(packages) in path for path in found.stdout.split())
    serving = subprocess.Popen(
        [tmp_path / "own/bin/sinew", "serve", "--port", "0", "--data", str(tmp_path / "data"), "--show-link"],
        cwd=tmp_path,
        env=own,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert serving.stdout is not None
    try:
        # A slow start prints a line of progress before the link.
        found_links = (re.search(r"(http://\S+)/\?token=\S+", line) for line in serving.stdout)
        link = next((match for match in found_links if match is not None), None)
        assert link is not None
        with urllib.request.urlopen(link[1], timeout=60.0) as answer:
            page = answer.read().decode()
        assert page == (packages / "backend/static/index.html").read_text(encoding="utf-8")
        for script in re.findall(r'src="(/[^"]+\.js)"', page):
            assert urllib.request.urlopen(link[1] + script, timeout=60.0).status == 200
        serving.send_signal(signal.SIGTERM)
        serving.wait(60.0)
    finally:
        serving.kill()
        serving.wait()
        serving.stdout.close()


def locked(name: str) -> dict[str, list[str]]:
    """Return the hashes in a lock file, by package and version."""
    text = (ROOT / f".ci/locks/{name}.lock").read_text(encoding="utf-8")
    entries = re.findall(r"^([a-z0-9-]+==[^\s;]+)[^\n]*((?:\n    --hash=\S+(?: \\)?)*)", text, re.MULTILINE)
    return {package: re.findall(r"--hash=sha256:([0-9a-f]{64})", hashes) for package, hashes in entries}


def test_lock_files_match_the_project_and_contain_hashes_but_no_hosts() -> None:
    checked = subprocess.run([sys.executable, ".ci/lock.py", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stderr
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = ["uv", "build", "run", *project["optional-dependencies"]]
    assert {file.stem for file in (ROOT / ".ci/locks").iterdir()} == set(names)
    for name in names:
        assert "://" not in (ROOT / f".ci/locks/{name}.lock").read_text(encoding="utf-8")
        assert locked(name)
        assert all(locked(name).values())


def test_each_requirement_is_in_its_lock_file() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for name, needed in {"run": project["dependencies"], **project["optional-dependencies"]}.items():
        locked_names = {package.partition("==")[0] for package in (*locked(name), *locked("run"))}
        assert {re.split(r"[\s\[~=]", requirement)[0] for requirement in needed} <= locked_names
