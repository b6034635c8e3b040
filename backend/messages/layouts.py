"""Layouts of the charts: which panels, and which signals in each."""

from collections import Counter
from collections.abc import Collection
from typing import Annotated, Literal

from pydantic import Field

from backend.errors import Because, RefusalError
from backend.messages.base import Schema, quantity
from backend.plain_text import ONE_LINE
from backend.sample import UNIT_OF

_NAME = "[A-Za-z][A-Za-z0-9_]{0,19}"
Drawn = Annotated[str, Field(max_length=43, pattern=f"^{_NAME}( - {_NAME})?$")]
"""A column of the sample, a difference of two, or a derived signal."""

LayoutName = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^\S(.*\S)?$"), ONE_LINE]


class ChartPanel(Schema):
    """One chart: signals of one unit over time, or over another signal."""

    title: LayoutName
    signals: list[Drawn] = Field(max_length=8, description="what is drawn, in this order")
    over: Drawn | None = Field(description="signal along the other axis; null for time")
    share: float = quantity("1", "height, as a multiple of that of a plain panel", ge=0.5, le=4.0)


class ChartLayout(Schema):
    """A stack of panels under a name."""

    version: Literal[1]
    name: LayoutName
    panels: list[ChartPanel] = Field(min_length=1, max_length=12)


def look_over(layouts: list[ChartLayout], formulas: Collection[str] = ()) -> None:
    """Raise RefusalError for what no chart can show: signals that are not there, several units on one axis.

    ``formulas`` are the names of derived signals, also of removed ones: their units are for the page to look at.
    """
    _once([layout.name for layout in layouts], "layout of the charts")
    for layout in layouts:
        _once([panel.title for panel in layout.panels], f"panel of layout “{layout.name}”")
        for panel in layout.panels:
            _look_over_panel(panel, layout.name, formulas)
        if all(panel.over is not None for panel in layout.panels):
            raise _refused(f"layout “{layout.name}” has no panel over time; add one: its time axis is that of all")


def _look_over_panel(panel: ChartPanel, layout: str, formulas: Collection[str]) -> None:
    where = f"panel “{panel.title}” of layout “{layout}”"
    for name in (*panel.signals, *filter(None, [panel.over])):
        if name not in UNIT_OF and name not in formulas:
            raise _refused(f"{where}: there is no signal {name}", legal=UNIT_OF)
    _once(panel.signals, f"signal in {where}")
    units = {UNIT_OF[name]: name for name in reversed(panel.signals) if name in UNIT_OF}
    if len(units) > 1:
        told = " and ".join(f"{name} in {unit}" for unit, name in reversed(units.items()))
        raise _refused(f"{where} has {told}: one panel has one unit; put them into panels of their own")


def _once(names: list[str], what: str) -> None:
    name, count = max(Counter(names).items(), key=lambda item: item[1], default=("", 0))
    if count > 1:
        raise _refused(f"{what}: “{name}” is there {count} times; once is enough")


def _refused(message: str, legal: dict[str, str] | None = None) -> RefusalError:
    return RefusalError(Because.BAD_VALUE, message, code="bad_layout", legal=legal)
