"""Flight records: the seconds around each trip."""

from datetime import datetime

from pydantic import Field

from backend.messages.base import Schema, quantity


class FlightView(Schema):
    """One trip and the extent of what was kept around it."""

    id: int
    at: datetime
    fault: str
    text: str
    run: int | None
    tick: int = Field(description="tick of the trip, of the loop that ran then")
    before_s: float = quantity("s", "length kept before the trip")
    after_s: float = quantity("s", "length kept after the trip")


class FlightList(Schema):
    """Flight records, newest first."""

    flights: list[FlightView]


class FlightMoment(Schema):
    """The moment of a flight record to show."""

    t: float = quantity("s", "time since the trip", ge=-1e6, le=1e6)
