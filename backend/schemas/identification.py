"""Schemas of identifications: requests, forecasts, models, curves, validation."""

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

# Validation ----------------------------------------------------------------------------------------
# Identified models compared with validation data and with predictions from geometry and springs.


class SampleRange(Schema):
    """Consecutive samples, decimated for drawing."""

    label: str = Field(description="label, such as the voltage of a step; empty if there is only one range")
    t: list[float] = quantity("s", "time since the first sample of the run, or since the step of a motor")
    measured: list[float]
    predicted: list[float]


class ValidationOutput(Schema):
    """One output, measured and predicted by the model, in the unit of the signal."""

    name: str = Field(description="G_q or G_S of an actuator, A or B of motors")
    signal: str
    unit: str
    fit_percent: float | None = Field(description="100 (1 - |y - y_hat| / |y - mean y|) over all samples [%]")
    rms: float | None = Field(description="RMS of measured minus predicted, in the unit of the signal")
    samples: int = Field(description="number of samples used for fit and residual")
    problem: str = Field(description="why there is no prediction; else empty")
    stretches: list[SampleRange]


class ValidationView(Schema):
    """A model compared with validation data."""

    run: int = Field(description="identification run of the model")
    of: int = Field(description="run of the record")
    own: bool = Field(description="whether both are the same run; the estimation then did not use the compared samples")
    kind: str
    outputs: list[ValidationOutput]


class PredictionComparison(Schema):
    """An identified value and its prediction for the same run.

    Predictions come from geometry, springs and motor loops.
    """

    identified: float
    std: float | None = Field(description="standard error; null if it was not stored or could not be computed")
    predicted: float
    off_percent: float = Field(description="100 (identified / predicted - 1) [%]")


class ChannelComparison(Schema):
    """Gain K and sum of lags T of G_q or G_S."""

    K: PredictionComparison
    T: PredictionComparison
    grade: Grade


class TrendRow(Schema):
    """One actuator identification.

    Predictions use the parameters and λ of the motor loops of its own run.
    """

    run: int
    S: float = quantity("N·m/rad", "stiffness of the identification")
    G_q: ChannelComparison
    G_S: ChannelComparison


class PredictedModels(Schema):
    """Predictions versus S with the active parameters and tuning."""

    S: list[float] = quantity("N·m/rad", "stiffness")
    K_q: list[float]
    T_q: list[float] = quantity("s", "sum of lags of G_q")
    K_S: list[float]
    T_S: list[float] = quantity("s", "sum of lags of G_S")


class LoadFriction(Schema):
    """Load-dependent friction, estimated from the newest run at each tension."""

    estimate: LoadFrictionFit | None = Field(description="null if it is not measured")
    problem: str = Field(description="why it is not measured; else empty")
    sentence: str
    left_out: list[str] = Field(description="runs that were not used, each with the reason")


class Trend(Schema):
    """Identified gains and lags by S, and their predictions."""

    rows: list[TrendRow]
    predicted: PredictedModels
    left_out: list[str] = Field(description="identifications omitted from the rows, each with the reason")
    friction: LoadFriction


# Curves --------------------------------------------------------------------------------------------


class Bode(Schema):
    """A frequency response."""

    omega: list[float] = quantity("rad/s", "angular frequency")
    magnitude: list[float]
    phase_deg: list[float] = quantity("°", "phase, unwrapped")


class MeasuredBode(Bode):
    """A frequency response estimated from the data without a model."""

    coherence: list[float] = Field(description="coherence of input and output, 0 to 1")


class Correlation(Schema):
    """A residual test: it fails if any correlation exceeds the bound of the test."""

    lags_s: list[float] = quantity("s", "lag")
    correlation: list[float]
    bound: list[float] = Field(
        description="bound of the correlation at each lag; the level applies to all lags jointly"
    )
    statistic: float = Field(description="largest correlation, in standard deviations")
    critical: float = Field(description="critical value of the statistic")
    level: float = Field(description="significance level: probability that a complete model fails the test")
    passed: bool


class Candidate(Schema):
    """A model structure that was tried."""

    structure: str
    K: float | None
    T: float | None = quantity("s", "sum of lags")
    fit_percent: float | None = Field(description="fit of the simulated output on validation data")
    BIC: float | None
    grade: str
    problem: str


class ChannelCurves(Schema):
    """Curves of G_q or G_S."""

    name: str
    model: Bode
    first_order: Bode
    measured: MeasuredBode | None = Field(description="null for runs recorded by versions that did not store it")
    step_t: list[float] = quantity("s", "time of the step responses")
    step_model: list[float]
    step_first_order: list[float]
    whiteness: Correlation
    input_correlation: Correlation
    candidates: list[Candidate]


