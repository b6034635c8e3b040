"""Identification runs: what to do, what to expect of it, what came out."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from backend.experiments.plans import ActuatorIdentificationPlan, MotorIdentificationPlan, SpringIdentificationPlan
from backend.identification.fitting import Method
from backend.identification.models import Grade
from backend.messages.base import Finite, Schema, quantity
from backend.messages.experiment import Metric, SettingValue, SettingView
from backend.models.settings import describe
from backend.plain_text import ONE_LINE


def _declared(plan: type[Any], name: str) -> Any:
    """Return the field of a setting that the plan declares, with its bounds."""
    setting = next(setting for setting in describe(plan) if setting.name == name)
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
    settings: list[SettingView]


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
    figures: list[Metric] = Field(description="what to expect, in numbers")
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


class Started(Schema):
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


class SpringFitView(Schema):
    """A polynomial through the measured pairs."""

    order: int
    k: list[float] = Field(description="coefficients, lowest power first [N/m^i]")
    std_errors: list[float]
    rms_N: float = quantity("N", "RMS error")
    max_N: float = quantity("N", "largest error")
    cross_validation_N: float = quantity("N", "RMS error at pairs left out one at a time")
    rising: bool


class SpringView(Schema):
    """One spring: polynomials of several orders, and which of them to use."""

    name: str = Field(description="A, B, or table for an imported one")
    recommended: int = Field(description="order to use")
    reason: str
    pairs: int
    hysteresis_N: float | None = quantity("N", "largest mean difference between the ways up and down")
    fits: list[SpringFitView]


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
