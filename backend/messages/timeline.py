"""Everything that happened, as the log shows it."""

from datetime import datetime
from typing import Annotated

from pydantic import AwareDatetime, Field

from backend.messages.base import Schema, quantity
from backend.storage.events import EventKind
from backend.storage.orm import TAG_MAX

Instant = Annotated[AwareDatetime, Field(json_schema_extra={"maxLength": 40})]
"""A time with its zone; what is longer than that is none."""


class TimelineEntry(Schema):
    """One thing that happened."""

    at: datetime
    kind: EventKind
    who: str = Field(description="who asked for it; empty where nobody did")
    text: str
    event: int | None = Field(description="its number; null of a run that began or ended")
    run: int | None
    t: float | None = quantity("s", "where it stands in the recording of the run, since its first sample")
    flight: bool = Field(description="a flight record of this number was kept")
    note: str
    tags: list[str]
    remark_by: str = Field(description="whose note and tags these are")


class Timeline(Schema):
    """A page of it, newest first."""

    entries: list[TimelineEntry]
    total: int = Field(description="how many there are of what is asked for, these included")
    more_before: datetime | None = Field(description="ask for what was before this; null where there is no more")


class Remark(Schema):
    """What a person says of an event; with neither note nor tags it is taken off."""

    note: str = Field(default="", max_length=10_000)
    tags: list[Annotated[str, Field(max_length=10 * TAG_MAX)]] = Field(
        default=[], max_length=100, description=f"words of at most {TAG_MAX} characters"
    )
