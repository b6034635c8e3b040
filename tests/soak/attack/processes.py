"""The processes of a service and their processor time."""

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

WATCHDOG, POOL, TRACKER = b"plant.safety_card", b"spawn_main", b"resource_tracker"
"""Words of the command lines: the card's watchdog, a worker of a pool for computing, and what Python starts beside."""


class Busy(NamedTuple):
    """A process and its processor time [s]."""

    pid: int
    cpu_s: float


def children(pid: int) -> list[int]:
    """Return the children of a process, none if it has ended."""
    found: list[int] = []
    with suppress(FileNotFoundError, ProcessLookupError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with suppress(FileNotFoundError, ProcessLookupError):
                found += map(int, (thread / "children").read_text(encoding="ascii").split())
    return found


def descendants(pid: int) -> list[int]:
    """Return all descendants of a process."""
    return [below for child in children(pid) for below in (child, *descendants(child))]


def named(pid: int, word: bytes) -> list[int]:
    """Return the descendants of ``pid`` with ``word`` in their command line."""
    return [below for below in descendants(pid) if word in _command_line(below)]


def pool_workers(service: int) -> list[Busy]:
    """Return the worker processes of a service."""
    return [Busy(pid, cpu_s) for pid in named(service, POOL) if (cpu_s := _cpu_s(pid)) is not None]


def count_unpooled_children(service: int) -> int:
    """Count the children of a service outside of the pools: its loop, and unexpected ones."""
    lines = map(_command_line, children(service))
    return sum(POOL not in line and TRACKER not in line for line in lines)


def is_there(pid: int) -> bool:
    """Return whether a process is alive; a zombie is not."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return _fields(pid)[0] not in "ZX"
    return False


def kill(pid: int) -> None:
    """Send SIGKILL, also to a process that has ended."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def _command_line(pid: int) -> bytes:
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def _cpu_s(pid: int) -> float | None:
    with suppress(FileNotFoundError, ProcessLookupError):
        fields = _fields(pid)
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return None


def _fields(pid: int) -> list[str]:
    """Return the fields of /proc/PID/stat from the state on; the name before it may contain any character."""
    return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(") ")[2].split()
