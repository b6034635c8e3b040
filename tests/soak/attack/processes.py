"""The processes of a service: which there are, and how busy."""

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

WATCHDOG, POOL, TRACKER = b"plant.safety_card", b"spawn_main", b"resource_tracker"
"""Words of the command lines: the card's watchdog, a worker of a pool for computing, and what Python starts beside."""


class Busy(NamedTuple):
    """A process and the time it has computed [s]."""

    pid: int
    cpu_s: float


def children(pid: int) -> list[int]:
    """Return the children of a process, none where it is gone."""
    found: list[int] = []
    with suppress(FileNotFoundError, ProcessLookupError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with suppress(FileNotFoundError, ProcessLookupError):
                found += map(int, (thread / "children").read_text(encoding="ascii").split())
    return found


def descendants(pid: int) -> list[int]:
    """Return all processes below one."""
    return [below for child in children(pid) for below in (child, *descendants(child))]


def named(pid: int, word: bytes) -> list[int]:
    """Return the processes below ``pid`` with ``word`` in their command line."""
    return [below for below in descendants(pid) if word in _command_line(below)]


def pool_workers(service: int) -> list[Busy]:
    """Return the workers of a service's pools."""
    return [Busy(pid, cpu_s) for pid in named(service, POOL) if (cpu_s := _cpu_s(pid)) is not None]


def strangers(service: int) -> int:
    """Count the children of a service that come and go with no pool: its loop, and whatever should not be there."""
    lines = map(_command_line, children(service))
    return sum(POOL not in line and TRACKER not in line for line in lines)


def is_there(pid: int) -> bool:
    """Whether a process lives; one that is only waited for does not."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return _fields(pid)[0] not in "ZX"
    return False


def kill(pid: int) -> None:
    """kill -9, also of what is gone already."""
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
    """Fields of /proc/PID/stat from the state on; the name before it may hold anything."""
    return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(") ")[2].split()
