"""Installs locked packages with uv: ``python .ci/install.py [EXTRA,EXTRA...]``.

Run by the environment's Python. uv itself is installed by pip, with a hash like all packages. The locks name no host:
pip's configuration of this machine is passed on to uv. The page is built, and Sinew itself installed, while packages
are downloaded and the control laws compiled.
"""

import os
import shlex
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCKS = ROOT / ".ci" / "locks"


def pip(*arguments: str) -> str:
    """Run pip and return its output. Raises CalledProcessError."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def as_pip_was_told() -> dict[str, str]:
    """Return uv's environment with pip's configuration, unless uv has its own."""
    told: dict[str, list[str]] = {}
    for line in pip("config", "list").splitlines():
        place, _, value = line.partition("=")
        name = place.rpartition(".")[2]
        # the last value, that of the environment, counts
        told[name] = shlex.split(shlex.split(value)[0]) if value else []
    environment = {"UV_INDEX_STRATEGY": "unsafe-best-match"}  # all indexes are equal, as for pip
    for option, variable, separator in (
        ("index-url", "UV_DEFAULT_INDEX", " "),
        ("extra-index-url", "UV_INDEX", " "),
        ("find-links", "UV_FIND_LINKS", ","),
        ("trusted-host", "UV_INSECURE_HOST", " "),
        ("no-index", "UV_NO_INDEX", " "),
        ("cert", "SSL_CERT_FILE", " "),
        ("timeout", "UV_HTTP_TIMEOUT", " "),
        ("default-timeout", "UV_HTTP_TIMEOUT", " "),
    ):
        if told.get(option):
            environment[variable] = separator.join(told[option])
    return {**environment, **os.environ}


def bring_uv() -> None:
    """Install the locked uv if it is missing."""
    pip("install", "--quiet", "--require-hashes", "--requirement", str(LOCKS / "uv.lock"))


def run(environment: dict[str, str], *command: str) -> None:
    """Run a module of the environment's Python. Raises CalledProcessError."""
    subprocess.run([sys.executable, *command], cwd=ROOT, env=environment, check=True)


def install(environment: dict[str, str], *what: str) -> None:
    """Install with uv into the environment of this Python. Raises CalledProcessError."""
    run(environment, "-m", "uv", "pip", "install", "--quiet", "--python", sys.executable, *what)


def install_locked(environment: dict[str, str], *names: str) -> None:
    """Install the packages of these locks, verified by their hashes."""
    install(environment, "--require-hashes", *(f"--requirement={LOCKS / f'{name}.lock'}" for name in names))


def beside_each_other(*works: Callable[[], None]) -> None:
    """Run functions in parallel; raise the first error once all have ended."""
    errors: list[BaseException] = []

    def done(work: Callable[[], None]) -> None:
        try:
            work()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=done, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]


def main(extras: list[str]) -> None:
    """Install Sinew and these extras for development."""
    unknown = [extra for extra in extras if not (LOCKS / f"{extra}.lock").exists()]
    if unknown:
        sys.exit(f"there is no extra {', '.join(unknown)}: rig, postgres and dev are those of pyproject.toml")
    environment: dict[str, str] = {}
    beside_each_other(bring_uv, lambda: environment.update(as_pip_was_told()))
    named = f".[{','.join(extras)}]" if extras else "."

    def page() -> None:
        install_locked(environment, "build")
        run(environment, "frontend/build.py", "build")
        install(environment, "--no-build-isolation", "--no-deps", "--editable", named)

    def program() -> None:
        install_locked(environment, "run", *extras)
        beside_each_other(
            lambda: run(environment, "-m", "backend.compile_ahead"),
            lambda: run(environment, "-m", "backend.realtime.compile_ahead"),
        )

    beside_each_other(page, program)


if __name__ == "__main__":
    try:
        main([extra for argument in sys.argv[1:] for extra in argument.split(",") if extra])
    except subprocess.CalledProcessError as failed:
        sys.exit(failed.returncode)
