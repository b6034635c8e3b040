"""What identifications of actuator, motors and springs store of their results. Pure."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field

from backend.identification import FirstOrder, FrequencyCheck, Grade, Residuals
from backend.models.document import ABSENT, DocumentCodec, UnreadableDocumentError
from backend.response_docs import describe_field
from plant import Side

# Actuator ------------------------------------------------------------------------------------------
#
# What an actuator identification found: the models of G_q and G_S, how good they are, and which
# samples they used.
#
# All numbers in SI; None stands for a figure that could not be had, or that an earlier version did
# not keep.


VERSION = 1
ChannelName = Literal["G_q", "G_S"]
CHANNELS: tuple[ChannelName, ...] = ("G_q", "G_S")

Numbers = tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class ChannelModel:
    """The transfer function of one channel; ``covariance`` in the order of its structure's parameters."""

    structure: str
    parameters: dict[str, float]
    std_errors: dict[str, float | None] = field(default_factory=dict)
    covariance: tuple[Numbers, ...] = ()
    noise: Numbers = ()
    method: str | None = None
    first_order: FirstOrder


@dataclass(frozen=True, kw_only=True)
class ActuatorModel:
    """Both channels, at the joint position and stiffness of rest before the excitation."""

    S_nominal: float
    q_nominal: float | None = None
    G_q: ChannelModel
    G_S: ChannelModel
    version: int = VERSION


@dataclass(frozen=True, kw_only=True)
class TriedStructure:
    """A structure that was tried, in brief."""

    structure: str
    parameters: dict[str, float] | None = field(default=None, metadata=ABSENT)
    K: float | None
    T: float | None
    fit_percent: float | None
    BIC: float | None
    grade: Grade
    problem: str = ""


@dataclass(frozen=True)
class FailedCandidate:
    """A structure that gave no model, and why."""

    structure: str
    problem: Annotated[str, Field(min_length=1)]


@dataclass(frozen=True, kw_only=True)
class ArxEstimate:
    """What the paper's method gives on the same record."""

    method: str | None = field(default=None, metadata=ABSENT)
    fit_percent: float | None = None
    K: float
    T: float
    K_std: float | None = None
    T_std: float | None = None
    problem: str = ""


@dataclass(frozen=True)
class MissingArxEstimate:
    """Why the paper's method gives nothing."""

    problem: Annotated[str, Field(min_length=1)]


@dataclass(frozen=True, kw_only=True)
class ChannelQuality:
    """How good the model of one channel is; ``arx`` is None where it was not computed then."""

    fit_percent: float | None = None
    fit_all_percent: float | None = None
    gain_geometry: float | None = None
    gain_error_percent: float | None = None
    y_resolution: float | None = None
    residuals: Residuals
    frequency: FrequencyCheck | None = field(default=None, metadata=ABSENT)
    usable: bool = False
    grade: Grade
    verdict: str = ""
    candidates: tuple[Annotated[TriedStructure | FailedCandidate, Field(union_mode="left_to_right")], ...] = ()
    arx: Annotated[ArxEstimate | MissingArxEstimate | None, Field(union_mode="left_to_right")] = field(
        default=None, metadata=ABSENT
    )


@dataclass(frozen=True, kw_only=True)
class ActuatorQuality:
    """How good both models are; ``motion_counts`` is the joint's motion, peak to peak."""

    motion_counts: float | None = None
    G_q: ChannelQuality
    G_S: ChannelQuality
    version: int = VERSION


@dataclass(frozen=True, kw_only=True)
class ActuatorRecord:
    """Which samples of the run were used: from ``first_sample`` on, every ``period_s``."""

    input: str = "theta_A_ref"
    outputs: tuple[str, ...] = ("q", "S")
    first_sample: int
    samples: int
    period_s: float


@dataclass(frozen=True, kw_only=True)
class ActuatorOptions:
    """What was asked for: the tension [N] that was held, and the estimator where there was a choice."""

    tension_N: float
    estimator: str | None = None


