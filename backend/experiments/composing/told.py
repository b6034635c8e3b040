"""What each part of an experiment comes to once it is laid out: when it plays, from where to where. Pure."""

from dataclasses import dataclass, replace

from backend.errors import Path
from backend.experiments.composing.laid import Laid
from backend.realtime.program import left_at


@dataclass(frozen=True)
class Played:
    """A part as it plays.

    ``q_from`` and ``S_from`` are the references that its first piece finds, None where the experiment begins; ``q_to``,
    ``S_to`` and ``piece_s`` are that piece's own. ``end_s`` is the end of its last piece, all repetitions counted.
    """

    path: Path
    start_s: float
    end_s: float
    pieces: int
    piece_s: float
    q_from: float | None
    S_from: float | None
    q_to: float
    S_to: float


def played_parts(laid: Laid) -> list[Played]:
    """Return the parts that move or wait, in the order in which they first play."""
    found: dict[Path, Played] = {}
    at: tuple[float, float] | None = None
    clock_s = 0.0
    for segment, path in zip(laid.segments, laid.places, strict=True):
        end_s = clock_s + segment.duration_s
        q_from, S_from = at or (None, None)
        first = found.get(path) or Played(
            path, clock_s, end_s, 0, segment.duration_s, q_from, S_from, segment.q_ref, segment.S_ref
        )
        found[path] = replace(first, end_s=end_s, pieces=first.pieces + 1)
        clock_s = end_s
        at = left_at(segment, *(at or (segment.q_ref, segment.S_ref)))
    return list(found.values())
