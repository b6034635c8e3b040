"""Descriptors, children and sockets of a process, read from the kernel."""

import os
from contextlib import suppress
from pathlib import Path

_LISTENS_TCP, _LISTENS_UNIX = "0A", "00010000"


def children(pid: int) -> list[int]:
    """Return the child processes of ``pid``."""
    started = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # the thread has ended meanwhile
            started += [int(child) for child in (task / "children").read_text().split()]
    return started


def descendants(pid: int) -> dict[int, str]:
    """Return all descendants of ``pid`` with their command lines."""
    found: dict[int, str] = {}
    for child in children(pid):
        found |= {child: command(child), **descendants(child)}
    return found


def command(pid: int) -> str:
    """Return the command line of a process."""
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode().strip()


def held(pid: int) -> list[str]:
    """Return the targets of a process's descriptors; for a socket, its kind and address."""
    links = []
    kinds = _sockets(pid)
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            link = os.readlink(descriptor)
            links.append(kinds.get(link[8:-1], link) if link.startswith("socket:") else link)
    return links


def listening(pid: int) -> list[str]:
    """Return the listening sockets of a process."""
    return [link for link in held(pid) if link.startswith("listening ")]


def _sockets(pid: int) -> dict[str, str]:
    """Return the sockets in the network namespace of the process by inode."""
    kinds = {}
    for name in ("tcp", "tcp6"):
        for words in _table(pid, name):
            kinds[words[9]] = f"{'listening' if words[3] == _LISTENS_TCP else 'connected'} {name} {words[1]}"
    for words in _table(pid, "unix"):
        kinds[words[6]] = f"{'listening' if words[3] == _LISTENS_UNIX else 'connected'} unix {' '.join(words[7:])}"
    return kinds


def _table(pid: int, name: str) -> list[list[str]]:
    return [line.split() for line in Path(f"/proc/{pid}/net/{name}").read_text().splitlines()[1:]]
