"""Where things came from, what happened in a run, and how far the set-up has got."""

from datetime import datetime
from enum import StrEnum

from pydantic import Field

from backend.messages.base import Schema, quantity

LONGEST_S = 1e9
"""Longer than any recording [s]: thirty years."""


class LineageBank(Schema):
    """A bank that a run used or that was built from it."""

    id: int
    name: str
    version: int


class LineageEntry(Schema):
    """Where an entry of the bank in use came from."""

    name: str = Field(description="what the entry is called, by its tension")
    S_nominal: float = quantity("N·m/rad", "nominal point")
    run: int | None = Field(description="identification run; null for data from elsewhere or from geometry")


class LineageKind(StrEnum):
    """What a box of the lineage is about."""

    RUN = "run"
    GAINS = "gains"
    BANK = "bank"
    IDENTIFICATION = "identification"
    DATA = "data"
    PARAMETERS = "parameters"
    CALIBRATION = "calibration"


class LineageNode(Schema):
    """A box of the lineage; ``run``, ``bank`` and ``identification`` say which page tells more of it."""

    id: str
    kind: LineageKind
    title: str
    detail: str
    sha256: str | None = Field(description="digest of its content, in hex")
    no_sha256: str = Field(description="why there is no digest")
    out_of_date: str = Field(description="what holds no more, empty where all does")
    run: int | None = Field(description="the run it is, or the run whose samples it is")
    bank: int | None
    identification: int | None = Field(description="the identification by the number of its run")
    origins: list[str] = Field(description="ids of what it came from")


class Lineage(Schema):
    """Back to raw data and forth to what came of it."""

    run: int
    software: str
    parameters: str
    parameters_as_now: bool = Field(description="the plant's parameters are still those of this run")
    bank: LineageBank | None = Field(description="bank in use; null while the gains came from geometry")
    entries: list[LineageEntry]
    banks_built: list[LineageBank] = Field(description="banks with an entry that was identified from this run")
    runs_with_them: list[int] = Field(description="newest runs that used these banks")
    nodes: list[LineageNode] = Field(description="the same as boxes, each with a digest of its content")


class RunMark(Schema):
    """Something that happened during a run."""

    t: float = quantity("s", "time since the run's first sample")
    kind: str
    text: str
    who: str


class RunMarks(Schema):
    """What happened during a run, in order."""

    marks: list[RunMark]


class PlannedPart(Schema):
    """A named part of a program."""

    title: str
    start_s: float = quantity("s", "begin, from that of the program")
    end_s: float = quantity("s", "end, from the begin of the program")


class PlannedLine(Schema):
    """What is asked for of one signal of the sample."""

    name: str = Field(description="of the sample's column")
    unit: str
    values: list[float | None] = Field(description="null where the plan leaves it open")


class Planned(Schema):
    """What a program asks for over its whole length, known before it plays.

    Of an experiment the references and pushes, where it has any; of an identification its set points and excitation:
    motor references without the force loop's trim, the voltage of steps, the tension that motor references give at
    q = 0.
    """

    t: list[float] = Field(description="times since the program began [s]")
    lines: list[PlannedLine]
    parts: list[PlannedPart]


class ReplayRequest(Schema):
    """The moment to show."""

    t: float = quantity("s", "time since the run's first sample", ge=0.0, le=LONGEST_S)


class ChecklistState(StrEnum):
    """How far a step of the set-up is."""

    MISSING = "missing"
    DONE = "done"
    OUTDATED = "outdated"
    UNUSABLE = "unusable"


class ChecklistStep(Schema):
    """One step from pretension to report."""

    name: str
    state: ChecklistState
    detail: str = Field(description="what there is, or why it no longer holds")
    run: int | None
    at: datetime | None


class Checklist(Schema):
    """The set-up in order; each step builds on those before."""

    steps: list[ChecklistStep]
