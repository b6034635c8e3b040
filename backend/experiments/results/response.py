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
from backend.loop.program import Program
from plant.interface import T_s

Array = NDArray[np.float64]

LEAST_SHARE = 0.05
"""Lines of the excitation below this share of its strongest are not measured."""

LEAST_GAIN = 0.05
"""A loop that follows less of its reference at the lowest line has no bandwidth to speak of."""

BAND = 1.12
"""Lines of a sweep or a sequence are taken together within bands of this ratio of frequencies."""

MINUS_3_DB = 2.0**-0.5


@dataclass(frozen=True)
class Response:
    """``H`` (n,) complex, from the reference to the signal, at ``f`` (n,) [Hz], rising."""

    signal: str
    f: Array
    H: NDArray[np.complex128]

    @property
    def gain(self) -> Array:
        """Gain of each line over that of the lowest, which is exactly 1."""
        size: Array = np.abs(self.H)
        gain: Array = size / size[0]
        return gain


@dataclass(frozen=True, kw_only=True)
class ResponseFigures(Whole):
    """Figures of both responses. ``reasons`` tells by name which could not be measured and why."""

    bandwidth_q_Hz: float | None = figure("Hz", "Bandwidth of q", "where |q/q_ref| falls to 0.707 of its lowest line")
    bandwidth_S_Hz: float | None = figure("Hz", "Bandwidth of S", "where |S/S_ref| falls to 0.707 of its lowest line")
    resonance_q_dB: float | None = figure("dB", "Resonance of q", "largest |q/q_ref| over that at the lowest line")
    resonance_S_dB: float | None = figure("dB", "Resonance of S", "largest |S/S_ref| over that at the lowest line")
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
        gain = response.gain
        values[names[1]] = 20.0 * float(np.log10(gain.max()))
        edge = bandwidth(response)
        values[names[0]] = edge
        values[names[2]] = None if edge is None else lag_at(response, edge)
        if edge is None:
            reason = f"it is still above −3 dB at {response.f[-1]:.3g} Hz, the highest line: excite it higher"
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


def bandwidth(response: Response) -> float | None:
    """Return where the gain first falls to −3 dB of the lowest line [Hz], between two lines by the logarithm."""
    gain = response.gain
    below = np.flatnonzero(gain < MINUS_3_DB)
    if below.size == 0:
        return None
    k = int(below[0])
    share = np.log(gain[k - 1] / MINUS_3_DB) / np.log(gain[k - 1] / gain[k])
    return float(response.f[k - 1] * (response.f[k] / response.f[k - 1]) ** share)


def lag_at(response: Response, f: float) -> float:
    """Return how far the signal is behind its reference at ``f`` [Hz], in degrees."""
    phase = np.unwrap(np.angle(response.H))
    return -float(np.degrees(np.interp(np.log(f), np.log(response.f), phase)))


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
