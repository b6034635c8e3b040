"""Frequency responses of the closed loops, measured and predicted. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.analysis.context import EvaluationContext, PredictionUnavailableError
from backend.analysis.step_metrics import (
    NO_NUMBER,
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
from plant import T_s

# Response ------------------------------------------------------------------------------------------
#
# Frequency responses of the closed loops, from references that were excited to what was measured.
# Pure.
#
# Of a periodic excitation the last period is measured, line by line: what came before has died
# down. Of a sweep all of it, smoothed: there the response is an estimate.


Array = NDArray[np.float64]

LINE_SHARE_MIN = 0.05
"""Lines of the excitation below this share of its strongest are not measured."""

GAIN_MIN = 0.05
"""A loop that follows less of its reference at the lowest line has no bandwidth to speak of."""

BAND_RATIO = 1.12
"""Lines of a sweep or a sequence are taken together within bands of this ratio of frequencies."""

LOW_GAIN_MIN = 0.6
"""Least gain of the lowest line from which a bandwidth below it is interpolated towards the gain 1 at rest.

There the bandwidth is within 1.1 % for loops of two equal lags, within 2 % for four.
"""

MINUS_3_DB = 2.0**-0.5
"""Gain at the bandwidth. At rest the gain is 1, because integral action leaves no error there."""


@dataclass(frozen=True)
class Response:
    """``H`` (n,) complex, from the reference to the signal, at ``f`` (n,) [Hz], rising."""

    signal: str
    f: Array
    H: NDArray[np.complex128]

    @property
    def gain(self) -> Array:
        """Gain of each line, (n,); that at rest is 1."""
        return np.asarray(np.abs(self.H))


@dataclass(frozen=True, kw_only=True)
class ResponseMetrics(WholeMetrics):
    """Figures of both responses. ``reasons`` tells by name which could not be measured and why."""

    bandwidth_q_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of q", "where |q/q_ref| falls to 0.707; at rest it is 1"
    )
    bandwidth_S_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of S", "where |S/S_ref| falls to 0.707; at rest it is 1"
    )
    resonance_q_dB: float | None = declare_metric(
        "dB", "Resonance of q", "largest |q/q_ref| over that at rest, which is 1"
    )
    resonance_S_dB: float | None = declare_metric(
        "dB", "Resonance of S", "largest |S/S_ref| over that at rest, which is 1"
    )
    lag_q_deg: float | None = declare_metric("°", "Lag of q at its bandwidth", "phase of q behind q_ref there")
    lag_S_deg: float | None = declare_metric("°", "Lag of S at its bandwidth", "phase of S behind S_ref there")
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_response_metrics(columns: Columns, program: Program) -> ResponseMetrics:
    """Measure both responses. ``columns`` holds q, S, their references, tensions, voltages, one sample a millisecond.

    Raises NoSamplesError when no excitation was played to its end.
    """
    found = compute_responses(columns, program)
    if not found:
        raise NoSamplesError("no excitation of one reference alone was played to its end")
    values: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for signal in ("q", "S"):
        response = next((item for item in found if item.signal == signal), None)
        names = (f"bandwidth_{signal}_Hz", f"resonance_{signal}_dB", f"lag_{signal}_deg")
        if response is None:
            values |= dict.fromkeys(names)
            reasons |= dict.fromkeys(names, f"the reference of {signal} alone was not excited to the end")
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
    """Return why nothing can be told of a response, "" where it can."""
    if not np.isfinite(response.H).all():
        return NO_NUMBER
    if abs(response.H[0]) < GAIN_MIN:
        return f"{response.signal} did not follow its reference at the lowest line: its gain there was below {GAIN_MIN}"
    return ""


def compute_responses(columns: Columns, program: Program) -> tuple[Response, ...]:
    """Return the response to each excitation that was played to its end; of one signal the first comes first."""
    size = columns["q"].size
    return tuple(_compute_response(columns, item) for item in list_excitations(program) if item.window.stop <= size)


def compute_bandwidth(response: Response) -> tuple[float | None, str]:
    """Return where the gain first falls to −3 dB of that at rest [Hz], or None and why that is not measured.

    Between two lines, and between rest and the lowest one, 1/|H|² is interpolated over f² by a monotone cubic (Fritsch
    and Carlson 1980): it is even and smooth in f, and for loops without zeros a polynomial in f².
    """
    from scipy.interpolate import PchipInterpolator

    f, gain = response.f, response.gain
    below = np.flatnonzero(gain < MINUS_3_DB)
    if below.size == 0:
        return None, f"it is still above −3 dB at {f[-1]:.3g} Hz, the highest line: excite it higher"
    k = int(below[0])
    if k == 0 and gain[0] < LOW_GAIN_MIN:
        return None, f"its gain is {gain[0]:.2g} already at {f[0]:.3g} Hz, the lowest line: take a longer period"
    used = slice(0, k + 2 if k + 1 < f.size and gain[k + 1] > 0.0 else k + 1)
    x, inverse = np.append(0.0, f[used] ** 2), np.append(1.0, gain[used] ** -2)
    crossings = PchipInterpolator(x, inverse).solve(MINUS_3_DB**-2, extrapolate=False)
    return float(np.sqrt(crossings[(crossings >= x[k]) & (crossings <= x[k + 1])][0])), ""


def compute_resonance(response: Response) -> float:
    """Return the largest gain of the lines over that at rest [dB]; 0 where none is larger."""
    return 20.0 * float(np.log10(max(1.0, response.gain.max())))


def compute_lag(response: Response, f: float) -> float:
    """Return how far the signal is behind its reference at ``f`` [Hz], in degrees; at rest it is not."""
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
    f, H, _ = average_bands(f, U, Y)
    return Response(excitation.signal, f, H)


def average_bands(
    f: Array, U: NDArray[np.complex128], Y: NDArray[np.complex128]
) -> tuple[Array, NDArray[np.complex128], Array]:
    """Take lines together in bands of the ratio BAND: frequency [Hz], response and √(1 − γ²) of each, nan of a line."""
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
#
# What the closed loops should answer to an excitation: of the models and gains that were in use.
# Pure.


Complex = NDArray[np.complex128]

BANDWIDTH_MIN_HZ, BANDWIDTH_MAX_HZ = 0.01, 100.0
"""Between these a predicted bandwidth is looked for; the faster is a tenth of the sampling."""

_GRID_POINTS = 2000


@dataclass(frozen=True)
class PredictedResponse:
    """The response to one excitation: at any frequency, until the loop's references ask for more than there is."""

    signal: str
    S: float
    tuning: cascade.CascadeTuning
    context: EvaluationContext

    def response(self, f: Array) -> Complex:
        """Return it at ``f`` (n,) [Hz]."""
        parameters, closed = self.context.parameters, self.context.has_position_loop
        if self.tuning.following.budget > 0.0:
            H = planned_response(parameters, self.tuning, self.S, f, position_loop=closed)
        else:
            H = make_sampled_loop(parameters, self.tuning, self.S, position_loop=closed).closed.response(f)
        output, to = (OUTPUTS.q, INPUTS.q_ref) if self.signal == "q" else (OUTPUTS.S, INPUTS.S_ref)
        return np.asarray(H[:, output, to])

    def compute_bandwidth(self) -> float | None:
        """Where the gain falls to −3 dB of that at rest [Hz], as it is measured; None where it does not."""
        f = np.geomspace(BANDWIDTH_MIN_HZ, BANDWIDTH_MAX_HZ, _GRID_POINTS)
        found, _ = compute_bandwidth(Response(self.signal, f, self.response(f)))
        return found


