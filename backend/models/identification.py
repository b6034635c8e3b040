"""Stored results of identifications of actuator, motors and springs. Pure.

Numbers are in SI. None stands for a number that could not be computed, or that an earlier version did not store.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field

from backend.identification import FirstOrder, FrequencyCheck, Grade, Residuals
from backend.models import messages
from backend.models.document import ABSENT, DocumentCodec, UnreadableDocumentError
from backend.response_docs import describe_field
from plant import Side

# Actuator ------------------------------------------------------------------------------------------


VERSION = 1
ChannelName = Literal["G_q", "G_S"]
CHANNELS: tuple[ChannelName, ...] = ("G_q", "G_S")

Numbers = tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class ChannelModel:
    """Transfer function of one channel.

    ``covariance`` has the order of the parameters of its structure.
    """

    structure: str
    parameters: dict[str, float]
    std_errors: dict[str, float | None] = field(default_factory=dict)
    covariance: tuple[Numbers, ...] = ()
    noise: Numbers = ()
    method: str | None = None
    first_order: FirstOrder


@dataclass(frozen=True, kw_only=True)
class ActuatorModel:
    """Models of both channels, at position and stiffness before the excitation."""

    S_nominal: float
    q_nominal: float | None = None
    G_q: ChannelModel
    G_S: ChannelModel
    version: int = VERSION


@dataclass(frozen=True, kw_only=True)
class TriedStructure:
    """A model structure that was tried, with a summary of its model."""

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
    """A model structure that gave no model, and why."""

    structure: str
    problem: Annotated[str, Field(min_length=1)]


@dataclass(frozen=True, kw_only=True)
class ArxEstimate:
    """Result of the paper's method on the same record."""

    method: str | None = field(default=None, metadata=ABSENT)
    fit_percent: float | None = None
    K: float
    T: float
    K_std: float | None = None
    T_std: float | None = None
    problem: str = ""


@dataclass(frozen=True)
class MissingArxEstimate:
    """Reason why the paper's method gives no result."""

    problem: Annotated[str, Field(min_length=1)]


@dataclass(frozen=True, kw_only=True)
class ChannelQuality:
    """Quality of the model of one channel; ``arx`` is None if it was not computed."""

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
    """Quality of both models.

    ``motion_counts`` is the motion of the joint, peak to peak.
    """

    motion_counts: float | None = None
    G_q: ChannelQuality
    G_S: ChannelQuality
    version: int = VERSION


@dataclass(frozen=True, kw_only=True)
class ActuatorRecord:
    """Samples of the run that were used: from ``first_sample`` on, every ``period_s``."""

    input: str = "theta_A_ref"
    outputs: tuple[str, ...] = ("q", "S")
    first_sample: int
    samples: int
    period_s: float


@dataclass(frozen=True, kw_only=True)
class ActuatorOptions:
    """Options of the identification: tension [N] and estimator."""

    tension_N: float
    estimator: str | None = None


@dataclass(frozen=True)
class IdentifiedChannel:
    """Model and quality of one channel."""

    model: ChannelModel
    quality: ChannelQuality


@dataclass(frozen=True)
class ActuatorResult:
    """Models and qualities of an actuator identification."""

    model: ActuatorModel
    quality: ActuatorQuality

    def channel(self, name: ChannelName) -> IdentifiedChannel:
        """Return model and quality of one channel."""
        if name == "G_q":
            return IdentifiedChannel(self.model.G_q, self.quality.G_q)
        return IdentifiedChannel(self.model.G_S, self.quality.G_S)


ACTUATOR_MODEL: DocumentCodec[ActuatorModel] = DocumentCodec(ActuatorModel, "its model", VERSION)
ACTUATOR_QUALITY: DocumentCodec[ActuatorQuality] = DocumentCodec(ActuatorQuality, "the quality of its model", VERSION)
ACTUATOR_RECORD: DocumentCodec[ActuatorRecord] = DocumentCodec(
    ActuatorRecord, "the description of its samples", VERSION
)
ACTUATOR_OPTIONS: DocumentCodec[ActuatorOptions] = DocumentCodec(ActuatorOptions, "its options", VERSION)


# Motors --------------------------------------------------------------------------------------------
# K_m in rad/(V·s), T_m in s, Coulomb voltage u_c in V.


@dataclass(frozen=True)
class MotorFit:
    """Least-squares fit on position, or its standard errors."""

    K_m: float | None
    T_m: float | None
    u_c: float | None


@dataclass(frozen=True)
class MotorConstants:
    """Gain and time constant of a motor."""

    K_m: float | None
    T_m: float | None


@dataclass(frozen=True)
class StepRuleEstimate:
    """Estimate by the 63.21 % rule from one voltage step [V]."""

    voltage: float
    K_m: float | None
    T_m: float | None


@dataclass(frozen=True)
class IdentifiedMotor:
    """Result for one motor; ``before`` are the parameters that were active."""

    parameters: MotorFit
    std_errors: MotorFit
    coulomb: bool
    rule: tuple[StepRuleEstimate, ...]
    rule_mean: MotorConstants
    rule_spread: MotorConstants
    before: MotorConstants


@dataclass(frozen=True)
class RefusedStep:
    """A voltage step [V] that could not be used, and why."""

    voltage: float
    reason: str


@dataclass(frozen=True)
class StoredStepCurve:
    """Points of a voltage step [V] to draw, measured and modelled: t [s], angle [rad]."""

    voltage: float = field(metadata=describe_field("voltage of the step", "V"))
    t: tuple[float, ...] = field(metadata=describe_field("time since the step", "s"))
    measured: tuple[float, ...] = field(metadata=describe_field("measured rotation", "rad"))
    model: tuple[float, ...] = field(metadata=describe_field("rotation of the model", "rad"))


