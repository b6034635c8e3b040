"""Runs beside one of them: their metrics, what they were set to, and their signals on its time axis."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated

from pydantic import Field

from backend.schemas.base import HUGE, Finite, RowNumber, Schema, quantity
from backend.schemas.run import LONGEST_S
from backend.schemas.state import MarkKind

MOST_NUMBER = 100_000
"""Beyond the steps and events of any run."""


class AlignBy(StrEnum):
    """What of each run is brought to one moment."""

    BEGIN = "begin"
    STEP = "step"
    EVENT = "event"


class StepSignal(StrEnum):
    """Signals that jump when they are told to."""

    Q_REF = "q_ref"
    S_REF = "S_ref"
    F_PUSH = "F_push"


class ComparisonRequest(Schema):
    """Which runs, beside which of them, and how they are aligned: ``number`` counts steps or events from 1."""

    run: list[RowNumber] = Field(min_length=1, max_length=100, description="runs to compare, in order")
    reference: RowNumber | None = Field(
        default=None, description="run that the differences are to; the first if left out"
    )
    by: AlignBy = Field(default=AlignBy.BEGIN, description="what is brought to one moment")
    step: StepSignal = Field(default=StepSignal.Q_REF, description="signal whose step it is")
    event: MarkKind = Field(default=MarkKind.TRIP, description="kind of the event")
    number: int = Field(default=1, ge=1, le=MOST_NUMBER, description="which step or event of each run, from 1")


class DifferencesRequest(ComparisonRequest):
    """Of which signal, over which stretch of the reference, and from what deviation on it is told."""

    signal: Annotated[str, Field(max_length=40)] = "q"
    from_s: Finite = Field(default=0.0, ge=0.0, le=LONGEST_S, description="begin, on the reference's axis [s]")
    to_s: Finite = Field(default=LONGEST_S, gt=0.0, le=LONGEST_S, description="end, on the reference's axis [s]")
    points: int = Field(default=2000, ge=10, le=20000, description="most points; beyond it the envelope is sent")
    band: Finite = Field(default=HUGE, ge=0.0, le=HUGE, description="tolerance to either side, in the signal's unit")


class ComparedRun(Schema):
    """One of the runs that are compared."""

    id: int
    title: str
    kind: str
    station: str
    who: str
    started: datetime
    verdict: str = Field(description="in one sentence")
    aligned_at_s: float | None = quantity("s", "moment that is aligned, from the run's first sample; null: none")
    offset_s: float | None = quantity("s", "what its times are shifted by onto the reference's axis; null: not aligned")
    not_aligned: str = Field(description="why it is not aligned")


class ComparedValue(Schema):
    """A metric of one run."""

    value: float | None
    reason: str = Field(description="why there is no value, or why it is that of a part only")
    difference: float | None = Field(description="to the reference run; null where either has no value")
    percent: float | None = Field(description="the difference in per cent of the reference; null where that is 0")


class ComparedMetric(Schema):
    """A metric of all compared runs, in their order."""

    name: str
    label: str
    definition: str
    unit: str
    values: list[ComparedValue]


class ComparedSetting(Schema):
    """Something that not all compared runs were set to alike: of each run in its order, null where it has none."""

    name: str
    unit: str = Field(description="SI, 1 for what has none")
    values: list[bool | float | str | None]


class RunComparison(Schema):
    """Runs beside each other."""

    reference: int
    runs: list[ComparedRun]
    metrics: list[ComparedMetric]
    settings: list[ComparedSetting] = Field(description="what differs of what they were set to")


class RunDifference(Schema):
    """A signal of a run minus that of the reference, at the reference's samples; null where either has none."""

    run: int
    reason: str = Field(description="why nothing is compared")
    minimum: list[float | None] = Field(description="smallest difference per bucket; raw: the difference")
    maximum: list[float | None] = Field(description="largest difference per bucket; raw: the difference")
    compared_s: float = quantity("s", "length of what was compared, of the stretch asked for")
    missing_s: float = quantity("s", "the rest of the stretch, where one of both has no sample")
    left_at_s: float | None = quantity("s", "when the band is left first, on the reference's axis; null: never")
    outside_s: float = quantity("s", "how long it is outside the band, together")
    longest_s: float = quantity("s", "how long at most without coming back into it")
    largest: float | None = Field(description="difference of the largest size, in the signal's unit")
    largest_at_s: float | None = quantity("s", "when, on the reference's axis")


class Differences(Schema):
    """Differences of all runs to the reference, but for itself, computed from every sample."""

    reference: int
    signal: str
    unit: str
    raw: bool = Field(description="buckets are single samples")
    width_s: float = quantity("s", "length of a bucket")
    t: list[float] = quantity("s", "where the buckets begin, on the reference's axis")
    runs: list[RunDifference]
