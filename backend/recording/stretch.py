"""Reads every sample of a range of a recording in parts, including signals that are computed from columns."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.errors import OutOfRangeError, require_within
from backend.recording.following import computed, lengths_of
from backend.recording.reader import read_samples
from backend.sample import COMBINED_BY_NAME
from backend.storage import recordings
from backend.storage.database import Database, Session

SLAB_TICKS = 50_000
"""Ticks that are read at once: all columns of them take 6 MB."""

_EXACT = 1e-6
"""Share of a period by which a time may miss its tick: 0.3 / 0.001 is a little less than 300."""


@dataclass(frozen=True)
class Stretch:
    """Ticks ``begin`` to ``end`` (exclusive) of a run, counted from its first sample."""

    run_id: int
    begin: int
    end: int
    period_s: float

    @property
    def ticks(self) -> int:
        """Number of ticks; the recording may lack some of them."""
        return self.end - self.begin

    @property
    def from_s(self) -> float:
        """Time of the first tick since the first sample of the run [s]."""
        return self.begin * self.period_s

    @property
    def to_s(self) -> float:
        """Time of the last tick since the first sample of the run [s]."""
        return (self.end - 1) * self.period_s

    def tick_at(self, time_s: float) -> int:
        """Return the tick at or before a time, counted from the first sample of the run."""
        return int(np.floor(time_s / self.period_s + _EXACT))


@dataclass(frozen=True)
class Slab:
    """Consecutive samples: their ``ticks`` [n] since the first sample of the run, and a column [n] per signal (SI)."""

    ticks: NDArray[np.int64]
    columns: dict[str, NDArray[np.float64]]


def stretch_of(session: Session, run_id: int, from_s: float = 0.0, to_s: float | None = None) -> Stretch:
    """Return the ticks with from_s <= t <= to_s; without ``to_s`` up to the last sample.

    Raises UnknownRecordError when nothing of the run was recorded, and OutOfRangeError for a range that is not within
    the recording or holds no tick.
    """
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    period_s = recording.period_s
    last = span.end_tick - span.first_tick - 1
    last_s = last * period_s
    slack_s = _EXACT * period_s
    within = f"the recording of run {run_id} ends at {last_s:.3f} s: choose a range within it"
    if not -slack_s <= from_s <= last_s + slack_s:
        require_within("from", from_s, 0.0, last_s, "s", within, words="begin of the range")
    if to_s is None:
        to_s = last_s
    if not from_s <= to_s <= last_s + slack_s:
        require_within("to", to_s, from_s, last_s, "s", within, words="end of the range")
    begin = int(np.ceil(from_s / period_s - _EXACT))
    end = int(np.floor(to_s / period_s + _EXACT)) + 1
    if end <= begin:
        remedy = "choose a longer range: this one lies between two samples"
        raise OutOfRangeError("range", to_s - from_s, period_s, None, "s", remedy, words="length of the range")
    return Stretch(run_id, begin, min(end, last + 1), period_s)


def slabs(database: Database, stretch: Stretch, names: Sequence[str]) -> Iterator[Slab]:
    """Yield the samples of a range, ``SLAB_TICKS`` at most at a time; a part without any sample is left out.

    Each slab is read in a transaction of its own. Raises UnknownRecordError, UnknownSignalError, CodecError.
    """
    for begin in range(stretch.begin, stretch.end, SLAB_TICKS):
        end = min(begin + SLAB_TICKS, stretch.end)
        with database.reading() as session:
            slab = _read(session, stretch, names, begin, end)
        if slab.ticks.size:
            yield slab


def _read(session: Session, stretch: Stretch, names: Sequence[str], begin: int, end: int) -> Slab:
    combined = [COMBINED_BY_NAME[name] for name in dict.fromkeys(names) if name in COMBINED_BY_NAME]
    recorded = recordings.get(session, stretch.run_id).fields
    terms = [term.column for one in combined for term in one.terms if term.column in recorded]
    stored = [name for name in names if name not in COMBINED_BY_NAME]
    read = list(dict.fromkeys([*stored, *terms])) or recorded[:1]
    samples = read_samples(session, stretch.run_id, read, begin * stretch.period_s, end * stretch.period_s)
    columns = {name: samples.columns[name].astype(np.float64) for name in read}
    lengths = lengths_of(session, stretch.run_id, combined)
    columns |= {one.name: computed(one, columns, lengths, samples.t.size) for one in combined}
    ticks = np.rint(samples.t / stretch.period_s).astype(np.int64)
    return Slab(ticks, {name: columns[name] for name in names})
