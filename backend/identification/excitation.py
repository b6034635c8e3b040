"""Noise-free part of an input, frequency responses, and correlations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from backend.identification import messages
from backend.identification.initialization import FitProblem, least_squares
from backend.identification.models import Complex, FrequencyCheck, Model, moving_average
from backend.identification.records import Controller, Record, Signal, UnstableModelError

# Excitation ----------------------------------------------------------------------------------------
# The part of the input that is independent of measurement noise: the basis of instruments in closed loop.


NoiseFreeInput = Callable[[Signal], Signal]
"""Function from parameters to an input of shape (n,) without measurement noise."""

_LAGS_OF_FIT = 14


def external_signal(record: Record) -> Signal | None:
    """Return the external signal of the loop, shape (n,).

    u + C y if the controller C is known, else r; None if neither is known, or r is constant.
    """
    from scipy.signal import lfilter

    if record.controller is not None:
        return np.asarray(record.u + lfilter(_feedback(record, record.controller), [1.0, -1.0], record.y))
    return record.r if record.r is not None and np.ptp(record.r) > 0.0 else None


def noise_free_input(problem: FitProblem) -> NoiseFreeInput | None:
    """Return the function that reconstructs the input without noise for this record.

    None if no external signal is known.
    """
    record = problem.record
    external = external_signal(record)
    if external is None:
        return None
    if record.controller is not None:
        feedback = _feedback(record, record.controller)
        return lambda parameters: _centre(_closed_loop_input(problem, parameters, feedback, external))
    fitted = _centre(fit_input(record.u, external[:, np.newaxis], record.period_s))
    return lambda parameters: fitted


def _centre(u: Signal) -> Signal:
    """Return u without its mean, so that a simulation at rest starts near the record."""
    return np.asarray(u - np.mean(u))


def _feedback(record: Record, controller: Controller) -> Signal:
    """Return the numerator over 1 - z^-1 of the feedback from y to -u.

    Sampled controllers differ in their integration and in whether they use the newest sample. The correct version
    leaves u + C y free of noise, and therefore smoothest.
    """
    from scipy.signal import lfilter

    k_p, k_i = controller.k_p, controller.k_i * record.period_s
    versions = [np.array([k_p + weight * k_i, (1.0 - weight) * k_i - k_p]) for weight in (0.0, 0.5, 1.0)]
    versions += [np.concatenate(([0.0], version)) for version in versions]
    roughness = [
        float(np.sum(np.diff(record.u + lfilter(version, [1.0, -1.0], record.y)) ** 2)) for version in versions
    ]
    return versions[int(np.argmin(roughness))]


def _closed_loop_input(problem: FitProblem, parameters: Signal, feedback: Signal, from_outside: Signal) -> Signal:
    """Return the response of u to the external signal, 1/(1 + G C).

    The model is used for G.
    """
    from scipy.signal import sosfilt, zpk2sos

    poles = np.exp(problem.structure.poles(parameters) * problem.record.period_s)
    taps = parameters[0] * moving_average(problem.structure.poles(parameters), problem.record.period_s)
    taps *= np.real(np.prod(1.0 - poles))
    open_loop = np.convolve(np.real(np.poly(poles)), [1.0, -1.0])
    loop = np.convolve(np.concatenate(([0.0], taps)), feedback)
    size = max(open_loop.size, loop.size)
    closed = np.zeros(size)
    closed[: open_loop.size] += open_loop
    closed[: loop.size] += loop
    closed_poles = np.roots(closed)
    if np.max(np.abs(closed_poles)) >= 1.0:
        raise UnstableModelError(messages.closed_loop_unstable())
    zeros = np.concatenate((poles, [1.0], np.zeros(closed_poles.size - poles.size - 1)))
    # The stubs of zpk2sos omit complex zeros and poles, its purpose.
    sections = zpk2sos(zeros, closed_poles, 1.0)  # type: ignore[arg-type]  # the stubs leave complex zeros out
    return np.asarray(sosfilt(sections, from_outside))


def fit_input(u: Signal, r: Signal, period_s: float) -> Signal:
    """Return the least-squares fit of u (n,) by external signals r (n, m) through a bank of lags.

    The lags range from one sample to a fifth of the record.
    """
    from scipy.signal import lfilter

    count = u.size
    decays = np.exp(-period_s / np.geomspace(period_s, count * period_s / 5.0, _LAGS_OF_FIT))
    lagged = [lfilter([0.0, 1.0 - decay], [1.0, -decay], r, axis=0) for decay in decays]
    columns = np.column_stack((np.ones(count), np.linspace(-1.0, 1.0, count), r, *lagged))
    return np.asarray(columns @ least_squares(columns, u, rcond=1e-10))


# Frequency -----------------------------------------------------------------------------------------
# Comparison of the model with a non-parametric frequency response (Welch's averages), with coherence.


SEGMENTS = 4
MIN_COHERENCE = 0.9
MIN_EXCITATION = 0.01
_LINES = 60


@dataclass(frozen=True)
class FrequencyResponse:
    """Estimate at ``omega`` [rad/s], shape (m,): complex ``response``.

    ``coherence`` of input and output, 0 to 1; ``excitation`` is the input's power at each line relative to the largest
    of all lines.
    """

    omega: Signal
    response: Complex
    coherence: Signal
    excitation: Signal


def welch_response(record: Record) -> FrequencyResponse:
    """Return the ratio of averaged cross spectra.

    The segments are a quarter of the record long, overlap by half, and have a Hann window. If the external signal of
    the loop is known, both spectra are taken with it, S_ry / S_ru: the plain ratio S_uy / S_uu would mix the plant with
    the inverse of the controller.
    """
    from scipy.fft import rfftfreq

    length = record.u.size // SEGMENTS
    external = external_signal(record)
    u, y = _spectra(record.u, length), _spectra(record.y, length)
    reference = u if external is None else _spectra(external, length)
    input_power, output_power = _average(u, u).real, _average(y, y).real
    power = np.maximum(input_power * output_power, np.finfo(float).tiny)
    return FrequencyResponse(
        omega=np.asarray(2.0 * np.pi * rfftfreq(length, record.period_s)[1:]),
        response=_average(reference, y) / _average(reference, u),
        coherence=np.abs(_average(u, y)) ** 2 / power,
        excitation=input_power / np.max(input_power),
    )


def _spectra(signal: Signal, length: int) -> Complex:
    """Transform each windowed segment without line 0; shape (segments, length // 2)."""
    from scipy.fft import rfft
    from scipy.signal import detrend, get_window

    segments = np.lib.stride_tricks.sliding_window_view(detrend(signal), length)[:: length // 2]
    centred = segments - np.mean(segments, axis=1, keepdims=True)
    return np.asarray(rfft(centred * get_window("hann", length), axis=1)[:, 1:])


def _average(first: Complex, second: Complex) -> Complex:
    return np.asarray(np.mean(first.conj() * second, axis=0))


def check_frequency_response(model: Model, record: Record) -> FrequencyCheck:
    """Compare the model with Welch's estimate at some 60 lines, evenly spaced in log.

    The model's response includes the hold of the input, (1 - e^-jwh)/(jwh), which the samples contain.
    """
    measured = welch_response(record)
    lines = np.unique(np.geomspace(1, measured.omega.size, _LINES).astype(int)) - 1
    omega, response, coherence = measured.omega[lines], measured.response[lines], measured.coherence[lines]
    turned = 1j * omega * record.period_s
    ratio = model.response(omega) * -np.expm1(-turned) / turned / response
    trusted = (coherence >= MIN_COHERENCE) & (measured.excitation[lines] >= MIN_EXCITATION)
    gain_percent = 100.0 * np.abs(np.abs(ratio[trusted]) - 1.0)
    phase_deg = np.abs(np.degrees(np.angle(ratio[trusted])))
    return FrequencyCheck(
        omega=tuple(omega.tolist()),
        magnitude=tuple(np.abs(response).tolist()),
        phase_deg=tuple(np.degrees(np.unwrap(np.angle(response))).tolist()),
        coherence=tuple(coherence.tolist()),
        worst_gain_percent=float(np.max(gain_percent, initial=0.0)),
        worst_phase_deg=float(np.max(phase_deg, initial=0.0)),
        trusted_lines=int(np.count_nonzero(trusted)),
    )


# Spectra -------------------------------------------------------------------------------------------
# Correlations of long signals through the FFT.


def correlation(later: Signal, earlier: Signal) -> Signal:
    """Return the sum over k of later[k + lag] earlier[k], lag = 0 .. n-1; shape (n,)."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * later.size)
    return np.asarray(irfft(rfft(later, size) * np.conj(rfft(earlier, size)), size)[: later.size])
