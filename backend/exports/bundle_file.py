"""A bundle as a file: looked at from outside before anything in it is believed."""

import hashlib
import re
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backend.documents.digest import digest_of
from backend.documents.run_banks import LARGEST
from backend.exports.bundle import DIGEST_LENGTH, FORMAT, MANIFEST, RECORDS, called
from backend.exports.errors import ImportRefusedError
from backend.exports.files import PIECE
from backend.exports.strict_json import read_strict

_NAME = re.compile(
    r"(manifest|records)\.json|(recordings/[1-9]\d{0,8}\.parquet)|(reports/[1-9]\d{0,8}\.html)", re.ASCII
)
_LARGEST_TEXT = 64_000_000
"""Bytes of a member that is read whole: records and reports of a run have one or two million."""
_MOST_MEMBERS = 1_000
_CHANGED = f"was changed: its sha256 is another one than {MANIFEST} tells"


@dataclass(frozen=True)
class Bundle:
    """An opened bundle whose hashes hold: its manifest, its records, and its members."""

    archive: zipfile.ZipFile
    sha256: str
    run: int
    records: list[dict[str, Any]]
    names: frozenset[str]

    def text(self, name: str) -> bytes:
        """Return a member that is read whole."""
        return self.archive.read(name)

    def unpack(self, name: str, file: Path) -> None:
        """Write a member to a file. Raises OSError."""
        with self.archive.open(name) as packed, file.open("wb") as plain:
            while piece := packed.read(PIECE):
                plain.write(piece)


@contextmanager
def opened(file: Path) -> Iterator[Bundle]:
    """Open a bundle for the block, when all its hashes hold. Raises ImportRefusedError, OSError."""
    whole = _digest(file)
    try:
        with zipfile.ZipFile(file) as archive:
            names = _members(archive, file.stat().st_size)
            manifest = _manifest(archive, names)
            records = _records(archive, manifest)
            if archive.comment != whole:
                raise ImportRefusedError("the archive around its members was changed, or its end is missing")
            yield Bundle(archive, whole.decode(), int(manifest["run"]), records, frozenset(names))
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, UnicodeDecodeError) as error:
        raise ImportRefusedError(f"it is no bundle, or was cut off or changed: {error}") from None


def _digest(file: Path) -> bytes:
    """Return the sha256 of all but the comment, which should be the same."""
    found, left = hashlib.sha256(), file.stat().st_size - DIGEST_LENGTH
    with file.open("rb") as whole:
        while left > 0 and (piece := whole.read(min(PIECE, left))):
            found.update(piece)
            left -= len(piece)
    return found.hexdigest().encode()


def _members(archive: zipfile.ZipFile, size: int) -> dict[str, zipfile.ZipInfo]:
    """Return the members by name. Raises ImportRefusedError for what no bundle has: paths, compression, duplicates."""
    found: dict[str, zipfile.ZipInfo] = {}
    for info in archive.infolist():
        name = info.filename
        if not _NAME.fullmatch(name) or name in found or len(found) >= _MOST_MEMBERS:
            raise ImportRefusedError(f"a bundle has no member {name[:80]!r}, or not twice")
        if info.compress_type != zipfile.ZIP_STORED or info.compress_size != info.file_size or info.flag_bits & 1:
            raise ImportRefusedError(f"{name} is compressed or encrypted: members of a bundle are stored as they are")
        if info.file_size > (size if name.endswith(".parquet") else min(size, _LARGEST_TEXT)):
            raise ImportRefusedError(f"{name} says that it has {info.file_size} bytes: that is too much")
        found[name] = info
    if sum(info.file_size for info in found.values()) > size:
        raise ImportRefusedError("its members say that they are larger than the file")
    for name in (MANIFEST, RECORDS):
        if name not in found:
            raise ImportRefusedError(f"it has no {name}: it is no bundle of a run")
    return found


def _manifest(archive: zipfile.ZipFile, names: Mapping[str, zipfile.ZipInfo]) -> dict[str, Any]:
    manifest = read_json(archive.read(MANIFEST), MANIFEST)
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise ImportRefusedError(f"{MANIFEST} is not of format {FORMAT}: take the Sinew that wrote it")
    told, run, records = manifest.get("members"), manifest.get("run"), manifest.get("records")
    if not isinstance(told, dict) or not isinstance(records, dict) or type(run) is not int:
        raise ImportRefusedError(f"{MANIFEST} names no run, no records or no members")
    for name in sorted({*told, *names} - {MANIFEST}):
        if name not in names:
            raise ImportRefusedError(f"{name[:80]} is missing")
        if not isinstance(told.get(name), dict):
            raise ImportRefusedError(f"{name} is in the file, and {MANIFEST} does not name it")
        if told[name].get("sha256") != _hash(archive, name):
            raise _changed(archive, name, records)
    return manifest


def _changed(archive: zipfile.ZipFile, name: str, told: Mapping[str, Any]) -> ImportRefusedError:
    """Return the refusal of a member whose hash is another one; of records with the name of the one that differs."""
    if name == RECORDS:
        for record in _list(read_json(archive.read(RECORDS), RECORDS)):
            if told.get(called(record)) != digest_of(record):
                return ImportRefusedError(f"{called(record)} {_CHANGED}")
    return ImportRefusedError(f"{name} {_CHANGED}")


def _records(archive: zipfile.ZipFile, manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    document = read_json(archive.read(RECORDS), RECORDS)
    records = _list(document)
    if document.get("run") != manifest["run"]:
        raise ImportRefusedError(f"{MANIFEST} says that it is of run {manifest['run']}, {RECORDS} of another one")
    told = manifest["records"]
    for record in records:
        if told.get(called(record)) != digest_of(record):
            raise ImportRefusedError(f"{called(record)} is another one than {MANIFEST} tells")
    if len(told) != len(records) or len({called(record) for record in records}) != len(records):
        raise ImportRefusedError(f"{MANIFEST} and {RECORDS} do not tell of the same records")
    return records


def _list(document: Any) -> list[dict[str, Any]]:
    records = document.get("records") if isinstance(document, dict) else None
    whole = isinstance(records, list) and all(
        isinstance(record, dict)
        and set(record) == {"kind", "number", "document", "carried"}
        and isinstance(record["kind"], str)
        and type(record["number"]) is int
        and 0 < record["number"] <= LARGEST
        and isinstance(record["carried"], dict)
        for record in records
    )
    if not isinstance(records, list) or not whole:
        raise ImportRefusedError(f"{RECORDS} is no list of records, each of a kind with a number from 1 to {LARGEST}")
    return records


def _hash(archive: zipfile.ZipFile, name: str) -> str:
    found = hashlib.sha256()
    try:
        with archive.open(name) as packed:
            while piece := packed.read(PIECE):
                found.update(piece)
    except zipfile.BadZipFile:
        return "damaged"
    return found.hexdigest()


def read_json(text: bytes, name: str) -> Any:
    """Read a document that every database can hold. Raises ImportRefusedError."""
    try:
        return read_strict(text)
    except ValueError as error:
        raise ImportRefusedError(f"{name} cannot be read: {error}") from None
