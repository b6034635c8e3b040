"""The model beside a frequency response that assumes no model (Welch's averages), with coherence."""

from dataclasses import dataclass

import numpy as np

from backend.identification.excitation import external_signal
from backend.identification.record import Record, Signal
from backend.identification.result import Complex, FrequencyCheck, Model

SEGMENTS = 4
MIN_COHERENCE = 0.9
MIN_EXCITATION = 0.01
_LINES = 60


@dataclass(frozen=True)
class FrequencyResponse:
    """Estimate at ``omega`` [rad/s], shape (m,): complex ``response``; ``coherence`` of input and output, 0 to 1.

    ``excitation`` is the input's power at each line over the largest of all lines.
    """

    omega: Signal
    response: Complex
    coherence: Signal
    excitation: Signal


def welch_response(record: Record) -> FrequencyResponse:
    """Ratio of averaged cross spectra, over segments of a quarter of the record, half overlapped, Hann window.

    Where something from outside the loop is known, both spectra are taken with it, S_ry / S_ru: the plain ratio
    S_uy / S_uu would mix the plant with the inverse of the controller.
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
    """Transform each windowed segment, line 0 left out; shape (segments, length // 2)."""
    from scipy.fft import rfft
    from scipy.signal import detrend, get_window

    segments = np.lib.stride_tricks.sliding_window_view(detrend(signal), length)[:: length // 2]
    centred = segments - np.mean(segments, axis=1, keepdims=True)
    return np.asarray(rfft(centred * get_window("hann", length), axis=1)[:, 1:])


def _average(first: Complex, second: Complex) -> Complex:
    return np.asarray(np.mean(first.conj() * second, axis=0))


def check_frequency_response(model: Model, record: Record) -> FrequencyCheck:
    """Compare the model with Welch's estimate on some 60 lines, evenly spread on a logarithmic axis.

    The model's response gets the hold of the input, (1 - e^-jwh)/(jwh), which the samples contain.
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
