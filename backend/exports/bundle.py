"""A run with all that it came from in one file: its records, the samples of every run among them, its report.

A zip whose members are stored as they are, so that nothing in it can swell. ``manifest.json`` has the sha256 of each
member and of each record; the comment of the archive that of all bytes before it. A bundle is written in one stream.
"""

import hashlib
import json
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from backend import __version__
from backend.documents.digest import digest_of
from backend.exports.errors import ExportError
from backend.exports.formats import DataFormat, pieces
from backend.exports.sink import Sink
from backend.exports.source import of_run
from backend.storage import Database, Session, banks, bring_up, identifications, origins, recordings, results, runs
from backend.storage.carried import BANK, IDENTIFICATION, RESULT, RUN, document_of
from backend.storage.runs import EndState, Run
from backend.storage.schema import Document

FORMAT = 1
MANIFEST, RECORDS = "manifest.json", "records.json"
DIGEST_LENGTH = 64
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of all members: the same bundle is the same bytes whenever it is written."""


@dataclass
class Gathered:
    """Records, each after those that it names; ``recorded`` are the runs whose samples are there."""

    records: list[dict[str, Any]] = field(default_factory=list)
    recorded: list[int] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


def recording_of(run_id: int) -> str:
    """Return the name of the member with the samples of a run."""
    return f"recordings/{run_id}.parquet"


def report_of(run_id: int) -> str:
    """Return the name of the member with the report of a run."""
    return f"reports/{run_id}.html"


def gather(session: Session, run_id: int) -> Gathered:
    """Return all that a run came from, and what was computed of it. Raises UnknownRecordError, ExportError."""
    gathered = Gathered()
    _gather_run(session, runs.get(session, run_id), gathered)
    for found in reversed(identifications.find(session, run_id=run_id)):
        _add(session, gathered, IDENTIFICATION, found.id)
    for number in results.numbers(session, run_id):
        _add(session, gathered, RESULT, number)
    return gathered


def write(database: Database, run_id: int, report: bytes | None, folder: Path) -> Iterator[bytes]:
    """Yield the bundle of a run. Raises UnknownRecordError, ExportError before the first piece."""
    with database.reading() as session:
        gathered = gather(session, run_id)
    exports = {number: of_run(database, number) for number in gathered.recorded}
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
                    yield sink.taken()
            members[name] = {"sha256": found.hexdigest(), "size": size}
            yield sink.taken()

        def all_members() -> Iterator[bytes]:
            said = {"run": run_id, "records": gathered.records}
            yield from member(RECORDS, [_json(said)])
            for number, export in exports.items():
                yield from member(recording_of(number), pieces(export, DataFormat.PARQUET, folder))
            if report is not None:
                yield from member(report_of(run_id), [report])
            manifest = {
                "format": FORMAT,
                "software": __version__,
                "run": run_id,
                "missing": gathered.missing,
                "records": {called(record): digest_of(record) for record in gathered.records},
                "members": dict(members),
            }
            yield from member(MANIFEST, [_json(manifest)])

        for piece in all_members():
            sha256.update(piece)
            yield piece
    held = sink.taken()[:-DIGEST_LENGTH]
    sha256.update(held)
    yield held + sha256.hexdigest().encode()


def called(record: dict[str, Any]) -> str:
    """Return what a record is called."""
    return f"{record['kind']} {record['number']}"


def _gather_run(session: Session, run: Run, gathered: Gathered) -> None:
    if run.end_state == EndState.RUNNING:
        raise ExportError(f"run {run.id} is not over: bundle it when it is")
    way = origins.banks_on_the_way(session, run)
    if way.computed:
        raise ExportError(
            f"run {run.id} computes the number of a bank that it changes to, {way.computed[0][:80]}, which elsewhere "
            "would be that of another one: export its samples"
        )
    for number in sorted({*way.numbers, *([] if run.bank_id is None else [run.bank_id])}):
        bank = banks.get(session, number)
        for entry in bank.entries:
            if entry.identification_id is not None:
                estimate = identifications.get(session, entry.identification_id)
                if estimate.run_id is not None:
                    _gather_run(session, runs.get(session, estimate.run_id), gathered)
                _add(session, gathered, IDENTIFICATION, estimate.id)
        _add(session, gathered, BANK, bank.id)
    if _add(session, gathered, RUN, run.id, _carried(session, run)):
        found = recordings.of_runs(session, [run.id]).get(run.id)
        if found is not None and found[1] is not None:
            gathered.recorded.append(run.id)
        else:
            why = "there was no recording" if found is None else found[0].problem or "nothing was recorded"
            gathered.missing.append(f"samples of run {run.id}: {why}")


def _carried(session: Session, run: Run) -> Document:
    """Return what goes with a run that is no record of the other installation: what was calibrated when it began."""
    held = bring_up.held_at(session, run.station, run.started_at)
    known = origins.of_runs(session, [run.id])
    if run.id in known:
        return dict(known[run.id].carried)
    return {origins.CALIBRATIONS: [bring_up.told(one) for one in held]} if held else {}


def _add(session: Session, gathered: Gathered, kind: str, number: int, carried: Document | None = None) -> bool:
    if any((record["kind"], record["number"]) == (kind, number) for record in gathered.records):
        return False
    document = document_of(session, kind, number)
    gathered.records.append({"kind": kind, "number": number, "document": document, "carried": carried or {}})
    return True


def _json(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, indent=1, allow_nan=False).encode() + b"\n"
