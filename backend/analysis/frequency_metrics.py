"""Frequency responses of the closed loops, measured and predicted."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.analysis import messages
from backend.analysis.context import EvaluationContext, PredictionUnavailableError
from backend.analysis.step_metrics import (
    Columns,
    NoSamplesError,
    ReferenceExcitation,
    WholeMetrics,
    compute_whole_metrics,
    declare_metric,
    list_excitations,
)
from backend.control import cascade
from backend.faults import Limit
from backend.realtime import Program
from backend.tuning import INPUTS, OUTPUTS, decoupling_matrix, make_sampled_loop, planned_response
from plant import (
    T_s,
)

# Response ------------------------------------------------------------------------------------------
# Frequency responses from excited references to measured signals. A periodic excitation is evaluated
# at its spectral lines in the last period, when transients have decayed. A sweep is evaluated as a
# whole and averaged in bands, so its response is an estimate.


Array = NDArray[np.float64]

LINE_SHARE_MIN = 0.05
"""Least magnitude of evaluated lines, relative to the strongest line of the excitation."""

GAIN_MIN = 0.05
"""Least gain at the lowest line for a meaningful bandwidth."""

BAND_RATIO = 1.12
"""Ratio of the frequency limits of a band, in which lines of a sweep or a sequence are averaged."""

LOW_GAIN_MIN = 0.6
"""Least gain of the lowest line for interpolating a bandwidth below it, towards the gain 1 at rest.

