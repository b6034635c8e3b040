"""Experiments as texts: written, looked over, kept in versions."""

from datetime import datetime

from pydantic import Field

from backend.experiments.composing.text import MAX_CHARACTERS
from backend.messages.base import Schema, quantity


class ExperimentText(Schema):
    """An experiment as YAML or JSON; what is taken says ``GET /api/experiments/schema``."""

    text: str = Field(min_length=1, max_length=MAX_CHARACTERS)


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


class OwnExperiment(Schema):
    """The newest version of an own experiment."""

    name: str
    version: int
    title: str = Field(description="empty where this version of Sinew does not take it any more")
    who: str
    created: datetime


class OwnExperimentList(Schema):
    """Own experiments, by name."""

    experiments: list[OwnExperiment]
