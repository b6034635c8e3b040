"""What an event of the loop leaves on the time axis and in the journal."""

from typing import NamedTuple, assert_never

from backend.faults import Fault, explained
from backend.operating.standing_wall import wall_in_words
from backend.realtime.commands import (
    Accepted,
    Event,
    ModeChanged,
    PlantAnswers,
    PlantFailing,
    PlayerMoved,
    PretensionReached,
    PushReleased,
    ReadinessChanged,
    Refused,
    RunEnded,
    Stopped,
    TuningChanged,
    WallChanged,
)
from backend.realtime.program import ContactFelt, TouchForgotten
from backend.realtime.supervisor import LoopDied
from backend.schemas.state import MarkKind


class Mark(NamedTuple):
    """One mark at ``tick``."""

    kind: MarkKind
    text: str
    tick: int


def mark_of(event: Event | LoopDied, now: int) -> Mark | None:
    """Return the mark of an event, None where whoever asked for it leaves one; ``now`` is the newest tick."""
    match event:
        case ModeChanged(tick, before, after):
            return Mark(MarkKind.MODE, f"{before} → {after}", tick)
        case PretensionReached(tick):
            return Mark(MarkKind.MODE, "pretension reached", tick)
        case ContactFelt(tick, F_ext_hat, contact_N):
            return Mark(MarkKind.NOTE, f"contact: {F_ext_hat:.1f} N, from {contact_N:g} N on the joint gives way", tick)
        case TouchForgotten(tick):
            return Mark(MarkKind.NOTE, "zeros found anew: the outside force has to be learned again", tick)
        case PushReleased(tick, why):
            return Mark(MarkKind.NOTE, f"push let go: {why}", tick)
        case TuningChanged(tick, 0, lam_q, lam_S):
            return Mark(MarkKind.TUNING, f"as before the program: λ_q {lam_q:g} s, λ_S {lam_S:g} s", tick)
        case TuningChanged(tick, _, lam_q, lam_S):
            return Mark(MarkKind.TUNING, f"by the program: λ_q {lam_q:g} s, λ_S {lam_S:g} s", tick)
        case WallChanged(tick, number, wall) if number:
            return Mark(MarkKind.NOTE, f"by the program: {wall_in_words(wall)}", tick)
        case Stopped(fault=Fault.STOP_PRESSED):
            return None
        case Stopped(fault=fault, arrived_tick=tick, detail=seen):
            return Mark(MarkKind.TRIP, explained(fault, seen), tick)
        case PlantFailing(tick, reason):
            return Mark(MarkKind.FAULT, f"the plant cannot be read or written: {reason}", tick)
        case PlantAnswers(tick):
            return Mark(MarkKind.NOTE, "the plant answers again", tick)
        case LoopDied(reason):
            return Mark(MarkKind.TRIP, f"The control loop died: {reason}", now)
        case Accepted() | Refused() | RunEnded() | ReadinessChanged() | WallChanged() | PlayerMoved():
            return None
        case _:
            assert_never(event)
