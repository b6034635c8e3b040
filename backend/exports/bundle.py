"""Bundles: a run with its lineage in one file, verified before it is used."""

import hashlib
import json
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from backend import __version__
from backend.exports import messages
from backend.exports.base import ExportError, ImportRefusedError, Sink, export_run, get_reason, read_strict
from backend.exports.formats import PIECE, DataFormat, stream_export
from backend.models import MAX_RECORD_NUMBER, document_digest
from backend.storage import (
    BANK,
    IDENTIFICATION,
    RESULT,
    RUN,
    Database,
    Document,
    EndState,
    Run,
    Session,
    banks,
    build_record_document,
    commissioning,
    identifications,
    origins,
    recordings,
    results,
    runs,
)

# Bundle --------------------------------------------------------------------------------------------
# A run with its lineage in one file: records, the samples of all runs among them, report.
#
# A zip archive whose members are stored uncompressed, so nothing in it can expand. ``manifest.json`` has the sha256 of
# each member and of each record; the comment of the archive that of all bytes before it. A bundle is written in one
# stream.


FORMAT = 1
MANIFEST, RECORDS = "manifest.json", "records.json"
DIGEST_LENGTH = 64
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of all members: the same bundle has the same bytes whenever it is written."""


@dataclass
class Gathered:
    """Records, each after those it refers to; ``recorded`` are the runs with samples."""

    records: list[dict[str, Any]] = field(default_factory=list)
    recorded: list[int] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


def make_recording_name(run_id: int) -> str:
    """Return the name of the member with the samples of a run."""
    return f"recordings/{run_id}.parquet"


def make_report_name(run_id: int) -> str:
    """Return the name of the member with the report of a run."""
    return f"reports/{run_id}.html"


def gather(session: Session, run_id: int) -> Gathered:
    """Return the lineage and the results of a run.

    Raises UnknownRecordError, ExportError.
    """
    gathered = Gathered()
    _gather_run(session, runs.get(session, run_id), gathered)
    for found in reversed(identifications.find(session, run_id=run_id)):
        _add(session, gathered, IDENTIFICATION, found.id)
    for number in results.numbers(session, run_id):
        _add(session, gathered, RESULT, number)
    return gathered


def write_bundle(database: Database, run_id: int, report: bytes | None, folder: Path) -> Iterator[bytes]:
    """Yield the bundle of a run.

    Raises UnknownRecordError, ExportError before the first piece.
    """
    with database.reading() as session:
        gathered = gather(session, run_id)
    exports = {number: export_run(database, number) for number in gathered.recorded}
    sink, members, sha256 = Sink(), {}, hashlib.sha256()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_STORED) as archive:
        archive.comment = bytes(DIGEST_LENGTH)

        def member(name: str, content: Iterable[bytes]) -> Iterator[bytes]:
            found, size = hashlib.sha256(), 0
            with archive.open(zipfile.ZipInfo(name, _EPOCH), "w", force_zip64=True) as opened:
                for piece in content:
                    opened.write(piece)
                    found.update(piece)
                    size += len(piece)
                    yield sink.take()
            members[name] = {"sha256": found.hexdigest(), "size": size}
            yield sink.take()

        def all_members() -> Iterator[bytes]:
            content = {"run": run_id, "records": gathered.records}
            yield from member(RECORDS, [_json(content)])
            for number, export in exports.items():
                yield from member(make_recording_name(number), stream_export(export, DataFormat.PARQUET, folder))
            if report is not None:
                yield from member(make_report_name(run_id), [report])
            manifest = {
                "format": FORMAT,
                "software": __version__,
                "run": run_id,
                "missing": gathered.missing,
                "records": {get_record_name(record): document_digest(record) for record in gathered.records},
                "members": dict(members),
            }
            yield from member(MANIFEST, [_json(manifest)])

        for piece in all_members():
            sha256.update(piece)
            yield piece
    held = sink.take()[:-DIGEST_LENGTH]
    sha256.update(held)
    yield held + sha256.hexdigest().encode()


def get_record_name(record: dict[str, Any]) -> str:
    """Return the name of a record."""
    return f"{record['kind']} {record['number']}"


def _gather_run(session: Session, run: Run, gathered: Gathered) -> None:
    if run.end_state == EndState.RUNNING:
        raise ExportError(messages.run_not_ended(run_id=run.id))
    changed = origins.load_banks_during_run(session, run)
    if changed.computed:
        raise ExportError(messages.run_computes_bank(run_id=run.id, expression=changed.computed[0]))
    for number in sorted({*changed.numbers, *([] if run.bank_id is None else [run.bank_id])}):
        bank = banks.get(session, number)
        for entry in bank.entries:
            if entry.identification_id is not None:
                estimate = identifications.get(session, entry.identification_id)
                if estimate.run_id is not None:
                    _gather_run(session, runs.get(session, estimate.run_id), gathered)
                _add(session, gathered, IDENTIFICATION, estimate.id)
        _add(session, gathered, BANK, bank.id)
    if _add(session, gathered, RUN, run.id, _collect_calibrations(session, run)):
        found = recordings.of_runs(session, [run.id]).get(run.id)
        if found is not None and found[1] is not None:
            gathered.recorded.append(run.id)
        else:
            why = messages.no_recording() if found is None else found[0].problem or messages.nothing_recorded()
            gathered.missing.append(messages.samples_missing(run_id=run.id, reason=why))


def _collect_calibrations(session: Session, run: Run) -> Document:
    """Return the calibrations at the start of a run, which are no records elsewhere."""
    held = commissioning.held_at(session, run.station, run.started_at)
    known = origins.of_runs(session, [run.id])
    if run.id in known:
        return dict(known[run.id].carried)
    return {origins.CALIBRATIONS: [commissioning.describe_calibration(one) for one in held]} if held else {}


def _add(session: Session, gathered: Gathered, kind: str, number: int, extra: Document | None = None) -> bool:
    if any((record["kind"], record["number"]) == (kind, number) for record in gathered.records):
        return False
    document = build_record_document(session, kind, number)
    gathered.records.append({"kind": kind, "number": number, "document": document, "carried": extra or {}})
    return True


def _json(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, indent=1, allow_nan=False).encode() + b"\n"


# Bundle file ---------------------------------------------------------------------------------------
# A bundle as a file of unknown origin: verified before its content is used.


_NAME = re.compile(
    r"(manifest|records)\.json|(recordings/[1-9]\d{0,8}\.parquet)|(reports/[1-9]\d{0,8}\.html)", re.ASCII
)
_LARGEST_TEXT = 64_000_000
"""Most bytes of a member that is read completely: records and reports of a run have one or two million."""
_MOST_MEMBERS = 1_000


@dataclass(frozen=True)
class Bundle:
    """Opened bundle with verified hashes: manifest, records and members."""

    archive: zipfile.ZipFile
    sha256: str
    run: int
    records: list[dict[str, Any]]
    names: frozenset[str]

    def text(self, name: str) -> bytes:
        """Return a member that is read completely."""
        return self.archive.read(name)

    def unpack(self, name: str, file: Path) -> None:
        """Write a member to a file. Raises OSError."""
        with self.archive.open(name) as packed, file.open("wb") as plain:
            while piece := packed.read(PIECE):
                plain.write(piece)


@contextmanager
def open_bundle(file: Path) -> Iterator[Bundle]:
    """Open a bundle for the block if all its hashes are correct.

    Raises ImportRefusedError, OSError.
    """
    whole = _digest(file)
    try:
        with zipfile.ZipFile(file) as archive:
            names = _members(archive, file.stat().st_size)
            manifest = _manifest(archive, names)
            records = _records(archive, manifest)
            if archive.comment != whole:
                raise ImportRefusedError(messages.archive_changed())
            yield Bundle(archive, whole.decode(), int(manifest["run"]), records, frozenset(names))
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, UnicodeDecodeError) as error:
        raise ImportRefusedError(messages.not_a_bundle(reason=str(error))) from None


def _digest(file: Path) -> bytes:
    """Return the sha256 of all bytes except the comment, which should be equal."""
    found, left = hashlib.sha256(), file.stat().st_size - DIGEST_LENGTH
    with file.open("rb") as whole:
        while left > 0 and (piece := whole.read(min(PIECE, left))):
            found.update(piece)
            left -= len(piece)
    return found.hexdigest().encode()


def _members(archive: zipfile.ZipFile, size: int) -> dict[str, zipfile.ZipInfo]:
    """Return the members by name.

    Raises ImportRefusedError for anything no bundle has: paths, compression, duplicates.
    """
    found: dict[str, zipfile.ZipInfo] = {}
    for info in archive.infolist():
        name = info.filename
        if not _NAME.fullmatch(name) or name in found or len(found) >= _MOST_MEMBERS:
            raise ImportRefusedError(messages.member_not_allowed(member=name))
        if info.compress_type != zipfile.ZIP_STORED or info.compress_size != info.file_size or info.flag_bits & 1:
            raise ImportRefusedError(messages.member_compressed(member=name))
        if info.file_size > (size if name.endswith(".parquet") else min(size, _LARGEST_TEXT)):
            raise ImportRefusedError(messages.member_too_large(member=name, size=info.file_size))
        found[name] = info
    if sum(info.file_size for info in found.values()) > size:
        raise ImportRefusedError(messages.members_larger_than_file())
    for name in (MANIFEST, RECORDS):
        if name not in found:
            raise ImportRefusedError(messages.bundle_without_member(member=name))
    return found


def _manifest(archive: zipfile.ZipFile, names: Mapping[str, zipfile.ZipInfo]) -> dict[str, Any]:
    manifest = read_json(archive.read(MANIFEST), MANIFEST)
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise ImportRefusedError(messages.manifest_of_another_format(manifest=MANIFEST, version=FORMAT))
    members, run, records = manifest.get("members"), manifest.get("run"), manifest.get("records")
    if not isinstance(members, dict) or not isinstance(records, dict) or type(run) is not int:
        raise ImportRefusedError(messages.manifest_incomplete(manifest=MANIFEST))
    for name in sorted({*members, *names} - {MANIFEST}):
        if name not in names:
            raise ImportRefusedError(messages.member_missing(member=name))
        if not isinstance(members.get(name), dict):
            raise ImportRefusedError(messages.member_not_in_manifest(member=name, manifest=MANIFEST))
        if members[name].get("sha256") != _hash(archive, name):
            raise _make_hash_error(archive, name, records)
    return manifest


def _make_hash_error(archive: zipfile.ZipFile, name: str, members: Mapping[str, Any]) -> ImportRefusedError:
    """Return the error of a member with a wrong hash, naming the record that differs."""
    if name == RECORDS:
        for record in _list(read_json(archive.read(RECORDS), RECORDS)):
            if members.get(get_record_name(record)) != document_digest(record):
                return ImportRefusedError(messages.content_changed(name=get_record_name(record), manifest=MANIFEST))
    return ImportRefusedError(messages.content_changed(name=name, manifest=MANIFEST))


def _records(archive: zipfile.ZipFile, manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    document = read_json(archive.read(RECORDS), RECORDS)
    records = _list(document)
    if document.get("run") != manifest["run"]:
        raise ImportRefusedError(
            messages.records_of_another_run(run_id=manifest["run"], manifest=MANIFEST, records=RECORDS)
        )
    record_list = manifest["records"]
    for record in records:
        if record_list.get(get_record_name(record)) != document_digest(record):
            name = get_record_name(record)
            raise ImportRefusedError(messages.record_differs_from_manifest(record=name, manifest=MANIFEST))
    if len(record_list) != len(records) or len({get_record_name(record) for record in records}) != len(records):
        raise ImportRefusedError(messages.records_differ_from_manifest(manifest=MANIFEST, records=RECORDS))
    return records


def _list(document: Any) -> list[dict[str, Any]]:
    records = document.get("records") if isinstance(document, dict) else None
    whole = isinstance(records, list) and all(
        isinstance(record, dict)
        and set(record) == {"kind", "number", "document", "carried"}
        and isinstance(record["kind"], str)
        and type(record["number"]) is int
        and 0 < record["number"] <= MAX_RECORD_NUMBER
        and isinstance(record["carried"], dict)
        for record in records
    )
    if not isinstance(records, list) or not whole:
        raise ImportRefusedError(messages.invalid_records(records=RECORDS, maximum=MAX_RECORD_NUMBER))
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
    """Parse a document that every database can hold. Raises ImportRefusedError."""
    try:
        return read_strict(text)
    except ValueError as error:
        raise ImportRefusedError(messages.member_unreadable(member=name, reason=get_reason(error))) from None
