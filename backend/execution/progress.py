"""Progress of a run: its phases, and the callback that reports them."""

from collections.abc import Callable
from enum import StrEnum


class RunPhase(StrEnum):
    """What is being done for a run, in the order in which it is done."""

    STARTING = "starting"
    PRETENSION = "pretension"
    PROGRAM = "program"
    PAUSED = "paused"
    EVALUATION = "evaluation"


ProgressCallback = Callable[[RunPhase, float], None]
"""Told a few times a second: what is being done, and for how long [s of loop time]."""
