"""Metrics of a simulated run, computed independently of backend.experiments."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.tuning.simulation import Trajectory

Array = NDArray[np.float64]
HIGH = np.pi / 3.0
STEPS = (
    (0.0, 10.0, 2.0),
    (HIGH, 10.0, 8.0),
    (-HIGH, 10.0, 8.0),
    (HIGH, 10.0, 8.0),
    (0.0, 10.0, 8.0),
    (0.0, 8.0, 6.0),
    (0.0, 14.0, 6.0),
    (0.0, 8.0, 6.0),
    (0.0, 10.0, 6.0),
    (HIGH, 14.0, 8.0),
    (-HIGH, 8.0, 8.0),
)


def references(steps: tuple[tuple[float, float, float], ...]) -> tuple[Array, Array]:
    ticks = [round(1000 * duration) for _, _, duration in steps]
    return np.repeat([q for q, _, _ in steps], ticks), np.repeat([S for _, S, _ in steps], ticks)


@dataclass
class Quality:
    overshoot_percent: float
    stiffness_deviation: float
    joint_deviation: float
    least_tension: float
    greatest_tension: float


def assess(trajectory: Trajectory, q_ref: Array, S_ref: Array) -> Quality:
    """Return the worst case over all steps; deviations are of the constant signal."""
    edges = np.flatnonzero(np.diff(q_ref).astype(bool) | np.diff(S_ref).astype(bool)) + 1
    overshoot, S_deviation, q_deviation = 0.0, 0.0, 0.0
    for start, end in zip(edges, [*edges[1:], q_ref.size], strict=True):
        step_ticks = slice(start, end)
        for y, ref in ((trajectory.q, q_ref), (trajectory.S, S_ref)):
            step = ref[start] - ref[start - 1]
            if step != 0.0:
                overshoot = max(overshoot, 100.0 * float(np.max((y[step_ticks] - ref[start]) / step)))
        if S_ref[start] == S_ref[start - 1]:
            S_deviation = max(S_deviation, float(np.max(np.abs(trajectory.S[step_ticks] - S_ref[start]))))
        if q_ref[start] == q_ref[start - 1]:
            q_deviation = max(q_deviation, float(np.max(np.abs(trajectory.q[step_ticks] - q_ref[start]))))
    tension = np.array([trajectory.F_A, trajectory.F_B])
    return Quality(overshoot, S_deviation, q_deviation, float(tension.min()), float(tension.max()))
