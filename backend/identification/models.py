"""Model structures, their responses, their reduction to first order, and results."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import cache
from typing import Any

import numpy as np

from backend.identification import messages
from backend.identification.records import Signal, StructureError, UnstableModelError
from plant import Message

# Published models ----------------------------------------------------------------------------------
# Table 1 of the paper: the models that its authors identified on their rig, for comparison.


@dataclass(frozen=True)
class Published:
    """A row: S [N·m/rad] at the operating point; parameters of G_q and of G_S.

    K, T [s], a2 [s²] and a1 [s]; ``a1_q`` as corrected by erratum E2, a tenth of the printed value.
    """

    S: float
    K_q: float
    T_q: float
    K_S: float
    T_S: float
    a2_q: float
    a1_q: float
    a2_S: float
    a1_S: float


TABLE_1 = {
    10.0: Published(
        S=8.24, K_q=0.0498, T_q=0.64, K_S=1.17, T_S=0.57, a2_q=7.329e-5, a1_q=5.747e-3, a2_S=2.3e-5, a1_S=1.6e-3
    ),
    20.0: Published(
        S=10.55, K_q=0.0484, T_q=0.78, K_S=2.826, T_S=1.19, a2_q=4.919e-5, a1_q=4.688e-3, a2_S=2.1e-5, a1_S=2.2e-3
    ),
    30.0: Published(
        S=12.43, K_q=0.0495, T_q=1.58, K_S=1.821, T_S=0.62, a2_q=3.475e-5, a1_q=3.309e-3, a2_S=1.3e-5, a1_S=4.2e-3
    ),
    40.0: Published(
        S=14.06, K_q=0.0491, T_q=2.98, K_S=1.47, T_S=0.43, a2_q=2.2e-6, a1_q=1.07e-3, a2_S=7.7e-6, a1_S=7.4e-4
    ),
}
"""Rows by tendon tension [N]."""


# Response ------------------------------------------------------------------------------------------
# Exact responses of the structures to an input that is held between samples (zero-order hold).
#
# Nothing is approximated: the state equations are integrated by the matrix exponential and executed as second-order
# sections, which keep several poles near z = 1 separate, unlike one long polynomial.


Poles = np.ndarray[tuple[int], np.dtype[np.complex128]]


def split_poles(poles: Poles) -> tuple[Signal, Poles]:
    """Return the real poles, and the upper one of each complex pair."""
    real = np.abs(poles.imag) <= 1e-9 * np.abs(poles)
    return poles[real].real, poles[poles.imag > 1e-9 * np.abs(poles)]


def state_space(poles: Poles) -> tuple[Signal, Signal, Signal]:
    """Return a cascade of lags and oscillators with static gain 1.

    A (n, n) [1/s], B (n,) [1/s], C (n,). Every state is of the size of the input, so that the matrix exponential is
    accurate.
    """
    lags, pairs = split_poles(poles)
    order = lags.size + 2 * pairs.size
    A, B, C = np.zeros((order, order)), np.zeros(order), np.zeros(order)
    state, fed_by = 0, -1
    for lag in lags:
        A[state, state] = lag
        _connect_input(A, B, state, fed_by, -lag)
        state, fed_by = state + 1, state
    for pole in pairs:
        omega = abs(pole)
        A[state, state + 1], A[state + 1, state], A[state + 1, state + 1] = omega, -omega, 2.0 * pole.real
        _connect_input(A, B, state + 1, fed_by, omega)
        state, fed_by = state + 2, state
    C[fed_by] = 1.0
    return A, B, C


def _connect_input(A: Signal, B: Signal, state: int, fed_by: int, rate: float) -> None:
    if fed_by < 0:
        B[state] = rate
    else:
        A[state, fed_by] = rate


def sections(poles: Poles, period_s: float) -> Signal:
    """Return the all-pole second-order sections of the sampled system, shape (m, 6).

    The static gain is 1.
    """
    lags, pairs = split_poles(poles)
    rows = []
    for pole in pairs:
        a1, a2 = -2.0 * np.exp(pole.real * period_s) * np.cos(pole.imag * period_s), np.exp(2.0 * pole.real * period_s)
        gain = abs(np.expm1(pole * period_s)) ** 2
        rows.append([gain, 0.0, 0.0, 1.0, a1, a2])
    decay, loss = np.exp(lags * period_s), -np.expm1(lags * period_s)
    for i in range(0, lags.size - 1, 2):
        rows.append([loss[i] * loss[i + 1], 0.0, 0.0, 1.0, -decay[i] - decay[i + 1], decay[i] * decay[i + 1]])
    if lags.size % 2:
        rows.append([loss[-1], 0.0, 0.0, 1.0, -decay[-1], 0.0])
    return np.array(rows)


def moving_average(poles: Poles, period_s: float, part: float = 1.0) -> Signal:
    """Return the numerator of the sampled system, sum 1, shape (n,).

    The powers of z^-1 ascend. The output is taken a ``part``, 0 < part <= 1, of a sample time after the newest input;
    for a whole sample time there are as many taps as poles, otherwise one more.
    """
    A, B, C = state_space(poles)
    order = B.size
    step, x = _discretize_zoh(A, B, period_s)
    seen, first = _discretize_zoh(A, B, part * period_s)
    impulse = np.empty(order + 1)
    impulse[0] = C @ first
    for k in range(1, order + 1):
        impulse[k] = C @ seen @ x
        x = step @ x
    taps = np.convolve(np.real(np.poly(np.exp(poles * period_s))), impulse)[: order + (part < 1.0)]
    return np.asarray(taps / taps.sum())


def _discretize_zoh(A: Signal, B: Signal, time_s: float) -> tuple[Signal, Signal]:
    """Return the state transition, shape (n, n), and the effect of a held input (n,)."""
    from scipy.linalg import expm

    order = B.size
    joint = np.zeros((order + 1, order + 1))
    joint[:order, :order], joint[:order, order] = A * time_s, B * time_s
    transition = expm(joint)
    return transition[:order, :order], transition[:order, order]


def simulate_response(
    poles: Poles, period_s: float, u: Signal, initial: Signal | None = None, dead_time_s: float = 0.0
) -> Signal:
    """Return the response of the system with these poles and static gain 1.

    The shape is that of ``u``. Without dead time the output at sample k depends on the input up to sample k - 1. With
    one, whole samples or not, the input before the record counts as 0. ``initial``, shape (order,), are coordinates of
    the state before the first sample in the basis of :func:`free_responses`; without it the system is at rest. Raises
    UnstableModelError.
    """
    from scipy.signal import lfilter, sosfilt

    check_stable(poles, period_s)
    whole, part = divmod(dead_time_s / period_s, 1.0)
    late = min(int(whole) + 1, u.size)
    driven = np.zeros(u.size)
    driven[late:] = lfilter(moving_average(poles, period_s, 1.0 - part), [1.0], u[: u.size - late])
    if initial is not None:
        driven[: poles.size] += initial @ _impulses(poles.size)
    return np.asarray(sosfilt(sections(poles, period_s), driven))


def free_responses(poles: Poles, period_s: float, count: int) -> Signal:
    """Return the responses to ``order`` independent initial states without input.

    Shape (count, order).
    """
    from scipy.signal import sosfilt

    # Only until e^-40: the rest is negligible, and would end in slow subnormal numbers.
    alive = min(count, poles.size + int(40.0 / (np.min(-poles.real) * period_s)))
    columns = np.zeros((poles.size, count))
    columns[:, : poles.size] = _impulses(poles.size)
    columns[:, :alive] = sosfilt(sections(poles, period_s), columns[:, :alive], axis=1)
    return columns.T


@cache
def _impulses(order: int) -> Signal:
    """Return an impulse and its differences, (order, order).

    Filtered by the poles they span the free responses.
    """
    rows = np.eye(order)
    for row in range(1, order):
        rows[row] = rows[row - 1] - np.roll(rows[row - 1], 1)
    return rows


def check_stable(poles: Poles, period_s: float) -> None:
    """Raise UnstableModelError unless all poles are in the left half plane.

    Their rates must be between 1e-9 and 50 per sample.
    """
    rates = np.abs(poles) * period_s
    if not (np.all(np.isfinite(poles)) and np.all(poles.real < 0.0)):
        raise UnstableModelError(messages.poles_not_stable(poles=poles))
    if not (np.all(rates > 1e-9) and np.all(rates < 50.0)):
        raise UnstableModelError(messages.poles_not_resolved(poles=poles))


# Structures ----------------------------------------------------------------------------------------
# Model structures: the transfer functions of a few parameters.
#
# All are a gain over a polynomial without zeros, b0 / (a_N s^N + ... + a_1 s + 1), with different parameters, followed
# by a dead time e^(-t_d s) if the structure has one.


MAX_ORDER = 4
MAX_LAGS = 6
DEAD_TIME = "+delay"
"""Suffix of the name of a structure with a dead time."""
KNOWN = f"first, third, lags2 .. lags{MAX_LAGS}, order:1 .. order:{MAX_ORDER}, each also with {DEAD_TIME}"


class DenominatorKind(StrEnum):
    """Parametrization of the denominator."""

    FIRST = "first"
    THIRD = "third"
    LAGS = "lags"
    FREE = "free"


@dataclass(frozen=True)
class Structure:
    """A parametrized transfer function; build it with :func:`find_structure`.

    ``names`` are the parameters in order, the gain first, all others positive; if the structure is ``delayed`` the last
    one is the dead time t_d [s].
    """

    name: str
    kind: DenominatorKind
    order: int
    names: tuple[str, ...]
    delayed: bool = False

    @property
    def undelayed(self) -> "Structure":
        """The structure without dead time."""
        return find_structure(self.name.removesuffix(DEAD_TIME))

    def dead_time(self, parameters: Signal) -> float:
        """Return the dead time [s], 0 if the structure has none."""
        return float(parameters[-1]) if self.delayed else 0.0

    def sum_of_lags(self, parameters: Signal) -> float:
        """Return a_1 + t_d [s], minus the slope of the phase at zero frequency."""
        return float(self.denominator(parameters)[1]) + self.dead_time(parameters)

    def denominator(self, parameters: Signal) -> Signal:
        """Return the coefficients 1, a_1 .. a_N in ascending powers of s.

        Shape (order + 1,); units s^i.
        """
        dynamics = self._dynamics(parameters)
        match self.kind:
            case DenominatorKind.FIRST:
                return np.array([1.0, dynamics[0]])
            case DenominatorKind.THIRD:
                T, a2, a1 = dynamics
                return np.convolve([1.0, T], [1.0, a1, a2])
            case DenominatorKind.LAGS:
                return np.asarray(np.poly1d([dynamics[0], 1.0]) ** self.order).ravel()[::-1]
            case DenominatorKind.FREE:
                return np.concatenate(([1.0], dynamics))

    def poles(self, parameters: Signal) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
        """Return the poles [rad/s], shape (order,)."""
        if self.kind in (DenominatorKind.FIRST, DenominatorKind.LAGS):
            return np.full(self.order, -1.0 / parameters[1], dtype=np.complex128)
        if self.kind is DenominatorKind.THIRD:
            T, a2, a1 = self._dynamics(parameters)
            return np.concatenate(([-1.0 / T], _roots(np.array([1.0, a1, a2]))))
        return _roots(self.denominator(parameters))

    def from_denominator(self, gain: float, denominator: Signal) -> Signal:
        """Return the parameters, without dead time, closest to a stable denominator.

        It has the same order (ascending, 1 first).
        """
        if self.kind is DenominatorKind.FIRST:
            return np.array([gain, denominator[1]])
        if self.kind is DenominatorKind.LAGS:
            return np.array([gain, denominator[1] / self.order])
        if self.kind is DenominatorKind.THIRD:
            poles = _roots(denominator)
            slowest = int(np.argmin(np.where(np.abs(poles.imag) < 1e-9 * np.abs(poles), np.abs(poles), np.inf)))
            a2, a1, _ = np.real(np.poly(np.delete(poles, slowest)) / np.prod(-np.delete(poles, slowest)).real)
            return np.array([gain, -1.0 / poles[slowest].real, a2, a1])
        return np.concatenate(([gain], denominator[1:]))

    def _dynamics(self, parameters: Signal) -> Signal:
        return parameters[1:-1] if self.delayed else parameters[1:]


def find_structure(name: str) -> Structure:
    """Return the structure of a name, one of KNOWN. Raises StructureError."""
    if name.endswith(DEAD_TIME):
        plain = find_structure(name.removesuffix(DEAD_TIME))
        if not plain.delayed:
            return replace(plain, name=name, names=(*plain.names, "t_d"), delayed=True)
    if name == "first":
        return Structure(name, DenominatorKind.FIRST, 1, ("K", "T"))
    if name == "third":
        return Structure(name, DenominatorKind.THIRD, 3, ("K", "T", "a2", "a1"))
    lags = re.fullmatch(r"lags([2-9])", name)
    if lags and int(lags[1]) <= MAX_LAGS:
        return Structure(name, DenominatorKind.LAGS, int(lags[1]), ("K", "tau"))
    free = re.fullmatch(r"order:([1-9])", name)
    if free and int(free[1]) <= MAX_ORDER:
        order = int(free[1])
        return Structure(name, DenominatorKind.FREE, order, ("b0", *(f"a{i}" for i in range(1, order + 1))))
    raise StructureError(messages.unknown_structure(name=name, known=KNOWN))


def _roots(ascending: Signal) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Return the roots of a polynomial in ascending powers.

    The polynomial is scaled first, since a_N may be ten powers of ten below 1.
    """
    order = ascending.size - 1
    scale = abs(ascending[-1]) ** (1.0 / order)
    if not (scale > 0.0 and np.all(np.isfinite(ascending))):
        raise UnstableModelError(messages.coefficients_overflow())
    scaled = ascending / scale ** np.arange(order + 1)
    found = np.asarray(np.roots(scaled[::-1]) / scale, dtype=np.complex128)
    if found.size != order or not np.all(np.isfinite(found)):  # a coefficient that underflows loses its root
        raise UnstableModelError(messages.coefficients_overflow())
    return found


