"""Touch: the outside force, what was learned of it, and the joint that gives way."""

from typing import Literal

from pydantic import Field

from backend.messages.base import ANY_SIZE, Schema, quantity


class TouchPoint(Schema):
    """What is estimated at one stiffness with nothing outside."""

    S: float = quantity("N·m/rad", "joint stiffness at which it was learned")
    F: float = quantity("N", "mean of the estimate with nothing outside, taken off from then on")
    std_N: float = quantity("N", "standard deviation of the estimate at rest")


class ContactView(Schema):
    """The contact that the joint gives way to."""

    F_ext_hat: float = quantity("N", "outside force in the tick in which it was felt")
    contact_N: float = quantity("N", "force from which on it counted as a contact")
    tick: int


class SweepView(Schema):
    """Learning over all of the stiffness by itself: how far it is, or how the last time ended."""

    under_way: bool
    point: int = Field(description="the one that is learned, or was when it ended, from 1")
    points: int
    S_ref: float = quantity("N·m/rad", "stiffness reference at that point", **ANY_SIZE)
    why: str = Field(description="why it ended before its end; empty where it did not")


class TouchView(Schema):
    """What is in force of touch."""

    contact_N: float = quantity("N", "force from which on the joint gives way; 0 for never")
    learned: list[TouchPoint] = Field(description="by rising stiffness; between them straight lines are taken off")
    felt: ContactView | None = Field(description="given way to at present; null for none")
    sweep: SweepView | None = Field(default=None, description="learning over S by itself; null where there was none")


class TouchOrder(Schema):
    """What is to change: null and false leave what is."""

    contact_N: float | None = quantity(
        "N", "force from which on the joint gives way to a contact, 0 for never", default=None, **ANY_SIZE
    )
    learn: bool = Field(default=False, description="take what is estimated now for nothing outside, at this stiffness")
    forget: bool = Field(default=False, description="forget what was learned; with learn, all but that")
    sweep: Literal["begin", "stop"] | None = Field(
        default=None, description="learn over all of the stiffness, point by point, with nobody at the joint; alone"
    )
