"""M_s, margins and safe ranges of λ of the outer loops, computed on the high-order models (erratum E6)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backend.controllers import i_p
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
    """What an outer loop controls, from its control signal to its measurement, with its frequency response at hand."""

    def __init__(self, system: "control.StateSpace") -> None:
        self.system = system
        self.response = system(1j * _OMEGA)

    def loop_response(self, gains: i_p.Gains) -> NDArray[np.complex128]:
        """Frequency response of the loop opened at the control signal."""
        return np.asarray(self.response * (gains.k_p + gains.k_i / (1j * _OMEGA)))

    def robustness(self, gains: i_p.Gains) -> Robustness:
        """Robustness of the I-P loop around this process."""
        import control

        s = control.tf("s")
        loop = self.system * control.tf2ss(gains.k_p + gains.k_i / s)
        return robustness_of(loop, self.loop_response(gains), _OMEGA)

    def sensitivity_peak(self, gains: i_p.Gains) -> float:
        """M_s alone, without the margins that take most of the time of ``robustness``; inf for an unstable loop."""
        import control

        s = control.tf("s")
        loop = self.system * control.tf2ss(gains.k_p + gains.k_i / s)
        if not _stable(loop):
            return math.inf
        return peak(self.loop_response(gains))

    def closed_loop(self, gains: i_p.Gains) -> "control.StateSpace":
        """From the reference to the measurement."""
        import control

        s = control.tf("s")
        feedback = control.tf2ss(gains.k_p + gains.k_i / s)
        forward = control.tf2ss(control.tf(gains.k_r + gains.k_i / s))
        return control.feedback(self.system, feedback) * forward


def robustness_of(
    loop: "control.StateSpace", response: NDArray[np.complex128], omega: NDArray[np.float64]
) -> Robustness:
    """Robustness of a loop, continuous or sampled, with its ``response`` (n,) at ``omega`` (n,) [rad/s], evenly in log.

    Gain margins are counted on both sides: a conditionally stable loop is lost when gain is taken away, too.
    """
    import control

    if not _stable(loop):
        return Robustness(math.inf, 1.0, 1.0, 0.0, stable=False)
    gain_margins, phase_margins, *_ = control.stability_margins(control.frd(response, omega), returnall=True)
    return Robustness(
        peak(response),
        float(min(gain_margins[gain_margins > 1.0], default=math.inf)),
        float(max(gain_margins[gain_margins < 1.0], default=0.0)),
        math.radians(min(np.abs(phase_margins), default=math.inf)),
        stable=True,
    )


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


def safe_lambda(process: OuterProcess, gains_for: Callable[[float], i_p.Gains], M_s: float = M_S_MAX) -> float:
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
