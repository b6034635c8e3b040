"""Schemas of chart layouts and of a person's preferences for the page."""

from collections import Counter
from collections.abc import Collection, Iterable
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from backend.errors import RequestRejectedError
from backend.plain_text import ONE_LINE
from backend.sample import UNIT_BY_SIGNAL
from backend.schemas import messages
from backend.schemas.base import Schema, quantity
from backend.units import AngleUnit
from plant import ErrorCode, Message

# Chart layouts -------------------------------------------------------------------------------------


_NAME = "[A-Za-z][A-Za-z0-9_]{0,19}"
ChartSignal = Annotated[str, Field(max_length=43, pattern=f"^{_NAME}( - {_NAME})?$")]
"""A column of the sample, a difference of two, or a derived signal."""

LayoutName = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^\S(.*\S)?$"), ONE_LINE]


class ChartPanel(Schema):
    """A chart of signals with one unit against time or another signal."""

    title: LayoutName
    signals: list[ChartSignal] = Field(max_length=8, description="signals to draw, in this order")
    over: ChartSignal | None = Field(description="signal of the horizontal axis; null for time")
    share: float = quantity("1", "height as a multiple of the default panel height", ge=0.5, le=4.0)


class ChartLayout(Schema):
    """A named list of panels."""

    version: Literal[1]
    name: LayoutName
    panels: list[ChartPanel] = Field(min_length=1, max_length=12)


def check_preferences(layouts: list[ChartLayout], formulas: Collection[str] = ()) -> None:
    """Check that the signals of layouts exist and each panel has one unit.

    ``formulas`` are the names of derived signals, including deleted ones; the page checks their units. Raises
    RequestRejectedError.
    """
    if duplicate := _find_duplicate(layout.name for layout in layouts):
        raise _build_error(messages.duplicate_layout(layout=duplicate.name, count=duplicate.occurrences))
    for layout in layouts:
        if duplicate := _find_duplicate(panel.title for panel in layout.panels):
            raise _build_error(
                messages.duplicate_panel(layout=layout.name, panel=duplicate.name, count=duplicate.occurrences)
            )
        for panel in layout.panels:
            _check_panel(panel, layout.name, formulas)
        if all(panel.over is not None for panel in layout.panels):
            raise _build_error(messages.no_panel_over_time(layout=layout.name))


def _check_panel(panel: ChartPanel, layout: str, formulas: Collection[str]) -> None:
    for name in (*panel.signals, *filter(None, [panel.over])):
        if name not in UNIT_BY_SIGNAL and name not in formulas:
            message = messages.unknown_signal(layout=layout, panel=panel.title, signal=name)
            raise _build_error(message, legal=UNIT_BY_SIGNAL)
    if duplicate := _find_duplicate(panel.signals):
        raise _build_error(
            messages.duplicate_signal(
                layout=layout, panel=panel.title, signal=duplicate.name, count=duplicate.occurrences
            )
        )
    units = {UNIT_BY_SIGNAL[name]: name for name in reversed(panel.signals) if name in UNIT_BY_SIGNAL}
    if len(units) > 1:
        signals = " and ".join(f"{name} in {unit}" for unit, name in reversed(units.items()))
        raise _build_error(messages.several_units(layout=layout, panel=panel.title, signals=signals))


class _Duplicate(NamedTuple):
    name: str
    occurrences: int


def _find_duplicate(names: Iterable[str]) -> _Duplicate | None:
    """Return the most frequent name, None if each occurs once."""
    name, count = max(Counter(names).items(), key=lambda item: item[1], default=("", 0))
    return _Duplicate(name, count) if count > 1 else None


def _build_error(message: Message, legal: dict[str, str] | None = None) -> RequestRejectedError:
    return RequestRejectedError(ErrorCode.BAD_VALUE, message, code="bad_layout", legal=legal)


# Preferences ---------------------------------------------------------------------------------------


SignalName = Annotated[str, Field(max_length=20, pattern="^[A-Za-z][A-Za-z_]{0,19}$")]
SignalColours = dict[SignalName, Annotated[str, Field(max_length=7, pattern="^#[0-9a-fA-F]{6}$")]]


class Preferences(Schema):
    """Settings of the page for one person, on every machine.

    They do not affect the control loop.
    """

    scheme: Literal["light", "dark", "auto"]
    colours: SignalColours = Field(
        max_length=40, description="custom colour of a signal as #rrggbb; its reference has the same colour"
    )
    hidden: list[ChartSignal] = Field(max_length=60, description="signals switched off in the charts")
    layout: LayoutName = Field(description="name of the active chart layout, custom or built-in")
    layouts: list[ChartLayout] = Field(max_length=20, description="custom chart layouts")
    clock: bool = Field(description="whether the time axis shows the time of day; else the time since the start")
    window_s: float = quantity("s", "length of the time window that follows the newest sample", ge=5.0, le=120.0)
    statistics: bool = Field(description="whether the charts show statistics of the visible range")
    solid: bool | None = Field(
        description="whether the 3D view replaces the 2D drawing in a browser that uses a graphics "
        "processor; null if not chosen"
    )
    solid_unaided: bool | None = Field(
        description="the same for a browser that renders without a graphics processor, which slows the "
        "page; null if not chosen"
    )
    camera: str = Field(max_length=20, pattern="^[A-Za-z]{1,20}$", description="name of the camera of the 3D view")
    toured: bool = Field(description="whether the first-run tour was completed or dismissed")
    notify: bool = Field(
        description="whether the page notifies the person of ended runs and of trips while no tab is "
        "visible; each browser must also permit notifications"
    )
    sound: bool = Field(description="whether the page plays a short sound for the same events")
    angles: AngleUnit = Field(description="unit of angles on the page, in error messages and in reports")


DEFAULT_PREFERENCES = Preferences(
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
    angles=AngleUnit.DEGREES,
)
"""Preferences of a person who has not changed any."""