# Result --------------------------------------------------------------------------------------------
# Results of an identification as plain data, JSON-ready through ``to_json``.
#
# First order, residual tests and frequency check are stored directly: NaN is stored as null, and read as None.


Complex = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
Figures = tuple[float | None, ...]


@dataclass(frozen=True)
class Model:
    """Transfer function b0 e^(-t_d s) / (a_N s^N + ... + a_1 s + 1).

    ``parameters`` are those of the structure, by name.
    """

    structure: str
    parameters: dict[str, float]

    @property
    def vector(self) -> Signal:
        """Parameters in the structure's order, shape (p,)."""
        return np.array([self.parameters[name] for name in find_structure(self.structure).names])

    @property
    def denominator(self) -> Signal:
        """Coefficients 1, a_1 .. a_N in ascending powers of s, shape (order + 1,)."""
        return find_structure(self.structure).denominator(self.vector)

    @property
    def poles(self) -> Complex:
        """Poles [rad/s], shape (order,)."""
        return find_structure(self.structure).poles(self.vector)

    @property
    def gain(self) -> float:
        """Static gain K [unit of y / unit of u]."""
        return float(self.vector[0])

    @property
    def sum_of_lags(self) -> float:
        """T [s]: minus the slope of the phase at zero frequency, here a_1 + t_d."""
        return find_structure(self.structure).sum_of_lags(self.vector)

    @property
    def dead_time(self) -> float:
        """Dead time t_d [s], 0 for structures without."""
        return find_structure(self.structure).dead_time(self.vector)

    def response(self, omega: Signal) -> Complex:
        """Return the frequency response at ``omega`` [rad/s], same shape."""
        s = 1j * np.asarray(omega)
        return np.asarray(self.gain * np.exp(-self.dead_time * s) / np.polyval(self.denominator[::-1], s))


