"""How a person likes the page; nothing here reaches the loop."""

from typing import Annotated, Literal

from pydantic import Field

from backend.messages.base import Schema, quantity
from backend.messages.layouts import ChartLayout, Drawn, LayoutName
from backend.units import Angles

SignalName = Annotated[str, Field(max_length=20, pattern="^[A-Za-z][A-Za-z_]{0,19}$")]
SignalColours = dict[SignalName, Annotated[str, Field(max_length=7, pattern="^#[0-9a-fA-F]{6}$")]]


class Preferences(Schema):
    """What the page remembers for one person, on every machine."""

    scheme: Literal["light", "dark", "auto"]
    colours: SignalColours = Field(
        max_length=40, description="own colour of a signal as #rrggbb; its reference follows it"
    )
    hidden: list[Drawn] = Field(max_length=60, description="signals switched off in the charts")
    layout: LayoutName = Field(description="name of the charts' layout in use: an own one, or one of the page's")
    layouts: list[ChartLayout] = Field(max_length=20, description="own layouts of the charts")
    clock: bool = Field(description="the time axis tells the time of day; else the time since the start")
    window_s: float = quantity("s", "length of the following window", ge=5.0, le=120.0)
    statistics: bool = Field(description="figures of the visible range are shown")
    solid: bool | None = Field(
        description="3D view instead of the flat drawing where the browser has a graphics processor; null: not chosen"
    )
    solid_unaided: bool | None = Field(
        description="the same where the browser paints without a graphics processor, which slows the page; "
        "null: not chosen"
    )
    camera: str = Field(
        max_length=20, pattern="^[A-Za-z]{1,20}$", description="name of the camera that the 3D view is seen from"
    )
    toured: bool = Field(description="the first-run tour was seen or dismissed")
    notify: bool = Field(
        description="notifications, while no tab is in sight, of runs that are over and of trips; "
        "each browser has to allow them besides"
    )
    sound: bool = Field(description="a short sound for the same")
    angles: Angles = Field(description="unit in which angles are read: on the page, in refusals and in reports")


NEW_HERE = Preferences(
    scheme="auto",
    colours={},
    hidden=[],
    layout="Standard",
    layouts=[],
    clock=False,
    window_s=20.0,
    statistics=False,
    solid=None,
    solid_unaided=None,
    camera="Front",
    toured=False,
    notify=False,
    sound=False,
    angles=Angles.DEGREES,
)
"""What somebody starts with who has chosen nothing yet."""
