"""Model of two inputs and two outputs, its responses with standard errors, and results."""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from backend.identification.models import Complex, CorrelationTest, Figures, FirstOrder, Poles, Verdict
from backend.identification.records import Signal
from backend.identification.relative_gain import relative_gain, relative_gain_std
from backend.identification.two_channel_excitation import InputCorrelation
from backend.identification.two_input_fit import OutputStructure, differentiated_responses

# Model ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OutputModel:
    """Model of one output: y = (B_1(s) u_1 + B_2(s) u_2) / A(s).

    ``parameters`` by name, in the order of ``structure.names``: coefficients of B_1 and B_2, ``bj_k`` that of s^k u_j
    [unit of y / unit of u_j · s^k], then the parameters of A.
    """

    structure: OutputStructure
    parameters: dict[str, float]

    @property
    def vector(self) -> Signal:
        """Parameters in the structure's order, shape (p,)."""
        return np.array([self.parameters[name] for name in self.structure.names])

    @property
    def denominator(self) -> Signal:
        """Coefficients 1, a_1 .. a_N of A in ascending powers of s, shape (order + 1,)."""
        return self.structure.denominator_of(self.vector)

    @property
    def poles(self) -> Poles:
        """Poles [rad/s], shape (order,)."""
        return self.structure.poles(self.vector)

    def numerator(self, channel: int) -> Signal:
        """Return the coefficients of B_1 (channel 0) or B_2 (1) in ascending powers of s."""
        return self.vector[self.structure.numerator_slice(channel)]

    @property
    def gains(self) -> Signal:
        """Static gains of both inputs, shape (2,)."""
        return np.array([self.numerator(0)[0], self.numerator(1)[0]])

    def sum_of_lags(self, channel: int) -> float:
        """Return T [s], minus the slope of the phase at zero frequency; NaN without static gain."""
        numerator = np.append(self.numerator(channel), 0.0)
        if numerator[0] == 0.0:
            return float("nan")
        return float(self.denominator[1] - numerator[1] / numerator[0])

    def response(self, omega: Signal) -> Complex:
        """Return the frequency responses to both inputs at ``omega`` [rad/s], (m, 2)."""
        return _respond(self.structure, self.vector, omega)

    def response_gradient(self, omega: Signal) -> Complex:
        """Differentiate the frequency responses by the parameters, shape (m, 2, p)."""
        vector, shape = self.vector, self.structure
        gradient = np.zeros((omega.size, 2, vector.size), dtype=np.complex128)
        s = 1j * omega
        powers = np.power.outer(s, np.arange(max(shape.degrees) + 1)) / np.polyval(self.denominator[::-1], s)[:, None]
        for channel, degree in enumerate(shape.degrees):
            gradient[:, channel, shape.numerator_slice(channel)] = powers[:, : degree + 1]
        for i in range(shape.numerator_count, vector.size):
            up, down = vector.copy(), vector.copy()
            step = 1e-6 * vector[i]
            up[i], down[i] = up[i] + step, down[i] - step
            gradient[:, :, i] = (_respond(shape, up, omega) - _respond(shape, down, omega)) / (2.0 * step)
        return gradient

    def simulate_input(self, channel: int, u: Signal, period_s: float) -> Signal:
        """Return the response from rest to one held input (n,), shape (n,)."""
        columns = differentiated_responses(self.poles, period_s, u, self.structure.degrees[channel])
        return np.asarray(columns @ self.numerator(channel))

    def simulate(self, u: Signal, period_s: float) -> Signal:
        """Return the response from rest to held inputs (n, 2), shape (n,)."""
        return self.simulate_input(0, u[:, 0], period_s) + self.simulate_input(1, u[:, 1], period_s)


def _respond(shape: OutputStructure, vector: Signal, omega: Signal) -> Complex:
    s = 1j * omega
    denominator = np.polyval(shape.denominator_of(vector)[::-1], s)
    numerators = [np.polyval(vector[shape.numerator_slice(channel)][::-1], s) for channel in (0, 1)]
    return np.asarray(np.column_stack(numerators) / denominator[:, np.newaxis])