@dataclass(frozen=True, kw_only=True)
class MotorQuality:
    """Quality of the model of one motor."""

    rms_counts: float | None
    grade: Grade
    verdict: str
    refused: tuple[RefusedStep, ...]
    steps: tuple[StoredStepCurve, ...]


@dataclass(frozen=True)
class MotorModels:
    """Results for both motors."""

    A: IdentifiedMotor
    B: IdentifiedMotor
    version: int = VERSION


@dataclass(frozen=True)
class MotorQualities:
    """Quality of the models of both motors."""

    A: MotorQuality
    B: MotorQuality
    version: int = VERSION


@dataclass(frozen=True)
class MotorResult:
    """Model and quality of one motor."""

    model: IdentifiedMotor
    quality: MotorQuality


@dataclass(frozen=True)
class MotorsResult:
    """Models and qualities of a motor identification."""

    models: MotorModels
    qualities: MotorQualities

    def side(self, side: Side) -> MotorResult:
        """Return model and quality of one motor."""
        if side == "A":
            return MotorResult(self.models.A, self.qualities.A)
        return MotorResult(self.models.B, self.qualities.B)


MOTOR_MODELS: DocumentCodec[MotorModels] = DocumentCodec(MotorModels, "its model", VERSION)
MOTOR_QUALITIES: DocumentCodec[MotorQualities] = DocumentCodec(MotorQualities, "the quality of its model", VERSION)


# Springs -------------------------------------------------------------------------------------------
# Polynomials F = k_0 + k_1 x + … of several orders, x in m and F in N.


@dataclass(frozen=True)
class StoredSpringFit:
    """A polynomial of one order and its errors.

    ``rising`` says whether it rises over the whole measured range.
    """

    order: int
    k: tuple[float, ...] = field(metadata=describe_field("coefficients, lowest power first [N/m^i]"))
    std_errors: tuple[float | None, ...]
    rms_N: float | None = field(metadata=describe_field("RMS error", "N"))
    max_N: float | None = field(metadata=describe_field("largest error", "N"))
    cross_validation_N: float | None = field(
        metadata=describe_field("RMS cross-validation error, leaving out one pair at a time", "N")
    )
    rising: bool


@dataclass(frozen=True)
class SpringModel:
    """Polynomials of one spring.

    ``before`` are the coefficients that were active, None for a table.
    """

    recommended: int
    reason: str
    fits: tuple[StoredSpringFit, ...]
    before: tuple[float, ...] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class SpringQuality:
    """Measured points of one spring, decimated for drawing.

    ``errors`` and ``curve`` are by order; ``curve`` also has "x".
    """

    pairs: int
    hysteresis_N: float | None
    x: tuple[float, ...]
    F: tuple[float, ...]
    rising: tuple[bool, ...]
    errors: dict[str, tuple[float, ...]]
    curve: dict[str, tuple[float, ...]]

    @property
    def curve_x(self) -> tuple[float, ...]:
        """Elongations of the curves [m]."""
        return self.curve["x"]


@dataclass(frozen=True)
class SpringModels:
    """Models of both springs from a sweep, or of one from a table."""

    A: SpringModel | None = field(default=None, metadata=ABSENT)
    B: SpringModel | None = field(default=None, metadata=ABSENT)
    table: SpringModel | None = field(default=None, metadata=ABSENT)
    version: int = VERSION


@dataclass(frozen=True)
class SpringQualities:
    """Quality of the models in ``SpringModels``."""

    A: SpringQuality | None = field(default=None, metadata=ABSENT)
    B: SpringQuality | None = field(default=None, metadata=ABSENT)
    table: SpringQuality | None = field(default=None, metadata=ABSENT)
    version: int = VERSION


@dataclass(frozen=True)
class SpringResult:
    """Model and quality of one spring."""

    model: SpringModel
    quality: SpringQuality


@dataclass(frozen=True)
class TableReading:
    """Units and layout of an imported table.

    ``not_read`` has the reason by the name of an ignored column.
    """

    x_unit: str
    F_unit: str
    layout: dict[str, str | int]
    not_read: dict[str, str]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class TableRecord:
    """File of an imported table.

    ``read`` is None for tables that an earlier version imported.
    """

    file: str
    sha256: str
    points: int | None = None
    read: TableReading | None = None


SPRING_MODELS: DocumentCodec[SpringModels] = DocumentCodec(SpringModels, "its model", VERSION)
SPRING_QUALITIES: DocumentCodec[SpringQualities] = DocumentCodec(SpringQualities, "the quality of its model", VERSION)
TABLE: DocumentCodec[TableRecord] = DocumentCodec(TableRecord, "the description of its file", VERSION)


def combine_spring_results(models: SpringModels, qualities: SpringQualities, owner: str) -> dict[str, SpringResult]:
    """Return the results by spring: "A" and "B", or "table".

    Error messages name the ``owner``, such as "run 12". Raises UnreadableDocumentError.
    """
    pairs = ((name, getattr(models, name), getattr(qualities, name)) for name in ("A", "B", "table"))
    present = [(name, model, quality) for name, model, quality in pairs if model or quality]
    missing = next((name for name, model, quality in present if not (model and quality)), "" if present else "A")
    if missing:
        raise UnreadableDocumentError(
            messages.document_unreadable(owner=owner, label="its model", field=missing, reason="it is missing")
        )
    return {name: SpringResult(model, quality) for name, model, quality in present}