class MotorCurves(Schema):
    """Voltage steps of one motor."""

    side: Literal["A", "B"]
    steps: list[StoredStepCurve]


class OrderCurve(Schema):
    """One polynomial: its errors at the measured points, and its curve."""

    order: int
    errors: list[float] = quantity("N", "measured minus fitted force at the measured points")
    force: list[float] = quantity("N", "fitted force at curve_x")


class SpringCurves(Schema):
    """Measured points of one spring, with the fitted polynomials."""

    name: str
    x: list[float] = quantity("m", "elongation of the measured points")
    F: list[float] = quantity("N", "force of the measured points")
    rising: list[bool]
    curve_x: list[float] = quantity("m", "elongation of the curves")
    orders: list[OrderCurve]


class IdentificationCurves(Schema):
    """Curves of one identification; lists of other kinds are empty."""

    channels: list[ChannelCurves]
    motors: list[MotorCurves]
    springs: list[SpringCurves]


# Requests and results ------------------------------------------------------------------------------


def _declare_setting(plan: type[Any], name: str) -> Any:
    """Return the pydantic field of a setting of a plan, with its bounds."""
    setting = next(setting for setting in describe_settings(plan) if setting.name == name)
    bounds = {"ge": setting.minimum, "le": setting.maximum}
    return quantity(setting.unit, setting.meaning, default=setting.default, **bounds)


class ActuatorRequest(Schema):
    """The closed-loop experiment of method section 4, at one tension or several."""

    kind: Literal["actuator"] = "actuator"
    tension_N: float = _declare_setting(ActuatorIdentificationPlan, "tension_N")
    tensions_N: list[Finite] | None = quantity(
        "N",
        "tensions of several consecutive runs",
        default=None,
        min_length=1,
        max_length=8,
    )
    amplitude_rad: float = _declare_setting(ActuatorIdentificationPlan, "amplitude_rad")
    chip_s: float = _declare_setting(ActuatorIdentificationPlan, "chip_s")
    bits: int = _declare_setting(ActuatorIdentificationPlan, "bits")
    periods: int = _declare_setting(ActuatorIdentificationPlan, "periods")
    settle_s: float = _declare_setting(ActuatorIdentificationPlan, "settle_s")
    estimator: Literal[Method.DEFAULT, Method.ARX] = _declare_setting(ActuatorIdentificationPlan, "estimator")


class MotorRequest(Schema):
    """Unloaded voltage steps of both motors, method section 2."""

    kind: Literal["motor"]
    u_low: float = _declare_setting(MotorIdentificationPlan, "u_low")
    u_high: float = _declare_setting(MotorIdentificationPlan, "u_high")
    levels: int = _declare_setting(MotorIdentificationPlan, "levels")
    travel_rad: float = _declare_setting(MotorIdentificationPlan, "travel_rad")
    step_s: float = _declare_setting(MotorIdentificationPlan, "step_s")
    settle_s: float = _declare_setting(MotorIdentificationPlan, "settle_s")


class SpringRequest(Schema):
    """Slow sweep of both tensions, method section 3."""

    kind: Literal["spring"]
    F_low: float = _declare_setting(SpringIdentificationPlan, "F_low")
    F_high: float = _declare_setting(SpringIdentificationPlan, "F_high")
    sweep_s: float = _declare_setting(SpringIdentificationPlan, "sweep_s")
    cycles: int = _declare_setting(SpringIdentificationPlan, "cycles")
    settle_s: float = _declare_setting(SpringIdentificationPlan, "settle_s")


def _find_kind(body: Any) -> Any:
    return body.get("kind", "actuator") if isinstance(body, dict) else getattr(body, "kind", None)


IdentificationRequest = Annotated[
    Annotated[ActuatorRequest, Tag("actuator")]
    | Annotated[MotorRequest, Tag("motor")]
    | Annotated[SpringRequest, Tag("spring")],
    Discriminator(_find_kind),
]
"""Request of an identification; of the actuator if it has no kind."""


class IdentificationKind(Schema):
    """A kind of identification with its settings."""

    kind: str
    title: str
    description: str
    settings: list[Setting]


class IdentificationKindList(Schema):
    """All kinds of identification."""

    kinds: list[IdentificationKind]


class PathPoint(Schema):
    """A point of the expected path of the joint."""

    q: float = quantity("rad", "joint position")
    S: float = quantity("N·m/rad", "joint stiffness")


