"""Whether joint and estimate of the outside force are at rest, so that something may be learned of it."""

import numpy as np
from numpy.typing import NDArray

from backend.realtime.program import MODES, Mode
from backend.sample import INDEX

LEARNED_TICKS = 1000
"""Samples at rest that a point is learned from: 1 s."""

DRIFT_N = 0.1
"""What the estimate may move by from one half of them to the other [N]: as much as a count of the joint's encoder."""

_MOVING_RAD, _MOVING_S = 0.01, 0.1
"""At rest, the joint stays within so much, and its stiffness [N·m/rad]."""


def why_not(rows: NDArray[np.float64], since: int) -> str:
    """Why nothing can be learned from these samples, of one bias from the tick ``since`` on; empty where it can."""
    if len(rows) < LEARNED_TICKS or not np.all(np.isfinite(rows[:, INDEX["F_ext_hat"]])):
        return "the outside force is not known yet, the motors' zeros come with pretension"
    if set(rows[:, INDEX["mode"]].astype(int)) != {MODES.index(Mode.RUN)}:
        return f"the joint has to be held in run for {LEARNED_TICKS / 1000:g} s"
    if rows[0, INDEX["tick"]] < since:
        return f"something else was put into force less than {LEARNED_TICKS / 1000:g} s ago"
    touched = touched_by(rows)
    if touched:
        return touched
    if np.ptp(rows[:, INDEX["q"]]) > _MOVING_RAD or np.ptp(rows[:, INDEX["S"]]) > _MOVING_S:
        return f"joint and stiffness have to be at rest for {LEARNED_TICKS / 1000:g} s"
    return ""


def touched_by(rows: NDArray[np.float64]) -> str:
    """Say what of the simulation acts on the joint in these samples; empty for nothing."""
    if np.any(rows[:, INDEX["F_push"]] != 0.0):
        return "the joint is pushed"
    if np.any(np.nan_to_num(rows[:, INDEX["F_wall"]]) != 0.0):  # nan on a rig, where nobody simulates one
        return "the joint presses on a wall"
    return ""


def drift(rows: NDArray[np.float64]) -> float:
    """Return by how much the mean of the estimate [N] differs between both halves of the samples."""
    F = rows[:, INDEX["F_ext_hat"]]
    half = len(F) // 2
    return abs(float(F[:half].mean() - F[half:].mean()))
