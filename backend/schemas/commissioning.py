"""Bringing a rig up: its steps, what each is about, how it stands, what came of it."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from backend.commissioning import Input, StepId, StepState
from backend.schemas.base import Finite, Schema, quantity


class StepFigure(Schema):
    """One number that a step has measured."""

    words: str
    value: float | None = Field(description="null where it was not measured")
    unit: str


class StepResult(Schema):
    """What a step came to, by whom and when."""

    passed: bool
    text: str
    figures: list[StepFigure]
    who: str
    at: datetime


class RunningStep(Schema):
    """A step that is under way."""

    phase: str
    elapsed_s: float = quantity("s", "time since the step began")
    confirm: str = Field(description="what a person is asked to do and to confirm now; empty for nothing")


class BringUpStep(Schema):
    """One step; ``why`` tells how its state comes about, ``blocked`` why it cannot be started now."""

    id: StepId
    title: str
    instruction: str
    inputs: list[Input]
    state: StepState
    why: str
    blocked: str
    result: StepResult | None
    running: RunningStep | None


class EarlierLockout(Schema):
    """Who had the drives off, as hands were to be at the rig, and when."""

    who: str
    at: datetime


class BringUpView(Schema):
    """The whole of it, in the order of the steps; ``why_not`` tells where there is nothing to be brought up."""

    applies: bool
    why_not: str
    drives_on: bool | None = Field(description="whether the drive-enable line is on; null where it is not seen")
    drives_locked: bool = Field(description="whether they stay off, and nothing starts, until they are switched on")
    drives_left: EarlierLockout | None = Field(
        description="who left them off before this service was started, where nobody has switched them since"
    )
    steps: list[BringUpStep]


class DrivesRequest(Schema):
    """Take the drives away, or give them back."""

    on: bool


class StepValues(Schema):
    """Numbers that a step asks for, by name; what is left out is as its default."""

    values: dict[Annotated[str, Field(max_length=40)], Finite] = Field(default_factory=dict, max_length=20)
