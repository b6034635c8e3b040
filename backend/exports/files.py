"""Files by their content."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

PIECE = 1 << 20


def file_digest(file: Path) -> str:
    """Return the sha256 of a file, in hex. Raises OSError."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def write_whole(pieces: Iterable[bytes], file: Path) -> None:
    """Write a file whole, or not at all. Raises OSError, and what the pieces raise."""
    part = file.with_name(f"{file.name}.part")
    try:
        with part.open("wb") as opened:
            for piece in pieces:
                opened.write(piece)
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)
