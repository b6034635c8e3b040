"""How far a run is, as whoever plays it tells whoever shows it."""

from collections.abc import Callable
from enum import StrEnum


class Doing(StrEnum):
    """What is being done for a run, in the order in which it is done."""

    STARTING = "starting"
    PRETENSION = "pretension"
    PROGRAM = "program"
    PAUSED = "paused"
    EVALUATION = "evaluation"


Notify = Callable[[Doing, float], None]
"""Told a few times a second: what is being done, and for how long [s of loop time]."""
