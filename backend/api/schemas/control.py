"""Control of the actuator: who holds it, and how it is taken."""

from pydantic import Field

from backend.api.schemas.base import Schema, quantity


class ControlRequest(Schema):
    """Take control; over from somebody else only if that is said."""

    take_over: bool = Field(default=False, description="take control although somebody else holds it")


class Lease(Schema):
    """Control was given: commands carry ``Sinew-Control: epoch.sequence`` with a sequence that grows."""

    epoch: int
    name: str


class HolderView(Schema):
    """Who holds control."""

    name: str
    epoch: int
    page: bool = Field(description="a page, which is missed when it falls silent, or a script")
    silent_s: float = quantity("s", "time since the holder was last heard")
    lost: bool = Field(description="not heard any more: references are held, a soft stop follows")
