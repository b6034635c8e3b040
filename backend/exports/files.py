"""Files that are written whole or not at all, and files by their content."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from io import BufferedWriter
from pathlib import Path

PIECE = 1 << 20
_MODE = 0o666


def file_digest(file: Path) -> str:
    """Return the sha256 of a file, in hex. Raises OSError."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def write_whole(pieces: Iterable[bytes], file: Path) -> None:
    """Write a file whole, or not at all. Raises like ``write_all``."""
    write_all({file: pieces})


def write_all(contents: Mapping[Path, Iterable[bytes]]) -> None:
    """Write files, each whole, and none of them where one cannot be written.

    A file that is there keeps its mode; a link keeps pointing at its file. Where the file system allows it, content
    has no name before it is complete, so that a process that is killed leaves nothing behind.

    Raises OSError, which names the file, and what the pieces raise.
    """
    with ExitStack() as stack:
        written = []
        for file, pieces in contents.items():
            with _naming(file):
                written.append(_Written(file.resolve(), stack))
            for piece in pieces:
                with _naming(file):
                    written[-1].opened.write(piece)
            with _naming(file):
                written[-1].complete()
        for one in written:
            with _naming(one.target):
                one.put_in_place()


class _Written:
    """The new content of one file, under a name of its own or none."""

    def __init__(self, target: Path, stack: ExitStack) -> None:
        self.target = target
        self._part = target.with_name(f"{target.name}.part")
        self._has_name = False
        self.opened: BufferedWriter = os.fdopen(self._open(), "wb")
        stack.callback(self._close)
        with suppress(FileNotFoundError):
            os.fchmod(self.opened.fileno(), target.stat().st_mode & 0o777)

    def _open(self) -> int:
        if (unnamed := getattr(os, "O_TMPFILE", 0)) and Path("/proc/self/fd").is_dir():
            with suppress(OSError):  # the file system knows no files without a name, or the folder is none
                return os.open(self.target.parent, unnamed | os.O_WRONLY, _MODE)
        descriptor = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, _MODE)
        self._has_name = True
        return descriptor

    def complete(self) -> None:
        """Have the content on the disk."""
        self.opened.flush()
        os.fsync(self.opened.fileno())

    def put_in_place(self) -> None:
        """Give the content the name of its file."""
        if not self._has_name:
            self._part.unlink(missing_ok=True)
            descriptor = self.opened.fileno()
            # Only with a descriptor of a folder, which an absolute path leaves unused, does Python call linkat.
            os.link(f"/proc/self/fd/{descriptor}", self._part, src_dir_fd=descriptor, follow_symlinks=True)
            self._has_name = True
        os.replace(self._part, self.target)
        self._has_name = False

    def _close(self) -> None:
        with suppress(OSError):  # of a full disk, which was raised before
            self.opened.close()
        if self._has_name:
            self._part.unlink(missing_ok=True)


@contextmanager
def _naming(file: Path) -> Iterator[None]:
    """Raise errors of the operating system with the file that they are about."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(file)) from error
