"""Touch: the outside force, what was learned of it, and the joint that gives way."""

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


class TouchView(Schema):
    """What is in force of touch."""

    contact_N: float = quantity("N", "force from which on the joint gives way; 0 for never")
    learned: list[TouchPoint] = Field(description="by rising stiffness; between them straight lines are taken off")
    felt: ContactView | None = Field(description="given way to at present; null for none")


class TouchOrder(Schema):
    """What is to change: null and false leave what is."""

    contact_N: float | None = quantity(
        "N", "force from which on the joint gives way to a contact, 0 for never", default=None, **ANY_SIZE
    )
    learn: bool = Field(default=False, description="take what is estimated now for nothing outside, at this stiffness")
    forget: bool = Field(default=False, description="forget what was learned; with learn, all but that")
