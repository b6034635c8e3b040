"""What a motor identification found of both motors: K_m [rad/(V·s)], T_m [s], Coulomb voltage u_c [V], and how good."""

from dataclasses import dataclass, field

from backend.documents.edge import ABSENT, Edge
from backend.identification.models import Grade
from plant.parameters import Side

VERSION = 1


@dataclass(frozen=True)
class Fitted:
    """Least squares on position, or its standard errors."""

    K_m: float | None
    T_m: float | None
    u_c: float | None


@dataclass(frozen=True)
class Pair:
    """Gain and time constant alone."""

    K_m: float | None
    T_m: float | None


@dataclass(frozen=True)
class RuleStep:
    """The 63.21 % rule on one step [V]."""

    voltage: float
    K_m: float | None
    T_m: float | None


@dataclass(frozen=True)
class MotorModel:
    """One motor; ``before`` is what was in force."""

    parameters: Fitted
    std_errors: Fitted
    coulomb: bool
    rule: tuple[RuleStep, ...]
    rule_mean: Pair
    rule_spread: Pair
    before: Pair


@dataclass(frozen=True)
class RefusedStep:
    """A step [V] that could not be used, and why."""

    voltage: float
    reason: str


@dataclass(frozen=True)
class StepCurve:
    """A few points of a step [V] as measured and as the model says, to draw: t [s], turn [rad]."""

    voltage: float
    t: tuple[float, ...]
    measured: tuple[float, ...]
    model: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class MotorQuality:
    """How well the model of one motor describes its steps; ``grade`` is None where it was stored without."""

    rms_counts: float | None
    grade: Grade | None = field(default=None, metadata=ABSENT)
    verdict: str
    refused: tuple[RefusedStep, ...]
    steps: tuple[StepCurve, ...]


@dataclass(frozen=True)
class MotorModels:
    """Both motors."""

    A: MotorModel
    B: MotorModel
    version: int = VERSION


@dataclass(frozen=True)
class MotorQualities:
    """How good both are."""

    A: MotorQuality
    B: MotorQuality
    version: int = VERSION


@dataclass(frozen=True)
class MotorFound:
    """One motor: its model, and how good that is."""

    model: MotorModel
    quality: MotorQuality


@dataclass(frozen=True)
class MotorsFound:
    """All that is stored of a motor identification."""

    models: MotorModels
    qualities: MotorQualities

    def side(self, side: Side) -> MotorFound:
        """Return one motor."""
        if side == "A":
            return MotorFound(self.models.A, self.qualities.A)
        return MotorFound(self.models.B, self.qualities.B)


MODELS: Edge[MotorModels] = Edge(MotorModels, "its model", VERSION)
QUALITIES: Edge[MotorQualities] = Edge(MotorQualities, "the quality of its model", VERSION)
