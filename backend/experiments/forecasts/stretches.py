"""What a program of identification does when: its set points in turn, and what is done at each. Pure."""

from dataclasses import dataclass
from enum import StrEnum

from backend.realtime.program import Law


class Stage(StrEnum):
    """What is done at a set point, in the order in which it is done."""

    TRAVELLING = "on the way"
    SETTLING = "settling"
    WINDING = "winding"
    EXCITING = "exciting"
    BRAKING = "braking"


@dataclass(frozen=True)
class Stretch:
    """Ticks ``begin`` .. ``end`` of a program, from its first one as 0: one stage of the set point ``number`` ``of``.

    ``set_point`` is a tension [N], of voltage steps a voltage [V].
    """

    number: int
    of: int
    set_point: float
    stage: Stage
    begin: int
    end: int


def titled(law: Law, set_point: float) -> str:
    """Name a set point as it is read: "20 N", "−3.5 V"."""
    return f"{set_point:g} {'V' if law is Law.MOTOR_STEPS else 'N'}".replace("-", "−")
