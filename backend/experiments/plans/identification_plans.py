"""Plans that identify motors and springs (method sections 2 and 3): settings in, a ``Program`` for the loop out. Pure.

The actuator's is in ``backend.experiments.plans.plan``. Angles in rad, voltages in V, tensions in N, times in s.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from backend.control.motion_primitives import STEP_BRAKING_S, ZERO_VOLTS_S
from backend.errors import OutOfRangeError
from backend.models.run import Phase
from backend.models.settings import integer, number
from backend.realtime.program import Law, Program, TensionLeg, VoltageStep

UPPER_END = -1.5
"""Where a step down starts [rad]: the tendons go slack above 0, and a step up needs the rest of the way to brake."""


@dataclass(frozen=True)
class MotorIdentificationPlan:
    """Unloaded voltage steps of both motors at once (method section 2).

    Both tendons are let slack, so that the motors run free. Each voltage is stepped up and then down again: the way
    back is data too, and the motors stay within the turn that the joint's range allows.
    """

    kind: ClassVar[str] = "motor_identification"

    u_low: float = number(2.0, 0.3, 9.0, "V", "u_low", "smallest voltage step")
    u_high: float = number(5.0, 0.5, 9.5, "V", "u_high", "largest voltage step, short of saturation")
    levels: int = integer(4, 2, 8, "n", "number of voltages from the smallest to the largest")
    travel_rad: float = number(12.0, 2.0, 12.0, "rad", "Δθ", "a step ends once a motor has turned by this much")
    step_s: float = number(2.5, 0.3, 10.0, "s", "t_u", "a step ends after this time at the latest")
    settle_s: float = number(1.0, 0.5, 10.0, "s", "t_0", "time the motors are held where a step starts")

    def __post_init__(self) -> None:
        if self.u_low >= self.u_high:
            words, remedy = "smallest voltage step", "keep it below the largest"
            raise OutOfRangeError("u_low", self.u_low, None, self.u_high, "V", remedy, words=words)

    def voltages(self) -> tuple[float, ...]:
        """Return the voltages [V] stepped to, both ways."""
        return tuple(round(float(u), 3) for u in np.linspace(self.u_low, self.u_high, self.levels))

    def program(self) -> Program:
        """Return the steps, up and down in turn."""
        lower_end = UPPER_END - self.travel_rad
        steps = (
            VoltageStep(start, u, self.step_s, self.travel_rad)
            for voltage in self.voltages()
            for start, u in ((lower_end, voltage), (UPPER_END, -voltage))
        )
        return Program(Law.MOTOR_STEPS, settle_s=self.settle_s, steps=tuple(steps))

    def phases(self) -> tuple[Phase, ...]:
        """Return one phase per step, as long as it can get."""
        around_each = self.settle_s + ZERO_VOLTS_S + STEP_BRAKING_S
        return tuple(
            Phase(
                f"step_{position}",
                f"Step to {step.u:g} V",
                position * (around_each + self.step_s),
                (position + 1) * (around_each + self.step_s),
            )
            for position, step in enumerate(self.program().steps)
        )


@dataclass(frozen=True)
class SpringIdentificationPlan:
    """Slow sweep of both tensions up and down, the joint held near 0 by antagonism (method section 3).

    Going both ways shows what is not the spring: the load cells' delay and friction between spring and load cell part
    the two ways, and the mean of both is free of it.
    """

    kind: ClassVar[str] = "spring_identification"

    F_low: float = number(2.0, 1.5, 15.0, "N", "F_low", "tension where the sweep starts, above slack")
    F_high: float = number(45.0, 20.0, 47.0, "N", "F_high", "tension where the sweep turns, below the solid spring's")
    sweep_s: float = number(15.0, 3.0, 120.0, "s", "t_s", "time of one way up or down")
    cycles: int = integer(2, 1, 10, "n", "number of times up and down")
    settle_s: float = number(2.0, 0.5, 30.0, "s", "t_0", "time at the lowest tension before the sweep starts")

    def program(self) -> Program:
        """Return the sweep."""
        up_and_down = (TensionLeg(self.F_high, self.sweep_s), TensionLeg(self.F_low, self.sweep_s))
        return Program(Law.TENSION_SWEEP, tension_N=self.F_low, settle_s=self.settle_s, legs=up_and_down * self.cycles)

    def phases(self) -> tuple[Phase, ...]:
        """Return settling and every way up and down."""
        ways = [Phase("settle", "Lowest tension held", 0.0, self.settle_s)]
        for way in range(2 * self.cycles):
            start = self.settle_s + way * self.sweep_s
            name = "up" if way % 2 == 0 else "down"
            ways.append(Phase(f"{name}_{way // 2 + 1}", f"Tension {name}", start, start + self.sweep_s))
        return tuple(ways)
