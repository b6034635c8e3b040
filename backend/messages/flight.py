"""Flight records: the seconds around each trip."""

from datetime import datetime

from backend.messages.base import Schema, quantity


class FlightView(Schema):
    """One trip and the extent of what was kept around it."""

    id: int
    at: datetime
    fault: str
    text: str
    run: int | None
    before_s: float = quantity("s", "length kept before the trip")
    after_s: float = quantity("s", "length kept after the trip")


class FlightList(Schema):
    """Flight records, newest first."""

    flights: list[FlightView]
