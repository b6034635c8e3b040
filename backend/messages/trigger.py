"""The trigger: what is waited for, and what it does at present."""

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from backend.messages.base import HUGE, Schema, quantity
from backend.recording.trigger import ConditionKind

LONGEST_S = 60.0
"""Longest time before a trigger, which the ring still holds, and longest time after it."""

CAPTURES_MAX = 100

_Value = Annotated[float, Field(ge=-HUGE, le=HUGE)]


class TriggerOrder(Schema):
    """A condition on one signal, and how much is kept around it."""

    signal: str = Field(max_length=40, description="name of a signal of the sample, of a combined one, or of a formula")
    condition: ConditionKind = Field(description="a level, an edge through a level, or a window")
    level: _Value = Field(description="level, or lower end of the window, in the SI unit of the signal")
    upper: _Value | None = Field(default=None, description="upper end of the window; null without a window")
    before_s: float = quantity("s", "time kept before the trigger", default=1.0, ge=0.0, le=LONGEST_S)
    after_s: float = quantity("s", "time kept from the trigger on", default=1.0, ge=0.001, le=LONGEST_S)
    captures: int = Field(default=1, ge=1, le=CAPTURES_MAX, description="how many are made before it disarms itself")


class TriggerView(TriggerOrder):
    """What was armed last, and what it does at present."""

    unit: str = Field(description="SI unit of the signal")
    says: str = Field(description="the condition in words, in SI")
    who: str
    at: datetime
    phase: Literal["armed", "capturing", "ended"]
    captured: int = Field(description="captures made so far")
    left_s: float = quantity("s", "time until the capture under way is complete; 0 while none is")
    ended: str = Field(description="why it waits for nothing any more; empty while it does")
