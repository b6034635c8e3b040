"""What a process holds and whom it has started, as the kernel tells it."""

import os
from contextlib import suppress
from pathlib import Path

_LISTENS_TCP, _LISTENS_UNIX = "0A", "00010000"


def children(pid: int) -> list[int]:
    """Processes that ``pid`` has started."""
    started = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that has ended meanwhile
            started += [int(child) for child in (task / "children").read_text().split()]
    return started


def descendants(pid: int) -> dict[int, str]:
    """All processes below ``pid`` with their command lines."""
    found: dict[int, str] = {}
    for child in children(pid):
        found |= {child: command(child), **descendants(child)}
    return found


def command(pid: int) -> str:
    """Command line of a process."""
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode().strip()


def held(pid: int) -> list[str]:
    """What the descriptors of a process lead to; a socket with its kind and where it is bound."""
    links = []
    kinds = _sockets(pid)
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            link = os.readlink(descriptor)
            links.append(kinds.get(link[8:-1], link) if link.startswith("socket:") else link)
    return links


def listening(pid: int) -> list[str]:
    """Sockets of a process that take connections."""
    return [link for link in held(pid) if link.startswith("listening ")]


def _sockets(pid: int) -> dict[str, str]:
    """Sockets in the process's network by inode."""
    kinds = {}
    for name in ("tcp", "tcp6"):
        for words in _table(pid, name):
            kinds[words[9]] = f"{'listening' if words[3] == _LISTENS_TCP else 'connected'} {name} {words[1]}"
    for words in _table(pid, "unix"):
        kinds[words[6]] = f"{'listening' if words[3] == _LISTENS_UNIX else 'connected'} unix {' '.join(words[7:])}"
    return kinds


def _table(pid: int, name: str) -> list[list[str]]:
    return [line.split() for line in Path(f"/proc/{pid}/net/{name}").read_text().splitlines()[1:]]