@dataclass(frozen=True)
class FirstOrder:
    """K/(T s + 1) with gain and low-frequency phase of a larger model.

    T [s] is the sum of its lags and dead time.
    """

    K: float
    T: float
    K_std: float | None = None
    T_std: float | None = None

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard errors of K and T, NaN if not available."""
        return float("nan") if self.K_std is None else self.K_std, float("nan") if self.T_std is None else self.T_std


@dataclass(frozen=True)
class DryFriction:
    """Model of a motor with Coulomb friction, fitted to the record.

    K [unit of y / unit of u], T [s], u_c [unit of u]. ``found`` states whether friction is present; if not, the
    standard errors show how uncertain K and T are because of possible friction. ``fit_percent`` is that of its
    simulation on the whole record. ``t_d`` [s] is the dead time of this model, 0 if the linear model has none.
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

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard errors of K and T."""
        return self.K_std, self.T_std

    def off_percent(self, K: float, T: float) -> tuple[float, float]:
        """Return the deviations [%] of a linear gain and sum of lags from these.

        The sum of lags includes the dead time.
        """
        return 100.0 * (K / self.K - 1.0), 100.0 * (T / (self.T + self.t_d) - 1.0)


@dataclass(frozen=True)
class CorrelationTest:
    """Correlations at ``lags_s`` [s] with their bounds; ``passed`` if all are within.

    The bounds are those of the test: at the 1 % level for all lags together, that is for the largest of them.
    """

    lags_s: tuple[float, ...]
    correlation: Figures
    bound: Figures
    passed: bool


@dataclass(frozen=True)
class Residuals:
    """Tests of the whitened residuals and information criteria (smaller is better)."""

    whiteness: CorrelationTest
    input_correlation: CorrelationTest
    std: float | None = None
    AIC: float | None = None
    BIC: float | None = None
    FPE: float | None = None


@dataclass(frozen=True)
class FrequencyCheck:
    """A non-parametric frequency response, and the model's deviation from it.

    ``omega`` [rad/s], ``magnitude`` [unit of y / unit of u], ``phase_deg`` [deg, unwrapped] and ``coherence`` (0 to 1)
    by line; the worst deviations are those of the ``trusted_lines``: coherence at least 0.9, input power at least a
    hundredth of its largest.
    """

    omega: tuple[float, ...]
    magnitude: Figures
    phase_deg: Figures
    coherence: Figures
    worst_gain_percent: float | None
    worst_phase_deg: float | None
    trusted_lines: int


class Grade(StrEnum):
    """Suitability of a model for tuning."""

    USABLE = "usable"
    CAUTION = "usable with caution"
    UNUSABLE = "not usable"


def worst_grade(*grades: Grade) -> Grade:
    """Return the worst of some grades."""
    return max(grades, key=list(Grade).index)


def joint_method_name(methods: Mapping[str, str]) -> str:
    """Return the names of the estimators by channel; once if they are equal."""
    if len(set(methods.values())) == 1:
        return next(iter(methods.values()))
    return messages.methods_of_channels(methods=methods)


@dataclass(frozen=True)
class Hint:
    """A structure that explains a record better, fitted to the same samples.

    ``dead_time``: it is the same structure with a dead time, else one of a higher order. ``fit_percent`` is the
    simulated fit on the record, ``BIC_gain`` the reduction of its BIC, ``F`` the ratio of the F test with
    ``more_parameters`` degrees of freedom, initial states included. ``white`` and ``independent_of_input`` are the
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
    def sentence(self) -> Message:
        """The recommendation with its values."""
        return messages.better_structure(
            structure=self.structure,
            dead_time=self.dead_time,
            fit_percent=self.fit_percent,
            fit_percent_before=self.fit_percent_before,
            BIC_gain=self.BIC_gain,
            F=self.F,
        )