@dataclass(frozen=True)
class IdentifiedChannel:
    """One channel: its model, and how good that is."""

    model: ChannelModel
    quality: ChannelQuality


@dataclass(frozen=True)
class ActuatorResult:
    """All that is stored of an actuator identification."""

    model: ActuatorModel
    quality: ActuatorQuality

    def channel(self, name: ChannelName) -> IdentifiedChannel:
        """Return one channel."""
        if name == "G_q":
            return IdentifiedChannel(self.model.G_q, self.quality.G_q)
        return IdentifiedChannel(self.model.G_S, self.quality.G_S)


MODEL: DocumentCodec[ActuatorModel] = DocumentCodec(ActuatorModel, "its model", VERSION)
QUALITY: DocumentCodec[ActuatorQuality] = DocumentCodec(ActuatorQuality, "the quality of its model", VERSION)
RECORD: DocumentCodec[ActuatorRecord] = DocumentCodec(ActuatorRecord, "what is told of its samples", VERSION)
OPTIONS: DocumentCodec[ActuatorOptions] = DocumentCodec(ActuatorOptions, "its options", VERSION)


# Motor ---------------------------------------------------------------------------------------------
#
# What a motor identification found of both motors: K_m [rad/(V·s)], T_m [s], Coulomb voltage u_c
# [V], and how good.


@dataclass(frozen=True)
class MotorFit:
    """Least squares on position, or its standard errors."""

    K_m: float | None
    T_m: float | None
    u_c: float | None


@dataclass(frozen=True)
class MotorConstants:
    """Gain and time constant alone."""

    K_m: float | None
    T_m: float | None


@dataclass(frozen=True)
class StepRuleEstimate:
    """The 63.21 % rule on one step [V]."""

    voltage: float
    K_m: float | None
    T_m: float | None


@dataclass(frozen=True)
class IdentifiedMotor:
    """One motor; ``before`` is what was in force."""

    parameters: MotorFit
    std_errors: MotorFit
    coulomb: bool
    rule: tuple[StepRuleEstimate, ...]
    rule_mean: MotorConstants
    rule_spread: MotorConstants
    before: MotorConstants


@dataclass(frozen=True)
class RefusedStep:
    """A step [V] that could not be used, and why."""

    voltage: float
    reason: str


@dataclass(frozen=True)
class StoredStepCurve:
    """A few points of a step [V] as measured and as the model says, to draw: t [s], turn [rad]."""

    voltage: float = field(metadata=describe_field("voltage of the step", "V"))
    t: tuple[float, ...] = field(metadata=describe_field("time from the step", "s"))
    measured: tuple[float, ...] = field(metadata=describe_field("turn as measured", "rad"))
    model: tuple[float, ...] = field(metadata=describe_field("turn of the model", "rad"))


@dataclass(frozen=True, kw_only=True)
class MotorQuality:
    """How well the model of one motor describes its steps."""

    rms_counts: float | None
    grade: Grade
    verdict: str
    refused: tuple[RefusedStep, ...]
    steps: tuple[StoredStepCurve, ...]


@dataclass(frozen=True)
class MotorModels:
    """Both motors."""

    A: IdentifiedMotor
    B: IdentifiedMotor
    version: int = VERSION


@dataclass(frozen=True)
class MotorQualities:
    """How good both are."""

    A: MotorQuality
    B: MotorQuality
    version: int = VERSION


@dataclass(frozen=True)
class MotorResult:
    """One motor: its model, and how good that is."""

    model: IdentifiedMotor
    quality: MotorQuality


@dataclass(frozen=True)
class MotorsResult:
    """All that is stored of a motor identification."""

    models: MotorModels
    qualities: MotorQualities

    def side(self, side: Side) -> MotorResult:
        """Return one motor."""
        if side == "A":
            return MotorResult(self.models.A, self.qualities.A)
        return MotorResult(self.models.B, self.qualities.B)


