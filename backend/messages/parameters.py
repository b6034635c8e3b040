"""The parameters in force: what the controller knows of motors and springs, by versions over the parameter file."""

from datetime import datetime

from pydantic import Field

from backend.messages.base import RowNumber, Schema


class ParameterChange(Schema):
    """An entry that a version changes, of one side; null where it has no such entry before or after."""

    name: str
    side: str
    unit: str
    before: float | None
    after: float | None
    percent: float | None = Field(description="change in per cent of what it was; null where it was 0 or nothing")


class ParameterVersion(Schema):
    """A version; number 0 is the parameter file as it is."""

    number: int
    digest: str = Field(description="of all numbers with their sources, as lineage shows it")
    who: str
    at: datetime | None
    estimate: int | None = Field(description="stored identification that its values came from last")
    run: int | None = Field(description="run of that identification; null for a table")
    undone: bool = Field(description="whether it put a former version back")
    changes: list[ParameterChange] = Field(description="against the version before")


class ParameterProposal(Schema):
    """What applying an identification would change, or why it cannot be applied."""

    estimate: int
    problem: str = Field(description="why it cannot be applied; empty where it can")
    digest: str
    changes: list[ParameterChange]


class ParametersView(Schema):
    """The set in force, newest version first, and what was asked about an identification."""

    name: str
    versions: list[ParameterVersion]
    proposal: ParameterProposal | None


class ApplyRequest(Schema):
    """The stored identification to apply, of motors or springs, by the number of its estimate."""

    estimate: RowNumber


class UndoRequest(Schema):
    """The version to undo: the newest, as whoever undoes it sees it."""

    version: RowNumber
