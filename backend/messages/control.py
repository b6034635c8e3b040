"""Control of the actuator: who holds it, and how it is taken."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from backend.messages.base import RowNumber, Schema, quantity

PageKey = Annotated[str, Field(max_length=16, pattern="^[A-Za-z0-9_-]{16}$")]


class ControlRequest(Schema):
    """Take control; over from somebody else only if that is said."""

    take_over: bool = Field(default=False, description="take control although somebody else holds it")
    resume: PageKey | None = Field(
        default=None, description="the key of this page before it was loaded again: goes on, or is refused"
    )
    handed: RowNumber | None = Field(
        default=None, description="the number under which it was handed over or offered: takes that, or is refused"
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


Reason = Annotated[str, Field(max_length=200, description="why, in a few words; stands in the log")]


class Wish(Schema):
    """Ask whoever holds control for it, or offer it to somebody as the page that holds it."""

    reason: Reason
    to: str | None = Field(default=None, max_length=60, description="to whom it is offered; null asks for it")


class Answer(StrEnum):
    """What one of the two says to a request or an offer."""

    HAND_OVER = "hand_over"
    DECLINE = "decline"
    """Of the holder: keep control; of who is offered it: do not take it; also what either takes back."""


class WishAnswer(Schema):
    """What is said to a request or an offer; whoever keeps control says why."""

    answer: Answer
    reason: Reason = ""


class Standing(StrEnum):
    """How a request or an offer stands: the first three wait for somebody, the others are its end."""

    ASKED = "asked"
    OFFERED = "offered"
    HANDED = "handed"
    """To who asked for it, whose page takes it now."""

    TAKEN = "taken"
    DECLINED = "declined"
    WITHDRAWN = "withdrawn"
    LAPSED = "lapsed"
    LEFT = "left"
    FREED = "freed"
    """Control was given up or lost, or who offered it does not hold it any more."""


OPEN_WISHES = (Standing.ASKED, Standing.OFFERED, Standing.HANDED)
"""Those that wait for somebody."""


class WishView(Schema):
    """Control that somebody asks for, or that is offered to somebody."""

    number: int
    name: str = Field(description="who is to have it")
    by: str = Field(description="who holds it: is asked, or offers it")
    reason: str
    standing: Standing
    answer: str = Field(description="why it was declined, or what was said beside handing it over")
    offered: bool = Field(description="offered without being asked for")
    epoch: int | None = Field(description="what others know the control by that was taken by this; null before")