class Prediction(Schema):
    """Forecast of a run from the present joint position."""

    duration_s: float = quantity("s", "time from the start until the joint is back in pretension")
    q_start: float = quantity("rad", "present joint position")
    q_low: float = quantity("rad", "smallest joint position of the run")
    q_high: float = quantity("rad", "largest joint position of the run")
    F_low: float = quantity("N", "smallest tendon tension of the run; 0 if the tendons become slack")
    F_high: float = quantity("N", "largest tendon tension of the run")
    path: list[PathPoint] = Field(description="path of the joint while the tendons are taut, from the start")
    within_range: bool = Field(
        description="whether joint and springs stay within their range; otherwise the service rejects the run"
    )
    figures: list[Expectation] = Field(description="expected values")
    q_counts: float | None = Field(
        description="peak-to-peak joint motion that the excitation alone causes, in encoder counts; actuator only"
    )
    u_peak_V: float | None = quantity("V", "largest motor voltage expected; actuator and motor")
    F_min_N: float | None = quantity("N", "smallest tendon tension expected; actuator only")
    enough_motion: bool = Field(description="whether the expected motion suffices for an identification")
    message: str


class PauseRequest(Schema):
    """Whether the next run of the current request waits in pretension."""

    paused: bool


class StartedRun(Schema):
    """Number of the started run, which will have the result.

    Of several runs, it is the first one.
    """

    id: int


class ModelView(Schema):
    """A fitted model of one channel, G_q or G_S."""

    structure: str
    method: str
    parameters: dict[str, float]
    std_errors: dict[str, float | None]
    fit_percent: float | None = Field(description="fit of the simulated output on validation data")
    gain_geometry: float = Field(description="static gain computed from geometry")
    K: float = Field(description="static gain of the first-order reduction")
    T: float = quantity("s", "time constant of the first-order reduction: sum of lags")
    K_std: float | None = Field(description="standard error of K; null if it could not be computed")
    T_std: float | None = quantity("s", "standard error of T; null if it could not be computed")
    grade: Grade
    usable: bool
    verdict: str


class MotorEstimate(Schema):
    """K_m and T_m of one motor."""

    K_m: float = quantity("rad/(V·s)", "gain: steady-state speed per volt")
    T_m: float = quantity("s", "time constant")


class MotorView(Schema):
    """Result for one motor: least-squares fit, and 63.21 % rule for comparison."""

    side: Literal["A", "B"]
    fitted: MotorEstimate
    std_errors: MotorEstimate
    u_c: float = quantity("V", "Coulomb voltage, which overcomes Coulomb friction")
    u_c_std: float = quantity("V", "standard error of the Coulomb voltage")
    rule_mean: MotorEstimate = Field(description="63.21 % rule, mean over the steps")
    rule_spread: MotorEstimate = Field(description="63.21 % rule, standard deviation over the steps")
    before: MotorEstimate = Field(description="active parameters at the time of the run")
    rms_counts: float = Field(description="RMS error of position, in encoder counts")
    refused: list[str] = Field(description="steps that could not be used, with the reason")
    grade: Grade
    verdict: str


class SpringView(Schema):
    """Result for one spring: polynomials of several orders, and the recommended one."""

    name: str = Field(description="A, B, or table for an imported one")
    recommended: int = Field(description="recommended order")
    reason: str
    pairs: int
    hysteresis_N: float | None = quantity(
        "N",
        "largest difference between the locally averaged forces "
        "at rising and at falling tension, at the same elongation",
    )
    fits: list[StoredSpringFit]


class SpringTableRequest(Schema):
    """A measured table of a spring to import."""

    name: Annotated[str, ONE_LINE] = Field(min_length=1, max_length=120, description="name of the file")
    table: str = Field(
        max_length=400_000,
        description="table of the file; CSV with the columns 'x [m]' or 'x [mm]', and 'F [N]', units in the heading",
    )
    header: int | None = Field(
        default=None, ge=1, le=400_000, description="line with the names of the columns; detected if omitted"
    )
    decimal: Literal["point", "comma"] | None = Field(default=None, description="decimal mark; detected if omitted")


class ColumnNotRead(Schema):
    """A column of a file that was not read."""

    name: str
    reason: str


class SpringTableReading(Schema):
    """Layout of an imported table."""

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
        description="layout of the table; null for tables that an earlier version imported"
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
    """One identification run and, after its end, its models."""

    id: int
    run: int
    kind: str
    status: str
    created: datetime
    progress: float = Field(ge=0.0, le=1.0)
    tension_N: float | None = quantity("N", "tension of an actuator identification")
    S_nominal: float | None = quantity("N·m/rad", "stiffness of the run")
    settings: dict[str, SettingValue]
    estimate: int | None = Field(description="number of the stored identification; null if there is none")
    usable: bool
    G_q: ModelView | None
    G_S: ModelView | None
    motors: list[MotorView]
    springs: list[SpringView]
    message: str


class IdentificationList(Schema):
    """Identification runs, newest first."""

    identifications: list[IdentificationView]
