"""Schemas of identification runs, their curves and models."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from backend.experiments import (
    ActuatorIdentificationPlan,
    Expectation,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
)
from backend.identification import Grade, LoadFrictionFit, Method
from backend.models import Setting, StoredSpringFit, StoredStepCurve, describe_settings
from backend.plain_text import ONE_LINE
from backend.schemas.base import Finite, Schema, quantity
from backend.schemas.experiment import SettingValue

# Compared models -----------------------------------------------------------------------------------
#
# Identified models beside what they are judged by: data they have not seen, and what geometry and
# springs say.


class SampleRange(Schema):
    """Samples in a row, evenly thinned to be drawn."""

    label: str = Field(description="what sets it apart, as the voltage of a step; empty where there is one")
    t: list[float] = quantity("s", "time from the first sample of the run, or from a motor's step")
    measured: list[float]
    predicted: list[float]


class ValidationOutput(Schema):
    """One output, as measured and as the model says; in the unit of the signal."""

    name: str = Field(description="G_q or G_S of an actuator, A or B of motors")
    signal: str
    unit: str
    fit_percent: float | None = Field(description="100 (1 - |y - y_hat| / |y - mean y|) over all samples [%]")
    rms: float | None = Field(description="RMS of measured minus predicted, in the unit of the signal")
    samples: int = Field(description="samples that fit and residual are of")
    problem: str = Field(description="why there is nothing; empty where there is")
    stretches: list[SampleRange]


class ValidationView(Schema):
    """A model beside the part of a record that it was not fitted to."""

    run: int = Field(description="identification run whose model it is")
    of: int = Field(description="run whose record it is")
    own: bool = Field(description="whether that is its own run: what is predicted was then left out of the fit")
    kind: str
    outputs: list[ValidationOutput]


class PredictionComparison(Schema):
    """A figure of a model beside what geometry, springs and motor loops predict for the same run."""

    identified: float
    std: float | None = Field(description="standard error; null where it was not kept or could not be had")
    predicted: float
    off_percent: float = Field(description="100 (identified / predicted - 1) [%]")


class ChannelComparison(Schema):
    """Gain and sum of lags of G_q or G_S."""

    K: PredictionComparison
    T: PredictionComparison
    grade: Grade


class TrendRow(Schema):
    """One actuator identification; predicted with the parameters and λ of the motor loops of its own run."""

    run: int
    S: float = quantity("N·m/rad", "stiffness at which it was made")
    G_q: ChannelComparison
    G_S: ChannelComparison


class PredictedModels(Schema):
    """What is predicted over S with what is in force now."""

    S: list[float] = quantity("N·m/rad", "stiffness")
    K_q: list[float]
    T_q: list[float] = quantity("s", "sum of lags of G_q")
    K_S: list[float]
    T_S: list[float] = quantity("s", "sum of lags of G_S")


class LoadFriction(Schema):
    """What the newest run at each tension says of the friction over the load."""

    estimate: LoadFrictionFit | None = Field(description="null where it is not measured")
    problem: str = Field(description="why it is not measured; empty where it is")
    sentence: str
    left_out: list[str] = Field(description="what was not used or not measured, each with the reason")


class Trend(Schema):
    """Identified gains and lags in order of S, beside what geometry, springs and motor loops predict."""

    rows: list[TrendRow]
    predicted: PredictedModels
    left_out: list[str] = Field(description="identifications that are not among the rows, each with the reason")
    friction: LoadFriction


# Curves --------------------------------------------------------------------------------------------
#
# Curves of an identification, to draw: responses, residual tests, errors.


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


class MotorCurves(Schema):
    """Steps of one motor."""

    side: Literal["A", "B"]
    steps: list[StoredStepCurve]


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


# Identification ------------------------------------------------------------------------------------
#
# Identification runs: what to do, what to expect of it, what came out.


def _declared(plan: type[Any], name: str) -> Any:
    """Return the field of a setting that the plan declares, with its bounds."""
    setting = next(setting for setting in describe_settings(plan) if setting.name == name)
    bounds = {"ge": setting.minimum, "le": setting.maximum}
    return quantity(setting.unit, setting.meaning, default=setting.default, **bounds)


class ActuatorRequest(Schema):
    """The closed-loop experiment of method section 4, at one tension or at several in turn."""

    kind: Literal["actuator"] = "actuator"
    tension_N: float = _declared(ActuatorIdentificationPlan, "tension_N")
    tensions_N: list[Finite] | None = quantity(
        "N",
        "tensions of several runs in turn",
        default=None,
        min_length=1,
        max_length=8,
    )
    amplitude_rad: float = _declared(ActuatorIdentificationPlan, "amplitude_rad")
    chip_s: float = _declared(ActuatorIdentificationPlan, "chip_s")
    bits: int = _declared(ActuatorIdentificationPlan, "bits")
    periods: int = _declared(ActuatorIdentificationPlan, "periods")
    settle_s: float = _declared(ActuatorIdentificationPlan, "settle_s")
    estimator: Literal[Method.DEFAULT, Method.ARX] = _declared(ActuatorIdentificationPlan, "estimator")


class MotorRequest(Schema):
    """Unloaded voltage steps of both motors, method section 2."""

    kind: Literal["motor"]
    u_low: float = _declared(MotorIdentificationPlan, "u_low")
    u_high: float = _declared(MotorIdentificationPlan, "u_high")
    levels: int = _declared(MotorIdentificationPlan, "levels")
    travel_rad: float = _declared(MotorIdentificationPlan, "travel_rad")
    step_s: float = _declared(MotorIdentificationPlan, "step_s")
    settle_s: float = _declared(MotorIdentificationPlan, "settle_s")


class SpringRequest(Schema):
    """Slow sweep of both tensions, method section 3."""

    kind: Literal["spring"]
    F_low: float = _declared(SpringIdentificationPlan, "F_low")
    F_high: float = _declared(SpringIdentificationPlan, "F_high")
    sweep_s: float = _declared(SpringIdentificationPlan, "sweep_s")
    cycles: int = _declared(SpringIdentificationPlan, "cycles")
    settle_s: float = _declared(SpringIdentificationPlan, "settle_s")


def _kind(body: Any) -> Any:
    return body.get("kind", "actuator") if isinstance(body, dict) else getattr(body, "kind", None)


IdentificationRequest = Annotated[
    Annotated[ActuatorRequest, Tag("actuator")]
    | Annotated[MotorRequest, Tag("motor")]
    | Annotated[SpringRequest, Tag("spring")],
    Discriminator(_kind),
]
"""What to identify; the actuator where no kind is given."""


class IdentificationKind(Schema):
    """Something that can be identified."""

    kind: str
    title: str
    description: str
    settings: list[Setting]


class IdentificationKindList(Schema):
    """What can be identified."""

    kinds: list[IdentificationKind]


class PathPoint(Schema):
    """A point of the way that the joint is expected to go."""

    q: float = quantity("rad", "joint position")
    S: float = quantity("N·m/rad", "joint stiffness")


class Prediction(Schema):
    """What a run is expected to do before it starts, from where the joint is at present."""

    duration_s: float = quantity("s", "from the start until the joint is back in pretension, all ways included")
    q_start: float = quantity("rad", "joint position at present")
    q_low: float = quantity("rad", "least joint position on the whole way")
    q_high: float = quantity("rad", "largest joint position on the whole way")
    F_low: float = quantity("N", "least tendon tension on the whole way; 0 where the tendons are let slack")
    F_high: float = quantity("N", "largest tendon tension on the whole way")
    path: list[PathPoint] = Field(description="way of the joint while the tendons are taut, start first")
    within_range: bool = Field(description="whether joint and springs stay within their range; it is refused if not")
    figures: list[Expectation] = Field(description="what to expect, in numbers")
    q_counts: float | None = Field(
        description="joint motion by the excitation alone, peak to peak, in encoder counts; actuator only"
    )
    u_peak_V: float | None = quantity("V", "largest motor voltage expected; actuator and motor")
    F_min_N: float | None = quantity("N", "least tendon tension expected; actuator only")
    enough_motion: bool = Field(description="whether the run is worth starting")
    message: str


class PauseRequest(Schema):
    """Whether the next run of the order under way is to wait, in pretension, until this is taken back."""

    paused: bool


class StartedRun(Schema):
    """The task was started; its run, the first where there are several, carries the result."""

    id: int


class ModelView(Schema):
    """A fitted model of one channel, G_q or G_S."""

    structure: str
    method: str
    parameters: dict[str, float]
    std_errors: dict[str, float | None]
    fit_percent: float | None = Field(description="simulated fit on data not used for fitting")
    gain_geometry: float = Field(description="static gain known from geometry")
    K: float = Field(description="static gain of the first-order reduction")
    T: float = quantity("s", "time constant of the first-order reduction: sum of lags")
    K_std: float | None = Field(description="standard error of K; null where it could not be had")
    T_std: float | None = quantity("s", "standard error of T; null where it could not be had")
    grade: Grade
    usable: bool
    verdict: str


class MotorEstimate(Schema):
    """K_m and T_m of one motor."""

    K_m: float = quantity("rad/(V·s)", "gain: steady speed per voltage")
    T_m: float = quantity("s", "time constant")


class MotorView(Schema):
    """One motor: least squares over all steps, and the 63.21 % rule beside it."""

    side: Literal["A", "B"]
    fitted: MotorEstimate
    std_errors: MotorEstimate
    u_c: float = quantity("V", "Coulomb voltage: what only overcomes dry friction")
    u_c_std: float = quantity("V", "standard error of the Coulomb voltage")
    rule_mean: MotorEstimate = Field(description="63.21 % rule, mean over the steps")
    rule_spread: MotorEstimate = Field(description="63.21 % rule, standard deviation over the steps")
    before: MotorEstimate = Field(description="in force when the run was made")
    rms_counts: float = Field(description="RMS error of position, in encoder counts")
    refused: list[str] = Field(description="steps that could not be used, with the reason")
    grade: Grade
    verdict: str


class SpringView(Schema):
    """One spring: polynomials of several orders, and which of them to use."""

    name: str = Field(description="A, B, or table for an imported one")
    recommended: int = Field(description="order to use")
    reason: str
    pairs: int
    hysteresis_N: float | None = quantity("N", "largest mean difference between the ways up and down")
    fits: list[StoredSpringFit]


class SpringTableRequest(Schema):
    """A spring measured elsewhere."""

    name: Annotated[str, ONE_LINE] = Field(min_length=1, max_length=120, description="name of the file")
    table: str = Field(
        max_length=400_000,
        description="table of the file; CSV with the columns 'x [m]' or 'x [mm]', and 'F [N]', units in the heading",
    )
    header: int | None = Field(
        default=None, ge=1, le=400_000, description="line that names the columns; found where it is left out"
    )
    decimal: Literal["point", "comma"] | None = Field(
        default=None, description="mark before the decimals; found where it is left out"
    )


class ColumnNotRead(Schema):
    """A column of a file that was not read."""

    name: str
    reason: str


class SpringTableReading(Schema):
    """What was read of a measured table."""

    x_unit: str
    F_unit: str
    rows: int
    heading_line: int
    separator: str
    decimal_mark: str
    lines_above_heading: int
    comment_lines: int
    not_read: list[ColumnNotRead]
    notes: list[str]


class SpringTableView(Schema):
    """A spring identified from a measured table."""

    id: int
    file: str
    sha256: str = Field(description="digest of the table")
    read: SpringTableReading | None = Field(
        description="what was read of it; null for tables from before that was kept"
    )
    created: datetime
    who: str
    usable: bool
    spring: SpringView
    message: str


class SpringTableList(Schema):
    """Springs identified from tables, newest first."""

    tables: list[SpringTableView]


class IdentificationView(Schema):
    """One identification run and, once it has ended, its models."""

    id: int
    run: int
    kind: str
    status: str
    created: datetime
    progress: float = Field(ge=0.0, le=1.0)
    tension_N: float | None = quantity("N", "tension held, of the actuator")
    S_nominal: float | None = quantity("N·m/rad", "stiffness at which the run was held")
    settings: dict[str, SettingValue]
    estimate: int | None = Field(description="number of the stored identification; null while there is none")
    usable: bool
    G_q: ModelView | None
    G_S: ModelView | None
    motors: list[MotorView]
    springs: list[SpringView]
    message: str


class IdentificationList(Schema):
    """Identification runs, newest first."""

    identifications: list[IdentificationView]
