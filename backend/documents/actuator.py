"""What an actuator identification found: the models of G_q and G_S, how good they are, and which samples they used.

All numbers in SI; None stands for a figure that could not be had, or that an earlier version did not keep.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field

from backend.documents.edge import ABSENT, Edge
from backend.identification.models import Grade

VERSION = 1
ChannelName = Literal["G_q", "G_S"]
CHANNELS: tuple[ChannelName, ...] = ("G_q", "G_S")

Numbers = tuple[float | None, ...]


@dataclass(frozen=True)
class Reduced:
    """K/(T s + 1) with gain and low-frequency phase of a larger model, with standard errors."""

    K: float
    T: float
    K_std: float | None = None
    T_std: float | None = None


@dataclass(frozen=True, kw_only=True)
class ChannelModel:
    """The transfer function of one channel; ``covariance`` in the order of its structure's parameters."""

    structure: str
    parameters: dict[str, float]
    std_errors: dict[str, float | None] = field(default_factory=dict)
    covariance: tuple[Numbers, ...] = ()
    noise: Numbers = ()
    method: str | None = None
    first_order: Reduced


@dataclass(frozen=True, kw_only=True)
class ActuatorModel:
    """Both channels, at the joint position and stiffness of rest before the excitation."""

    S_nominal: float
    q_nominal: float | None = None
    G_q: ChannelModel
    G_S: ChannelModel
    version: int = VERSION


@dataclass(frozen=True, kw_only=True)
class ResidualTest:
    """Correlations at ``lags_s`` [s] beside their bounds; earlier versions kept one lag's 99 % ``band`` instead."""

    lags_s: tuple[float, ...]
    correlation: Numbers
    bound: Numbers | None = field(default=None, metadata=ABSENT)
    band: Numbers | None = field(default=None, metadata=ABSENT)
    passed: bool


@dataclass(frozen=True, kw_only=True)
class ResidualTests:
    """Tests of the whitened residuals, and information criteria."""

    whiteness: ResidualTest
    input_correlation: ResidualTest
    std: float | None = None
    AIC: float | None = None
    BIC: float | None = None
    FPE: float | None = None


@dataclass(frozen=True)
class FrequencyEstimate:
    """The response without a model, line by line, and how far the model is from it where that can be trusted."""

    omega: tuple[float, ...]
    magnitude: Numbers
    phase_deg: Numbers
    coherence: Numbers
    worst_gain_percent: float | None
    worst_phase_deg: float | None
    trusted_lines: int


@dataclass(frozen=True, kw_only=True)
class Candidate:
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
class NoArx:
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
    residuals: ResidualTests
    frequency: FrequencyEstimate | None = field(default=None, metadata=ABSENT)
    usable: bool = False
    grade: Grade
    verdict: str = ""
    candidates: tuple[Annotated[Candidate | FailedCandidate, Field(union_mode="left_to_right")], ...] = ()
    arx: Annotated[ArxEstimate | NoArx | None, Field(union_mode="left_to_right")] = field(default=None, metadata=ABSENT)


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
class Channel:
    """One channel: its model, and how good that is."""

    model: ChannelModel
    quality: ChannelQuality


@dataclass(frozen=True)
class ActuatorFound:
    """All that is stored of an actuator identification."""

    model: ActuatorModel
    quality: ActuatorQuality

    def channel(self, name: ChannelName) -> Channel:
        """Return one channel."""
        if name == "G_q":
            return Channel(self.model.G_q, self.quality.G_q)
        return Channel(self.model.G_S, self.quality.G_S)


@dataclass(frozen=True, kw_only=True)
class PartialReduced:
    """What of a first-order model was kept."""

    K: float | None = None
    T: float | None = None
    K_std: float | None = None
    T_std: float | None = None


@dataclass(frozen=True)
class PartialChannelModel:
    """What of a model a bank tells."""

    first_order: PartialReduced | None = None
    method: str | None = None


@dataclass(frozen=True)
class PartialModel:
    """What of both models a bank tells, where it is there: the estimate may be an early one."""

    S_nominal: float | None = None
    q_nominal: float | None = None
    G_q: PartialChannelModel | None = None
    G_S: PartialChannelModel | None = None


@dataclass(frozen=True)
class PartialChannelQuality:
    """What of a model's quality a bank tells."""

    fit_percent: float | None = None
    grade: Grade | None = None


@dataclass(frozen=True)
class PartialQuality:
    """What of both models' quality a bank tells."""

    G_q: PartialChannelQuality | None = None
    G_S: PartialChannelQuality | None = None


MODEL: Edge[ActuatorModel] = Edge(ActuatorModel, "its model", VERSION)
QUALITY: Edge[ActuatorQuality] = Edge(ActuatorQuality, "the quality of its model", VERSION)
RECORD: Edge[ActuatorRecord] = Edge(ActuatorRecord, "what is told of its samples", VERSION)
OPTIONS: Edge[ActuatorOptions] = Edge(ActuatorOptions, "its options", VERSION)
PARTIAL_MODEL: Edge[PartialModel] = Edge(PartialModel, "its model", VERSION)
PARTIAL_QUALITY: Edge[PartialQuality] = Edge(PartialQuality, "the quality of its model", VERSION)
