"""Where in a program something acts on the actuator: pushes, loads, excitations, as samples from its start. Pure."""

from collections.abc import Iterator
from typing import NamedTuple

from backend.realtime.program import Program, Segment, Shape, left_at
from plant.interface import T_s
from plant.parameters import SIDES, Side

_STILL = 1e-12
"""A reference that is nearer to where it was has not moved: the rest is rounding."""


class LoadStep(NamedTuple):
    """A load of one motor's shaft that steps on or off, and the samples until a load steps again."""

    side: Side
    window: slice
    on: bool


class Excited(NamedTuple):
    """An excitation of one reference, "q" or "S"; ``period`` is None for a sweep, which has none."""

    signal: str
    window: slice
    period: int | None


def timed(program: Program) -> Iterator[tuple[int, int, Segment]]:
    """Give each segment with its first sample and the one after its last."""
    start = 0
    for segment in program.segments:
        end = start + round(segment.duration_s / T_s)
        yield start, end, segment
        start = end


def load_steps(program: Program) -> tuple[LoadStep, ...]:
    """Return the steps of the loads, in order."""
    found: list[tuple[Side, int, bool]] = []
    before: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
    for start, _, segment in timed(program):
        now: dict[Side, float] = {"A": segment.load_A, "B": segment.load_B}
        found += [(side, start, abs(now[side]) > abs(before[side])) for side in SIDES if now[side] != before[side]]
        before = now
    starts = sorted({start for _, start, _ in found})
    ends = dict(zip(starts, [*starts[1:], round(program.duration_s / T_s)], strict=False))
    return tuple(LoadStep(side, slice(start, ends[start]), on) for side, start, on in found)


def pushes(program: Program) -> tuple[slice, ...]:
    """Return the stretches over which the joint is pushed."""
    found: list[slice] = []
    for start, end, segment in timed(program):
        if not segment.F_push:
            continue
        if found and found[-1].stop == start:
            found[-1] = slice(found[-1].start, end)
        else:
            found.append(slice(start, end))
    return tuple(found)


def excitations(program: Program) -> tuple[Excited, ...]:
    """Return where one of the references alone is excited by a known spectrum."""
    found: list[Excited] = []
    q, S = 0.0, 0.0
    for start, end, segment in timed(program):
        if segment.shape not in (Shape.SWEEP, Shape.PRBS, Shape.MULTISINE):
            q, S = left_at(segment, q, S)
            continue
        moved = [name for name, by in (("q", segment.q_ref - q), ("S", segment.S_ref - S)) if abs(by) > _STILL]
        if len(moved) == 1:
            found.append(Excited(moved[0], slice(start, end), _period(segment)))
    return tuple(found)


def undisturbed_from(program: Program, at: int) -> int:
    """Return the sample up to which nothing acts and no reference moves from ``at`` on."""
    held, until = (0.0, 0.0), at
    for _, end, segment in timed(program):
        if end <= at:
            held = left_at(segment, *held)
            continue
        acts = segment.F_push or segment.load_A or segment.load_B or segment.shape is not Shape.STEP
        if acts or (segment.q_ref, segment.S_ref) != held:
            break
        until = end
    return until


def _period(segment: Segment) -> int | None:
    if segment.shape is Shape.SWEEP:
        return None
    chips = 2**segment.count - 1 if segment.shape is Shape.PRBS else 1
    return round(segment.period_s / T_s) * chips
