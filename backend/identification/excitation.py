"""The part of the input that the measurement noise did not cause: what instruments in closed loop are made of."""

from collections.abc import Callable

import numpy as np

from backend.identification.errors import UnstableModelError
from backend.identification.linearisation import Problem, least_squares
from backend.identification.record import Controller, Record, Signal
from backend.identification.response import moving_average

NoiseFreeInput = Callable[[Signal], Signal]
"""From parameters to an input of shape (n,) that does not contain the measurement noise."""

_LAGS_OF_FIT = 14


def external_signal(record: Record) -> Signal | None:
    """Return what enters the loop from outside, shape (n,): u + C y where the controller C is known, or else r.

    None where neither is known, or where r is constant.
    """
    from scipy.signal import lfilter

    if record.controller is not None:
        return np.asarray(record.u + lfilter(_feedback(record, record.controller), [1.0, -1.0], record.y))
    return record.r if record.r is not None and np.ptp(record.r) > 0.0 else None


def noise_free_input(problem: Problem) -> NoiseFreeInput | None:
    """How to rebuild the input without noise for this record; None where nothing from outside the loop is known."""
    record = problem.record
    external = external_signal(record)
    if external is None:
        return None
    if record.controller is not None:
        feedback = _feedback(record, record.controller)
        return lambda parameters: _centred(_closed_loop_input(problem, parameters, feedback, external))
    fitted = _centred(_fitted_input(record, external))
    return lambda parameters: fitted


def _centred(u: Signal) -> Signal:
    """Without its mean, so that simulation from rest starts near where the record is."""
    return np.asarray(u - np.mean(u))


def _feedback(record: Record, controller: Controller) -> Signal:
    """Numerator over 1 - z^-1 of the feedback from y to -u, as the loop seems to have computed it.

    Sampled controllers differ in how they integrate and in whether they see the newest sample. The right version
    leaves u + C y free of noise, that is smoothest.
    """
    from scipy.signal import lfilter

    k_p, k_i = controller.k_p, controller.k_i * record.period_s
    versions = [np.array([k_p + weight * k_i, (1.0 - weight) * k_i - k_p]) for weight in (0.0, 0.5, 1.0)]
    versions += [np.concatenate(([0.0], version)) for version in versions]
    roughness = [
        float(np.sum(np.diff(record.u + lfilter(version, [1.0, -1.0], record.y)) ** 2)) for version in versions
    ]
    return versions[int(np.argmin(roughness))]


def _closed_loop_input(problem: Problem, parameters: Signal, feedback: Signal, from_outside: Signal) -> Signal:
    """Response of u to what enters the loop from outside, 1/(1 + G C), with the model for G."""
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
        raise UnstableModelError("the loop of model and controller is unstable")
    zeros = np.concatenate((poles, [1.0], np.zeros(closed_poles.size - poles.size - 1)))
    # The stubs of zpk2sos leave complex zeros and poles out, which are what it is for.
    sections = zpk2sos(zeros, closed_poles, 1.0)  # type: ignore[arg-type]  # the stubs leave complex zeros out
    return np.asarray(sosfilt(sections, from_outside))


def _fitted_input(record: Record, r: Signal) -> Signal:
    """Least-squares fit of u by r through a bank of lags, from one sample to a fifth of the record."""
    from scipy.signal import lfilter

    decays = np.exp(-record.period_s / np.geomspace(record.period_s, record.duration_s / 5.0, _LAGS_OF_FIT))
    lagged = [lfilter([0.0, 1.0 - decay], [1.0, -decay], r) for decay in decays]
    count = r.size
    columns = np.column_stack((np.ones(count), np.linspace(-1.0, 1.0, count), r, *lagged))
    return np.asarray(columns @ least_squares(columns, record.u, rcond=1e-10))
