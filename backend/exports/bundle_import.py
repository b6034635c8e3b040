"""A bundle taken in: everything looked through first, then stored with new numbers in one transaction."""

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from backend.documents.edge import UnreadableDocumentError
from backend.documents.run_banks import on_the_way, with_banks
from backend.exports.bundle import recording_of, report_of
from backend.exports.bundle_file import Bundle, opened
from backend.exports.errors import ImportRefusedError
from backend.exports.facts import Facts
from backend.exports.taking_in import LookOver, TakenIn, accept, checked, number_of, run_of, same_run, store_run
from backend.storage import Database, Session, identifications, origins, results
from backend.storage.carried import (
    BANK,
    ENTRIES,
    IDENTIFICATION,
    REFERENCES,
    RESULT,
    RUN,
    connect,
    find_same,
    import_alone,
    put,
    required,
)
from backend.storage.fit import UnfitDocumentError, require_carried
from backend.storage.maintenance import IMPORTING
from backend.storage.origins import Origin
from backend.storage.schema import Document

Numbers = dict[tuple[str, int], int]
"""By kind and number there, the number here."""


def take_in(
    database: Database, file: Path, who: str, folder: Path, name: str = "", look_over: LookOver = accept
) -> TakenIn:
    """Store the run of a bundle with all that it came from, of which nothing that is here already is stored again.

    ``folder`` has room for it unpacked, ``name`` is what the file is called where its own is another.
    ``backend.archive.imports`` looks over what each run was set to.

    Raises ImportRefusedError, OSError.
    """
    with opened(file) as bundle, TemporaryDirectory(prefix=IMPORTING, dir=folder) as unpacked:
        recorded = _recordings(bundle, Path(unpacked))
        numbers: Numbers = {}
        new = False
        origin = Origin("", 0, 0, name or file.name, bundle.sha256, who)
        with database.session() as session:
            import_alone(session)
            for record in bundle.records:
                new |= _take_in(session, record, numbers, recorded, origin, look_over)
            if (RUN, bundle.run) not in numbers:
                raise ImportRefusedError(f"run {bundle.run}, which it is of, is not among its records")
            run_id = numbers[RUN, bundle.run]
            if new and report_of(bundle.run) in bundle.names and results.newest_report(session, run_id, "html") is None:
                results.add_report(session, run_id, "html", bundle.text(report_of(bundle.run)))
    return TakenIn(run_id, bundle.run, new=new)


def _recordings(bundle: Bundle, folder: Path) -> dict[int, tuple[Facts, Path]]:
    """Unpack and read all recordings. Raises ImportRefusedError for one that is not that of its run."""
    found = {}
    for record in bundle.records:
        member = recording_of(record["number"])
        if record["kind"] == RUN and member in bundle.names:
            file = folder / f"{record['number']}.parquet"
            bundle.unpack(member, file)
            try:
                facts = checked(file)
                if number_of(facts) != record["number"] or run_of(facts) != record["document"]:
                    raise ImportRefusedError("it is of another run")
            except ImportRefusedError as error:
                raise ImportRefusedError(f"{member}: {error}") from None
            found[record["number"]] = facts, file
    known = {recording_of(number) for number in found} | {report_of(bundle.run)}
    for name in sorted(bundle.names):
        if "/" in name and name not in known:
            raise ImportRefusedError(f"{name} belongs to no run of the bundle")
    return found


def _take_in(
    session: Session,
    record: Mapping[str, Any],
    numbers: Numbers,
    recorded: Mapping[int, tuple[Facts, Path]],
    origin: Origin,
    look_over: LookOver,
) -> bool:
    """Store one record unless it is here; return whether something was. Raises ImportRefusedError with its name."""
    kind, was = record["kind"], record["number"]
    try:
        document, unconnected = required(kind, record["document"]), origins.BANKS in record["carried"]
        require_carried(record["carried"], of_run=kind == RUN)
        document = _renumbered(document, numbers, unconnected=unconnected)
        facts, file = recorded.get(was, (None, None)) if kind == RUN else (None, None)
        here = same_run(session, document, facts) if kind == RUN else find_same(session, kind, document)
        new = here is None or (kind == RUN and not unconnected and connect(session, here, document))
        if here is None:
            here = _store(session, kind, document, file, look_over)
            told = Origin(kind, here, was, origin.file, origin.sha256, origin.who, record["carried"])
            origins.add(session, told)
    except (UnfitDocumentError, UnreadableDocumentError, ImportRefusedError) as error:
        raise ImportRefusedError(f"{kind} {was}: {error}") from None
    numbers[kind, was] = here
    return new


def _store(session: Session, kind: str, document: Document, file: Path | None, look_over: LookOver) -> int:
    """Store a document, and see that what it says can be read. Raises ImportRefusedError, UnreadableDocumentError."""
    if kind == RUN:
        return store_run(session, document, file, look_over)
    number = put(session, kind, document)
    if kind == RESULT:
        results.newest(session, document["run_id"])
    elif kind == IDENTIFICATION:
        identifications.get(session, number).readable()
    return number


def _renumbered(document: Document, numbers: Numbers, *, unconnected: bool) -> Document:
    """Return a document that names other records by their numbers here; ``unconnected`` is a run without its banks.

    Raises ImportRefusedError.
    """

    def here(part: Mapping[str, Any]) -> dict[str, Any]:
        return {
            name: value if name not in REFERENCES or value is None else _number(REFERENCES[name], value, numbers)
            for name, value in part.items()
        }

    renumbered = here(document)
    if ENTRIES in renumbered:
        renumbered[ENTRIES] = [here(entry) for entry in renumbered[ENTRIES]]
    if "settings" in document and not unconnected:
        if computed := on_the_way(document["settings"]).computed:
            raise ImportRefusedError(f"it computes the number of a bank, {computed[0][:80]}: take its samples in alone")
        renumbered["settings"] = with_banks(document["settings"], lambda was: _number(BANK, was, numbers))
    return renumbered


def _number(kind: str, was: Any, numbers: Numbers) -> int:
    if (kind, was) not in numbers:
        raise ImportRefusedError(f"it names {kind} {was}, which is not before it in the bundle")
    return numbers[kind, was]
