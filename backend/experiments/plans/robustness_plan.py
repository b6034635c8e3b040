"""The paper's robustness test of the motor loops: an additional tension of 50 N, 0.375 N·m at the gearbox shaft."""

from dataclasses import dataclass
from typing import ClassVar

from backend.controllers.limits import STIFFNESS_RANGE
from backend.documents.result import Phase
from backend.experiments.settings import number
from backend.loop.program import Law, Program, Segment

LEAD_IN_S = 6.0
"""Time for joint and stiffness to settle before the first load."""

PAPER_LOAD_NM = 0.375
"""Fifty newtons at the reel's 7.5 mm."""


@dataclass(frozen=True)
class RobustnessPlan:
    """A load torque steps on and off at the gearbox shaft, of motor A first and then of motor B, under the cascade.

    It pulls the way the tendon does, as an additional spring tension would. The paper names the load and no result.
    """

    kind: ClassVar[str] = "robustness"

    load_Nm: float = number(
        PAPER_LOAD_NM, 0.02, 0.5, "N·m", "τ_load", "load torque at the gearbox shaft; 50 N on a reel"
    )
    q_ref: float = number(0.0, -1.0, 1.0, "rad", "q_ref", "joint position held meanwhile")
    S_ref: float = number(10.0, *STIFFNESS_RANGE, "N·m/rad", "S_ref", "stiffness held meanwhile")
    hold_s: float = number(4.0, 1.0, 30.0, "s", "t_L", "time the load is on, and off")

    def program(self) -> Program:
        """Return the loads as a program under the cascade."""
        held = [(0.0, 0.0), (self.load_Nm, 0.0), (0.0, 0.0), (0.0, self.load_Nm), (0.0, 0.0)]
        durations = [LEAD_IN_S, *[round(self.hold_s, 3)] * 4]
        segments = (
            Segment(duration_s, self.q_ref, self.S_ref, load_A=load_A, load_B=load_B)
            for duration_s, (load_A, load_B) in zip(durations, held, strict=True)
        )
        return Program(Law.CASCADE, tuple(segments))

    def phases(self) -> tuple[Phase, ...]:
        """Return lead-in, and every load on and off."""
        titles = (
            ("A_on", "Load on motor A"),
            ("A_off", "Motor A let go"),
            ("B_on", "Load on motor B"),
            ("B_off", "Motor B let go"),
        )
        hold_s = round(self.hold_s, 3)
        starts = [LEAD_IN_S + turn * hold_s for turn in range(len(titles))]
        loads = (Phase(name, title, start, start + hold_s) for (name, title), start in zip(titles, starts, strict=True))
        return (Phase("lead_in", "Lead-in, no load", 0.0, LEAD_IN_S), *loads)