@dataclass(frozen=True)
class TwoChannelModel:
    """Transfer matrix of two inputs and two outputs, with their names."""

    inputs: tuple[str, str]
    outputs: tuple[str, str]
    rows: tuple[OutputModel, OutputModel]

    @property
    def gains(self) -> Signal:
        """Static gain matrix, shape (2, 2): row of the output, column of the input."""
        return np.array([row.gains for row in self.rows])

    def response(self, omega: Signal) -> Complex:
        """Return the frequency response at ``omega`` [rad/s], shape (m, 2, 2)."""
        return np.stack([row.response(omega) for row in self.rows], axis=1)

    def response_gradient(self, omega: Signal) -> Complex:
        """Differentiate the frequency response by the parameters of both rows, (m, 2, 2, p)."""
        first, second = (row.response_gradient(omega) for row in self.rows)
        gradient = np.zeros((omega.size, 2, 2, first.shape[-1] + second.shape[-1]), dtype=np.complex128)
        gradient[:, 0, :, : first.shape[-1]] = first
        gradient[:, 1, :, first.shape[-1] :] = second
        return gradient

    def simulate(self, u: Signal, period_s: float) -> Signal:
        """Return the response from rest to held inputs (n, 2), shape (n, 2)."""
        return np.column_stack([row.simulate(u, period_s) for row in self.rows])


# Result --------------------------------------------------------------------------------------------
# Results as plain data, JSON-ready through ``to_json``, as with one input. Matrices are tuples of rows.


Matrix = tuple[tuple[float, float], tuple[float, float]]
CurveMatrix = tuple[tuple[Figures, Figures], tuple[Figures, Figures]]


@dataclass(frozen=True)
class RelativeGain:
    """Relative gain r of the pairing of input 1 with output 1, and its standard error.

    The relative gain array is [[r, 1 - r], [1 - r, r]].
    """

    value: float
    std: float

    @property
    def array(self) -> Matrix:
        """The relative gain array."""
        return (self.value, 1.0 - self.value), (1.0 - self.value, self.value)


@dataclass(frozen=True)
class FrequencyMatrix:
    """Frequency response of the model at ``omega`` [rad/s], with standard errors.

    ``magnitude`` [unit of y / unit of u], ``phase_deg`` [deg, unwrapped], ``magnitude_std`` and ``phase_std_deg`` by
    output, input and line; ``std`` is the root mean square distance of the complex response, which is meaningful for an
    entry close to zero too. The relative gain r is complex: ``rga_magnitude``, ``rga_phase_deg`` and its root mean
    square distance ``rga_std`` by line.
    """

    omega: tuple[float, ...]
    magnitude: CurveMatrix
    phase_deg: CurveMatrix
    magnitude_std: CurveMatrix
    phase_std_deg: CurveMatrix
    std: CurveMatrix
    rga_magnitude: Figures
    rga_phase_deg: Figures
    rga_std: Figures


@dataclass(frozen=True)
class EntryEstimate:
    """One entry of the transfer matrix: coefficients in ascending powers of s, and its quality.

    ``gain`` is the static gain. ``is_zero``: the entry is not distinguishable from zero, because the Wald statistic of
    all coefficients of its numerator, ``wald``, is below ``wald_bound``, the 1 % level of the chi-squared distribution.
    ``first_order`` has K and sum of lags T, None if the static gain is within three standard errors of zero.
    ``motion_percent`` is the motion of the output that this input causes, in percent of the whole (RMS).
    """

    input: str
    output: str
    gain: float
    gain_std: float
    numerator: tuple[float, ...]
    numerator_std: tuple[float, ...]
    denominator: tuple[float, ...]
    wald: float
    wald_bound: float
    is_zero: bool
    first_order: FirstOrder | None
    motion_percent: float
    verdict: Verdict


@dataclass(frozen=True)
class OutputEstimate:
    """Quality of the model of one output.

    ``fit_percent`` is the simulated fit on the last third of the record of a model fitted to the first two thirds, NaN
    if not available; ``fit_all_percent`` that of the reported model on the whole record. ``noise`` are the coefficients
    of the autoregressive noise model, empty for white noise. ``input_correlations`` are the tests of the whitened
    residuals with each input.
    """

    output: str
    std_errors: dict[str, float]
    method: str
    noise: tuple[float, ...]
    fit_percent: float
    fit_all_percent: float
    y_resolution: float | None
    whiteness: CorrelationTest
    input_correlations: tuple[CorrelationTest, CorrelationTest]
    residual_std: float
    AIC: float
    BIC: float
    FPE: float


