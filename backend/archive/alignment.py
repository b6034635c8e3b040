"""Which moment of each run is brought to one: its begin, a step of a reference, an event of the journal."""

from dataclasses import dataclass

from backend.archive.history import marks_of
from backend.recording.reader import nth_jump
from backend.schemas.comparison import AlignBy, ComparisonAsked
from backend.storage import recordings, runs
from backend.storage.database import Session
from backend.storage.orm import UnknownRecordError


@dataclass(frozen=True)
class Aligned:
    """The moment ``at_s`` [s] of a run, and what its times are shifted by; None and why where there is none."""

    at_s: float | None
    offset_s: float | None
    reason: str


def aligned(session: Session, numbers: list[int], reference: int, asked: ComparisonAsked) -> dict[int, Aligned]:
    """Return by run how it comes onto the time axis of the reference. Raises UnknownRecordError."""
    moments = {number: _moment(session, number, asked) for number in numbers}
    own, why = moments[reference]
    found = {}
    for number, (at_s, reason) in moments.items():
        if own is None and number != reference:
            found[number] = Aligned(at_s, None, reason or f"the reference cannot be aligned: {why}")
        else:
            offset_s = 0.0 if number == reference else None if at_s is None or own is None else own - at_s
            found[number] = Aligned(at_s, offset_s, reason)
    return found


def _moment(session: Session, run_id: int, asked: ComparisonAsked) -> tuple[float | None, str]:
    """Return the moment [s from the run's first sample], or None and why there is none."""
    runs.get(session, run_id)
    try:
        recordings.span(session, run_id)
    except UnknownRecordError:
        return None, f"run {run_id} has no samples"
    match asked.by:
        case AlignBy.BEGIN:
            return 0.0, ""
        case AlignBy.STEP:
            at_s, count = nth_jump(session, run_id, asked.step, asked.number)
            what = f"step of {asked.step}"
        case AlignBy.EVENT:
            times = [mark.t for mark in marks_of(session, run_id).marks if mark.kind == asked.event]
            count = len(times)
            at_s = times[asked.number - 1] if count >= asked.number else None
            what = f"event of the kind {asked.event}"
    return at_s, "" if at_s is not None else f"run {run_id} has {_counted(count, what)}, not {asked.number}"


def _counted(count: int, what: str) -> str:
    return f"no {what}" if count == 0 else f"{count} {what}" if count == 1 else f"{count} {_plural(what)}"


def _plural(what: str) -> str:
    first, _, rest = what.partition(" ")
    return f"{first}s {rest}"
