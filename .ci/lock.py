"""Renews the locks: ``python .ci/lock.py``; ``--check`` only compares them.

The comparison is with pyproject.toml. Each lock names every package of its set, for all Pythons and machines, with the
hashes of its files, and no host. Packages of ``run.lock`` are not repeated in those of the extras.
"""

import hashlib
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from install import LOCKS, ROOT, as_pip_was_told, pip

UV = "uv ~= 0.13.9"


def wanted() -> dict[str, list[str]]:
    """Return the requirements of each lock by its name."""
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project, build = pyproject["project"], pyproject["build-system"]["requires"]
    # Hatchling's editable installs need editables.
    return {"uv": [UV], "build": [*build, "editables"], "run": project["dependencies"], **{
        extra: [*project["dependencies"], *needed] for extra, needed in project["optional-dependencies"].items()
    }}  # fmt: skip


def digest(requirements: list[str]) -> str:
    """Return a short digest of a lock's requirements."""
    return hashlib.sha256(json.dumps(requirements).encode()).hexdigest()[:16]


def heading(requirements: list[str]) -> str:
    """Return the first line of a lock."""
    return f"# made by `make lock` from requirements {digest(requirements)}"


def stale() -> list[str]:
    """Return the locks that were not made from the current pyproject.toml."""
    return [
        name
        for name, requirements in wanted().items()
        if not (file := LOCKS / f"{name}.lock").exists()
        or file.read_text(encoding="utf-8").split("\n", 1)[0] != heading(requirements)
    ]


def packages(text: str) -> dict[str, str]:
    """Return the entries of a lock by their first line."""
    entries: dict[str, str] = {}
    name = ""
    for line in text.splitlines(keepends=True):
        if line[:1] not in (" ", "#"):
            name = line
            entries[name] = ""
        if name:
            entries[name] += line
    return entries


def compiled(requirements: list[str], constraints: Path | None, environment: dict[str, str], oldest: str) -> str:
    """Return the lock of these requirements. Raises CalledProcessError."""
    command = [
        sys.executable, "-m", "uv", "pip", "compile", "-", "--quiet", "--universal", f"--python-version={oldest}",
        "--generate-hashes", "--no-emit-index-url", "--no-emit-find-links", "--no-annotate", "--no-header", "--upgrade",
    ]  # fmt: skip
    if constraints is not None:
        command.append(f"--constraint={constraints}")
    asked = "\n".join(requirements)
    return subprocess.run(command, input=asked, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout


def renew() -> None:
    """Rewrite all locks with the newest compatible versions."""
    pip("install", "--quiet", "--upgrade", UV)
    sets = wanted()
    oldest = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["requires-python"]
    oldest = oldest.removeprefix(">=").strip()
    # From the index alone: other sources on this machine have files for at most one Python.
    environment = {
        name: value for name, value in as_pip_was_told().items() if name not in ("UV_FIND_LINKS", "UV_INDEX")
    }
    with tempfile.TemporaryDirectory() as folder:
        together = Path(folder) / "all.lock"
        everything = sorted({requirement for requirements in sets.values() for requirement in requirements})
        together.write_text(compiled(everything, None, environment, oldest), encoding="utf-8")
        locks = {name: packages(compiled(needed, together, environment, oldest)) for name, needed in sets.items()}
    for name, entries in locks.items():
        own = entries if name in ("uv", "build", "run") else {n: e for n, e in entries.items() if n not in locks["run"]}
        (LOCKS / f"{name}.lock").write_text(f"{heading(sets[name])}\n{''.join(own.values())}", encoding="utf-8")


if __name__ == "__main__":
    if "--check" not in sys.argv[1:]:
        renew()
    elif names := stale():
        sys.exit(f"not made from what pyproject.toml says now: {', '.join(names)}; run make lock")
