"""Ticks in a row on the simulator, as long as nothing comes of them that the interpreter has to see to."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.tick.desk import DONE, PUSHES, QUIET, TUNES, WALLS, Desk, Moving, decide, look, write_row
from plant.compiled import Cell, compiled_run, keep
from plant.interface import NO_RAW, Measurement, MotorCommand
from plant.simulator import Simulated, period

DECIDED = 8
"""Of the tick after the last whole one: the motion has decided, and the rest is the interpreter's."""


class Stretch(NamedTuple):
    """Ticks to be made: number of the first, and of the simulator's period before it; how many; overruns so far."""

    first: int
    period: int
    ticks: int
    overruns: int


@compiled_run
def run(
    desk: Cell[Desk],
    moving: Cell[Moving],
    simulated: Cell[Simulated],
    m: Measurement,
    stretch: Stretch,
    rows: NDArray[np.float64],
) -> tuple[int, int, float, float, Measurement]:
    """Make ticks, each with its row in ``rows`` (capacity, n), at the place of its number; ``m`` is measured now.

    Returns how many are whole, what came of the next one (QUIET: it was not begun; FOUND, FELT: it was looked at; DONE,
    TUNES, WALLS, DECIDED: it was decided), its voltages [V], and what is measured then.
    """
    for made in range(stretch.ticks):
        seen = look(desk, m, 0)
        if seen != QUIET:
            return made, seen, 0.0, 0.0, m
        came, u_A, u_B = decide(desk, moving)
        if came & (DONE | TUNES | WALLS) or not math.isfinite(u_A + u_B):
            return made, came | DECIDED, u_A, u_B, m
        if came & PUSHES:
            target = desk.decision.target.value
            keep(desk.orders.F_push, target.F_push)
            keep(desk.orders.load, target.load)
            keep(simulated.F_push, target.F_push)
            keep(simulated.load, target.load)
        m = period(simulated, u_A, u_B, stretch.period + made + 1)
        number = stretch.first + made
        write_row(desk, rows[number % rows.shape[0]], number, MotorCommand(u_A, u_B), NO_RAW, 0.0, stretch.overruns)
    return stretch.ticks, QUIET, 0.0, 0.0, m
