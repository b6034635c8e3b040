"""Frequency responses with their quality, beside those that models and gains let expect. Pure.

Each line of a periodic excitation is measured on its last period; how far the period before it differs says what the
line is worth. Within a band of a sweep the coherence says it. A line is measured only where no limit acted.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.in_force import InForce, NotPredictedError
from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.predicted_response import Predicted, predicted
from backend.experiments.results.response import LEAST_SHARE, Response, banded, bandwidth, lag_at, resonance, why_not
from backend.experiments.results.whole import Columns, Whole, whole
from backend.experiments.results.windows import Excited, excitations
from backend.faults import Limit
from backend.realtime.program import Program
from plant.interface import T_s

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

UNLIKE = 0.1
"""A line that differs by more than this share from one period to the next is not measured."""

_ACTED = {
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
    unlike: Array
    residual: float
    reasons: tuple[str, ...]
    expected: Complex | None
    predicted: Predicted | None
    unpredicted: str

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Which lines are (n,)."""
        return np.array([not reason for reason in self.reasons])

    @property
    def response(self) -> Response:
        """Measured lines alone."""
        kept = self.measured
        return Response(self.signal, self.f[kept], self.H[kept])


@dataclass(frozen=True, kw_only=True)
class BodeFigures(Whole):
    """Figures of both responses. ``reasons`` tells by name which could not be measured and why."""

    bandwidth_q_Hz: float | None = figure("Hz", "Bandwidth of q", "where |q/q_ref| falls to 0.707; at rest it is 1")
    bandwidth_q_predicted_Hz: float | None = figure(
        "Hz", "Bandwidth of q, predicted", "the same of the response that models and gains in use let expect"
    )
    gain_off_q_dB: float | None = figure(
        "dB",
        "Gain of q off its prediction",
        "largest difference of both gains at the measured lines up to the predicted bandwidth",
    )
    phase_off_q_deg: float | None = figure("°", "Phase of q off its prediction", "the same of the phase")
    resonance_q_dB: float | None = figure("dB", "Resonance of q", "largest |q/q_ref| over that at rest, which is 1")
    lag_q_deg: float | None = figure("°", "Lag of q at its bandwidth", "phase of q behind q_ref there")
    unlike_q_percent: float | None = figure(
        "%", "Repeatability of q", "largest change of a measured line from one period to the next, in a sweep √(1 − γ²)"
    )
    residual_q_percent: float | None = figure(
        "%", "Residual of q", "root mean square of q beside its lines over that at them, last period: friction, noise"
    )
    bandwidth_S_Hz: float | None = figure("Hz", "Bandwidth of S", "where |S/S_ref| falls to 0.707; at rest it is 1")
    bandwidth_S_predicted_Hz: float | None = figure(
        "Hz", "Bandwidth of S, predicted", "the same of the response that models and gains in use let expect"
    )
    gain_off_S_dB: float | None = figure(
        "dB",
        "Gain of S off its prediction",
        "largest difference of both gains at the measured lines up to the predicted bandwidth",
    )
    phase_off_S_deg: float | None = figure("°", "Phase of S off its prediction", "the same of the phase")
    resonance_S_dB: float | None = figure("dB", "Resonance of S", "largest |S/S_ref| over that at rest, which is 1")
    lag_S_deg: float | None = figure("°", "Lag of S at its bandwidth", "phase of S behind S_ref there")
    unlike_S_percent: float | None = figure(
        "%", "Repeatability of S", "largest change of a measured line from one period to the next, in a sweep √(1 − γ²)"
    )
    residual_S_percent: float | None = figure(
        "%", "Residual of S", "root mean square of S beside its lines over that at them, last period: friction, noise"
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def bode_figures(columns: Columns, program: Program, in_force: InForce) -> BodeFigures:
    """Measure both responses; ``columns`` holds q, S, their references, tensions, voltages, limits, a sample a ms.

    Raises NoSamplesError when no excitation was played to its end.
    """
    found = bode_lines(columns, program, in_force)
    if not found:
        raise NoSamplesError("no excitation of one reference alone was played to its end")
    values: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for signal in ("q", "S"):
        lines = next((one for one in found if one.signal == signal), None)
        named, missing = (
            ({}, dict.fromkeys(_NAMES, f"the reference of {signal} alone was not excited to the end"))
            if lines is None
            else _figures(lines)
        )
        for name in _NAMES:
            values[name.format(signal)] = named.get(name)
            if name in missing:
                reasons[name.format(signal)] = missing[name]
    return BodeFigures(**whole(columns), **values, reasons=reasons)


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


def _figures(lines: Lines) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the figures of one response, and why some are missing, by the names of ``_NAMES``."""
    values: dict[str, float | None] = {}
    missing: dict[str, str] = {}
    if lines.predicted is None:
        missing |= dict.fromkeys((_EXPECTED, _GAIN_OFF, _PHASE_OFF), lines.unpredicted)
    else:
        values[_EXPECTED] = lines.predicted.bandwidth()
        if values[_EXPECTED] is None:
            missing[_EXPECTED] = "it is expected to stay above −3 dB wherever a response can be sampled"
    kept = lines.measured
    bad = lines.reasons[0] or why_not(lines.response)
    if bad:  # all is told by its lowest line
        return values, dict.fromkeys((_WIDTH, _GAIN_OFF, _PHASE_OFF, _PEAK, _LAG, _UNLIKE, _RESIDUAL), bad) | missing
    response = lines.response
    values[_PEAK] = resonance(response)
    edge, reason = bandwidth(response)
    values[_WIDTH] = edge
    if edge is None:
        missing |= {_WIDTH: reason, _LAG: reason}
    else:
        values[_LAG] = lag_at(response, edge)
    if lines.expected is not None:
        within = response.f <= (values[_EXPECTED] or np.inf)  # beyond it friction is what is left
        off = (response.H / lines.expected[kept])[within]
        if off.size:
            values[_GAIN_OFF] = float(np.abs(20.0 * np.log10(np.abs(off))).max())
            values[_PHASE_OFF] = float(np.degrees(np.abs(np.angle(off))).max())
        else:
            reason = f"no line lies below the predicted bandwidth, the lowest is {response.f[0]:.3g} Hz"
            missing |= {_GAIN_OFF: f"{reason}: take a longer period", _PHASE_OFF: f"{reason}: take a longer period"}
    known = lines.unlike[kept & np.isfinite(lines.unlike)]
    if known.size:
        values[_UNLIKE] = 100.0 * float(known.max())
    else:
        missing[_UNLIKE] = "it needs three periods: the first one holds how the motion begins"
    if np.isfinite(lines.residual):
        values[_RESIDUAL] = 100.0 * lines.residual
    else:
        missing[_RESIDUAL] = "a sweep has no lines"
    return values, missing


def bode_lines(columns: Columns, program: Program, in_force: InForce) -> tuple[Lines, ...]:
    """Return the response to each excitation that was played to its end; of one signal the first comes first."""
    size = columns["q"].size
    return tuple(_lines(columns, one, in_force) for one in excitations(program) if one.window.stop <= size)


def _lines(columns: Columns, excited: Excited, in_force: InForce) -> Lines:
    window, period = excited.window, excited.period
    last = window if period is None else slice(window.stop - period, window.stop)
    f, U, Y = _spectra(columns, excited.signal, last)
    kept = np.abs(U) >= LEAST_SHARE * np.abs(U).max()
    H, unlike = Y[kept] / U[kept], np.full(int(kept.sum()), np.nan)
    power = np.abs(Y) ** 2
    residual = np.nan if period is None else float(np.sqrt(power[~kept].sum() / power[kept].sum()))
    if period is None or kept.sum() > MOST_LINES:
        f, H, unlike = banded(f[kept], U[kept], Y[kept])
    else:
        f = f[kept]
        if window.stop - window.start >= 3 * period:
            _, _, before = _spectra(columns, excited.signal, slice(last.start - period, last.start))
            with np.errstate(divide="ignore", invalid="ignore"):
                unlike = np.abs(Y - before)[kept] / np.abs(Y[kept])
    acted = _limits(columns, last, in_force.choice_at(window.start).budget > 0.0)
    reasons = tuple(
        acted or (f"it differs by {100.0 * part:.0f} % from one period to the next" if part > UNLIKE else "")
        for part in unlike
    )
    try:
        references = np.column_stack([columns[name][last] for name in ("q_ref", "S_ref")])
        expected = predicted(in_force, excited, references)
    except NotPredictedError as error:
        return Lines(excited.signal, f, H, unlike, residual, reasons, None, None, str(error))
    return Lines(excited.signal, f, H, unlike, residual, reasons, expected.response(f), expected, "")


MOST_LINES = 60
"""More lines than this are taken together in bands."""


def _spectra(columns: Columns, signal: str, window: slice) -> tuple[Array, Complex, Complex]:
    u, y = (np.asarray(columns[name][window]) for name in (f"{signal}_ref", signal))
    U, Y = (np.fft.rfft(one - one.mean())[1:] for one in (u, y))
    return np.arange(1, U.size + 1) / (u.size * T_s), U, Y


def _limits(columns: Columns, window: slice, planned: bool) -> str:
    """Return which limit acted in a stretch and for how long, "" where none did: what it did is no linear response."""
    flags = np.asarray(columns["limits"][window]).astype(int)
    for limit, words in _ACTED.items():
        if limit is Limit.GOVERNOR and planned:  # there it says that the trajectory moves
            continue
        ticks = int(np.count_nonzero(flags & int(limit)))
        if ticks:
            return f"{words} for {ticks * T_s:.3g} s: take a smaller amplitude"
    return ""
