"""Own exports taken in as runs: looked through whole first, then stored in one transaction or not at all."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from backend.documents.edge import UnreadableDocumentError
from backend.documents.run_banks import on_the_way, without_bank
from backend.exports.errors import ImportRefusedError
from backend.exports.facts import Batch, Facts, table_of
from backend.exports.files import file_digest
from backend.exports.formats import read
from backend.exports.source import unbroken
from backend.exports.strict_json import require_texts
from backend.recording.codec import pack, summarise
from backend.recording.digest import SamplesDigest, digest_of_recording
from backend.recording.recorder import CHUNK_TICKS
from backend.storage import Database, Session, origins, recordings, runs
from backend.storage.carried import RUN, find_same, import_alone, put, required
from backend.storage.fit import UnfitDocumentError
from backend.storage.origins import Origin
from backend.storage.recordings import Chunk
from backend.storage.runs import Run

LookOver = Callable[[Run], None]
"""Raises ImportRefusedError for a run that is not accepted, before its samples are stored."""


def accept(_run: Run) -> None:
    """Accept each run: that of a file of one's own, as a test has."""


@dataclass(frozen=True)
class TakenIn:
    """The number that a run has here; ``was`` is its number where it was made; ``new`` unless it was here before."""

    run: int
    was: int
    new: bool


def take_in(database: Database, file: Path, who: str, name: str = "", look_over: LookOver = accept) -> TakenIn:
    """Store an exported run: with its samples, parameters and settings, but without its banks.

    These are not in the file: its origin keeps by which numbers it named them. ``name`` is what the file is called
    where its own name is another. ``backend.archive.imports`` looks over what the run was set to.

    Raises ImportRefusedError, OSError.
    """
    facts = checked(file)
    document, was = run_of(facts), number_of(facts)
    named = on_the_way(document["settings"]).numbers | ({document["bank_id"]} - {None})
    carried = {origins.BANKS: sorted(named)} if named else {}
    with database.session() as session:
        import_alone(session)
        if (here := same_run(session, document, facts)) is not None:
            return TakenIn(here, was, new=False)
        alone = {**document, "bank_id": None, "settings": without_bank(document["settings"])}
        run_id = store_run(session, alone if named else document, file, look_over)
        origins.add(session, Origin(RUN, run_id, was, name or file.name, file_digest(file), who, carried))
    return TakenIn(run_id, was, new=True)


def checked(file: Path) -> Facts:
    """Read all of an export and return its facts. Raises ImportRefusedError where its samples are others than told."""
    facts, batches = read(file)
    try:
        require_texts(asdict(facts))
    except ValueError as error:
        raise ImportRefusedError(f"what it says of itself cannot be read: {error}") from None
    require_told(facts, batches)
    return facts


def require_told(facts: Facts, batches: Iterable[Batch]) -> None:
    """Raise ImportRefusedError where samples, or their times, are others than the facts tell."""
    digest, samples = SamplesDigest(facts.fields, facts.period_s), 0
    try:
        for tick, batch in _pieces(facts, batches):
            digest.add(tick, table_of(batch, facts.fields))
            samples += batch["t"].size
    except (ValueError, OverflowError) as error:
        raise ImportRefusedError(str(error)) from None
    if samples != facts.samples:
        raise ImportRefusedError(f"it holds {samples} samples, and says that it has {facts.samples}")
    if digest.hex() != facts.sha256:
        raise ImportRefusedError(f"its samples are not those that were exported: their sha256 is {digest.hex()}")


def run_of(facts: Facts) -> dict[str, Any]:
    """Return the run that an export is of. Raises ImportRefusedError."""
    if facts.run is None:
        raise ImportRefusedError(f"it is of {facts.of}, no run")
    try:
        return required(RUN, facts.run)
    except UnfitDocumentError as error:
        raise ImportRefusedError(f"its run: {error}") from None


def number_of(facts: Facts) -> int:
    """Return the number of the run where it was made. Raises ImportRefusedError."""
    kind, _, number = facts.of.partition(" ")
    if kind != RUN or not number.isdecimal() or len(number) > 9:
        raise ImportRefusedError(f"it is of {facts.of[:40]}, no run")
    return int(number)


def same_run(session: Session, document: Mapping[str, Any], facts: Facts | None) -> int | None:
    """Return the run that is this one and here already. Raises ImportRefusedError where it is another one."""
    try:
        here = find_same(session, RUN, dict(document))
    except UnfitDocumentError as error:
        raise ImportRefusedError(str(error)) from None
    recorded = here is not None and recordings.is_begun(session, here)
    if here is not None and recorded and facts is not None:
        removed = recordings.get(session, here).removed_at is not None
        if not removed and digest_of_recording(session, here) != facts.sha256:
            raise ImportRefusedError(f"run {here} is this one, and has other samples here")
    return here


def store_run(session: Session, document: Mapping[str, Any], file: Path | None, look_over: LookOver = accept) -> int:
    """Store a run with the samples of an export that was ``checked``. Raises ImportRefusedError."""
    run_id = put(session, RUN, dict(document))
    try:
        run = runs.get(session, run_id)
        _ = run.set_to
        look_over(run)
    except UnreadableDocumentError as error:
        raise ImportRefusedError(f"its run: {error}") from None
    if file is not None:
        facts, batches = read(file)
        recordings.begin_imported(session, run_id, facts.fields, facts.period_s, facts.missed, facts.problem)
        for tick, batch in _pieces(facts, batches):
            table = table_of(batch, facts.fields)
            chunks = [
                Chunk(tick + begin, len(part), pack(summarise(part)), pack(part))
                for begin in range(0, len(table), CHUNK_TICKS)
                for part in (table[begin : begin + CHUNK_TICKS],)
            ]
            recordings.add_chunks(session, run_id, chunks)
            session.expunge_all()  # or all of them would be held until the end
    return run_id


def _pieces(facts: Facts, batches: Iterable[Batch]) -> Iterator[tuple[int, Batch]]:
    """Yield stretches without a gap, in order of their ticks. Raises ImportRefusedError for times that are none."""
    end = -1
    for batch in batches:
        ticks = batch["t"] / facts.period_s
        if not np.all(np.abs(ticks) < 1e12) or not np.all(np.abs(ticks - np.rint(ticks)) < 0.01):
            raise ImportRefusedError(f"its times t are no multiples of {facts.period_s:g} s")
        for tick, part in unbroken(batch, facts.period_s):
            if tick <= end or (end < 0 and tick != 0):
                raise ImportRefusedError(f"its times t do not rise from 0: look at t = {tick * facts.period_s:g} s")
            yield tick, part
            end = tick + part["t"].size - 1
