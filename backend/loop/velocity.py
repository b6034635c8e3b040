"""How fast the joint moves: its encoder's differences, smoothed."""

import math

from plant.interface import T_s

VELOCITY_FILTER_S = 0.010
"""Time constant of the estimate [s]: an encoder count in one tick would read as 1.6 rad/s."""

_PASS_THROUGH = 1.0 - math.exp(-T_s / VELOCITY_FILTER_S)


class JointVelocity:
    """The estimate ``q_dot`` [rad/s], from rest at the first q [rad] that is a number."""

    def __init__(self, q: float) -> None:
        self.q_dot = 0.0
        self._q_before = q

    def step(self, q: float) -> None:
        """Take the reading of a tick [rad]; one that is no number is passed over, as its nan would stay for ever."""
        if math.isfinite(q):
            before = self._q_before if math.isfinite(self._q_before) else q
            self.q_dot += _PASS_THROUGH * ((q - before) / T_s - self.q_dot)
            self._q_before = q

    def stands_at(self, q: float) -> None:
        """Say where the joint stands now [rad]: it has not moved there."""
        self._q_before = q
