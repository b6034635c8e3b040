"""Schemas of the comparison of runs with a reference run."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated

from pydantic import Field

from backend.schemas.base import HUGE, Finite, RowNumber, Schema, quantity
from backend.schemas.run import LONGEST_S
from backend.schemas.state import MarkKind

MOST_NUMBER = 100_000
"""Bound of the number of a step or an event in a run."""


class AlignBy(StrEnum):
    """Event by which the time axes of runs are aligned."""

    BEGIN = "begin"
    STEP = "step"
    EVENT = "event"


class StepSignal(StrEnum):
    """Signals with steps, to align runs by."""

    Q_REF = "q_ref"
    S_REF = "S_ref"
    F_PUSH = "F_push"


class ComparisonRequest(Schema):
    """Runs to compare, reference run and alignment.

    ``number`` counts steps or events from 1.
    """

    run: list[RowNumber] = Field(min_length=1, max_length=100, description="runs to compare, in order")
    reference: RowNumber | None = Field(
        default=None, description="reference run of the differences; the first run if omitted"
    )
    by: AlignBy = Field(default=AlignBy.BEGIN, description="event to which the runs are aligned")
    step: StepSignal = Field(default=StepSignal.Q_REF, description="signal of the step")
    event: MarkKind = Field(default=MarkKind.TRIP, description="kind of the event")
    number: int = Field(default=1, ge=1, le=MOST_NUMBER, description="number of the step or event in each run, from 1")


class DifferencesRequest(ComparisonRequest):
    """Signal to compare, time range of the reference, and tolerance band."""

    signal: Annotated[str, Field(max_length=40)] = "q"
    from_s: Finite = Field(
        default=0.0, ge=0.0, le=LONGEST_S, description="start, on the time axis of the reference [s]"
    )
    to_s: Finite = Field(
        default=LONGEST_S, gt=0.0, le=LONGEST_S, description="end, on the time axis of the reference [s]"
    )
    points: int = Field(
        default=2000, ge=10, le=20000, description="maximum number of points; a longer range is sent as its envelope"
    )
    band: Finite = Field(
        default=HUGE, ge=0.0, le=HUGE, description="half-width of the tolerance band, in the signal's unit"
    )


class ComparedRun(Schema):
    """One of the compared runs."""

    id: int
    title: str
    kind: str
    station: str
    who: str
    started: datetime
    verdict: str = Field(description="verdict in one sentence")
    aligned_at_s: float | None = quantity("s", "aligned time since the run's first sample; null if not aligned")
    offset_s: float | None = quantity("s", "shift of its times to the time axis of the reference; null if not aligned")
    not_aligned: str = Field(description="why it is not aligned")


class ComparedValue(Schema):
    """A metric of one run."""

    value: float | None
    reason: str = Field(description="reason for a missing or partial value")
    difference: float | None = Field(description="difference from the reference run; null if either has no value")
    percent: float | None = Field(description="difference in percent of the reference; null if that is 0")


class ComparedMetric(Schema):
    """A metric of all compared runs, in order."""

    name: str
    label: str
    definition: str
    unit: str
    values: list[ComparedValue]


class ComparedSetting(Schema):
    """A setting that differs between the compared runs, null in runs without it."""

    name: str
    unit: str = Field(description="SI; 1 for a value without a unit")
    values: list[bool | float | str | None]


class RunComparison(Schema):
    """Metrics and different settings of the compared runs."""

    reference: int
    runs: list[ComparedRun]
    metrics: list[ComparedMetric]
    settings: list[ComparedSetting] = Field(description="settings that differ")


class RunDifference(Schema):
    """A signal of a run minus that of the reference, at the reference's samples.

    A difference is null if either has no sample.
    """

    run: int
    reason: str = Field(description="why the signal cannot be compared; else empty")
    minimum: list[float | None] = Field(description="smallest difference per bucket; raw: the difference")
    maximum: list[float | None] = Field(description="largest difference per bucket; raw: the difference")
    compared_s: float = quantity("s", "compared time of the requested range")
    missing_s: float = quantity("s", "time of the requested range in which either has no sample")
    left_at_s: float | None = quantity(
        "s", "first violation of the band, on the time axis of the reference; null for none"
    )
    outside_s: float = quantity("s", "total time outside the band")
    longest_s: float = quantity("s", "longest continuous time outside the band")
    largest: float | None = Field(description="difference of the largest magnitude, in the signal's unit")
    largest_at_s: float | None = quantity("s", "time of that difference, on the time axis of the reference")


class Differences(Schema):
    """Differences of all other runs from the reference, computed from every sample."""

    reference: int
    signal: str
    unit: str
    raw: bool = Field(description="whether each bucket is a single sample")
    width_s: float = quantity("s", "width of a bucket")
    t: list[float] = quantity("s", "start of each bucket, on the time axis of the reference")
    runs: list[RunDifference]
