"""The JSON messages of the websocket /api/live; the samples themselves travel in binary frames (backend.wire)."""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field

from backend.messages.base import Schema, quantity
from backend.messages.control import PageKey
from backend.messages.state import State

Whole = Annotated[int, Field(ge=0, le=2**53)]


class FieldView(Schema):
    """One column of a binary frame."""

    name: str
    symbol: str
    unit: str
    meaning: str


class LayoutMessage(Schema):
    """First message: how to read everything after it."""

    type: Literal["layout"] = "layout"
    fields: list[FieldView]
    period_s: float = quantity("s", "sampling period")
    modes: list[str] = Field(description="mode by its code in the sample")
    faults: list[str] = Field(description="fault by its code in the sample")
    limits: dict[str, int] = Field(description="bit of each limit in the sample")


class StateMessage(State):
    """The state, at once, on each change and at least twice a second."""

    type: Literal["state"] = "state"


class MarkKind(StrEnum):
    """What a mark on the time axis is about."""

    MODE = "mode"
    TUNING = "tuning"
    BANK = "bank"
    FAULT = "fault"
    TRIP = "trip"
    TRIGGER = "trigger"
    REFERENCES = "references"
    NOTE = "note"


class EventMessage(Schema):
    """A mark on the time axis."""

    type: Literal["event"] = "event"
    tick: int
    kind: MarkKind
    text: str


class Ping(Schema):
    """Asked by the page to measure the link; ``control`` is the key of the control it holds, if it does."""

    type: Literal["ping"] = "ping"
    id: Whole
    control: PageKey | None = None


class Pong(Schema):
    """Answer to a ping."""

    type: Literal["pong"] = "pong"
    id: int


LiveMessage = LayoutMessage | StateMessage | EventMessage | Pong