def predict_response(
    context: EvaluationContext, excitation: ReferenceExcitation, references: Array
) -> PredictedResponse:
    """Return what is expected of an excitation whose references (n, 2) were these. Raises NotPredictedError."""
    tuning = context.compute_gains_at(excitation.window.start)
    _, S = context.compute_references_before(excitation.window.start)
    budget = tuning.following.budget
    if budget > 0.0:
        asked = compute_required_voltage(tuning, S, references)
        if asked > budget:
            raise PredictionUnavailableError(
                f"the excitation asks the plan for {asked:.1f} V of its {budget:g} V: take a smaller amplitude"
            )
    return PredictedResponse(excitation.signal, S, tuning, context)


def compute_required_voltage(tuning: cascade.CascadeTuning, S: float, references: Array) -> float:
    """Largest |u_d| + |u_c| [V] with which the axes of a plan keep up with references (n, 2): (T θ'' + θ')/K."""
    model = tuning.following.model
    theta = (references - references[0]) @ decoupling_matrix(tuning.decoupler, S).T
    axes = np.column_stack([theta[:, 0] - theta[:, 1], theta[:, 0] + theta[:, 1]]) / 2.0
    rate = np.gradient(axes, T_s, axis=0)
    turning = np.gradient(rate, T_s, axis=0)
    u = (max(model.T_A, model.T_B) * turning + rate) / min(model.K_A, model.K_B)
    return float(np.abs(u).sum(axis=1).max())


