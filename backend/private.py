"""Keeps what the service writes to its owner: no other account of the machine reads tokens, sessions or recordings."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

FOLDER, FILE = 0o700, 0o600
UMASK = 0o077
"""For the whole process from its start on: what SQLite and others create is born private."""

_OURS = ("sinew*.db*", "token", "viewer-token", "signing-key", "*.new", "sessions.json", "service.lock", "backups/*")


def make_private(data: Path) -> list[str]:
    """Create the data folder, and take from others what they may do there, old files of ours included.

    Returns a sentence for each place that could not be changed; a folder that everyone shares is left as it is.
    """
    data.mkdir(mode=FOLDER, parents=True, exist_ok=True)
    return [sentence for path, mode in _places(data) if (sentence := _tighten(path, mode))]


def write_private(path: Path, text: str) -> None:
    """Put a file in the place of ``path``, whole or not at all, readable by its owner only. Raises OSError."""
    fresh = path.with_name(f"{path.name}.new")
    descriptor = os.open(fresh, os.O_CREAT | os.O_TRUNC | os.O_WRONLY | os.O_NOFOLLOW, FILE)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        os.fchmod(file.fileno(), FILE)
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(fresh, path)


def _places(data: Path) -> Iterator[tuple[Path, int]]:
    if not data.stat().st_mode & stat.S_ISVTX:  # such as /tmp
        yield data, FOLDER
    if (data / "backups").is_dir():
        yield data / "backups", FOLDER
    for pattern in _OURS:
        for path in data.glob(pattern):
            if path.is_file() and not path.is_symlink():
                yield path, FILE


def _tighten(path: Path, mode: int) -> str | None:
    if stat.S_IMODE(path.stat().st_mode) & ~mode == 0:
        return None
    try:
        path.chmod(mode)
    except PermissionError:
        return f"{path} can be used by other accounts and belongs to another one: change its mode to {mode:o}"
    return None
