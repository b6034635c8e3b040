"""Samples as a MATLAB 5 file: one column vector per signal.

Units, symbols and meanings are structs, the metadata a text. The format stores each vector contiguously, a recording
all signals together: a temporary file transposes them. Nothing is compressed, because the format requires the length of
compressed data before it. A vector has at most 2 GiB, which 74 hours fill.
"""

import io
import os
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from backend.exports import messages
from backend.exports.base import Batch, Export, ExportError, Facts, ImportRefusedError, read_facts

LARGEST = 2**31 - 1
"""Most bytes of a vector in a file of version 5."""
FACTS = "sinew_export"

_HEADER = struct.Struct("<116s8xHH")
_TAG = struct.Struct("<II")
_MATRIX, _INT8, _INT32, _UINT32, _SINGLE, _DOUBLE = 14, 1, 5, 6, 7, 9
_COMPRESSED, _UTF8 = 15, 16
_CLASS = {_SINGLE: 7, _DOUBLE: 6}
_CHARACTERS = 4
"""Class of a text, in addition to those of vectors."""
_PIECE = 1 << 20
_BATCH = 50_000


def write(export: Export, folder: Path) -> Iterator[bytes]:
    """Return the pieces of the file.

    ``folder`` has space for the samples, 140 bytes each, until it is written. Raises ExportError at once for a
    recording that is too long.
    """
    rows = export.facts.samples
    if 8 * rows + 128 > LARGEST:
        most = (LARGEST - 128) // 8
        raise ExportError(messages.too_many_samples_for_matlab(content=export.facts.of, samples=rows, maximum=most))
    return _pieces(export, folder)


def _pieces(export: Export, folder: Path) -> Iterator[bytes]:
    facts = export.facts
    text = messages.matlab_header(content=facts.of, software=facts.software)
    yield _HEADER.pack(text.encode("ascii", "replace")[:116].ljust(116), 0x100, 0x4D49)
    yield _small(facts)
    with tempfile.TemporaryFile(dir=folder) as turned:
        file, done = turned.fileno(), 0
        for batch in export.batches():
            for place, name in enumerate(facts.names):
                values = np.ascontiguousarray(batch[name], _kind(name))
                os.pwrite(file, values.tobytes(), _start(place, facts.samples) + values.itemsize * done)
            done += batch["t"].size
        for place, name in enumerate(facts.names):
            yield _vector_head(name, facts.samples)
            start, size = _start(place, facts.samples), np.dtype(_kind(name)).itemsize * facts.samples
            for begin in range(0, size, _PIECE):
                yield os.pread(file, min(_PIECE, size - begin), start + begin)
            yield bytes(-size % 8)


def _kind(name: str) -> str:
    return "<f8" if name == "t" else "<f4"


def _start(place: int, rows: int) -> int:
    """Return the offset of a column in the transposed file.

    The first column has twice the bytes of the others.
    """
    return 4 * rows * (place + (place > 0))


def _vector_head(name: str, rows: int) -> bytes:
    kind = _DOUBLE if name == "t" else _SINGLE
    size = (8 if name == "t" else 4) * rows
    described = _element(_UINT32, struct.pack("<II", _CLASS[kind], 0)) + _element(_INT32, struct.pack("<ii", rows, 1))
    inside = described + _element(_INT8, name.encode("ascii")) + _TAG.pack(kind, size)
    return _TAG.pack(_MATRIX, len(inside) + size + -size % 8) + inside


def _element(kind: int, content: bytes) -> bytes:
    return _TAG.pack(kind, len(content)) + content + bytes(-len(content) % 8)


def _small(facts: Facts) -> bytes:
    """Return the texts as scipy writes them, without its header."""
    from scipy.io import savemat

    content: dict[str, Any] = {  # scipy writes a Message, which has attributes, as a struct
        FACTS: facts.to_json(),
        "notation": str(facts.notation),
        "units": {column.name: column.unit for column in facts.columns},
        "symbols": {column.name: column.symbol for column in facts.columns},
        "meanings": {column.name: str(column.meaning) for column in facts.columns},
    }
    buffer = io.BytesIO()
    savemat(buffer, content)  # type: ignore[arg-type]  # the stubs forget that files may be open
    return buffer.getvalue()[_HEADER.size :]


def read_matlab(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return metadata and samples of a file of ``write``.

    Raises ImportRefusedError, or errors of a library.
    """
    found = _vectors(file)
    if FACTS not in found:
        raise ImportRefusedError(messages.matlab_without_metadata(name=FACTS))
    facts = read_facts(_text(file, found.pop(FACTS)[0]))
    missing = [name for name in facts.names if found.get(name, (0, 0))[1] != facts.samples]
    if missing:
        raise ImportRefusedError(messages.column_incomplete(column=missing[0], samples=facts.samples))

    def batches() -> Iterator[Batch]:
        with file.open("rb") as opened:
            for begin in range(0, facts.samples, _BATCH):
                count = min(_BATCH, facts.samples - begin)
                batch = {}
                for name in facts.names:
                    kind = np.dtype(_kind(name))
                    opened.seek(found[name][0] + kind.itemsize * begin)
                    batch[name] = np.frombuffer(opened.read(kind.itemsize * count), kind)
                yield batch

    return facts, batches()


def _vectors(file: Path) -> dict[str, tuple[int, int]]:
    """Return offset and number of rows of each vector and text of a file.

    Structs are skipped; compressed data are rejected, as their unpacked size is unknown.
    """
    found: dict[str, tuple[int, int]] = {}
    size = file.stat().st_size
    with file.open("rb") as opened:
        place = _HEADER.size
        while place + _TAG.size <= size:
            opened.seek(place)
            head = opened.read(256)
            kind, length = _TAG.unpack_from(head)
            if place + _TAG.size + length > size:
                raise ImportRefusedError(messages.file_truncated())
            if kind == _COMPRESSED:
                raise ImportRefusedError(messages.file_compressed())
            if kind == _MATRIX and len(head) >= 64 and head[16] in (_CHARACTERS, *_CLASS.values()):
                rows, columns = struct.unpack_from("<ii", head, 32)
                named, letters = _TAG.unpack_from(head, 40)
                numbers = 48 + letters + -letters % 8
                if named == _INT8 and (columns == 1 or head[16] == _CHARACTERS) and numbers + 8 <= len(head):
                    found[head[48 : 48 + letters].decode("ascii", "replace")] = (place + numbers + 8, rows)
            place += _TAG.size + length
    return found


def _text(file: Path, place: int) -> bytes:
    """Return the text at an offset, limited to the size of the file."""
    with file.open("rb") as opened:
        opened.seek(place - _TAG.size)
        kind, length = _TAG.unpack(opened.read(_TAG.size))
        if kind != _UTF8:
            raise ImportRefusedError(messages.metadata_not_utf8(name=FACTS))
        return opened.read(length)