# Bode ----------------------------------------------------------------------------------------------
#
# Frequency responses with their quality, beside those that models and gains let expect. Pure.
#
# Each line of a periodic excitation is measured on its last period; how far the period before it
# differs says what the line is worth. Within a band of a sweep the coherence says it. A line is
# measured only where no limit acted.


VARIATION_MAX = 0.1
"""A line that differs by more than this share from one period to the next is not measured."""

_LIMIT_REASONS = {
    Limit.VOLTAGE_A: "the voltage of motor A was clipped",
    Limit.VOLTAGE_B: "the voltage of motor B was clipped",
    Limit.GOVERNOR: "the governor held the reference back",
    Limit.TENSION_FLOOR: "a tendon was kept from going slack",
    Limit.TENSION_CEILING: "a tendon was kept below its largest tension",
    Limit.JOINT_RANGE: "the joint was kept within its range",
}


@dataclass(frozen=True)
class Lines:
    """Response to one excitation at ``f`` (n,) [Hz]: measured ``H``, ``unlike`` its quality, nan where there is none.

    ``residual`` is what of the signal's last period no line explains, as a share of its lines, nan where there is none.

    ``reasons`` (n) say of each line why it is not measured, "" where it is. ``expected`` (n,) is what was predicted,
    None where nothing was, and ``unpredicted`` says why.
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
        """Which lines are (n,)."""
        return np.array([not reason for reason in self.reasons])

    @property
    def response(self) -> Response:
        """Measured lines alone."""
        selected = self.measured
        return Response(self.signal, self.f[selected], self.H[selected])


@dataclass(frozen=True, kw_only=True)
class BodeMetrics(WholeMetrics):
    """Figures of both responses. ``reasons`` tells by name which could not be measured and why."""

    bandwidth_q_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of q", "where |q/q_ref| falls to 0.707; at rest it is 1"
    )
    bandwidth_q_predicted_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of q, predicted", "the same of the response that models and gains in use let expect"
    )
    gain_off_q_dB: float | None = declare_metric(
        "dB",
        "Gain of q off its prediction",
        "largest difference of both gains at the measured lines up to the predicted bandwidth",
    )
    phase_off_q_deg: float | None = declare_metric("°", "Phase of q off its prediction", "the same of the phase")
    resonance_q_dB: float | None = declare_metric(
        "dB", "Resonance of q", "largest |q/q_ref| over that at rest, which is 1"
    )
    lag_q_deg: float | None = declare_metric("°", "Lag of q at its bandwidth", "phase of q behind q_ref there")
    unlike_q_percent: float | None = declare_metric(
        "%", "Repeatability of q", "largest change of a measured line from one period to the next, in a sweep √(1 − γ²)"
    )
    residual_q_percent: float | None = declare_metric(
        "%", "Residual of q", "root mean square of q beside its lines over that at them, last period: friction, noise"
    )
    bandwidth_S_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of S", "where |S/S_ref| falls to 0.707; at rest it is 1"
    )
    bandwidth_S_predicted_Hz: float | None = declare_metric(
        "Hz", "Bandwidth of S, predicted", "the same of the response that models and gains in use let expect"
    )
    gain_off_S_dB: float | None = declare_metric(
        "dB",
        "Gain of S off its prediction",
        "largest difference of both gains at the measured lines up to the predicted bandwidth",
    )
    phase_off_S_deg: float | None = declare_metric("°", "Phase of S off its prediction", "the same of the phase")
    resonance_S_dB: float | None = declare_metric(
        "dB", "Resonance of S", "largest |S/S_ref| over that at rest, which is 1"
    )
    lag_S_deg: float | None = declare_metric("°", "Lag of S at its bandwidth", "phase of S behind S_ref there")
    unlike_S_percent: float | None = declare_metric(
        "%", "Repeatability of S", "largest change of a measured line from one period to the next, in a sweep √(1 − γ²)"
    )
    residual_S_percent: float | None = declare_metric(
        "%", "Residual of S", "root mean square of S beside its lines over that at them, last period: friction, noise"
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_bode_metrics(columns: Columns, program: Program, context: EvaluationContext) -> BodeMetrics:
    """Measure both responses; ``columns`` holds q, S, their references, tensions, voltages, limits, a sample a ms.

    Raises NoSamplesError when no excitation was played to its end.
    """
    found = build_bode_lines(columns, program, context)
    if not found:
        raise NoSamplesError("no excitation of one reference alone was played to its end")
    values: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for signal in ("q", "S"):
        lines = next((item for item in found if item.signal == signal), None)
        named, missing = (
            ({}, dict.fromkeys(_NAMES, f"the reference of {signal} alone was not excited to the end"))
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
    """Return the figures of one response, and why some are missing, by the names of ``_NAMES``."""
    values: dict[str, float | None] = {}
    missing: dict[str, str] = {}
    if lines.predicted is None:
        missing |= dict.fromkeys((_EXPECTED, _GAIN_OFF, _PHASE_OFF), lines.unpredicted)
    else:
        values[_EXPECTED] = lines.predicted.compute_bandwidth()
        if values[_EXPECTED] is None:
            missing[_EXPECTED] = "it is expected to stay above −3 dB wherever a response can be sampled"
    selected = lines.measured
    problem = lines.reasons[0] or find_problem(lines.response)
    if problem:  # all is told by its lowest line
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
        within = response.f <= (values[_EXPECTED] or np.inf)  # beyond it friction is what is left
        off = (response.H / lines.expected[selected])[within]
        if off.size:
            values[_GAIN_OFF] = float(np.abs(20.0 * np.log10(np.abs(off))).max())
            values[_PHASE_OFF] = float(np.degrees(np.abs(np.angle(off))).max())
        else:
            reason = f"no line lies below the predicted bandwidth, the lowest is {response.f[0]:.3g} Hz"
            missing |= {_GAIN_OFF: f"{reason}: take a longer period", _PHASE_OFF: f"{reason}: take a longer period"}
    known = lines.variation[selected & np.isfinite(lines.variation)]
    if known.size:
        values[_UNLIKE] = 100.0 * float(known.max())
    else:
        missing[_UNLIKE] = "it needs three periods: the first one holds how the motion begins"
    if np.isfinite(lines.residual):
        values[_RESIDUAL] = 100.0 * lines.residual
    else:
        missing[_RESIDUAL] = "a sweep has no lines"
    return values, missing


def build_bode_lines(columns: Columns, program: Program, context: EvaluationContext) -> tuple[Lines, ...]:
    """Return the response to each excitation that was played to its end; of one signal the first comes first."""
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
        f, H, variation = average_bands(f[selected], U[selected], Y[selected])
    else:
        f = f[selected]
        if window.stop - window.start >= 3 * period:
            _, _, before = _compute_spectra(columns, excitation.signal, slice(last.start - period, last.start))
            with np.errstate(divide="ignore", invalid="ignore"):
                variation = np.abs(Y - before)[selected] / np.abs(Y[selected])
    active_limit = _find_active_limit(columns, last, context.get_tuning_at(window.start).budget > 0.0)
    reasons = tuple(
        active_limit
        or (f"it differs by {100.0 * part:.0f} % from one period to the next" if part > VARIATION_MAX else "")
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
            unpredicted=str(error),
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
"""More lines than this are taken together in bands."""


def _compute_spectra(columns: Columns, signal: str, window: slice) -> tuple[Array, Complex, Complex]:
    u, y = (np.asarray(columns[name][window]) for name in (f"{signal}_ref", signal))
    U, Y = (np.fft.rfft(item - item.mean())[1:] for item in (u, y))
    return np.arange(1, U.size + 1) / (u.size * T_s), U, Y


def _find_active_limit(columns: Columns, window: slice, planned: bool) -> str:
    """Return which limit acted in a stretch and for how long, "" where none did: what it did is no linear response."""
    flags = np.asarray(columns["limits"][window]).astype(int)
    for limit, words in _LIMIT_REASONS.items():
        if limit is Limit.GOVERNOR and planned:  # there it says that the trajectory moves
            continue
        ticks = int(np.count_nonzero(flags & int(limit)))
        if ticks:
            return f"{words} for {ticks * T_s:.3g} s: take a smaller amplitude"
    return ""
