"""What identification returns: plain data, JSON-ready through ``to_json``."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from backend.identification.record import Signal
from backend.identification.structures import structure
from backend.units import percent

Complex = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]


@dataclass(frozen=True)
class Model:
    """A transfer function b0 e^(-t_d s) / (a_N s^N + ... + a_1 s + 1), as named parameters of a structure."""

    structure: str
    parameters: dict[str, float]

    @property
    def vector(self) -> Signal:
        """Parameters in the structure's order, shape (p,)."""
        return np.array([self.parameters[name] for name in structure(self.structure).names])

    @property
    def denominator(self) -> Signal:
        """1, a_1 .. a_N in ascending powers of s, shape (order + 1,)."""
        return structure(self.structure).denominator(self.vector)

    @property
    def poles(self) -> Complex:
        """Poles [rad/s], shape (order,)."""
        return structure(self.structure).poles(self.vector)

    @property
    def gain(self) -> float:
        """Static gain K [unit of y / unit of u]."""
        return float(self.vector[0])

    @property
    def sum_of_lags(self) -> float:
        """T [s]: minus the slope of the phase at zero frequency, which for these structures is a_1 + t_d."""
        return structure(self.structure).sum_of_lags(self.vector)

    @property
    def dead_time(self) -> float:
        """t_d [s], 0 for structures without."""
        return structure(self.structure).dead_time(self.vector)

    def response(self, omega: Signal) -> Complex:
        """Frequency response at ``omega`` [rad/s], same shape."""
        s = 1j * np.asarray(omega)
        return np.asarray(self.gain * np.exp(-self.dead_time * s) / np.polyval(self.denominator[::-1], s))


@dataclass(frozen=True)
class FirstOrder:
    """K/(T s + 1) with gain and low-frequency phase of a larger model; T [s] is its sum of lags and dead time."""

    K: float
    T: float
    K_std: float
    T_std: float


@dataclass(frozen=True)
class DryFriction:
    """A motor with dry friction, fitted to the record: K [unit of y / unit of u], T [s], u_c [unit of u].

    ``found`` says whether the friction is there; where it is not, the standard errors say how far what it could be
    leaves K and T open. ``fit_percent`` is that of its simulation on the whole record. ``t_d`` [s] is its dead time, 0
    beside a linear model without one.
    """

    found: bool
    K: float
    T: float
    u_c: float
    K_std: float
    T_std: float
    u_c_std: float
    fit_percent: float
    t_d: float = 0.0

    def off_percent(self, K: float, T: float) -> tuple[float, float]:
        """How far a linear gain and sum of lags and dead time are from these, in per cent."""
        return 100.0 * (K / self.K - 1.0), 100.0 * (T / (self.T + self.t_d) - 1.0)


@dataclass(frozen=True)
class CorrelationTest:
    """Correlations at ``lags_s`` [s] beside their bounds; ``passed`` where none leaves its bound.

    The bounds belong to the test: at the 1 % level for all lags together, that is the largest of them.
    """

    lags_s: tuple[float, ...]
    correlation: tuple[float, ...]
    bound: tuple[float, ...]
    passed: bool


@dataclass(frozen=True)
class Residuals:
    """Tests of the whitened residuals and information criteria (smaller is better)."""

    whiteness: CorrelationTest
    input_correlation: CorrelationTest
    std: float
    AIC: float
    BIC: float
    FPE: float


@dataclass(frozen=True)
class FrequencyCheck:
    """A non-parametric frequency response, and how far the model is from it where that can be trusted.

    ``omega`` [rad/s], ``magnitude`` [unit of y / unit of u], ``phase_deg`` [deg, unwrapped] and ``coherence`` (0 to 1)
    line by line; the worst deviations are taken over the ``trusted_lines``: coherence at least 0.9, input power at
    least a hundredth of its largest.
    """

    omega: tuple[float, ...]
    magnitude: tuple[float, ...]
    phase_deg: tuple[float, ...]
    coherence: tuple[float, ...]
    worst_gain_percent: float
    worst_phase_deg: float
    trusted_lines: int


class Grade(StrEnum):
    """How far a model may be trusted for tuning."""

    USABLE = "usable"
    CAUTION = "usable with caution"
    UNUSABLE = "not usable"


def worst(*grades: Grade) -> Grade:
    """Return the least of some grades."""
    return max(grades, key=list(Grade).index)


