"""Robustness of both outer loops together: singular values of the sensitivity matrix, and M_s of each loop.

The loops are sampled, as executed: the process behind its hold, the I-P laws and the dynamic decoupler. A peak of the
largest singular value above the M_s of both loops shows that errors in both outputs at once are amplified more than an
error in one: the loops are not decoupled there.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backend.control import pid
from backend.control.dynamic_decoupler import STATIC_ONLY, DynamicDecoupler
from backend.tuning import messages
from backend.tuning.coupled_model import Array
from backend.tuning.decoupling_filters import SampledSystem, make_state_space
from backend.tuning.gains import TuningError
from backend.tuning.robustness import Robustness, summarize_loop
from plant import T_s

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class OutputScales:
    """Deviations of ``q`` [rad] and ``S`` [N·m/rad] that count as equal.

    Singular values depend on the units of the outputs; M_s of each loop does not.
    """

    q: float
    S: float


@dataclass(frozen=True)
class CoupledRobustness:
    """Robustness of both loops: ``sigma_max`` [1] at ``omega`` [rad/s], and that of each loop.

    Unstable loops have sigma_max = inf and omega = NaN. Each loop is opened at its control signal while the other one
    is closed.
    """

    sigma_max: float
    omega: float
    q: Robustness
    S: Robustness
    stable: bool


class CoupledLoops:
    """Both outer loops around a process, with a dynamic decoupler.

    ``process`` is continuous, from the inputs of the model, (q_c, S_c) without static part, to (q, S), without direct
    feedthrough. ``decoupler`` is STATIC_ONLY for the loops without one. The loops have the period of the control step.
    """

    OMEGA = np.geomspace(1e-2, np.pi / T_s * (1.0 - 1e-9), 900)
    """Frequencies [rad/s] of the responses, up to that of Nyquist."""

    def __init__(
        self,
        process: "control.StateSpace",
        q: pid.IPGains,
        S: pid.IPGains,
        decoupler: DynamicDecoupler = STATIC_ONLY,
    ) -> None:
        M = decoupler.static
        self._process = _sample_process(process, np.array([[M.q_q, M.q_S], [M.S_q, M.S_S]]))
        self._decoupler = make_state_space(decoupler)
        self._k_p, self._k_i = np.diag([q.k_p, S.k_p]), np.diag([q.k_i, S.k_i])

    def is_stable(self) -> bool:
        """Return whether all poles of the closed loops are inside the unit circle."""
        P, K = self._process, self._decoupler
        feedback = -self._k_p @ P.C  # v = integral − k_p y
        integral = np.eye(2)
        A = np.block(
            [
                [P.A + P.B @ K.D @ feedback, P.B @ K.C, P.B @ K.D @ integral],
                [K.B @ feedback, K.A, K.B @ integral],
                [-T_s * self._k_i @ P.C, np.zeros((2, len(K.A))), integral],
            ]
        )
        return bool(np.all(np.abs(np.linalg.eigvals(A)) < 1.0))

    def sensitivity(self) -> NDArray[np.complex128]:
        """Return S = (I + L)⁻¹ at OMEGA, shape (n, 2, 2), from errors at the outputs to the outputs (q, S)."""
        z = np.exp(1j * self.OMEGA * T_s)
        law = self._k_p + self._k_i * (T_s / (z - 1.0))[:, None, None]
        loop = self._process.response(z) @ self._decoupler.response(z) @ law
        return np.asarray(np.linalg.inv(np.eye(2) + loop), dtype=np.complex128)

    def robustness(self, scales: OutputScales) -> CoupledRobustness:
        """Return the robustness of both loops. Raises TuningError for a scale that is not positive."""
        sensitivity = self.sensitivity()
        stable = self.is_stable()
        singular = largest_singular_values(scale_outputs(sensitivity, scales))
        k = int(np.argmax(singular))
        # With a diagonal law, S_ii is 1/(1 + L_i) of loop i with the other one closed.
        q, S = (summarize_loop(stable, 1.0 / sensitivity[:, i, i] - 1.0, self.OMEGA) for i in (0, 1))
        if not stable:
            return CoupledRobustness(math.inf, math.nan, q, S, stable=False)
        return CoupledRobustness(float(singular[k]), float(self.OMEGA[k]), q, S, stable=True)


def scale_outputs(matrices: NDArray[np.complex128], scales: OutputScales) -> NDArray[np.complex128]:
    """Return matrices (n, 2, 2) from outputs to outputs in units of ``scales``. Raises TuningError."""
    for symbol, scale in (("q", scales.q), ("S", scales.S)):
        if not (math.isfinite(scale) and scale > 0.0):
            raise TuningError(messages.output_scale_not_positive(symbol=symbol, scale=scale))
    units = np.array([scales.q, scales.S])
    return np.asarray(matrices * units[None, None, :] / units[None, :, None], dtype=np.complex128)


def largest_singular_values(matrices: NDArray[np.complex128]) -> Array:
    """Return the largest singular value of each matrix (n, 2, 2).

    σ² = (f + √(f² − 4 |det|²))/2 with f the sum of the squared moduli of the elements. The root is computed from a
    difference and a product, so that it loses no digits where both singular values are equal.
    """
    a, b = matrices[:, 0, :], matrices[:, 1, :]
    a_a, b_b = np.sum(np.abs(a) ** 2, axis=1), np.sum(np.abs(b) ** 2, axis=1)
    a_b = np.sum(a * np.conj(b), axis=1)
    return np.asarray(np.sqrt(0.5 * (a_a + b_b + np.hypot(a_a - b_b, 2.0 * np.abs(a_b)))), dtype=np.float64)


def _sample_process(process: "control.StateSpace", static: Array) -> SampledSystem:
    """Return the process behind a zero-order hold, with the static part at its inputs."""
    from scipy.linalg import expm

    A, B, C = (np.asarray(part, dtype=np.float64) for part in (process.A, process.B, process.C))
    order = len(A)
    joint = np.zeros((order + 2, order + 2))
    joint[:order, :order], joint[:order, order:] = A * T_s, B @ static * T_s
    transition = expm(joint)
    return SampledSystem(transition[:order, :order], transition[:order, order:], C, np.zeros((2, 2)))
