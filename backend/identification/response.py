"""Exact responses of the structures to an input that is held between samples (zero-order hold).

Nothing is approximated: the state equations are integrated by the matrix exponential and run as second-order
sections, which keep several poles near z = 1 apart where one long polynomial would not.
"""

from functools import cache

import numpy as np

from backend.identification.errors import UnstableModelError
from backend.identification.record import Signal

Poles = np.ndarray[tuple[int], np.dtype[np.complex128]]


def split_poles(poles: Poles) -> tuple[Signal, Poles]:
    """Real poles, and of each complex pair the one above the axis."""
    real = np.abs(poles.imag) <= 1e-9 * np.abs(poles)
    return poles[real].real, poles[poles.imag > 1e-9 * np.abs(poles)]


def state_space(poles: Poles) -> tuple[Signal, Signal, Signal]:
    """Cascade of lags and oscillators with static gain 1: A (n, n) [1/s], B (n,) [1/s], C (n,).

    Every state is of the size of the input, so that the matrix exponential is accurate.
    """
    lags, pairs = split_poles(poles)
    order = lags.size + 2 * pairs.size
    A, B, C = np.zeros((order, order)), np.zeros(order), np.zeros(order)
    state, fed_by = 0, -1
    for lag in lags:
        A[state, state] = lag
        _feed(A, B, state, fed_by, -lag)
        state, fed_by = state + 1, state
    for pole in pairs:
        omega = abs(pole)
        A[state, state + 1], A[state + 1, state], A[state + 1, state + 1] = omega, -omega, 2.0 * pole.real
        _feed(A, B, state + 1, fed_by, omega)
        state, fed_by = state + 2, state
    C[fed_by] = 1.0
    return A, B, C


def _feed(A: Signal, B: Signal, state: int, fed_by: int, rate: float) -> None:
    if fed_by < 0:
        B[state] = rate
    else:
        A[state, fed_by] = rate


def sections(poles: Poles, period_s: float) -> Signal:
    """All-pole second-order sections of the sampled system, static gain 1, shape (m, 6)."""
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
    """Numerator, sum 1, of the sampled system: ascending powers of z^-1, shape (n,).

    It gives the output a ``part``, 0 < part <= 1, of a sample time after the newest input; a whole sample time after it
    there are as many taps as poles, and at less one more.
    """
    A, B, C = state_space(poles)
    order = B.size
    step, x = _held(A, B, period_s)
    seen, first = _held(A, B, part * period_s)
    impulse = np.empty(order + 1)
    impulse[0] = C @ first
    for k in range(1, order + 1):
        impulse[k] = C @ seen @ x
        x = step @ x
    taps = np.convolve(np.real(np.poly(np.exp(poles * period_s))), impulse)[: order + (part < 1.0)]
    return np.asarray(taps / taps.sum())


def _held(A: Signal, B: Signal, time_s: float) -> tuple[Signal, Signal]:
    """Transition of the state, shape (n, n), and what an input that is held so long adds to it, shape (n,)."""
    from scipy.linalg import expm

    order = B.size
    joint = np.zeros((order + 1, order + 1))
    joint[:order, :order], joint[:order, order] = A * time_s, B * time_s
    transition = expm(joint)
    return transition[:order, :order], transition[:order, order]


def simulate(
    poles: Poles, period_s: float, u: Signal, initial: Signal | None = None, dead_time_s: float = 0.0
) -> Signal:
    """Response of the system with these poles and static gain 1; shape of ``u``.

    Without dead time the output at sample k has seen the input up to sample k - 1. With one, whole samples or not, the
    input before the record counts as 0. ``initial``, shape (order,), are coordinates of the
    state before the first sample in the basis of :func:`free_responses`; without it the system is at rest.
    Raises UnstableModelError.
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
    """Responses to ``order`` independent initial states, no input; shape (count, order)."""
    from scipy.signal import sosfilt

    # Until e^-40 only: beyond it comes nothing that counts beside the start, and in the end slow subnormal numbers.
    alive = min(count, poles.size + int(40.0 / (np.min(-poles.real) * period_s)))
    columns = np.zeros((poles.size, count))
    columns[:, : poles.size] = _impulses(poles.size)
    columns[:, :alive] = sosfilt(sections(poles, period_s), columns[:, :alive], axis=1)
    return columns.T


@cache
def _impulses(order: int) -> Signal:
    """Return an impulse and its differences, (order, order): through the poles alone they span the free responses."""
    rows = np.eye(order)
    for row in range(1, order):
        rows[row] = rows[row - 1] - np.roll(rows[row - 1], 1)
    return rows


def check_stable(poles: Poles, period_s: float) -> None:
    """Raise UnstableModelError unless all poles lie in the left half plane, between 1e-9 and 50 per sample."""
    rates = np.abs(poles) * period_s
    if not (np.all(np.isfinite(poles)) and np.all(poles.real < 0.0)):
        raise UnstableModelError(
            f"poles {np.array2string(poles, precision=4)} rad/s are not all in the left half plane"
        )
    if not (np.all(rates > 1e-9) and np.all(rates < 50.0)):
        raise UnstableModelError(f"poles {np.array2string(poles, precision=4)} rad/s are outside the sampled band")
