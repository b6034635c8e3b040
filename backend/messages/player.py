"""The player of a recording that stands in place of a plant: where it is, and what it is asked for."""

from pydantic import Field

from backend.messages.base import ANY_SIZE, HUGE, Schema, quantity
from backend.messages.history import RunMark


class PlayerView(Schema):
    """Where the player stands; ``t`` holds for ``tick``, and grows by ``speed`` from there on while it plays."""

    title: str = Field(description="what is played: the run, else the name of the file")
    t: float = quantity("s", "time in the recording, from its first sample")
    tick: int
    duration_s: float = quantity("s", "time of its last sample")
    playing: bool
    ended: bool = Field(description="whether it stands at the last sample")
    speed: float = Field(description="seconds of the recording in a second")
    speed_min: float
    speed_max: float


class PlayerOrder(Schema):
    """What the player is to do; null leaves a thing as it is."""

    playing: bool | None = None
    speed: float | None = Field(
        default=None, ge=-HUGE, le=HUGE, description="seconds of the recording in a second; its bounds are in the state"
    )
    t: float | None = quantity("s", "time in the recording to go to", default=None, **ANY_SIZE)


class PlayedRecording(Schema):
    """The recording that is played, and what happened in it."""

    title: str
    run: int | None = Field(description="number of the run that the file says it holds; null where it says none")
    duration_s: float = quantity("s", "time of its last sample")
    marks: list[RunMark] = Field(description="what happened, in order; t from the first sample")
