"""Formats of exports by name, and atomic writing of files."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from enum import StrEnum
from io import BufferedWriter
from pathlib import Path

from backend.exports import matlab, mcap, messages, writers
from backend.exports.base import Batch, Export, Facts, ImportRefusedError

# Files ---------------------------------------------------------------------------------------------
# Files that are written completely or not at all, and digests of files.


PIECE = 1 << 20
_MODE = 0o666


def file_digest(file: Path) -> str:
    """Return the sha256 of a file, in hex. Raises OSError."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def write_file_whole(pieces: Iterable[bytes], file: Path) -> None:
    """Write a file completely or not at all. Raises like ``write_files_whole``."""
    write_files_whole({file: pieces})


def write_files_whole(contents: Mapping[Path, Iterable[bytes]]) -> None:
    """Write files completely, or none of them if one fails.

    An existing file keeps its mode; a link stays a link. If the file system allows it, content has no name until it is
    complete, so a killed process leaves nothing behind. Raises OSError, which names the file, and errors of the pieces.
    """
    with ExitStack() as stack:
        written = []
        for file, pieces in contents.items():
            with _name_file_in_errors(file):
                written.append(_Written(file.resolve(), stack))
            for piece in pieces:
                with _name_file_in_errors(file):
                    written[-1].opened.write(piece)
            with _name_file_in_errors(file):
                written[-1].complete()
        for one in written:
            with _name_file_in_errors(one.target):
                one.rename_to_target()


class _Written:
    """New content of one file, under a temporary name or none."""

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
            with suppress(OSError):  # the file system has no unnamed files, or the folder is none
                return os.open(self.target.parent, unnamed | os.O_WRONLY, _MODE)
        descriptor = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, _MODE)
        self._has_name = True
        return descriptor

    def complete(self) -> None:
        """Flush the content to the disk."""
        self.opened.flush()
        os.fsync(self.opened.fileno())

    def rename_to_target(self) -> None:
        """Give the content the name of its file."""
        if not self._has_name:
            self._part.unlink(missing_ok=True)
            descriptor = self.opened.fileno()
            # Python calls linkat only with a descriptor of a folder, which an absolute path leaves unused.
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
def _name_file_in_errors(file: Path) -> Iterator[None]:
    """Raise errors of the operating system with the name of the file."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(file)) from error


# Formats -------------------------------------------------------------------------------------------
# Formats of an export by name, with their writers and readers.


class DataFormat(StrEnum):
    """Formats of samples for download."""

    CSV = "csv"
    PARQUET = "parquet"
    MAT = "mat"
    MCAP = "mcap"


MEDIA_TYPES = {
    DataFormat.CSV: "text/csv; charset=utf-8",
    DataFormat.PARQUET: "application/vnd.apache.parquet",
    DataFormat.MAT: "application/x-matlab-data",
    DataFormat.MCAP: "application/octet-stream",
}

_READ = {
    DataFormat.CSV: writers.read_csv,
    DataFormat.PARQUET: writers.read_parquet,
    DataFormat.MAT: matlab.read_matlab,
    DataFormat.MCAP: mcap.read_mcap,
}


def stream_export(export: Export, kind: DataFormat, folder: Path) -> Iterator[bytes]:
    """Return the file in pieces. Raises ExportError.

    ``folder`` has space for temporary files of the format.
    """
    match kind:
        case DataFormat.CSV:
            return writers.write_csv(export)
        case DataFormat.PARQUET:
            return writers.write_parquet(export)
        case DataFormat.MAT:
            return matlab.write(export, folder)
        case DataFormat.MCAP:
            return mcap.write(export)


def write_export(export: Export, kind: DataFormat, file: Path) -> None:
    """Write the whole file or nothing. Raises ExportError, OSError."""
    write_file_whole(stream_export(export, kind, file.parent), file)


def read_export(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return metadata and samples of an export; its suffix selects the format.

    Raises ImportRefusedError, also while the samples are read, OSError.
    """
    kind = file.suffix.removeprefix(".").lower()
    if kind not in set(DataFormat):
        raise ImportRefusedError(messages.file_type_not_supported(supported=tuple(DataFormat)))
    file.stat()  # a missing file raises OSError
    with _translate_errors():
        facts, batches = _READ[DataFormat(kind)](file)
    return facts, _each(batches)


def _each(batches: Iterator[Batch]) -> Iterator[Batch]:
    with _translate_errors():
        yield from batches


@contextmanager
def _translate_errors() -> Iterator[None]:
    """Raise ImportRefusedError for any error of a library that reads an unknown file."""
    try:
        yield
    except (ImportRefusedError, GeneratorExit):
        raise
    except Exception as error:
        first = (str(error).splitlines() or [type(error).__name__])[0]
        raise ImportRefusedError(messages.file_damaged(reason=first)) from error
