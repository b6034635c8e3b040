"""Flight records: the seconds around each trip and each trigger."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from backend.messages.base import Schema, quantity


class FlightView(Schema):
    """One trip or trigger, and the extent of what was kept around it."""

    id: int
    at: datetime
    kind: Literal["trip", "trigger"]
    who: str = Field(description="who pressed STOP or armed the trigger; empty where nobody did")
    fault: str = Field(description="what tripped; of a trigger the word trigger")
    text: str
    run: int | None
    tick: int = Field(description="tick of the trip or trigger, of the loop that ran then")
    before_s: float = quantity("s", "length kept before it")
    after_s: float = quantity("s", "length kept from it on")


class FlightList(Schema):
    """Flight records, newest first."""

    flights: list[FlightView]


class FlightMoment(Schema):
    """The moment of a flight record to show."""

    t: float = quantity("s", "time since the trip or trigger", ge=-1e6, le=1e6)
