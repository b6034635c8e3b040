"""What the loop can play by itself: references over time, an excitation, an external push.

A program is plain data, sent whole before it starts, so that its timing is the loop's own and no message has to
arrive in time while it plays.
"""

from dataclasses import dataclass
from enum import StrEnum


class Law(StrEnum):
    """Which control law a program runs under."""

    CASCADE = "cascade"
    COMPLIANCE = "compliance"
    FORCE_HOLD = "force_hold"


class Shape(StrEnum):
    """How a segment moves from the previous segment's values to its own."""

    STEP = "step"
    RAMP = "ramp"
    SINE = "sine"


@dataclass(frozen=True)
class Segment:
    """One stretch of a program.

    ``STEP`` jumps to the values at once and holds them; ``RAMP`` moves linearly and arrives at the end;
    ``SINE`` oscillates around the previous values with the difference as amplitude and ``period_s``.
    """

    duration_s: float
    q_ref: float
    S_ref: float
    F_push: float = 0.0
    shape: Shape = Shape.STEP
    period_s: float = 1.0


@dataclass(frozen=True)
class Excitation:
    """Binary sequence added to theta_A_ref (method section 4).

    ``levels`` is one period, a character per chip: "+" adds the amplitude, "-" subtracts it. It is repeated
    ``periods`` times.
    """

    amplitude_rad: float
    chip_s: float
    levels: str
    periods: int

    @property
    def duration_s(self) -> float:
        """Length of the whole excitation [s]."""
        return self.periods * len(self.levels) * self.chip_s


@dataclass(frozen=True)
class Program:
    """A law and what it is fed.

    Under ``CASCADE`` and ``COMPLIANCE`` the segments are played. Under ``FORCE_HOLD`` (actuator identification,
    figure 5 of the paper) theta_B_ref is 0, a slow force loop holds ``tension_N``, and after ``settle_s`` the
    excitation starts; segments stay empty.
    """

    law: Law
    segments: tuple[Segment, ...] = ()
    tension_N: float = 0.0
    settle_s: float = 0.0
    excitation: Excitation | None = None

    @property
    def duration_s(self) -> float:
        """Length of the whole program [s]."""
        if self.excitation is not None:
            return self.settle_s + self.excitation.duration_s
        return sum(segment.duration_s for segment in self.segments)
