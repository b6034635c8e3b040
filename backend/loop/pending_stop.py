"""A stop between its order and its proof."""

from dataclasses import dataclass

from backend.loop.commands import Stop


@dataclass(frozen=True)
class PendingStop:
    """A stop on its way to zero volts: what asked for it, in which tick, at which reading of the clock."""

    stop: Stop
    arrived_tick: int
    clock_s: float
    detail: str
