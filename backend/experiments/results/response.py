"""Frequency responses of the closed loops, from references that were excited to what was measured. Pure.

Of a periodic excitation the last period is measured, line by line: what came before has died down. Of a sweep all of
it, smoothed: there the response is an estimate.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.rest import NO_NUMBER
from backend.experiments.results.whole import Columns, Whole, whole
from backend.experiments.results.windows import Excited, excitations
from backend.realtime.program import Program
from plant.interface import T_s

Array = NDArray[np.float64]

LEAST_SHARE = 0.05
"""Lines of the excitation below this share of its strongest are not measured."""

LEAST_GAIN = 0.05
"""A loop that follows less of its reference at the lowest line has no bandwidth to speak of."""

BAND = 1.12
"""Lines of a sweep or a sequence are taken together within bands of this ratio of frequencies."""

LEAST_LOW_GAIN = 0.6
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
class ResponseFigures(Whole):
    """Figures of both responses. ``reasons`` tells by name which could not be measured and why."""

    bandwidth_q_Hz: float | None = figure("Hz", "Bandwidth of q", "where |q/q_ref| falls to 0.707; at rest it is 1")
    bandwidth_S_Hz: float | None = figure("Hz", "Bandwidth of S", "where |S/S_ref| falls to 0.707; at rest it is 1")
    resonance_q_dB: float | None = figure("dB", "Resonance of q", "largest |q/q_ref| over that at rest, which is 1")
    resonance_S_dB: float | None = figure("dB", "Resonance of S", "largest |S/S_ref| over that at rest, which is 1")
    lag_q_deg: float | None = figure("°", "Lag of q at its bandwidth", "phase of q behind q_ref there")
    lag_S_deg: float | None = figure("°", "Lag of S at its bandwidth", "phase of S behind S_ref there")
    reasons: Mapping[str, str] = field(default_factory=dict)


def response_figures(columns: Columns, program: Program) -> ResponseFigures:
    """Measure both responses. ``columns`` holds q, S, their references, tensions, voltages, one sample a millisecond.

    Raises NoSamplesError when no excitation was played to its end.
    """
    found = responses(columns, program)
    if not found:
        raise NoSamplesError("no excitation of one reference alone was played to its end")
    values: dict[str, Any] = {}
    reasons: dict[str, str] = {}
    for signal in ("q", "S"):
        response = next((one for one in found if one.signal == signal), None)
        names = (f"bandwidth_{signal}_Hz", f"resonance_{signal}_dB", f"lag_{signal}_deg")
        if response is None:
            values |= dict.fromkeys(names)
            reasons |= dict.fromkeys(names, f"the reference of {signal} alone was not excited to the end")
            continue
        if unmeasurable := why_not(response):
            values |= dict.fromkeys(names)
            reasons |= dict.fromkeys(names, unmeasurable)
            continue
        values[names[1]] = resonance(response)
        edge, reason = bandwidth(response)
        values[names[0]] = edge
        values[names[2]] = None if edge is None else lag_at(response, edge)
        if edge is None:
            reasons |= {names[0]: reason, names[2]: reason}
    return ResponseFigures(**whole(columns), **values, reasons=reasons)


def why_not(response: Response) -> str:
    """Return why nothing can be told of a response, "" where it can."""
    if not np.isfinite(response.H).all():
        return NO_NUMBER
    if abs(response.H[0]) < LEAST_GAIN:
        return (
            f"{response.signal} did not follow its reference at the lowest line: its gain there was below {LEAST_GAIN}"
        )
    return ""


def responses(columns: Columns, program: Program) -> tuple[Response, ...]:
    """Return the response to each excitation that was played to its end; of one signal the first comes first."""
    size = columns["q"].size
    return tuple(_response(columns, one) for one in excitations(program) if one.window.stop <= size)


def bandwidth(response: Response) -> tuple[float | None, str]:
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
    if k == 0 and gain[0] < LEAST_LOW_GAIN:
        return None, f"its gain is {gain[0]:.2g} already at {f[0]:.3g} Hz, the lowest line: take a longer period"
    used = slice(0, k + 2 if k + 1 < f.size and gain[k + 1] > 0.0 else k + 1)
    x, inverse = np.append(0.0, f[used] ** 2), np.append(1.0, gain[used] ** -2)
    crossings = PchipInterpolator(x, inverse).solve(MINUS_3_DB**-2, extrapolate=False)
    return float(np.sqrt(crossings[(crossings >= x[k]) & (crossings <= x[k + 1])][0])), ""


def resonance(response: Response) -> float:
    """Return the largest gain of the lines over that at rest [dB]; 0 where none is larger."""
    return 20.0 * float(np.log10(max(1.0, response.gain.max())))


def lag_at(response: Response, f: float) -> float:
    """Return how far the signal is behind its reference at ``f`` [Hz], in degrees; at rest it is not."""
    from scipy.interpolate import PchipInterpolator

    phase = np.append(0.0, np.unwrap(np.angle(response.H)))
    return -float(np.degrees(PchipInterpolator(np.append(0.0, response.f), phase)(f)))


def _response(columns: Columns, excited: Excited) -> Response:
    window, period = excited.window, excited.period
    if period is not None:
        window = slice(window.stop - period, window.stop)
    u, y = (np.asarray(columns[name][window]) for name in (f"{excited.signal}_ref", excited.signal))
    U, Y = (np.fft.rfft(signal - signal.mean())[1:] for signal in (u, y))
    f = np.arange(1, U.size + 1) / (u.size * T_s)
    kept = np.abs(U) >= LEAST_SHARE * np.abs(U).max()
    f, U, Y = f[kept], U[kept], Y[kept]
    if f.size <= 60 and period is not None:
        return Response(excited.signal, f, Y / U)
    f, H, _ = banded(f, U, Y)
    return Response(excited.signal, f, H)


def banded(
    f: Array, U: NDArray[np.complex128], Y: NDArray[np.complex128]
) -> tuple[Array, NDArray[np.complex128], Array]:
    """Take lines together in bands of the ratio BAND: frequency [Hz], response and √(1 − γ²) of each, nan of a line."""
    bands = np.floor(np.log(f / f[0]) / np.log(BAND)).astype(int)
    members = [bands == band for band in np.unique(bands)]
    both = np.array([np.vdot(U[one], Y[one]) for one in members])
    UU, YY = (np.array([np.vdot(X[one], X[one]).real for one in members]) for X in (U, Y))
    with np.errstate(divide="ignore", invalid="ignore"):
        unlike = np.sqrt(np.maximum(1.0 - np.abs(both) ** 2 / (UU * YY), 0.0))
    unlike[[one.sum() < 2 for one in members]] = np.nan
    centre = np.array([np.exp(np.log(f[one]).mean()) for one in members])
    return centre, both / UU, unlike
