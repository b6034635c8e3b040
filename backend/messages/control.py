"""Control of the actuator: who holds it, and how it is taken."""

from typing import Annotated

from pydantic import Field

from backend.messages.base import Schema, quantity

PageKey = Annotated[str, Field(max_length=16, pattern="^[A-Za-z0-9_-]{16}$")]


class ControlRequest(Schema):
    """Take control; over from somebody else only if that is said."""

    take_over: bool = Field(default=False, description="take control although somebody else holds it")
    resume: PageKey | None = Field(
        default=None, description="the key of this page before it was loaded again: goes on, or is refused"
    )


class Lease(Schema):
    """Control was given: commands carry ``Sinew-Control: page.sequence``, the sequence counting 1, 2, 3 ..."""

    epoch: int
    page: PageKey = Field(description="known to this page alone, told to nobody else")
    name: str


class HolderView(Schema):
    """Who holds control."""

    name: str
    epoch: int
    page: bool = Field(description="a page, which is missed when it falls silent, or a script")
    silent_s: float = quantity("s", "time since the holder was last heard")
    lost: bool = Field(description="not heard any more: references are held, a soft stop follows")
