"""Curves of an identification, to draw: responses, residual tests, errors."""

from typing import Literal

from pydantic import Field

from backend.messages.base import Schema, quantity


class Bode(Schema):
    """A frequency response, line by line."""

    omega: list[float] = quantity("rad/s", "angular frequency")
    magnitude: list[float]
    phase_deg: list[float] = quantity("°", "phase, unwrapped")


class MeasuredBode(Bode):
    """A frequency response estimated from the data without a model."""

    coherence: list[float] = Field(description="0 to 1: how much of the output follows the input")


class Correlation(Schema):
    """A residual test: whether the largest of all correlations leaves the bound that belongs to the test."""

    lags_s: list[float] = quantity("s", "lag")
    correlation: list[float]
    bound: list[float] = Field(description="what each correlation may be, at the level for all lags together")
    statistic: float = Field(description="largest correlation, in standard deviations")
    critical: float = Field(description="what the statistic may be")
    level: float = Field(description="probability that a model which leaves nothing out fails")
    passed: bool


class Candidate(Schema):
    """A structure that was tried."""

    structure: str
    K: float | None
    T: float | None = quantity("s", "sum of lags")
    fit_percent: float | None = Field(description="simulated fit on data not used for fitting")
    BIC: float | None
    grade: str
    problem: str


class ChannelCurves(Schema):
    """Curves of G_q or G_S."""

    name: str
    model: Bode
    first_order: Bode
    measured: MeasuredBode | None = Field(description="null for runs made before it was kept")
    step_t: list[float] = quantity("s", "time of the step responses")
    step_model: list[float]
    step_first_order: list[float]
    whiteness: Correlation
    input_correlation: Correlation
    candidates: list[Candidate]


class StepCurve(Schema):
    """One voltage step of a motor."""

    voltage: float = quantity("V", "voltage of the step")
    t: list[float] = quantity("s", "time from the step")
    measured: list[float] = quantity("rad", "turn as measured")
    model: list[float] = quantity("rad", "turn of the model")


class MotorCurves(Schema):
    """Steps of one motor."""

    side: Literal["A", "B"]
    steps: list[StepCurve]


class OrderCurve(Schema):
    """One polynomial: its errors at the pairs, and its curve."""

    order: int
    errors: list[float] = quantity("N", "measured minus fitted force at the pairs")
    force: list[float] = quantity("N", "fitted force over curve_x")


class SpringCurves(Schema):
    """Pairs of one spring with the polynomials through them."""

    name: str
    x: list[float] = quantity("m", "elongation of the pairs")
    F: list[float] = quantity("N", "force of the pairs")
    rising: list[bool]
    curve_x: list[float] = quantity("m", "elongation of the curves")
    orders: list[OrderCurve]


class IdentificationCurves(Schema):
    """All that can be drawn of one identification; lists that do not belong to its kind are empty."""

    channels: list[ChannelCurves]
    motors: list[MotorCurves]
    springs: list[SpringCurves]
