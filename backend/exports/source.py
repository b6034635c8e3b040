"""What is exported: samples as they come, a minute at a time, and the facts about them, looked through beforehand."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from backend.exports.errors import ExportError
from backend.exports.facts import Batch, Described, Facts, described, table_of
from backend.recording.codec import CodecError
from backend.recording.columns import Columns, recorded_columns
from backend.recording.digest import SamplesDigest
from backend.recording.reader import read_samples
from backend.storage import formulas, recordings, runs
from backend.storage.carried import RUN, document_of
from backend.storage.database import Database
from backend.storage.formulas import Formula
from backend.storage.records import UnknownRecordError
from plant.interface import T_s

SLAB_S = 50.0
"""Samples that are read at once [s]: 6 MB. Each in a snapshot of its own, as somebody may take hours to download."""


@dataclass(frozen=True)
class Export:
    """Facts, and the samples as often as they are asked for."""

    facts: Facts
    batches: Callable[[], Iterator[Batch]]


def of_run(database: Database, run_id: int, derived: Sequence[str] = ()) -> Export:
    """Return the export of a run, after reading all of it once: what cannot be read is refused beforehand.

    ``derived`` are signals of formulas that stand behind its columns. Raises UnknownRecordError, ExportError.
    """
    with database.reading() as session:
        run, document = runs.get(session, run_id), document_of(session, RUN, run_id)
        recording, extent = recordings.get(session, run_id), recordings.extent(session, run_id)
        written = {one.name: one for one in formulas.find(session) if one.name in derived}
    length_s = (extent.end_tick - extent.first_tick) * recording.period_s
    lacking = [name for name in derived if name not in written]
    if lacking:
        raise ExportError(f"there is no formula {', '.join(lacking)}")
    names = [*recording.fields, *derived] if derived else []
    digest, samples = SamplesDigest(recording.fields, recording.period_s), 0

    def batches() -> Iterator[Batch]:
        for number in range(int(np.ceil(length_s / SLAB_S))):
            yield from _slab(database, run_id, names, number * SLAB_S, min((number + 1) * SLAB_S, length_s))

    for batch in batches():
        samples += batch["t"].size
        for tick, part in unbroken(batch, recording.period_s):
            digest.add(tick, table_of(part, recording.fields))
    facts = Facts(
        of=f"run {run_id}",
        fields=recording.fields,
        period_s=recording.period_s,
        samples=samples,
        sha256=digest.hex(),
        columns=[*described(recording.fields), *(_described(written[name]) for name in derived)],
        derived=list(derived),
        started_at=run.started_at.isoformat(),
        run=document,
        missed=recording.missed,
        problem=recording.problem,
    )
    return Export(facts, batches)


def stored_or_none(database: Database, run_id: int) -> Export:
    """Return the export of a run, one without samples where none were recorded. Raises ExportError."""
    try:
        return of_run(database, run_id)
    except UnknownRecordError:
        return of_columns(recorded_columns(database, run_id)[0], f"run {run_id}")


def of_columns(columns: Columns, of: str, period_s: float = T_s) -> Export:
    """Return the export of samples in memory, of a flight record for example; ``of`` says what they are."""
    batch: Batch = {name: column if name == "t" else column.astype(np.float32) for name, column in columns.items()}
    fields = [name for name in batch if name != "t"]
    digest = SamplesDigest(fields, period_s)
    digest.add(0, table_of(batch, fields))
    facts = Facts(
        of=of,
        fields=fields,
        period_s=period_s,
        samples=batch["t"].size,
        sha256=digest.hex(),
        columns=described(fields),
    )
    return Export(facts, lambda: iter((batch,)))


def unbroken(batch: Batch, period_s: float) -> Iterator[tuple[int, Batch]]:
    """Cut a batch where samples are missing: yield each part with the tick of its first, counted from t = 0."""
    ticks = np.rint(batch["t"] / period_s).astype(np.int64)
    cuts = [0, *(np.flatnonzero(np.diff(ticks) != 1) + 1).tolist(), ticks.size]
    for begin, end in pairwise(cuts):
        if end > begin:
            yield int(ticks[begin]), {name: column[begin:end] for name, column in batch.items()}


def _described(formula: Formula) -> Described:
    meaning = f"{formula.meaning}, " if formula.meaning else ""
    return Described(formula.name, formula.name, formula.unit, f"{meaning}computed: {formula.expression}")


def _slab(database: Database, run_id: int, names: Sequence[str], from_s: float, to_s: float) -> Iterator[Batch]:
    try:
        with database.reading() as session:
            samples = read_samples(session, run_id, names, from_s, to_s)
    except (CodecError, UnknownRecordError) as error:
        raise ExportError(f"run {run_id} cannot be exported: {error}") from error
    if samples.t.size:  # a gap may be longer
        yield {"t": samples.t, **samples.columns}
