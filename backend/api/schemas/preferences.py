"""How a person likes the page; nothing here reaches the loop."""

from typing import Annotated, Literal

from pydantic import Field

from backend.api.schemas.base import Schema, quantity

SignalColours = dict[Annotated[str, Field(max_length=20)], Annotated[str, Field(pattern="^#[0-9a-fA-F]{6}$")]]


class Preferences(Schema):
    """What the page remembers for one person, on every machine."""

    scheme: Literal["light", "dark", "auto"] = "auto"
    colours: SignalColours = Field(
        default_factory=dict, max_length=40, description="own colour of a signal as #rrggbb; its reference follows it"
    )
    hidden: list[Annotated[str, Field(max_length=20)]] = Field(
        default_factory=list, max_length=40, description="signals switched off in the charts"
    )
    window_s: float = quantity("s", "length of the following window", default=20.0, ge=5.0, le=120.0)
    statistics: bool = Field(default=False, description="figures of the visible range are shown")
    solid: bool | None = Field(
        default=None, description="3D view instead of the flat drawing; null: as the browser can"
    )
    toured: bool = Field(default=False, description="the first-run tour was seen or dismissed")
