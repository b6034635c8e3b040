"""M_s, margins and safe ranges of λ, computed on the high-order models (errata E5, E6)."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import control
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from backend.controllers import i_p, i_pd
from backend.tuning.formulas import TuningError, motor_gains
from backend.tuning.models import LAM_MAX

M_S_MAX = 1.7
"""Largest sensitivity peak an operator is offered (method section 5)."""

LAM_MOTOR_MAX = 0.2
"""M_s of the motor loop is monotone in λ up to here only (erratum E5)."""

_OMEGA = np.logspace(-2, 3, 801)
_OMEGA_MOTOR = np.logspace(-2, 5, 1121)


@dataclass(frozen=True)
class Robustness:
    """``M_s`` [1], ``gain_margin`` [1], ``phase_margin`` [rad] of a loop; an unstable loop has M_s = inf."""

    M_s: float
    gain_margin: float
    phase_margin: float
    stable: bool


class OuterProcess:
    """What an outer loop controls, from its control signal to its measurement, with its frequency response at hand."""

    def __init__(self, system: control.StateSpace) -> None:
        self.system = system
        self.response = system(1j * _OMEGA)

    def loop_response(self, gains: i_p.Gains) -> NDArray[np.complex128]:
        """Frequency response of the loop opened at the control signal."""
        return np.asarray(self.response * (gains.k_p + gains.k_i / (1j * _OMEGA)))

    def robustness(self, gains: i_p.Gains) -> Robustness:
        """Robustness of the I-P loop around this process."""
        s = control.tf("s")
        loop = self.system * control.tf2ss(gains.k_p + gains.k_i / s)
        return _robustness(loop, self.loop_response(gains), _OMEGA)

    def sensitivity_peak(self, gains: i_p.Gains) -> float:
        """M_s alone, without the margins that take most of the time of ``robustness``; inf for an unstable loop."""
        s = control.tf("s")
        loop = self.system * control.tf2ss(gains.k_p + gains.k_i / s)
        if np.any(control.feedback(loop, 1).poles().real >= 0.0):
            return math.inf
        return _peak(self.loop_response(gains))

    def closed_loop(self, gains: i_p.Gains) -> control.StateSpace:
        """From the reference to the measurement."""
        s = control.tf("s")
        feedback = control.tf2ss(gains.k_p + gains.k_i / s)
        forward = control.tf2ss(control.tf(gains.k_r + gains.k_i / s))
        return control.feedback(self.system, feedback) * forward


def motor_robustness(K_m: float, T_m: float, gains: i_pd.Gains) -> Robustness:
    """Robustness of the inner loop on K_m/(s (T_m s + 1))."""
    s = control.tf("s")
    process = K_m / (s * (T_m * s + 1.0))
    feedback = (gains.k_p + gains.k_i / s + gains.k_d * s) / (gains.t_f * s + 1.0)
    loop = process * feedback
    return _robustness(control.tf2ss(loop), loop(1j * _OMEGA_MOTOR), _OMEGA_MOTOR)


def _robustness(loop: control.StateSpace, response: NDArray[np.complex128], omega: NDArray[np.float64]) -> Robustness:
    if np.any(control.feedback(loop, 1).poles().real >= 0.0):
        return Robustness(math.inf, 0.0, 0.0, stable=False)
    gain_margin, phase_margin, _, _ = control.margin(control.frd(response, omega))
    return Robustness(_peak(response), float(gain_margin), math.radians(float(phase_margin)), stable=True)


def _peak(response: NDArray[np.complex128]) -> float:
    """Max |1/(1 + L)|, refined between grid points by a parabola through the three nearest values."""
    sensitivity = np.abs(1.0 / (1.0 + response))
    k = int(np.argmax(sensitivity))
    if k in (0, sensitivity.size - 1):
        return float(sensitivity[k])
    low, peak, high = sensitivity[k - 1 : k + 2]
    return float(peak + (high - low) ** 2 / (8.0 * (2.0 * peak - high - low)))


def safe_lambda(process: OuterProcess, gains_for: Callable[[float], i_p.Gains], M_s: float = M_S_MAX) -> float:
    """Smallest λ [s] from which on, up to LAM_MAX, the outer loop's sensitivity peak stays at or below ``M_s``.

    ``gains_for`` gives the gains for a λ. Raises TuningError where no λ up to LAM_MAX is that robust.
    """

    def excess(lam: float) -> float:
        return _peak(process.loop_response(gains_for(lam))) - M_s

    grid = np.geomspace(0.05, LAM_MAX, 60)
    # A fast loop can be unstable and still have a small peak: only the part reached from the slow end counts.
    above = [k for k, lam in enumerate(grid) if excess(lam) > 0.0]
    if not above:
        return float(grid[0])
    if above[-1] == grid.size - 1:
        raise TuningError(f"no lam up to {LAM_MAX:g} s keeps M_s at or below {M_s:g}: identify the actuator again")
    return float(brentq(excess, grid[above[-1]], grid[above[-1] + 1], xtol=1e-6))


def motor_lambda(K_m: float, T_m: float, M_s: float) -> float:
    """λ [s] of the inner loop for a wanted M_s, on 0 < λ ≤ 0.2 s. Raises TuningError with the reachable span."""

    def peak(lam: float) -> float:
        return motor_robustness(K_m, T_m, motor_gains(K_m, T_m, lam)).M_s

    shortest = 1e-3
    highest, lowest = peak(shortest), peak(LAM_MOTOR_MAX)
    if not lowest <= M_s <= highest:
        raise TuningError(
            f"M_s = {M_s:g} is out of reach of the motor loop: choose {lowest:.3f} (lam = {LAM_MOTOR_MAX:g} s) "
            f"to {highest:.3f} (lam towards 0)"
        )
    return float(brentq(lambda lam: peak(lam) - M_s, shortest, LAM_MOTOR_MAX, xtol=1e-7))
