"""Identified models beside what they are judged by: data they have not seen, and what geometry and springs say."""

from pydantic import Field

from backend.identification.models import Grade
from backend.messages.base import Schema, quantity


class Stretch(Schema):
    """Samples in a row, evenly thinned to be drawn."""

    label: str = Field(description="what sets it apart, as the voltage of a step; empty where there is one")
    t: list[float] = quantity("s", "time from the first sample of the run, or from a motor's step")
    measured: list[float]
    predicted: list[float]


class UnseenOutput(Schema):
    """One output, as measured and as the model says; in the unit of the signal."""

    name: str = Field(description="G_q or G_S of an actuator, A or B of motors")
    signal: str
    unit: str
    fit_percent: float | None = Field(description="100 (1 - |y - y_hat| / |y - mean y|) over all samples [%]")
    rms: float | None = Field(description="RMS of measured minus predicted, in the unit of the signal")
    samples: int = Field(description="samples that fit and residual are of")
    problem: str = Field(description="why there is nothing; empty where there is")
    stretches: list[Stretch]


class UnseenView(Schema):
    """A model beside the part of a record that it was not fitted to."""

    run: int = Field(description="identification run whose model it is")
    of: int = Field(description="run whose record it is")
    own: bool = Field(description="whether that is its own run: what is predicted was then left out of the fit")
    kind: str
    outputs: list[UnseenOutput]


class Against(Schema):
    """A figure of a model beside what geometry, springs and motor loops predict for the same run."""

    identified: float
    std: float | None = Field(description="standard error; null where it was not kept or could not be had")
    predicted: float
    off_percent: float = Field(description="100 (identified / predicted - 1) [%]")


class ChannelAgainst(Schema):
    """Gain and sum of lags of G_q or G_S."""

    K: Against
    T: Against
    grade: Grade


class TrendRow(Schema):
    """One actuator identification; predicted with the parameters and λ of the motor loops of its own run."""

    run: int
    S: float = quantity("N·m/rad", "stiffness at which it was made")
    G_q: ChannelAgainst
    G_S: ChannelAgainst


class Predicted(Schema):
    """What is predicted over S with what is in force now."""

    S: list[float] = quantity("N·m/rad", "stiffness")
    K_q: list[float]
    T_q: list[float] = quantity("s", "sum of lags of G_q")
    K_S: list[float]
    T_S: list[float] = quantity("s", "sum of lags of G_S")


class LoadFrictionEstimate(Schema):
    """Coulomb friction c0 + c1 r_m F of motor A at the gearbox outlet, with standard errors."""

    c0: float = quantity("N·m", "Coulomb friction without load")
    c0_std: float = quantity("N·m", "standard error of c0")
    c1: float = Field(description="friction per load torque r_m F")
    c1_std: float = Field(description="standard error of c1")
    c0_c1_covariance: float = Field(description="covariance of c0 and c1 [N·m]")
    K_t: float = quantity("N·m/V", "torque per volt at rest, from the same fit")
    K_t_std: float = quantity("N·m/V", "standard error of K_t")
    runs: list[int] = Field(description="runs that were used")
    tensions_N: list[float] = quantity("N", "their mean tensions")
    samples: int = Field(description="samples that counted")


class LoadFriction(Schema):
    """What the newest run at each tension says of the friction over the load."""

    estimate: LoadFrictionEstimate | None = Field(description="null where it is not measured")
    problem: str = Field(description="why it is not measured; empty where it is")
    sentence: str
    left_out: list[str] = Field(description="what was not used or not measured, each with the reason")


class Trend(Schema):
    """Identified gains and lags in order of S, beside what geometry, springs and motor loops predict."""

    rows: list[TrendRow]
    predicted: Predicted
    left_out: list[str] = Field(description="identifications that are not among the rows, each with the reason")
    friction: LoadFriction
