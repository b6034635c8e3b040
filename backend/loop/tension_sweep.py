"""A slow sweep of both tensions at once, for the springs: the joint stays where antagonism holds it."""

from backend.controllers import cascade
from backend.loop.motion import Carry, Decision, MotorPositions, walk
from backend.loop.player import Target
from backend.loop.program import Program
from plant.interface import Measurement, T_s

Angles = tuple[float, float]


class TensionSweep(MotorPositions):
    """Spring identification: wind both motors evenly up and down, leg by leg.

    ``goals`` are theta_A and theta_B [rad] where the sweep starts and where each leg ends.
    """

    def __init__(self, carry: Carry, target: Target, program: Program, goals: tuple[Angles, ...]) -> None:
        super().__init__(carry, target)
        self._goals = goals
        self._ticks = [max(round(leg.duration_s / T_s), 1) for leg in program.legs]
        self._settle_ticks = round(program.settle_s / T_s)
        self._leg = -1
        self._elapsed = 0

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick: to the start, settle, then along the legs."""
        if self._leg < 0:
            references = walk(self._carry.theta_A_ref, self._carry.theta_B_ref, *self._goals[0])
            if references == self._goals[0]:
                self._elapsed += 1
                if self._elapsed >= self._settle_ticks:
                    self._leg, self._elapsed = 0, 0
            return self.follow(tuning, m, *references)
        self._elapsed += 1
        share = self._elapsed / self._ticks[self._leg]
        (from_A, from_B), (to_A, to_B) = self._goals[self._leg : self._leg + 2]
        if self._elapsed >= self._ticks[self._leg]:
            self.done = self._leg + 1 == len(self._ticks)
            if not self.done:
                self._leg, self._elapsed = self._leg + 1, 0
        return self.follow(tuning, m, from_A + share * (to_A - from_A), from_B + share * (to_B - from_B))
