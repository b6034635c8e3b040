"""Schemas of commissioning: steps with state and result, and drive lockout."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from backend.commissioning import Input, StepId, StepState
from backend.schemas.base import Finite, Schema, quantity


class StepFigure(Schema):
    """A value that a step has measured."""

    words: str
    value: float | None = Field(description="null if it was not measured")
    unit: str


class StepResult(Schema):
    """Result of a step, with person and time."""

    passed: bool
    text: str
    figures: list[StepFigure]
    who: str
    at: datetime


class RunningStep(Schema):
    """The current step."""

    phase: str
    elapsed_s: float = quantity("s", "time since the step began")
    confirm: str = Field(description="instruction that the operator has to confirm now; else empty")


class BringUpStep(Schema):
    """One step.

    ``why`` is the reason for its state, ``blocked`` the reason why it cannot start now.
    """

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
    """Drive lockout set before this service started, with person and time."""

    who: str
    at: datetime


class BringUpView(Schema):
    """Commissioning of the plant, in the order of its steps.

    ``why_not`` is the reason why it does not apply.
    """

    applies: bool
    why_not: str
    drives_on: bool | None = Field(description="whether the drive-enable line is on; null if unknown")
    drives_locked: bool = Field(description="whether the drive lockout is active, so that nothing starts")
    drives_left: EarlierLockout | None = Field(
        description="lockout set before this service started; null if there is none"
    )
    steps: list[BringUpStep]


class DrivesRequest(Schema):
    """Whether to enable the drives, or to start the drive lockout."""

    on: bool


class StepValues(Schema):
    """Inputs of a step by name; others have their defaults."""

    values: dict[Annotated[str, Field(max_length=40)], Finite] = Field(default_factory=dict, max_length=20)
