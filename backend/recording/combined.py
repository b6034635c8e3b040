"""Envelopes of signals that are not stored: they follow from the columns, sample by sample."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, islice

import numpy as np
from numpy.typing import NDArray

from backend.recording.codec import Table, unpack_alike
from backend.recording.following import Following, columns_of, computed, lengths_of
from backend.storage import Session, recordings
from backend.storage.recordings import Chunk, Recording

AT_HAND_SAMPLES = 1_000_000
"""So many samples at most are read one by one beside the live stream without making it stutter; more are read in a
process of its own, which takes longer to begin."""

_AT_ONCE = 64
"""Chunks that are unpacked together: fewer take longer, more take more memory."""


def combined_envelope(
    session: Session,
    recording: Recording,
    wanted: Sequence[Following],
    ticks: tuple[int, int],
    buckets: NDArray[np.int64],
) -> tuple[Table, Table]:
    """Return smallest and largest value per bucket, [buckets, wanted] each, over the ticks from .. up to ..

    ``buckets`` holds the first tick of each, and where the last one ends. nan where the recording lacks a column or
    the run's parameters a length. The extremes of a sum are not those of its terms: every sample is read, of an hour in
    about a second.
    """
    count = len(buckets) - 1
    low, high = (np.full((count, len(wanted)), np.nan, np.float32) for _ in range(2))
    lengths = lengths_of(session, recording.run_id, wanted)
    kept = [name for name in columns_of(wanted) if name in recording.fields]
    indices = [recording.fields.index(name) for name in kept]
    for alike in _alike(recordings.chunks(session, recording.run_id, *ticks)):
        at_ticks = np.array([chunk.first_tick for chunk in alike])[:, None] + np.arange(alike[0].count)
        inside = (at_ticks >= ticks[0]) & (at_ticks < ticks[1])
        table = unpack_alike([chunk.samples for chunk in alike], len(recording.fields), indices)[inside]
        columns = dict(zip(kept, table.astype(np.float64).T, strict=True))
        values = in_precision(np.column_stack([computed(one, columns, lengths, len(table)) for one in wanted]))
        at = np.searchsorted(buckets, at_ticks[inside], side="right") - 1
        starts = np.flatnonzero(np.diff(at, prepend=-1))
        low[at[starts]] = np.fmin(low[at[starts]], np.fmin.reduceat(values, starts, axis=0))
        high[at[starts]] = np.fmax(high[at[starts]], np.fmax.reduceat(values, starts, axis=0))
    return low, high


def _alike(chunks: Iterable[Chunk]) -> Iterator[list[Chunk]]:
    """Yield chunks that follow each other and are of one length together, some at once."""
    for _, alike in groupby(chunks, key=lambda chunk: chunk.count):
        while some := list(islice(alike, _AT_ONCE)):
            yield some


def in_precision(values: NDArray[np.float64]) -> Table:
    """Return computed values as columns are stored; nan for what is beyond that."""
    with np.errstate(over="ignore"):
        kept = values.astype(np.float32)
    kept[np.isinf(kept)] = np.nan
    return kept
