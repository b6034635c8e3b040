"""A real service for browser tests, with its own process, control loop, data folder and port."""

import os
import re
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

LINK = re.compile(r"(https?://127\.0\.0\.1:\d+(?:/\w+)*)/\?token=[\w-]+")
END_TIMEOUT_S = 30


@dataclass(frozen=True)
class Service:
    """A running service: address, sign-in link, data folder and output."""

    url: str
    link: str
    data: Path
    log: Path
    pid: int


@contextmanager
def running_service(
    data: Path,
    params: str = "lab",
    log: Path | None = None,
    descriptors: int | None = None,
    plant: Sequence[str] = ("simulator",),
    more: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    program: Sequence[str] = (sys.executable, "-u", "-m", "backend"),
    folder: Path | None = None,
) -> Iterator[Service]:
    """Start ``sinew serve`` and wait for its sign-in link; end it as Ctrl+C does.

    ``plant`` are the arguments after ``--plant``, ``more`` further arguments; ``environment`` extends the environment
    of the test, ``folder`` is the working directory. The output is copied to ``log``, by default a file in the data
    folder. ``descriptors`` limits the number of open files and sockets; the service starts with half of it.
    """
    data.mkdir(parents=True, exist_ok=True)
    log = log or data / "service.log"
    command = [*program, "serve", "--plant", *plant, "--params", params]
    command += ["--port", "0", "--show-link", "--data", str(data), *more]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, **(environment or {})},
        cwd=folder,
    )
    if descriptors is not None:
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (descriptors // 2, descriptors))
    assert process.stdout is not None
    copying = threading.Thread(target=_copy, args=(process.stdout, log), daemon=True)
    try:
        found = _read_until_link(process.stdout, log)
        copying.start()
        yield Service(found[1], found[0], data, log, process.pid)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        finally:
            if copying.ident is not None:
                copying.join(END_TIMEOUT_S)  # the log of a service that has ended is complete


def _read_until_link(said: IO[str], log: Path) -> re.Match[str]:
    """Return the sign-in link of a service; copy the lines up to it to the log."""
    with log.open("a", encoding="utf-8") as kept:
        for line in said:
            kept.write(line)
            if found := LINK.search(line):
                return found
    said.close()
    raise AssertionError(f"the service ended before it printed a sign-in link:\n{log.read_text(encoding='utf-8')}")


def _copy(said: IO[str], log: Path) -> None:
    """Append each further line of the service to its log immediately."""
    with said, log.open("a", encoding="utf-8", buffering=1) as kept:
        for line in said:
            kept.write(line)