MOTOR_MODELS: DocumentCodec[MotorModels] = DocumentCodec(MotorModels, "its model", VERSION)
MOTOR_QUALITIES: DocumentCodec[MotorQualities] = DocumentCodec(MotorQualities, "the quality of its model", VERSION)


# Spring --------------------------------------------------------------------------------------------
#
# What a spring identification found of both springs, or of a table: polynomials F = k_0 + k_1 x + …
# of several orders.
#
# Elongations in m, forces in N.


@dataclass(frozen=True)
class StoredSpringFit:
    """A polynomial of one order and its errors; ``rising`` where it rises over all elongations that were measured."""

    order: int
    k: tuple[float, ...] = field(metadata=describe_field("coefficients, lowest power first [N/m^i]"))
    std_errors: tuple[float | None, ...]
    rms_N: float | None = field(metadata=describe_field("RMS error", "N"))
    max_N: float | None = field(metadata=describe_field("largest error", "N"))
    cross_validation_N: float | None = field(metadata=describe_field("RMS error at pairs left out one at a time", "N"))
    rising: bool


@dataclass(frozen=True)
class SpringModel:
    """One spring; ``before`` are the coefficients that were in force, none for a table."""

    recommended: int
    reason: str
    fits: tuple[StoredSpringFit, ...]
    before: tuple[float, ...] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class SpringQuality:
    """Measured pairs, thinned to be drawn, the errors of each order at them, and the curves by order, "x" the first."""

    pairs: int
    hysteresis_N: float | None
    x: tuple[float, ...]
    F: tuple[float, ...]
    rising: tuple[bool, ...]
    errors: dict[str, tuple[float, ...]]
    curve: dict[str, tuple[float, ...]]

    @property
    def curve_x(self) -> tuple[float, ...]:
        """Where the curves are drawn."""
        return self.curve["x"]


@dataclass(frozen=True)
class SpringModels:
    """Both springs of a sweep, or the one of a table."""

    A: SpringModel | None = field(default=None, metadata=ABSENT)
    B: SpringModel | None = field(default=None, metadata=ABSENT)
    table: SpringModel | None = field(default=None, metadata=ABSENT)
    version: int = VERSION


@dataclass(frozen=True)
class SpringQualities:
    """How good they are."""

    A: SpringQuality | None = field(default=None, metadata=ABSENT)
    B: SpringQuality | None = field(default=None, metadata=ABSENT)
    table: SpringQuality | None = field(default=None, metadata=ABSENT)
    version: int = VERSION


@dataclass(frozen=True)
class SpringResult:
    """One spring: its model, and how good that is."""

    model: SpringModel
    quality: SpringQuality


@dataclass(frozen=True)
class TableReading:
    """What was read of a table: the units of x and F, how the file is laid out, other columns with the reason."""

    x_unit: str
    F_unit: str
    layout: dict[str, str | int]
    not_read: dict[str, str]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class TableRecord:
    """The file that a table came from, and what was read of it; None for tables from before that was kept."""

    file: str
    sha256: str
    points: int | None = None
    read: TableReading | None = None


SPRING_MODELS: DocumentCodec[SpringModels] = DocumentCodec(SpringModels, "its model", VERSION)
SPRING_QUALITIES: DocumentCodec[SpringQualities] = DocumentCodec(SpringQualities, "the quality of its model", VERSION)
TABLE: DocumentCodec[TableRecord] = DocumentCodec(TableRecord, "what is told of its file", VERSION)


def combine_spring_results(models: SpringModels, qualities: SpringQualities, of: str) -> dict[str, SpringResult]:
    """Return the springs of ``of`` by name: "A" and "B", or "table". Raises UnreadableDocumentError."""
    both = ((name, getattr(models, name), getattr(qualities, name)) for name in ("A", "B", "table"))
    there = [(name, model, quality) for name, model, quality in both if model or quality]
    missing = next((name for name, model, quality in there if not (model and quality)), "" if there else "A")
    if missing:
        raise UnreadableDocumentError(f"{of}: its model cannot be read, field {missing}: it is missing")
    return {name: SpringResult(model, quality) for name, model, quality in there}
