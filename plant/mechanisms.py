"""Elastic mechanisms of other variable stiffness actuators: energy, torques, stiffness.

Every mechanism is an elastic energy E(q, θ_A, θ_B) between the joint and both motors. Joint torque is −∂E/∂q, the load
of a motor ∂E/∂θ, and the stiffness S = ∂²E/∂q². Motor A is the first motor of the publications, motor B the second. The
tendons of the paper are in ``plant.dynamics``: they pull only, and have forces that load cells measure.

At rest without an external torque every mechanism obeys (θ_A, θ_B) = g q + h(S) (``MotorAxes``).
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from plant import messages
from plant.compilation import STRICT, compiled

Array = NDArray[np.float64]

# Axes ----------------------------------------------------------------------------------------------
# The two directions of the motors: one moves the joint, the other changes the preset, and with it the stiffness.


class MotorAxes(NamedTuple):
    """Directions of the motor angles: θ = g q_e + n p, where p is the preset.

    ``g_A``, ``g_B``: motor angle per equilibrium position [1]; ``n_A``, ``n_B``: motor angle per preset [1]. The
    inverse is q_e = v_A θ_A + v_B θ_B and p = w_A θ_A + w_B θ_B.
    """

    g_A: float
    g_B: float
    n_A: float
    n_B: float
    v_A: float
    v_B: float
    w_A: float
    w_B: float


ANTAGONISTIC_AXES = MotorAxes(g_A=1.0, g_B=1.0, n_A=1.0, n_B=-1.0, v_A=0.5, v_B=0.5, w_A=0.5, w_B=-0.5)
"""Both motors turn with the joint; half their difference is the preset."""

SERIES_AXES = MotorAxes(g_A=1.0, g_B=0.0, n_A=0.0, n_B=1.0, v_A=1.0, v_B=0.0, w_A=0.0, w_B=1.0)
"""Motor A turns with the joint; motor B is the preset."""


def tendon_axes(r_m: float, r_j: float) -> MotorAxes:
    """Return the axes of two tendons on radii r_m, r_j [m]; the preset is θ_A + θ_B."""
    turns = r_j / r_m
    share = r_m / (2.0 * r_j)
    return MotorAxes(g_A=turns, g_B=-turns, n_A=0.5, n_B=0.5, v_A=share, v_B=-share, w_A=1.0, w_B=1.0)


# Bidirectional -------------------------------------------------------------------------------------
# Bidirectional antagonistic springs: each motor pushes and pulls the joint through one exponential spring.
#
# Two actuators have this form: the qbmove with its load k sinh(a d) = (k/2) e^(a d) − (k/2) e^(−a d) (qbmove Advanced
# manual), and the BAVS with its load k (b e^(κ d) − a e^(−κ d)) (Petit and others 2015, Friedl and others 2011).


class Bidirectional(NamedTuple):
    """Springs with the load p e^(κ d) − n e^(−κ d) at d = θ − q, one per motor.

    ``p_A``, ``n_A``, ``p_B``, ``n_B`` [N·m]; ``kappa_A``, ``kappa_B`` [1/rad].
    """

    p_A: float
    n_A: float
    kappa_A: float
    p_B: float
    n_B: float
    kappa_B: float


@compiled
def _exponential_energy(p: float, n: float, kappa: float, d: float) -> float:
    return (p * math.expm1(kappa * d) + n * math.expm1(-kappa * d)) / kappa


@compiled
def _exponential_load(p: float, n: float, kappa: float, d: float) -> tuple[float, float]:
    """Return the load [N·m] and its slope [N·m/rad] at d = θ − q [rad]."""
    pushing, pulling = p * math.exp(kappa * d), n * math.exp(-kappa * d)
    return pushing - pulling, kappa * (pushing + pulling)


@compiled
def _bidirectional_energy(spring: Bidirectional, q: float, theta_A: float, theta_B: float) -> float:
    E_A = _exponential_energy(spring.p_A, spring.n_A, spring.kappa_A, theta_A - q)
    return E_A + _exponential_energy(spring.p_B, spring.n_B, spring.kappa_B, theta_B - q)


@compiled
def _bidirectional_torques(
    spring: Bidirectional, q: float, theta_A: float, theta_B: float
) -> tuple[float, float, float, float]:
    load_A, S_A = _exponential_load(spring.p_A, spring.n_A, spring.kappa_A, theta_A - q)
    load_B, S_B = _exponential_load(spring.p_B, spring.n_B, spring.kappa_B, theta_B - q)
    return load_A + load_B, load_A, load_B, S_A + S_B


@compiled
def _bidirectional_deflection(spring: Bidirectional, q: float, theta_A: float, theta_B: float) -> float:
    """Return the deflection [rad] of the spring that deflects further."""
    d_A, d_B = q - theta_A, q - theta_B
    return d_A if abs(d_A) > abs(d_B) else d_B


# Lever ---------------------------------------------------------------------------------------------
# Lever with a movable pivot, as in AwAS-II (Jafari and others 2014): E = K_s α² sin²δ with δ = q − θ_A and
# α = (L/r_t) y/(L − y). Motor B moves the pivot by a screw: y = y_0 + ``lead`` θ_B. S = 2 K_s α² cos 2δ falls to zero
# at a deflection of 45 degrees.


class Lever(NamedTuple):
    """Lever: ``K_s`` [N·m/rad], ``L`` and ``r_t`` [m], ``y_0`` [m], ``lead`` [m/rad]."""

    K_s: float
    L: float
    r_t: float
    y_0: float
    lead: float


@compiled
def _lever_ratio(lever: Lever, theta_B: float) -> tuple[float, float]:
    """Return the lever ratio α [1] and dα/dθ_B [1/rad]."""
    y = lever.y_0 + lever.lead * theta_B
    alpha = lever.L / lever.r_t * y / (lever.L - y)
    return alpha, lever.L / lever.r_t * lever.L / (lever.L - y) ** 2 * lever.lead


@compiled
def _lever_energy(lever: Lever, q: float, theta_A: float, theta_B: float) -> float:
    alpha, _ = _lever_ratio(lever, theta_B)
    return lever.K_s * (alpha * math.sin(q - theta_A)) ** 2


@compiled
def _lever_torques(lever: Lever, q: float, theta_A: float, theta_B: float) -> tuple[float, float, float, float]:
    alpha, alpha_rate = _lever_ratio(lever, theta_B)
    delta = q - theta_A
    tau = -lever.K_s * alpha**2 * math.sin(2.0 * delta)
    load_B = 2.0 * lever.K_s * alpha * alpha_rate * math.sin(delta) ** 2
    return tau, tau, load_B, 2.0 * lever.K_s * alpha**2 * math.cos(2.0 * delta)


# Pretension ----------------------------------------------------------------------------------------
# Spring with pretension, as in MACCEPA (Van Ham and others 2007): a spring between a lever arm of length B and a point
# at distance C. With α = θ_A − q and ℓ = √(B² + C² − 2 B C cos α) its extension is ℓ + β, β = r θ_B − (C − B).


class Pretension(NamedTuple):
    """Pretension: ``B``, ``C`` and reel radius ``r`` [m], ``kappa`` [N/m]."""

    B: float
    C: float
    r: float
    kappa: float


@compiled
def _pretension_geometry(spring: Pretension, q: float, theta_A: float, theta_B: float) -> tuple[float, float, float]:
    """Return α [rad], ℓ [m] and β [m]."""
    alpha = theta_A - q
    length = math.sqrt(spring.B**2 + spring.C**2 - 2.0 * spring.B * spring.C * math.cos(alpha))
    return alpha, length, spring.r * theta_B - (spring.C - spring.B)


@compiled
def _pretension_energy(spring: Pretension, q: float, theta_A: float, theta_B: float) -> float:
    _, length, beta = _pretension_geometry(spring, q, theta_A, theta_B)
    return 0.5 * spring.kappa * (length + beta) ** 2


@compiled
def _pretension_torques(
    spring: Pretension, q: float, theta_A: float, theta_B: float
) -> tuple[float, float, float, float]:
    alpha, length, beta = _pretension_geometry(spring, q, theta_A, theta_B)
    arm = spring.B * spring.C
    stretch = 1.0 + beta / length
    tau = spring.kappa * arm * math.sin(alpha) * stretch
    S = spring.kappa * (arm * math.cos(alpha) * stretch - (arm * math.sin(alpha)) ** 2 * beta / length**3)
    return tau, tau, spring.kappa * spring.r * (length + beta), S


@compiled
def _series_deflection(mechanism: Lever | Pretension, q: float, theta_A: float, theta_B: float) -> float:
    return q - theta_A


# Table ---------------------------------------------------------------------------------------------
# A mechanism of measured torque and stiffness over deflection δ = q − q_e and preset p.
#
# Between the measured points the torque is a bicubic polynomial per cell, with the measured stiffness as its slope. The
# energy is its integral over δ, so torque, loads and stiffness belong to one energy. Torque over deflection cannot show
# the energy at δ = 0: it is taken as zero for every preset, so motor B bears no load at zero deflection.


class TorqueTable(NamedTuple):
    """Measured mechanism as polynomials per cell.

    ``delta`` (n,), ``preset`` (m,) [rad]: edges of the cells. ``torque`` (n−1, m−1, 4, 4) [N·m/rad^(i+j)]: coefficients
    of δ^i p^j from the cell's lower edges. ``energy`` (n−1, m−1, 4) [J/rad^j]: energy at the lower edge in δ.
    """

    delta: Array
    preset: Array
    torque: Array
    energy: Array
    axes: MotorAxes


@compiled
def _find_cell(edges: Array, value: float) -> int:
    """Return the cell that contains ``value``, or the nearest one."""
    low, high = 0, edges.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if value < edges[middle]:
            high = middle
        else:
            low = middle
    return low


@compiled
def _polynomial(a: Array, t: float) -> tuple[float, float]:
    """Return a cubic with coefficients ``a`` (lowest power first) at t, and its slope."""
    value = ((a[3] * t + a[2]) * t + a[1]) * t + a[0]
    return value, (3.0 * a[3] * t + 2.0 * a[2]) * t + a[1]


@compiled
def _evaluate_table(table: TorqueTable, q: float, theta_A: float, theta_B: float) -> tuple[float, float, float, float]:
    """Return energy [J], torque [N·m], ∂E/∂p [N·m] and S [N·m/rad]."""
    axes = table.axes
    delta = q - axes.v_A * theta_A - axes.v_B * theta_B
    preset = axes.w_A * theta_A + axes.w_B * theta_B
    row, column = _find_cell(table.delta, delta), _find_cell(table.preset, preset)
    s, t = delta - table.delta[row], preset - table.preset[column]
    a = table.torque[row, column]
    E, E_rate = _polynomial(table.energy[row, column], t)
    tau = tau_slope = 0.0
    for i in range(3, -1, -1):
        c, c_rate = _polynomial(a[i], t)
        tau_slope = tau_slope * s + tau
        tau = tau * s + c
        E -= c * s ** (i + 1) / (i + 1.0)
        E_rate -= c_rate * s ** (i + 1) / (i + 1.0)
    return E, tau, E_rate, -tau_slope


@compiled
def _table_energy(table: TorqueTable, q: float, theta_A: float, theta_B: float) -> float:
    E, _, _, _ = _evaluate_table(table, q, theta_A, theta_B)
    return E


@compiled
def _table_torques(table: TorqueTable, q: float, theta_A: float, theta_B: float) -> tuple[float, float, float, float]:
    _, tau, E_rate, S = _evaluate_table(table, q, theta_A, theta_B)
    axes = table.axes
    return tau, axes.v_A * tau + axes.w_A * E_rate, axes.v_B * tau + axes.w_B * E_rate, S


@compiled
def _table_deflection(table: TorqueTable, q: float, theta_A: float, theta_B: float) -> float:
    return q - table.axes.v_A * theta_A - table.axes.v_B * theta_B


_HERMITE = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-3.0, 3.0, -2.0, -1.0], [2.0, -2.0, 1.0, 1.0]])
"""Coefficients of the cubic on [0, 1] from the values and then the slopes at 0 and 1."""


def build_torque_table(delta: Array, preset: Array, torque: Array, stiffness: Array, axes: MotorAxes) -> TorqueTable:
    """Return a mechanism through measured points.

    ``delta`` (n,), ``preset`` (m,) [rad], both rising; ``torque`` [N·m] and ``stiffness`` [N·m/rad] have the shape
    (n, m). Raises ValueError.
    """
    if delta.ndim != 1 or preset.ndim != 1 or delta.size < 3 or preset.size < 3:
        raise ValueError(messages.torque_table_too_small(delta=delta.shape, preset=preset.shape))
    if torque.shape != (delta.size, preset.size) or stiffness.shape != torque.shape:
        raise ValueError(messages.torque_table_of_wrong_shape(torque=torque.shape, stiffness=stiffness.shape))
    if not all(np.all(np.isfinite(values)) for values in (delta, preset, torque, stiffness)):
        raise ValueError(messages.torque_table_not_finite())
    for name, values in (("delta", delta), ("preset", preset)):
        falling = np.flatnonzero(np.diff(values) <= 0.0)
        if falling.size:
            raise ValueError(messages.torque_table_does_not_rise(axis=name, at=values[falling[0]]))
    if not delta[0] < 0.0 < delta[-1]:
        raise ValueError(messages.torque_table_without_zero(lowest=delta[0], highest=delta[-1]))
    slope = -stiffness
    corners = np.stack((torque, slope, np.gradient(torque, preset, axis=1), np.gradient(slope, preset, axis=1)))
    cells = np.empty((delta.size - 1, preset.size - 1, 4, 4))
    for row, column in np.ndindex(cells.shape[:2]):
        h, k = delta[row + 1] - delta[row], preset[column + 1] - preset[column]
        f, f_d, f_p, f_dp = corners[:, row : row + 2, column : column + 2]
        values = np.block([[f, k * f_p], [h * f_d, h * k * f_dp]])
        scale = h ** np.arange(4)[:, None] * k ** np.arange(4)
        cells[row, column] = _HERMITE @ values @ _HERMITE.T / scale
    return TorqueTable(delta=delta, preset=preset, torque=cells, energy=_integrate(delta, cells), axes=axes)


def _integrate(delta: Array, cells: Array) -> Array:
    """Return the energy at the lower edge of each cell, zero at δ = 0."""
    h = np.diff(delta)
    steps = -np.einsum("rcij,ri->rcj", cells, h[:, None] ** np.arange(1, 5) / np.arange(1.0, 5.0))
    edges = np.concatenate((np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)))
    row = int(np.searchsorted(delta, 0.0, side="right")) - 1
    at_zero = edges[row] - np.einsum("cij,i->cj", cells[row], (-delta[row]) ** np.arange(1, 5) / np.arange(1.0, 5.0))
    energy: Array = edges[:-1] - at_zero
    return energy


# Mechanism -----------------------------------------------------------------------------------------


Mechanism = Bidirectional | Lever | Pretension | TorqueTable

_ENERGIES: dict[type, Callable[..., float]] = {
    Bidirectional: _bidirectional_energy,
    Lever: _lever_energy,
    Pretension: _pretension_energy,
    TorqueTable: _table_energy,
}
_TORQUES: dict[type, Callable[..., tuple[float, float, float, float]]] = {
    Bidirectional: _bidirectional_torques,
    Lever: _lever_torques,
    Pretension: _pretension_torques,
    TorqueTable: _table_torques,
}


def elastic_energy(mechanism: Mechanism, q: float, theta_A: float, theta_B: float) -> float:
    """Return the elastic energy E [J] at joint and motor angles [rad]."""
    return _ENERGIES[type(mechanism)](mechanism, q, theta_A, theta_B)


@overload(elastic_energy, cast(Any, STRICT), strict=False)
def _overload_energy(mechanism: Any, q: Any, theta_A: Any, theta_B: Any) -> Any:
    return cast(Any, _ENERGIES[mechanism.instance_class]).py_func


def elastic_torques(
    mechanism: Mechanism, q: float, theta_A: float, theta_B: float
) -> tuple[float, float, float, float]:
    """Return joint torque −∂E/∂q, loads ∂E/∂θ_A and ∂E/∂θ_B [N·m], S [N·m/rad].

    Angles in rad. A motor bears its load as it bears r_m F of a tendon.
    """
    return _TORQUES[type(mechanism)](mechanism, q, theta_A, theta_B)


@overload(elastic_torques, cast(Any, STRICT), strict=False)
def _overload_torques(mechanism: Any, q: Any, theta_A: Any, theta_B: Any) -> Any:
    return cast(Any, _TORQUES[mechanism.instance_class]).py_func


REST_RANGE_RAD = 1.0
"""Range on either side in which ``compute_rest`` searches for the rest position [rad]."""


def compute_rest(mechanism: Mechanism, preset: float) -> tuple[float, float]:
    """Return the rest position q [rad] of θ = n p, and S there [N·m/rad].

    ``preset`` is p. Springs that differ between the motors move the rest position with the preset.
    """
    axes = motor_axes(mechanism)
    theta_A, theta_B = axes.n_A * preset, axes.n_B * preset
    low, high = -REST_RANGE_RAD, REST_RANGE_RAD
    if elastic_torques(mechanism, 0.0, theta_A, theta_B)[0] == 0.0:
        low = high = 0.0
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if elastic_torques(mechanism, middle, theta_A, theta_B)[0] > 0.0 else (low, middle)
    return high, elastic_torques(mechanism, high, theta_A, theta_B)[3]


_DEFLECTIONS: dict[type, Callable[..., float]] = {
    Bidirectional: _bidirectional_deflection,
    Lever: _series_deflection,
    Pretension: _series_deflection,
    TorqueTable: _table_deflection,
}


def elastic_deflection(mechanism: Mechanism, q: float, theta_A: float, theta_B: float) -> float:
    """Return the deflection that the mechanism's limit bounds [rad].

    It is that of the spring with the larger deflection, or q − θ_A where motor B sets the preset.
    """
    return _DEFLECTIONS[type(mechanism)](mechanism, q, theta_A, theta_B)


@overload(elastic_deflection, cast(Any, STRICT), strict=False)
def _overload_deflection(mechanism: Any, q: Any, theta_A: Any, theta_B: Any) -> Any:
    return cast(Any, _DEFLECTIONS[mechanism.instance_class]).py_func


def motor_axes(mechanism: Mechanism) -> MotorAxes:
    """Return the directions of the motor angles."""
    if isinstance(mechanism, Bidirectional):
        return ANTAGONISTIC_AXES
    return mechanism.axes if isinstance(mechanism, TorqueTable) else SERIES_AXES
