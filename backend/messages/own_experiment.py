"""Experiments as texts: written, looked over, kept in versions."""

from datetime import datetime
from typing import Any

from pydantic import Field

from backend.experiments.parser import MAX_CHARACTERS
from backend.messages.base import Schema, quantity
from backend.messages.experiment import DryRunView


class ExperimentText(Schema):
    """An experiment as YAML or JSON; what is taken says ``GET /api/experiments/schema``."""

    text: str = Field(min_length=1, max_length=MAX_CHARACTERS)


class ExperimentToCheck(ExperimentText):
    """An experiment that is looked over."""

    play: bool = Field(default=True, description="play it on the simulator too, which takes its time")


class WrittenExperiment(ExperimentText):
    """An experiment as it was written, and what its text says as plain data."""

    document: dict[str, Any]


class RecordedExperiment(WrittenExperiment):
    """A run as an experiment."""

    left_out: list[str] = Field(description="what happened in the run that the experiment does not repeat")


class PartPlayed(Schema):
    """A part of an experiment as it plays; without a reference before it where the experiment begins."""

    path: list[int | str] = Field(description="where it stands in the document")
    start_s: float = quantity("s", "when it begins for the first time")
    end_s: float = quantity("s", "when it ends for the last time")
    pieces: int = Field(description="pieces that the loop plays of it, all repetitions counted")
    piece_s: float = quantity("s", "length of its first piece")
    q_from: float | None = quantity("rad", "joint reference before its first piece")
    S_from: float | None = quantity("N·m/rad", "stiffness reference before its first piece")
    q_to: float = quantity("rad", "joint reference of its first piece")
    S_to: float = quantity("N·m/rad", "stiffness reference of its first piece")


class CheckedExperiment(Schema):
    """What can be told of an experiment before it is kept or started, its settings at their defaults."""

    name: str
    title: str
    duration_s: float = quantity("s", "length of its program")
    segments: int = Field(description="pieces that the loop plays")
    changes_of_tuning: int
    phases: list[str] = Field(description="titles of its stretches")
    criteria: int = Field(description="bounds that its runs are judged by")
    peak_voltage_V: float | None = quantity("V", "largest voltage on the simulator")
    min_tension_N: float | None = quantity("N", "least tension on the simulator")
    max_tension_N: float | None = quantity("N", "largest tension on the simulator")
    not_predicted: str = Field(description="why there are no peaks, where there are none")
    busy: bool = Field(description="there was no place to play it dry: ask again")
    document: dict[str, Any] = Field(description="what its text says as plain data")
    parts: list[PartPlayed] = Field(description="in the order in which they first play")
    dry_run: DryRunView | None = Field(description="how it went on the simulator, None where it was not played")


class OwnExperiment(Schema):
    """A version of an own experiment."""

    name: str
    version: int
    title: str = Field(description="empty where this version of Sinew does not take it any more")
    who: str
    created: datetime


class OwnExperimentList(Schema):
    """Own experiments by name, or the versions of one, the newest first."""

    experiments: list[OwnExperiment]