The error of the bandwidth is below 1.1 % for loops of two equal lags and below 2 % for four.
"""

MINUS_3_DB = 2.0**-0.5
"""Gain at the bandwidth. The gain at rest is 1, because of integral action."""


@dataclass(frozen=True)
class Response:
    """Complex frequency response ``H`` (n,) from the reference to the signal, at rising ``f`` (n,) [Hz]."""

    signal: str
    f: Array
    H: NDArray[np.complex128]

    @property
    def gain(self) -> Array:
        """Gain of each line (n,); 1 at rest."""
        return np.asarray(np.abs(self.H))


@dataclass(frozen=True, kw_only=True)
class ResponseMetrics(WholeMetrics):
    """Metrics of both responses; ``reasons`` by name for those not measured."""

    bandwidth_q_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of q", "frequency at which |q/q_ref| falls to 0.707 of its static value 1"
    )
    bandwidth_S_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of S", "frequency at which |S/S_ref| falls to 0.707 of its static value 1"
    )
    resonance_q_dB: float | None = declare_metric(
        "dB", "Resonance of q", "largest |q/q_ref| relative to its static value 1"
    )
    resonance_S_dB: float | None = declare_metric(
        "dB", "Resonance of S", "largest |S/S_ref| relative to its static value 1"
    )
    lag_q_deg: float | None = declare_metric(
        "°", "Phase lag of q at its bandwidth", "phase lag of q behind q_ref at the bandwidth"
    )
    lag_S_deg: float | None = declare_metric(
        "°", "Phase lag of S at its bandwidth", "phase lag of S behind S_ref at the bandwidth"
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_response_metrics(columns: Columns, program: Program) -> ResponseMetrics:
    """Compute the metrics of both responses.

    ``columns`` has q, S, their references, tensions and voltages, one sample per millisecond. Raises NoSamplesError
    without a completed excitation.
    """
    found = compute_responses(columns, program)
    if not found:
        raise NoSamplesError(messages.no_excitation_completed())
    values: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for signal in ("q", "S"):
        response = next((item for item in found if item.signal == signal), None)
        names = (f"bandwidth_{signal}_Hz", f"resonance_{signal}_dB", f"lag_{signal}_deg")
        if response is None:
            values |= dict.fromkeys(names)
            reasons |= dict.fromkeys(names, messages.reference_not_excited(signal=signal))
            continue
        if unmeasurable := find_problem(response):
            values |= dict.fromkeys(names)
            reasons |= dict.fromkeys(names, unmeasurable)
            continue
        values[names[1]] = compute_resonance(response)
        bandwidth_Hz, reason = compute_bandwidth(response)
        values[names[0]] = bandwidth_Hz
        values[names[2]] = None if bandwidth_Hz is None else compute_lag(response, bandwidth_Hz)
        if bandwidth_Hz is None:
            reasons |= {names[0]: reason, names[2]: reason}
    return ResponseMetrics(**compute_whole_metrics(columns), **values, reasons=reasons)


def find_problem(response: Response) -> str:
    """Return why a response has no metrics; empty if it has."""
    if not np.isfinite(response.H).all():
        return messages.sample_without_value()
    if abs(response.H[0]) < GAIN_MIN:
        return messages.reference_not_followed(signal=response.signal, minimum_gain=GAIN_MIN)
    return ""


def compute_responses(columns: Columns, program: Program) -> tuple[Response, ...]:
    """Return the response to each completed excitation, in their order."""
    size = columns["q"].size
    return tuple(_compute_response(columns, item) for item in list_excitations(program) if item.window.stop <= size)


def compute_bandwidth(response: Response) -> tuple[float | None, str]:
    """Return the frequency at which the gain falls to −3 dB [Hz], or None and the reason.

    Between lines, and between rest and the lowest line, 1/|H|² is interpolated over f² by a monotone cubic (Fritsch and
    Carlson 1980): it is even and smooth in f, and for loops without zeros a polynomial in f².
    """
    from scipy.interpolate import PchipInterpolator

    f, gain = response.f, response.gain
    below = np.flatnonzero(gain < MINUS_3_DB)
    if below.size == 0:
        return None, messages.bandwidth_above_lines(highest_Hz=float(f[-1]))
    k = int(below[0])
    if k == 0 and gain[0] < LOW_GAIN_MIN:
        return None, messages.bandwidth_below_lines(gain=float(gain[0]), lowest_Hz=float(f[0]))
    used = slice(0, k + 2 if k + 1 < f.size and gain[k + 1] > 0.0 else k + 1)
    x, inverse = np.append(0.0, f[used] ** 2), np.append(1.0, gain[used] ** -2)
    crossings = PchipInterpolator(x, inverse).solve(MINUS_3_DB**-2, extrapolate=False)
    return float(np.sqrt(crossings[(crossings >= x[k]) & (crossings <= x[k + 1])][0])), ""


def compute_resonance(response: Response) -> float:
    """Return the largest gain relative to rest [dB]; at least 0."""
    return 20.0 * float(np.log10(max(1.0, response.gain.max())))


def compute_lag(response: Response, f: float) -> float:
    """Return the phase lag at ``f`` [Hz], in degrees."""
    from scipy.interpolate import PchipInterpolator

    phase = np.append(0.0, np.unwrap(np.angle(response.H)))
    return -float(np.degrees(PchipInterpolator(np.append(0.0, response.f), phase)(f)))


def _compute_response(columns: Columns, excitation: ReferenceExcitation) -> Response:
    window, period = excitation.window, excitation.period
    if period is not None:
        window = slice(window.stop - period, window.stop)
    u, y = (np.asarray(columns[name][window]) for name in (f"{excitation.signal}_ref", excitation.signal))
    U, Y = (np.fft.rfft(signal - signal.mean())[1:] for signal in (u, y))
    f = np.arange(1, U.size + 1) / (u.size * T_s)
    selected = np.abs(U) >= LINE_SHARE_MIN * np.abs(U).max()
    f, U, Y = f[selected], U[selected], Y[selected]
    if f.size <= 60 and period is not None:
        return Response(excitation.signal, f, Y / U)
    f, H, _ = average_in_bands(f, U, Y)
    return Response(excitation.signal, f, H)


def average_in_bands(
    f: Array, U: NDArray[np.complex128], Y: NDArray[np.complex128]
) -> tuple[Array, NDArray[np.complex128], Array]:
    """Average lines in bands of the ratio BAND_RATIO.

    Returns frequency [Hz], response and √(1 − γ²) of each band; the latter is nan for a single line.
    """
    bands = np.floor(np.log(f / f[0]) / np.log(BAND_RATIO)).astype(int)
    members = [bands == band for band in np.unique(bands)]
    both = np.array([np.vdot(U[item], Y[item]) for item in members])
    UU, YY = (np.array([np.vdot(X[item], X[item]).real for item in members]) for X in (U, Y))
    with np.errstate(divide="ignore", invalid="ignore"):
        variation = np.sqrt(np.maximum(1.0 - np.abs(both) ** 2 / (UU * YY), 0.0))
    variation[[item.sum() < 2 for item in members]] = np.nan
    centre = np.array([np.exp(np.log(f[item]).mean()) for item in members])
    return centre, both / UU, variation


# Predicted response --------------------------------------------------------------------------------
# Expected responses from the models and gains that were active.


Complex = NDArray[np.complex128]

BANDWIDTH_MIN_HZ, BANDWIDTH_MAX_HZ = 0.01, 100.0
"""Frequency range of predicted bandwidths; the maximum is a tenth of the sampling rate."""

_GRID_POINTS = 2000


@dataclass(frozen=True)
class PredictedResponse:
    """Predicted response to one excitation, valid while the trajectory stays within its voltage limit."""

    signal: str
    S: float
    tuning: cascade.CascadeTuning
    context: EvaluationContext

    def response(self, f: Array) -> Complex:
        """Return the response at ``f`` (n,) [Hz]."""
        parameters, closed = self.context.parameters, self.context.has_position_loop
        if self.tuning.reference_tracking.budget > 0.0:
            H = planned_response(parameters, self.tuning, self.S, f, position_loop=closed)
        else:
            H = make_sampled_loop(parameters, self.tuning, self.S, position_loop=closed).closed.response(f)
        output, to = (OUTPUTS.q, INPUTS.q_ref) if self.signal == "q" else (OUTPUTS.S, INPUTS.S_ref)
        return np.asarray(H[:, output, to])

    def compute_bandwidth(self) -> float | None:
        """Return the frequency at which the gain falls to −3 dB [Hz]; None if it does not."""
        f = np.geomspace(BANDWIDTH_MIN_HZ, BANDWIDTH_MAX_HZ, _GRID_POINTS)
        found, _ = compute_bandwidth(Response(self.signal, f, self.response(f)))
        return found


def predict_response(
    context: EvaluationContext, excitation: ReferenceExcitation, references: Array
) -> PredictedResponse:
    """Return the predicted response to an excitation with these references (n, 2).

    Raises PredictionUnavailableError.
    """
    tuning = context.compute_gains_at(excitation.window.start)
    _, S = context.compute_references_before(excitation.window.start)
    budget = tuning.reference_tracking.budget
    if budget > 0.0:
        asked = compute_required_voltage(tuning, S, references)
        if asked > budget:
            raise PredictionUnavailableError(messages.excitation_above_voltage_limit(needed_V=asked, limit_V=budget))
    return PredictedResponse(excitation.signal, S, tuning, context)


def compute_required_voltage(tuning: cascade.CascadeTuning, S: float, references: Array) -> float:
    """Return the voltage max(|u_d| + |u_c|) [V] that a trajectory needs to follow references (n, 2): (T θ'' + θ')/K."""
    model = tuning.reference_tracking.model
    theta = (references - references[0]) @ decoupling_matrix(tuning.decoupler, S).T
    axes = np.column_stack([theta[:, 0] - theta[:, 1], theta[:, 0] + theta[:, 1]]) / 2.0
    rate = np.gradient(axes, T_s, axis=0)
    turning = np.gradient(rate, T_s, axis=0)
    u = (max(model.T_A, model.T_B) * turning + rate) / min(model.K_A, model.K_B)
    return float(np.abs(u).sum(axis=1).max())


# Bode ----------------------------------------------------------------------------------------------
# Frequency responses with their quality, compared with predictions.
#
# The quality of a line of a periodic excitation is its variation between the last two periods; that
# of a band of a sweep is its coherence. A line counts only if no limit was active.


VARIATION_MAX = 0.1
"""Largest variation of a line between periods, relative to its magnitude."""


@dataclass(frozen=True)
class Lines:
    """Response to one excitation at ``f`` (n,) [Hz]: measured ``H`` and its ``variation``, nan if unknown.

    ``residual`` is the part of the signal in the last period at other frequencies, relative to the lines; nan for a
    sweep. ``reasons`` (n) state why a line is not measured, and are empty if it is. ``expected`` (n,) is the
    prediction, None with the reason ``unpredicted``.
    """

    signal: str
    f: Array
    H: Complex
    variation: Array
    residual: float
    reasons: tuple[str, ...]
    expected: Complex | None
    predicted: PredictedResponse | None
    unpredicted: str

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Mask of the measured lines (n,)."""
        return np.array([not reason for reason in self.reasons])

    @property
    def response(self) -> Response:
        """Response at the measured lines."""
        selected = self.measured
        return Response(self.signal, self.f[selected], self.H[selected])


@dataclass(frozen=True, kw_only=True)
class BodeMetrics(WholeMetrics):
    """Metrics of both responses; ``reasons`` by name for those not measured."""

    bandwidth_q_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of q", "frequency at which |q/q_ref| falls to 0.707 of its static value 1"
    )
    bandwidth_q_predicted_Hz: float | None = declare_metric(
        "Hz",
        "Bandwidth of q, predicted",
        "frequency at which |q/q_ref|, predicted from models and active gains, falls to 0.707",
    )
    gain_off_q_dB: float | None = declare_metric(
        "dB",
        "Prediction error of the gain of q",
        "largest difference between measured and predicted gain at the lines up to the predicted bandwidth",
    )
    phase_off_q_deg: float | None = declare_metric(
        "°",
        "Prediction error of the phase of q",
        "largest difference between measured and predicted phase at the same lines",
    )
    resonance_q_dB: float | None = declare_metric(
        "dB", "Resonance of q", "largest |q/q_ref| relative to its static value 1"
    )
    lag_q_deg: float | None = declare_metric(
        "°", "Phase lag of q at its bandwidth", "phase lag of q behind q_ref at the bandwidth"
    )
    unlike_q_percent: float | None = declare_metric(
        "%",
        "Repeatability of q",
        "largest change of a measured line from one period to the next; for a sweep √(1 − γ²)",
    )
    residual_q_percent: float | None = declare_metric(
        "%",
        "Residual of q",
        "RMS of q outside the excited lines divided by that at the lines, last period: caused by friction and noise",
    )
    bandwidth_S_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of S", "frequency at which |S/S_ref| falls to 0.707 of its static value 1"
    )
    bandwidth_S_predicted_Hz: float | None = declare_metric(
        "Hz",
        "Bandwidth of S, predicted",
        "frequency at which |S/S_ref|, predicted from models and active gains, falls to 0.707",
    )
    gain_off_S_dB: float | None = declare_metric(
        "dB",
        "Prediction error of the gain of S",
        "largest difference between measured and predicted gain at the lines up to the predicted bandwidth",
    )
    phase_off_S_deg: float | None = declare_metric(
        "°",
        "Prediction error of the phase of S",
        "largest difference between measured and predicted phase at the same lines",
    )
    resonance_S_dB: float | None = declare_metric(
        "dB", "Resonance of S", "largest |S/S_ref| relative to its static value 1"
    )
    lag_S_deg: float | None = declare_metric(
        "°", "Phase lag of S at its bandwidth", "phase lag of S behind S_ref at the bandwidth"
    )
    unlike_S_percent: float | None = declare_metric(
        "%",
        "Repeatability of S",
        "largest change of a measured line from one period to the next; for a sweep √(1 − γ²)",
    )
    residual_S_percent: float | None = declare_metric(
        "%",
        "Residual of S",
        "RMS of S outside the excited lines divided by that at the lines, last period: caused by friction and noise",
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_bode_metrics(columns: Columns, program: Program, context: EvaluationContext) -> BodeMetrics:
    """Compute the metrics of both responses and their predictions.

    ``columns`` has q, S, their references, tensions, voltages and limits, one sample per millisecond. Raises
    NoSamplesError without a completed excitation.
    """
    found = build_bode_lines(columns, program, context)
    if not found:
        raise NoSamplesError(messages.no_excitation_completed())
    values: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for signal in ("q", "S"):
        lines = next((item for item in found if item.signal == signal), None)
        named, missing = (
            ({}, dict.fromkeys(_NAMES, messages.reference_not_excited(signal=signal)))
            if lines is None
            else _compute_metrics(lines)
        )
        for name in _NAMES:
            values[name.format(signal)] = named.get(name)
            if name in missing:
                reasons[name.format(signal)] = missing[name]
    return BodeMetrics(**compute_whole_metrics(columns), **values, reasons=reasons)


_WIDTH, _EXPECTED, _GAIN_OFF, _PHASE_OFF, _PEAK, _LAG, _UNLIKE, _RESIDUAL = _NAMES = (
    "bandwidth_{}_Hz",
    "bandwidth_{}_predicted_Hz",
    "gain_off_{}_dB",
    "phase_off_{}_deg",
    "resonance_{}_dB",
    "lag_{}_deg",
    "unlike_{}_percent",
    "residual_{}_percent",
)


def _compute_metrics(lines: Lines) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the metrics of one response, and reasons for missing ones, by the names in ``_NAMES``."""
    values: dict[str, float | None] = {}
    missing: dict[str, str] = {}
    if lines.predicted is None:
        missing |= dict.fromkeys((_EXPECTED, _GAIN_OFF, _PHASE_OFF), lines.unpredicted)
    else:
        values[_EXPECTED] = lines.predicted.compute_bandwidth()
        if values[_EXPECTED] is None:
            missing[_EXPECTED] = messages.predicted_bandwidth_out_of_range()
    selected = lines.measured
    problem = lines.reasons[0] or find_problem(lines.response)
    if problem:  # all metrics need the lowest line
        return values, dict.fromkeys(
            (_WIDTH, _GAIN_OFF, _PHASE_OFF, _PEAK, _LAG, _UNLIKE, _RESIDUAL), problem
        ) | missing
    response = lines.response
    values[_PEAK] = compute_resonance(response)
    bandwidth_Hz, reason = compute_bandwidth(response)
    values[_WIDTH] = bandwidth_Hz
    if bandwidth_Hz is None:
        missing |= {_WIDTH: reason, _LAG: reason}
    else:
        values[_LAG] = compute_lag(response, bandwidth_Hz)
    if lines.expected is not None:
        within = response.f <= (values[_EXPECTED] or np.inf)  # friction dominates above it
        off = (response.H / lines.expected[selected])[within]
        if off.size:
            values[_GAIN_OFF] = float(np.abs(20.0 * np.log10(np.abs(off))).max())
            values[_PHASE_OFF] = float(np.degrees(np.abs(np.angle(off))).max())
        else:
            reason = messages.no_line_below_predicted_bandwidth(lowest_Hz=float(response.f[0]))
            missing |= {_GAIN_OFF: reason, _PHASE_OFF: reason}
    known = lines.variation[selected & np.isfinite(lines.variation)]
    if known.size:
        values[_UNLIKE] = 100.0 * float(known.max())
    else:
        missing[_UNLIKE] = messages.fewer_than_three_periods()
    if np.isfinite(lines.residual):
        values[_RESIDUAL] = 100.0 * lines.residual
    else:
        missing[_RESIDUAL] = messages.sweep_without_lines()
    return values, missing


def build_bode_lines(columns: Columns, program: Program, context: EvaluationContext) -> tuple[Lines, ...]:
    """Return the response to each completed excitation, in their order."""
    size = columns["q"].size
    return tuple(_build_lines(columns, item, context) for item in list_excitations(program) if item.window.stop <= size)


def _build_lines(columns: Columns, excitation: ReferenceExcitation, context: EvaluationContext) -> Lines:
    window, period = excitation.window, excitation.period
    last = window if period is None else slice(window.stop - period, window.stop)
    f, U, Y = _compute_spectra(columns, excitation.signal, last)
    selected = np.abs(U) >= LINE_SHARE_MIN * np.abs(U).max()
    H, variation = Y[selected] / U[selected], np.full(int(selected.sum()), np.nan)
    power = np.abs(Y) ** 2
    residual = np.nan if period is None else float(np.sqrt(power[~selected].sum() / power[selected].sum()))
    if period is None or selected.sum() > LINES_MAX:
        f, H, variation = average_in_bands(f[selected], U[selected], Y[selected])
    else:
        f = f[selected]
        if window.stop - window.start >= 3 * period:
            _, _, before = _compute_spectra(columns, excitation.signal, slice(last.start - period, last.start))
            with np.errstate(divide="ignore", invalid="ignore"):
                variation = np.abs(Y - before)[selected] / np.abs(Y[selected])
    active_limit = _find_active_limit(columns, last, context.get_tuning_at(window.start).budget > 0.0)
    reasons = tuple(
        active_limit
        or (messages.line_not_periodic(variation_percent=100.0 * float(part)) if part > VARIATION_MAX else "")
        for part in variation
    )
    try:
        references = np.column_stack([columns[name][last] for name in ("q_ref", "S_ref")])
        expected = predict_response(context, excitation, references)
    except PredictionUnavailableError as error:
        return Lines(
            signal=excitation.signal,
            f=f,
            H=H,
            variation=variation,
            residual=residual,
            reasons=reasons,
            expected=None,
            predicted=None,
            unpredicted=error.message,
        )
    return Lines(
        signal=excitation.signal,
        f=f,
        H=H,
        variation=variation,
        residual=residual,
        reasons=reasons,
        expected=expected.response(f),
        predicted=expected,
        unpredicted="",
    )


LINES_MAX = 60
"""Number of lines above which they are averaged in bands."""


def _compute_spectra(columns: Columns, signal: str, window: slice) -> tuple[Array, Complex, Complex]:
    u, y = (np.asarray(columns[name][window]) for name in (f"{signal}_ref", signal))
    U, Y = (np.fft.rfft(item - item.mean())[1:] for item in (u, y))
    return np.arange(1, U.size + 1) / (u.size * T_s), U, Y


def _find_active_limit(columns: Columns, window: slice, planned: bool) -> str:
    """Return name and duration of an active limit, empty without one: a limited response is not linear."""
    flags = np.asarray(columns["limits"][window]).astype(int)
    for limit in messages.LIMITS:
        if limit is Limit.GOVERNOR and planned:  # the flag only means that the trajectory moves
            continue
        ticks = int(np.count_nonzero(flags & int(limit)))
        if ticks:
            return messages.limit_was_active(limit=limit, duration_s=ticks * T_s)
    return ""
