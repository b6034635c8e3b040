"""M_s, margins and safe ranges of λ of the outer loops, computed on the high-order models (erratum E6)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backend.control import pid
from backend.tuning.formulas import TuningError
from backend.tuning.models import LAM_MAX

if TYPE_CHECKING:
    import control

M_S_MAX = 1.7
"""Largest sensitivity peak an operator is offered (method section 5)."""

_OMEGA = np.logspace(-2, 3, 801)


@dataclass(frozen=True)
class Robustness:
    """``M_s`` [1], margins of gain [1] and of phase [rad] of a loop; an unstable loop has M_s = inf.

    ``gain_margin`` is the factor by which the gain may grow, inf without bound; ``gain_reduction`` is the factor to
    which it may fall, 0 without bound.
    """

    M_s: float
    gain_margin: float
    gain_reduction: float
    phase_margin: float
    stable: bool


class OuterProcess:
    """What an outer loop controls, from its control signal to its measurement, with its frequency response at hand.

    ``system`` has one input, one output and no direct feedthrough.
    """

    def __init__(self, system: "control.StateSpace") -> None:
        self._A, self._B, self._C = (np.asarray(part, dtype=np.float64) for part in (system.A, system.B, system.C))
        resolvent = 1j * _OMEGA[:, None, None] * np.eye(len(self._A)) - self._A
        self.response = (self._C @ np.linalg.solve(resolvent, np.broadcast_to(self._B, (_OMEGA.size, *self._B.shape))))[
            :, 0, 0
        ]

    def loop_response(self, gains: pid.IPGains) -> NDArray[np.complex128]:
        """Frequency response of the loop opened at the control signal."""
        return np.asarray(self.response * (gains.k_p + gains.k_i / (1j * _OMEGA)))

    def is_stable(self, gains: pid.IPGains) -> bool:
        """Whether all poles of the I-P loop around this process lie in the left half plane."""
        states = len(self._A)
        closed = np.zeros((states + 1, states + 1))
        closed[:states, :states] = self._A - gains.k_p * self._B @ self._C
        closed[:states, states:], closed[states:, :states] = gains.k_i * self._B, -self._C
        return bool(np.all(np.linalg.eigvals(closed).real < 0.0))

    def robustness(self, gains: pid.IPGains) -> Robustness:
        """Robustness of the I-P loop around this process."""
        return _robustness(self.is_stable(gains), self.loop_response(gains), _OMEGA)

    def sensitivity_peak(self, gains: pid.IPGains) -> float:
        """M_s alone; inf for an unstable loop."""
        return peak(self.loop_response(gains)) if self.is_stable(gains) else math.inf


def robustness_of(
    loop: "control.StateSpace", response: NDArray[np.complex128], omega: NDArray[np.float64]
) -> Robustness:
    """Robustness of a loop, continuous or sampled, with its ``response`` (n,) at ``omega`` (n,) [rad/s], evenly in log.

    Gain margins are counted on both sides: a conditionally stable loop is lost when gain is taken away, too.
    """
    return _robustness(_stable(loop), response, omega)


def _robustness(stable: bool, response: NDArray[np.complex128], omega: NDArray[np.float64]) -> Robustness:
    if not stable:
        return Robustness(math.inf, 1.0, 1.0, 0.0, stable=False)
    factors, phases = margins(response, omega)
    return Robustness(
        peak(response),
        float(min(factors[factors > 1.0], default=math.inf)),
        float(max(factors[factors < 1.0], default=0.0)),
        float(min(np.abs(phases), default=math.inf)),
        stable=True,
    )


def margins(
    response: NDArray[np.complex128], omega: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Factors on the gain (k,) [1] and turns of the phase (m,) [rad] that take a loop to −1.

    ``response`` (n,) at ``omega`` (n,) [rad/s], evenly in log. Between the points modulus and phase are cubic in
    log ω: with 160 points per decade they are right to 1e-6.
    """
    modulus, phase = np.log(np.abs(response)), np.unwrap(np.angle(response))
    whole = np.floor((phase - np.pi) / (2.0 * np.pi))
    factors = [
        math.exp(-_at(modulus, int(k), x))
        for k in np.flatnonzero(np.diff(whole))
        for x in _crossings(phase - (np.pi + 2.0 * np.pi * max(whole[k], whole[k + 1])), int(k))
    ]
    turns = [
        (_at(phase, int(k), x) + 2.0 * np.pi) % (2.0 * np.pi) - np.pi
        for k in np.flatnonzero(np.diff(np.sign(modulus)))
        for x in _crossings(modulus, int(k))
    ]
    return np.array(factors), np.array(turns)


def _cubic(y: NDArray[np.float64], k: int) -> tuple[NDArray[np.float64], int]:
    """Coefficients of the cubic through four points about the interval from ``k``, and its first point."""
    first = min(max(k - 1, 0), y.size - 4)
    return np.polyfit(np.arange(4.0), y[first : first + 4], 3), first


def _at(y: NDArray[np.float64], k: int, x: float) -> float:
    coefficients, first = _cubic(y, k)
    return float(np.polyval(coefficients, x - first))


def _crossings(y: NDArray[np.float64], k: int) -> list[float]:
    """Where ``y`` is zero between the points ``k`` and ``k + 1``, in points."""
    from scipy.optimize import brentq

    if y[k] == 0.0:
        return [float(k)]
    if y[k] * y[k + 1] >= 0.0:
        return []
    coefficients, first = _cubic(y, k)
    return [first + float(brentq(lambda x: float(np.polyval(coefficients, x)), k - first, k + 1 - first))]


def peak(response: NDArray[np.complex128]) -> float:
    """Max |1/(1 + L)| of a response (n,), between grid points by a parabola through the three nearest values."""
    sensitivity = np.abs(1.0 / (1.0 + response))
    k = int(np.argmax(sensitivity))
    if k in (0, sensitivity.size - 1):
        return float(sensitivity[k])
    low, middle, high = sensitivity[k - 1 : k + 2]
    return float(middle + (high - low) ** 2 / (8.0 * (2.0 * middle - high - low)))


def _stable(loop: "control.StateSpace") -> bool:
    import control

    poles = control.feedback(loop, 1).poles()
    return bool(np.all(np.abs(poles) < 1.0) if loop.isdtime(strict=True) else np.all(poles.real < 0.0))


def safe_lambda(process: OuterProcess, gains_for: Callable[[float], pid.IPGains], M_s: float = M_S_MAX) -> float:
    """Smallest λ [s] from which on, up to LAM_MAX, the outer loop's sensitivity peak stays at or below ``M_s``.

    ``gains_for`` gives the gains for a λ. Raises TuningError where no λ up to LAM_MAX is that robust.
    """
    from scipy.optimize import brentq

    def excess(lam: float) -> float:
        return peak(process.loop_response(gains_for(lam))) - M_s

    grid = np.geomspace(0.05, LAM_MAX, 60)
    # A fast loop can be unstable and still have a small peak: only the part reached from the slow end counts.
    above = [k for k, lam in enumerate(grid) if excess(lam) > 0.0]
    if not above:
        return float(grid[0])
    if above[-1] == grid.size - 1:
        raise TuningError(f"no λ up to {LAM_MAX:g} s keeps M_s at or below {M_s:g}: identify the actuator again")
    return float(brentq(excess, grid[above[-1]], grid[above[-1] + 1], xtol=1e-6))
