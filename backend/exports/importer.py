"""Import of bundles and exported runs: checked completely, then stored.

Each in one transaction.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from backend.exports import messages
from backend.exports.base import Batch, Facts, ImportRefusedError, get_reason, make_table, require_texts, unbroken
from backend.exports.bundle import Bundle, make_recording_name, make_report_name, open_bundle
from backend.exports.formats import file_digest, read_export
from backend.models import UnreadableDocumentError, find_bank_changes, remove_initial_bank, renumber_banks
from backend.recording import CHUNK_TICKS, SamplesDigest, compute_recording_digest, pack_table, summarize_buckets
from backend.storage import (
    BANK,
    ENTRIES,
    IDENTIFICATION,
    IMPORTING,
    REFERENCES,
    RESULT,
    RUN,
    Chunk,
    Database,
    Document,
    Origin,
    Run,
    Session,
    UnfitDocumentError,
    connect_imported_bank,
    exclude_other_imports,
    find_same_record,
    identifications,
    import_document,
    origins,
    parse_required_record,
    recordings,
    require_identification_document,
    results,
    runs,
)

# Run import ----------------------------------------------------------------------------------------
# Own exports imported as runs: checked completely, then stored in one transaction or not at all.


RunCheck = Callable[[Run], None]
"""Raises ImportRefusedError for a run that is not accepted, before its samples are stored."""


def accept(_run: Run) -> None:
    """Accept each run."""


@dataclass(frozen=True)
class ImportResult:
    """Number ``run`` of an imported run here, and its number ``was`` at its origin.

    ``new``: it was not here before.
    """

    run: int
    was: int
    new: bool


def import_export(
    database: Database, file: Path, who: str, name: str = "", check_run: RunCheck = accept
) -> ImportResult:
    """Store an exported run with samples, parameters and settings, without its banks.

    Banks are not in the file: the run's origin stores their numbers. ``name`` is the name of the file if its own
    differs. ``backend.services.downloads`` checks the settings of the run. Raises ImportRefusedError, OSError.
    """
    facts = check_export(file)
    document, was = get_run(facts), get_run_number(facts)
    named = find_bank_changes(document["settings"]).numbers | ({document["bank_id"]} - {None})
    extra = {origins.BANKS: sorted(named)} if named else {}
    with database.session() as session:
        exclude_other_imports(session)
        if (here := same_run(session, document, facts)) is not None:
            return ImportResult(here, was, new=False)
        alone = {**document, "bank_id": None, "settings": remove_initial_bank(document["settings"])}
        run_id = store_run(session, alone if named else document, file, check_run)
        origins.add(
            session,
            Origin(
                kind=RUN,
                number=run_id,
                was=was,
                file=name or file.name,
                sha256=file_digest(file),
                who=who,
                carried=extra,
            ),
        )
    return ImportResult(run_id, was, new=True)


def check_export(file: Path) -> Facts:
    """Read a whole export and return its metadata.

    Raises ImportRefusedError if samples and metadata disagree.
    """
    facts, batches = read_export(file)
    try:
        require_texts(asdict(facts))
    except ValueError as error:
        raise ImportRefusedError(messages.metadata_unreadable(reason=get_reason(error))) from None
    require_matching_facts(facts, batches)
    return facts


def require_matching_facts(facts: Facts, batches: Iterable[Batch]) -> None:
    """Raise ImportRefusedError if samples or times differ from the metadata."""
    digest, samples = SamplesDigest(facts.fields, facts.period_s), 0
    try:
        for tick, batch in _pieces(facts, batches):
            digest.add(tick, make_table(batch, facts.fields))
            samples += batch["t"].size
    except (ValueError, OverflowError) as error:
        raise ImportRefusedError(get_reason(error)) from None
    if samples != facts.samples:
        raise ImportRefusedError(messages.wrong_number_of_samples(samples=samples, stated=facts.samples))
    if digest.hex() != facts.sha256:
        raise ImportRefusedError(messages.samples_changed(sha256=digest.hex()))


def get_run(facts: Facts) -> dict[str, Any]:
    """Return the run of an export. Raises ImportRefusedError."""
    if facts.run is None:
        raise ImportRefusedError(messages.not_of_a_run(content=facts.of))
    try:
        return parse_required_record(RUN, facts.run)
    except UnfitDocumentError as error:
        raise ImportRefusedError(messages.invalid_run(reason=error.message)) from None


def get_run_number(facts: Facts) -> int:
    """Return the number of the run at its origin. Raises ImportRefusedError."""
    kind, _, number = facts.of.partition(" ")
    if kind != RUN or not number.isdecimal() or len(number) > 9:
        raise ImportRefusedError(messages.not_of_a_run(content=facts.of[:40]))
    return int(number)


def same_run(session: Session, document: Mapping[str, Any], facts: Facts | None) -> int | None:
    """Return the run here that equals this one, or None.

    Raises ImportRefusedError if that has other samples.
    """
    try:
        here = find_same_record(session, RUN, dict(document))
    except UnfitDocumentError as error:
        raise ImportRefusedError(error.message) from None
    recorded = here is not None and recordings.is_begun(session, here)
    if here is not None and recorded and facts is not None:
        removed = recordings.get(session, here).removed_at is not None
        if not removed and compute_recording_digest(session, here) != facts.sha256:
            raise ImportRefusedError(messages.run_with_other_samples(run_id=here))
    return here


def store_run(session: Session, document: Mapping[str, Any], file: Path | None, check_run: RunCheck = accept) -> int:
    """Store a run with the samples of an export that passed ``check_export``.

    Raises ImportRefusedError.
    """
    run_id = import_document(session, RUN, dict(document))
    try:
        run = runs.get(session, run_id)
        _ = run.set_to
        check_run(run)
    except UnreadableDocumentError as error:
        raise ImportRefusedError(messages.invalid_run(reason=error.message)) from None
    if file is not None:
        facts, batches = read_export(file)
        recordings.begin_imported(
            session=session,
            run_id=run_id,
            fields=facts.fields,
            period_s=facts.period_s,
            missed=facts.missed,
            problem=facts.problem,
        )
        for tick, batch in _pieces(facts, batches):
            table = make_table(batch, facts.fields)
            chunks = [
                Chunk(tick + begin, len(part), pack_table(summarize_buckets(part)), pack_table(part))
                for begin in range(0, len(table), CHUNK_TICKS)
                for part in (table[begin : begin + CHUNK_TICKS],)
            ]
            recordings.add_chunks(session, run_id, chunks)
            session.expunge_all()  # otherwise all rows stay in memory until the end
    return run_id


def _pieces(facts: Facts, batches: Iterable[Batch]) -> Iterator[tuple[int, Batch]]:
    """Yield ranges without gaps in order of their ticks.

    Raises ImportRefusedError for invalid times.
    """
    end = -1
    for batch in batches:
        ticks = batch["t"] / facts.period_s
        if not np.all(np.abs(ticks) < 1e12) or not np.all(np.abs(ticks - np.rint(ticks)) < 0.01):
            raise ImportRefusedError(messages.times_not_multiples(period_s=facts.period_s))
        for tick, part in unbroken(batch, facts.period_s):
            if tick <= end or (end < 0 and tick != 0):
                raise ImportRefusedError(messages.times_do_not_increase(t=tick * facts.period_s))
            yield tick, part
            end = tick + part["t"].size - 1


# Bundle import -------------------------------------------------------------------------------------
# Import of a bundle: checked completely, then stored with new numbers in one transaction.


Numbers = dict[tuple[str, int], int]
"""Numbers here, by kind and number at the origin."""


def import_bundle(
    database: Database, file: Path, who: str, folder: Path, name: str = "", check_run: RunCheck = accept
) -> ImportResult:
    """Store the run of a bundle with its lineage, without records that exist here.

    ``folder`` has space for the unpacked bundle, ``name`` is the name of the file if its own differs.
    ``backend.services.downloads`` checks the settings of each run. Raises ImportRefusedError, OSError.
    """
    with open_bundle(file) as bundle, TemporaryDirectory(prefix=IMPORTING, dir=folder) as unpacked:
        recorded = _recordings(bundle, Path(unpacked))
        numbers: Numbers = {}
        new = False
        origin = Origin(kind="", number=0, was=0, file=name or file.name, sha256=bundle.sha256, who=who)
        with database.session() as session:
            exclude_other_imports(session)
            for record in bundle.records:
                new |= _import_member(
                    session=session,
                    record=record,
                    numbers=numbers,
                    recorded=recorded,
                    origin=origin,
                    check_run=check_run,
                )
            if (RUN, bundle.run) not in numbers:
                raise ImportRefusedError(messages.bundle_without_its_run(run_id=bundle.run))
            run_id = numbers[RUN, bundle.run]
            if (
                new
                and make_report_name(bundle.run) in bundle.names
                and results.newest_report(session, run_id, "html") is None
            ):
                results.add_report(session, run_id, "html", bundle.text(make_report_name(bundle.run)))
    return ImportResult(run_id, bundle.run, new=new)


def _recordings(bundle: Bundle, folder: Path) -> dict[int, tuple[Facts, Path]]:
    """Unpack and read all recordings.

    Raises ImportRefusedError for a recording of another run.
    """
    found = {}
    for record in bundle.records:
        member = make_recording_name(record["number"])
        if record["kind"] == RUN and member in bundle.names:
            file = folder / f"{record['number']}.parquet"
            bundle.unpack(member, file)
            try:
                facts = check_export(file)
                if get_run_number(facts) != record["number"] or facts.run != record["document"]:
                    raise ImportRefusedError(messages.recording_of_another_run())
            except ImportRefusedError as error:
                raise ImportRefusedError(messages.recording_refused(member=member, reason=error.message)) from None
            found[record["number"]] = facts, file
    known = {make_recording_name(number) for number in found} | {make_report_name(bundle.run)}
    for name in sorted(bundle.names):
        if "/" in name and name not in known:
            raise ImportRefusedError(messages.member_of_no_run(member=name))
    return found


def _import_member(
    session: Session,
    record: Mapping[str, Any],
    numbers: Numbers,
    recorded: Mapping[int, tuple[Facts, Path]],
    origin: Origin,
    check_run: RunCheck,
) -> bool:
    """Store one record unless it exists here; return whether it is new.

    Raises ImportRefusedError with the name of the record.
    """
    kind, was = record["kind"], record["number"]
    try:
        document, unconnected = parse_required_record(kind, record["document"]), origins.BANKS in record["carried"]
        require_identification_document(record["carried"], of_run=kind == RUN)
        document = _renumber(document, numbers, unconnected=unconnected)
        facts, file = recorded.get(was, (None, None)) if kind == RUN else (None, None)
        here = same_run(session, document, facts) if kind == RUN else find_same_record(session, kind, document)
        new = here is None or (kind == RUN and not unconnected and connect_imported_bank(session, here, document))
        if here is None:
            here = _store(session, kind, document, file, check_run)
            record_origin = Origin(
                kind=kind,
                number=here,
                was=was,
                file=origin.file,
                sha256=origin.sha256,
                who=origin.who,
                carried=record["carried"],
            )
            origins.add(session, record_origin)
    except (UnfitDocumentError, UnreadableDocumentError, ImportRefusedError) as error:
        raise ImportRefusedError(messages.record_refused(record=f"{kind} {was}", reason=error.message)) from None
    numbers[kind, was] = here
    return new


def _store(session: Session, kind: str, document: Document, file: Path | None, check_run: RunCheck) -> int:
    """Store a document and check that it is readable.

    Raises ImportRefusedError, UnreadableDocumentError.
    """
    if kind == RUN:
        return store_run(session, document, file, check_run)
    number = import_document(session, kind, document)
    if kind == RESULT:
        results.newest(session, document["run_id"])
    elif kind == IDENTIFICATION:
        identifications.get(session, number).readable()
    return number


def _renumber(document: Document, numbers: Numbers, *, unconnected: bool) -> Document:
    """Return a document that refers to other records by their numbers here.

    ``unconnected``: a run without its banks. Raises ImportRefusedError.
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
        if computed := find_bank_changes(document["settings"]).computed:
            raise ImportRefusedError(messages.computed_bank_number(expression=computed[0]))
        renumbered["settings"] = renumber_banks(document["settings"], lambda was: _number(BANK, was, numbers))
    return renumbered


def _number(kind: str, was: Any, numbers: Numbers) -> int:
    if (kind, was) not in numbers:
        raise ImportRefusedError(messages.record_not_before(kind=kind, number=was))
    return numbers[kind, was]