@dataclass(frozen=True)
class TwoChannelIdentification:
    """Identified 2 x 2 model, its quality and a verdict for each entry.

    ``covariance``, shape (p, p), is that of the parameters of both rows together, and robust to coloured residuals;
    ``gain_covariance``, shape (4, 4), that of the static gains in the order 11, 12, 21, 22. ``entries`` and ``gains``
    have the row of the output and the column of the input.
    """

    model: TwoChannelModel
    covariance: Signal = field(repr=False)
    gains: Matrix
    gain_covariance: Signal = field(repr=False)
    relative_gain: RelativeGain
    entries: tuple[tuple[EntryEstimate, EntryEstimate], tuple[EntryEstimate, EntryEstimate]]
    outputs: tuple[OutputEstimate, OutputEstimate] = field(repr=False)
    frequency: FrequencyMatrix = field(repr=False)
    input_correlation: InputCorrelation = field(repr=False)
    verdict: Verdict

    def to_json(self) -> dict[str, Any]:
        """Return plain dictionaries, lists and numbers."""
        document = asdict(self)
        document["covariance"] = self.covariance.tolist()
        document["gain_covariance"] = self.gain_covariance.tolist()
        document["relative_gain"]["array"] = self.relative_gain.array
        document["verdict"]["sentence"] = self.verdict.sentence
        for row, entries in zip(document["entries"], self.entries, strict=True):
            for stored, entry in zip(row, entries, strict=True):
                stored["verdict"]["sentence"] = entry.verdict.sentence
        return document


# Responses with standard errors --------------------------------------------------------------------


def compute_gain_covariance(model: TwoChannelModel, covariance: Signal) -> Signal:
    """Return the covariance of the static gains 11, 12, 21, 22 from that of the parameters (p, p)."""
    first, second = (row.structure for row in model.rows)
    offset = len(first.names)
    at = [first.numerator_slice(0).start, first.numerator_slice(1).start]
    at += [offset + second.numerator_slice(0).start, offset + second.numerator_slice(1).start]
    return np.asarray(covariance[np.ix_(at, at)])


def compute_frequency_matrix(model: TwoChannelModel, covariance: Signal, omega: Signal) -> FrequencyMatrix:
    """Return the frequency response at ``omega`` [rad/s] with standard errors (delta method).

    ``covariance``, shape (p, p), is that of the parameters of both rows.
    """
    G, gradient = model.response(omega), model.response_gradient(omega)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = gradient / G[..., np.newaxis]  # derivatives of log G: of log magnitude, and of the phase
    magnitude, phase = np.abs(G), np.unwrap(np.angle(G), axis=0)
    by_entry = gradient.reshape(omega.size, 4, -1)
    spread = by_entry @ covariance @ np.conj(np.swapaxes(by_entry, 1, 2))
    r = relative_gain(G)
    return FrequencyMatrix(
        omega=tuple(omega.tolist()),
        magnitude=_to_curves(magnitude),
        phase_deg=_to_curves(np.degrees(phase)),
        magnitude_std=_to_curves(magnitude * _deviation(relative.real, covariance)),
        phase_std_deg=_to_curves(np.degrees(_deviation(relative.imag, covariance))),
        std=_to_curves(np.sqrt(np.maximum(np.einsum("mii->mi", spread).real, 0.0)).reshape(-1, 2, 2)),
        rga_magnitude=_to_figures(np.abs(r)),
        rga_phase_deg=_to_figures(np.degrees(np.angle(r))),
        rga_std=_to_figures(relative_gain_std(G, spread)),
    )


def _deviation(gradient: Signal, covariance: Signal) -> Signal:
    """Return the standard error of functions with these derivatives (..., p), shape (...)."""
    variance = np.einsum("...i,ij,...j->...", gradient, covariance, gradient)
    return np.asarray(np.sqrt(np.where(variance >= 0.0, variance, np.nan)))


def _to_curves(values: Signal) -> CurveMatrix:
    """Return the curves of each entry of matrices (m, 2, 2)."""
    (first, second), (third, fourth) = np.moveaxis(values, 0, -1)
    return (_to_figures(first), _to_figures(second)), (_to_figures(third), _to_figures(fourth))


def _to_figures(values: Signal) -> Figures:
    """Return numbers; None for those that are not finite, such as the phase of a zero entry."""
    return tuple(value if np.isfinite(value) else None for value in values.tolist())


def compute_first_order(row: OutputModel, channel: int, covariance: Signal) -> FirstOrder:
    """Return static gain K and sum of lags T of an entry with standard errors.

    ``covariance``, shape (p, p), is that of the parameters of the row.
    """
    names, vector = row.structure.names, row.vector
    gradient = np.zeros(vector.size)
    for i, value in enumerate(vector):
        step = 1e-6 * abs(value) if value else 1e-9
        up, down = vector.copy(), vector.copy()
        up[i], down[i] = up[i] + step, down[i] - step
        moved = [
            OutputModel(row.structure, dict(zip(names, nearby.tolist(), strict=True))).sum_of_lags(channel)
            for nearby in (up, down)
        ]
        gradient[i] = (moved[0] - moved[1]) / (2.0 * step)
    at = row.structure.numerator_slice(channel).start
    return FirstOrder(
        K=float(row.gains[channel]),
        T=row.sum_of_lags(channel),
        K_std=float(np.sqrt(covariance[at, at])),
        T_std=float(_deviation(gradient, covariance)),
    )