def joint_method(methods: Mapping[str, str]) -> str:
    """Name the estimators that ran, by channel; once where they are the same."""
    if len(set(methods.values())) == 1:
        return next(iter(methods.values()))
    return "; ".join(f"{channel}: {method}" for channel, method in methods.items())


@dataclass(frozen=True)
class Hint:
    """A structure that explains a record better than the one that was asked for; both fitted to the same samples.

    ``dead_time`` where it is the same with a dead time, else it is of a higher order. ``fit_percent`` is the simulated
    fit on the record, ``BIC_gain`` by how much its BIC is lower, ``F`` the ratio of the F test with
    ``more_parameters`` degrees of freedom, initial states among them. ``white`` and ``independent_of_input`` are the
    tests of its residuals.
    """

    structure: str
    dead_time: bool
    fit_percent_before: float
    fit_percent: float
    BIC_gain: float
    F: float
    more_parameters: int
    white: bool
    independent_of_input: bool

    @property
    def sentence(self) -> str:
        """What would help, with figures."""
        return (
            f"{'a dead time' if self.dead_time else 'a higher order'} would help: {self.structure} fits"
            f" {percent(self.fit_percent)} % of the record where this structure fits"
            f" {percent(self.fit_percent_before)} %"
            f" (BIC lower by {self.BIC_gain:.3g}, F = {self.F:.3g})"
        )


@dataclass(frozen=True)
class InputOffset:
    """The input u_0 [unit of u] at which the output would be zero, with its standard error.

    An offset of the output by -K u_0 looks the same.
    """

    u_0: float
    u_0_std: float


@dataclass(frozen=True)
class Verdict:
    """A grade and its reasons; ``sentence`` says both in one line."""

    grade: Grade
    reasons: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The verdict as the operator reads it."""
        reasons = "; ".join(self.reasons)
        return f"{self.grade.value.capitalize()} for tuning: {reasons}."


@dataclass(frozen=True)
class Estimate:
    """A model, how it was found and how good it is.

    ``fit_percent`` is the simulated fit 100 (1 - |y - y_hat| / |y - mean y|) on the last third of the record by a
    model fitted to the first two thirds, NaN where that could not be had, as the verdict then says;
    ``fit_all_percent`` that of the reported model on the whole record. ``friction`` is there where something moves both
    ways, so that dry friction would be seen. ``spread_percent`` is how well K and T are known, with what the structure
    leaves out and the friction that the record cannot exclude; NaN where that could not be had.
    ``covariance``, shape (p, p), is in the order of ``model.vector`` and robust to coloured residuals. ``noise`` are
    the coefficients d_1 .. of the autoregressive noise model 1/D, empty for white noise. ``gain_error_percent``
    compares the gain with ``gain_geometry`` where that is known; ``y_resolution`` is one count of the output's sensor,
    given or found. ``hint`` is there where another structure would help, ``input_offset`` where it differs from zero.
    """

    model: Model
    std_errors: dict[str, float]
    covariance: Signal = field(repr=False)
    method: str
    fit_percent: float
    fit_all_percent: float
    first_order: FirstOrder
    noise: tuple[float, ...]
    residuals: Residuals = field(repr=False)
    frequency: FrequencyCheck = field(repr=False)
    gain_geometry: float | None
    gain_error_percent: float | None
    y_resolution: float | None
    friction: DryFriction | None
    spread_percent: float
    verdict: Verdict
    hint: Hint | None = None
    input_offset: InputOffset | None = None

    def summary(self) -> dict[str, Any]:
        """Return what the command line prints of foreign data."""
        return {
            "parameters": self.model.parameters,
            "std_errors": self.std_errors,
            "method": self.method,
            "fit_percent": self.fit_percent,
            "spread_percent": self.spread_percent,
            "friction": None if self.friction is None else asdict(self.friction),
            "input_offset": None if self.input_offset is None else asdict(self.input_offset),
            "hint": None if self.hint is None else asdict(self.hint),
            "grade": self.verdict.grade,
            "verdict": self.verdict.sentence,
        }

    def to_json(self) -> dict[str, Any]:
        """Plain dictionaries, lists and numbers."""
        document = asdict(self)
        document["covariance"] = self.covariance.tolist()
        document["verdict"] = {**asdict(self.verdict), "sentence": self.verdict.sentence}
        return document