@dataclass(frozen=True)
class InputOffset:
    """The input u_0 [unit of u] with zero output, and its standard error.

    Indistinguishable from an offset of the output by -K u_0.
    """

    u_0: float
    u_0_std: float


@dataclass(frozen=True)
class Verdict:
    """A grade and its reasons; ``sentence`` has both in one line."""

    grade: Grade
    reasons: tuple[Message, ...]

    @property
    def sentence(self) -> str:
        """The verdict as text for the operator."""
        return messages.verdict(grade=self.grade.value, reasons=self.reasons)


@dataclass(frozen=True)
class Estimate:
    """A model, its method and its quality.

    ``fit_percent`` is the simulated fit 100 (1 - |y - y_hat| / |y - mean y|) on the last third of the record of a model
    fitted to the first two thirds, NaN if not available, which the verdict explains; ``fit_all_percent`` that of the
    reported model on the whole record. ``friction`` is set for motion in both directions, in which Coulomb friction
    would be visible. ``spread_percent`` is the uncertainty of K and T, including unmodelled dynamics and friction that
    the record cannot exclude; NaN if not available. ``covariance``, shape (p, p), is in the order of ``model.vector``
    and robust to coloured residuals. ``noise`` are the coefficients d_1 .. of the autoregressive noise model 1/D, empty
    for white noise. ``gain_error_percent`` compares the gain with ``gain_geometry`` if that is known; ``y_resolution``
    is one count of the output sensor, given or detected. ``hint`` is set if another structure would be better,
    ``input_offset`` if it differs from zero.
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
        """Return the summary that the command line prints for imported data."""
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
        """Return plain dictionaries, lists and numbers."""
        document = asdict(self)
        document["covariance"] = self.covariance.tolist()
        document["verdict"] = {**asdict(self.verdict), "sentence": self.verdict.sentence}
        return document


# Reduction -----------------------------------------------------------------------------------------
# Reduction to K/(T s + 1), for the λ formulas: same gain, same phase at low frequency.


def reduce_to_first_order(model: Model, covariance: Signal) -> FirstOrder:
    """Return static gain K and sum of lags T with standard errors.

    T includes the dead time; the errors follow from ``covariance`` (p, p).
    """
    shape, parameters = find_structure(model.structure), model.vector
    gradient = np.zeros(parameters.size)
    for i in range(1, parameters.size):
        step = 1e-6 * parameters[i]
        up, down = parameters.copy(), parameters.copy()
        up[i], down[i] = up[i] + step, down[i] - step
        gradient[i] = (shape.sum_of_lags(up) - shape.sum_of_lags(down)) / (2.0 * step)
    return FirstOrder(
        K=model.gain,
        T=model.sum_of_lags,
        K_std=_root(float(covariance[0, 0])),
        T_std=_root(float(gradient @ covariance @ gradient)),
    )


def _root(variance: float) -> float:
    """Return the square root; NaN for a variance that is negative by rounding."""
    return float(np.sqrt(variance)) if variance >= 0.0 else float("nan")
