"""Progress of a run: its phases, and the callback that reports them."""

from collections.abc import Callable
from enum import StrEnum


class RunPhase(StrEnum):
    """Phases of a run, in order."""

    STARTING = "starting"
    PRETENSION = "pretension"
    PROGRAM = "program"
    PAUSED = "paused"
    EVALUATION = "evaluation"


ProgressCallback = Callable[[RunPhase, float], None]
"""Receives the current phase and its duration so far [s of loop time], several times per second."""
