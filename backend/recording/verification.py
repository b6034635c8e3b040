"""Verification of a database's recordings by their digests and summaries."""

import hashlib
from dataclasses import dataclass

import numpy as np

from backend.recording import messages
from backend.recording.codec import CodecError, Table, summarize_buckets, unpack
from backend.storage import Chunk, Database, Session, recordings


@dataclass(frozen=True)
class RecordingsCheck:
    """Number of verified recordings, problems found, and parts without a digest."""

    recordings: int
    problems: tuple[str, ...]
    not_compared: tuple[str, ...]


def check_recordings(database: Database) -> RecordingsCheck:
    """Compare the digest of every chunk of samples with the stored one.

    Chunks from before digests were stored only allow a comparison of their summaries.
    """
    problems: list[str] = []
    not_compared: list[str] = []
    with database.reading() as session:
        numbers = recordings.recorded_runs(session)
    for number in numbers:
        with database.reading() as session:
            found, without = _of_run(session, number)
        problems += found
        if without:
            not_compared.append(messages.chunks_without_digest(run_id=number, chunks=without))
    return RecordingsCheck(len(numbers), tuple(problems), tuple(not_compared))


def _of_run(session: Session, number: int) -> tuple[list[str], int]:
    recording = recordings.get(session, number)
    digests = recordings.recorded_digests(session, number)
    if not digests:
        return [], 0
    first = next(iter(digests))
    problems: list[str] = []
    for chunk in recordings.chunks(session, number, first, max(digests) + 1):
        if why := _problem(chunk, digests[chunk.first_tick], len(recording.fields)):
            at_s = (chunk.first_tick - first) * recording.period_s
            problems.append(messages.samples_differ(run_id=number, from_s=at_s, reason=why))
    return problems, sum(digest == "" for digest in digests.values())


def _problem(chunk: Chunk, digest: str, columns: int) -> str:
    if digest and (found := hashlib.sha256(chunk.samples).hexdigest()) != digest:
        return messages.digest_differs(found=found, recorded=digest)
    try:
        table, summary = unpack(chunk.samples, columns), unpack(chunk.summary, columns)
    except CodecError as error:
        return str(error)
    if len(table) != chunk.count:
        return messages.count_differs(found=len(table), recorded=chunk.count)
    if not _is_equal(summarize_buckets(table), summary):
        return messages.summaries_differ()
    return ""


def _is_equal(one: Table, other: Table) -> bool:
    return one.shape == other.shape and bool(np.array_equal(one, other, equal_nan=True))
