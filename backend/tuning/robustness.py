"""Robustness of all loops on high-order models: M_s, margins, ranges of λ.

See erratum E6.
"""

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backend.control import Decoupler, decoupler, pid
from backend.tuning import messages
from backend.tuning.gains import (
    LAM_MAX,
    MotorModel,
    PointModel,
    TuningError,
    TuningParameters,
    designed_point,
    make_motor_loops,
    motor_gains,
    motor_model,
    position_gains,
    stiffness_gains,
    true_motor_model,
)
from plant import (
    NO_LOAD,
    SIDES,
    Dynamics,
    Motor,
    PlantParameters,
    PlantState,
    T_s,
    compute_elastic_torques,
    motor_axes,
    state_derivative,
    tendon_tension,
)

if TYPE_CHECKING:
    import control


# Linear model --------------------------------------------------------------------------------------
# The high-order linear model of the outer loops' process: the plant linearized at rest, with closed motor loops.
#
# It has the four lags of the motor loops, their load, and the joint's resonance, which a first-order model neglects
# (erratum E6). Coulomb friction is neglected: smoothed at standstill it would act as a huge viscous friction.


_STEP = 1e-6
_REST_RANGE_RAD = 1.0
"""Range on either side in which the motors of another mechanism are turned to rest [rad]."""

_STATES = 8
"""States of a plant without friction: the bristles, the last of ``PlantState``, are excluded."""


def decoupled_model(
    parameters: PlantParameters, gains: pid.MotorPairGains, S: float, *, true_plant: bool = False
) -> "control.StateSpace":
    """Return the linear model from (q_c, S_c) to (q, S) at S [N·m/rad] and q = 0.

    The motor loops have ``gains``. The diagonal has the processes of the two outer loops, with gain 1 at low frequency;
    the cross terms have gain 0 there, and vanish if both sides are equal. With ``true_plant`` motors and springs are
    those of the plant itself, and the decoupler is still the one of the identified springs.
    """
    import control

    d = decoupler.build_decoupler(parameters)
    system = control.interconnect(
        [
            linear_plant(parameters, d, S, true_plant=true_plant),
            _motor_loop(gains.A, "A"),
            _motor_loop(gains.B, "B"),
            _decoupler(d, S),
            _outputs(d, S),
        ],
        inputs=["q_c", "S_c"],
        outputs=["q_out", "S_out"],
        check_unused=False,
    )
    return system


def linearize_one_motor(parameters: PlantParameters, gains: pid.MotorPairGains, S: float) -> PointModel:
    """Return the model from theta_A_ref to q and to S at S [N·m/rad], motor B held.

    It follows from geometry, springs and motor loops: the static gain of the linear plant without friction, and its sum
    of lags, minus the slope of the phase at zero frequency.
    """
    import control

    d = decoupler.build_decoupler(parameters)
    system = control.interconnect(
        [linear_plant(parameters, d, S), _motor_loop(gains.A, "A"), _motor_loop(gains.B, "B"), _outputs(d, S)],
        inputs=["theta_A_ref"],
        outputs=["q_out", "S_out"],
        check_unused=False,
    )
    A, B, C = (np.asarray(part) for part in (system.A, system.B, system.C))
    once = np.linalg.solve(A, B)
    K, slope = -(C @ once)[:, 0], -(C @ np.linalg.solve(A, once))[:, 0]
    T = -slope / K
    return PointModel(S, float(K[0]), float(T[0]), float(K[1]), float(T[1]))


def linear_plant(
    parameters: PlantParameters, d: Decoupler, S: float, *, true_plant: bool = False
) -> "control.StateSpace":
    """Return the plant from voltages [V] and joint torque [N·m] to q, θ_A, θ_B [rad].

    The plant is linearized at rest at S [N·m/rad] and q = 0. Motors and springs are the identified ones, or with
    ``true_plant`` those of the plant itself. S is always the controller's estimate.
    """
    import control

    theta_A, theta_B = decoupler.motor_positions(d, 0.0, S)
    if true_plant:
        plant = _without_friction(parameters.make_dynamics())
        theta_A, theta_B = _at_rest(plant, theta_A, theta_B)
    else:
        plant = parameters.make_identified_dynamics()
    _, load_A, load_B = compute_elastic_torques(plant, 0.0, theta_A, theta_B)
    at = np.array(
        PlantState(
            q=0.0, q_dot=0.0, theta_A=theta_A, omega_A=0.0, tau_A=load_A, theta_B=theta_B, omega_B=0.0, tau_B=load_B
        )
    )[:_STATES]
    u_A, u_B = load_A / plant.motor_A.K_t, load_B / plant.motor_B.K_t

    def rate(x: NDArray[np.float64], u_A: float, u_B: float, tau_ext: float = 0.0) -> NDArray[np.float64]:
        return np.array(
            state_derivative(plant=plant, x=PlantState(*x), u_A=u_A, u_B=u_B, tau_ext=tau_ext, load=NO_LOAD)
        )[:_STATES]

    A = np.column_stack(
        [(rate(at + dx, u_A, u_B) - rate(at - dx, u_A, u_B)) / (2.0 * _STEP) for dx in _STEP * np.eye(_STATES)]
    )
    B = np.column_stack(
        [
            (rate(at, u_A + _STEP, u_B) - rate(at, u_A - _STEP, u_B)) / (2.0 * _STEP),
            (rate(at, u_A, u_B + _STEP) - rate(at, u_A, u_B - _STEP)) / (2.0 * _STEP),
            (rate(at, u_A, u_B, _STEP) - rate(at, u_A, u_B, -_STEP)) / (2.0 * _STEP),
        ]
    )
    C = np.zeros((3, _STATES))
    C[0, 0] = C[1, 2] = C[2, 5] = 1.0
    inputs = ["u_A", "u_B", "tau_ext"]
    return control.ss(A, B, C, np.zeros((3, 3)), inputs=inputs, outputs=["q", "theta_A", "theta_B"], name="plant")


def _without_friction(plant: Dynamics) -> Dynamics:
    def free(motor: Motor) -> Motor:
        return motor._replace(friction=motor.friction._replace(c0=0.0, c1=0.0, lugre=None))

    return plant._replace(motor_A=free(plant.motor_A), motor_B=free(plant.motor_B))


def _at_rest(plant: Dynamics, theta_A: float, theta_B: float) -> tuple[float, float]:
    """Return θ_A, θ_B [rad] with the preset of the given ones and no torque at q = 0.

    The stiffness loop determines the preset, the position loop the rest. With tendons the preset is the sum, and the
    tensions are equal.
    """
    from scipy.optimize import brentq

    if plant.mechanism is not None:
        axes = motor_axes(plant.mechanism)

        def torque(turn: float) -> float:
            return compute_elastic_torques(plant, 0.0, theta_A + axes.g_A * turn, theta_B + axes.g_B * turn)[0]

        turn = float(brentq(torque, -_REST_RANGE_RAD, _REST_RANGE_RAD, xtol=1e-12))
        return theta_A + axes.g_A * turn, theta_B + axes.g_B * turn
    r_m, half = plant.joint.r_m, 0.5 * (theta_A + theta_B)

    def excess(offset: float) -> float:
        tension_A = tendon_tension(plant.spring_A, r_m * (half + offset))
        return float(tension_A - tendon_tension(plant.spring_B, r_m * (half - offset)))

    offset = float(brentq(excess, -half, half, xtol=1e-12))
    return half + offset, half - offset


def _motor_loop(gains: pid.IPDGains, side: str) -> "control.StateSpace":
    """Return the continuous I-PD law with its filter.

    States: integral, filtered integral, filtered position.
    """
    import control

    k_p, k_i, k_d, t_f = gains
    A = np.array([[0.0, 0.0, 0.0], [1.0 / t_f, -1.0 / t_f, 0.0], [0.0, 0.0, -1.0 / t_f]])
    B = np.array([[k_i, -k_i], [0.0, 0.0], [0.0, 1.0 / t_f]])
    C = np.array([[0.0, 1.0, k_d / t_f - k_p]])
    D = np.array([[0.0, -k_d / t_f]])
    names = [f"theta_{side}_ref", f"theta_{side}"]
    return control.ss(A, B, C, D, inputs=names, outputs=[f"u_{side}"], name=f"motor_{side}")


def decoupling_matrix(d: Decoupler, S: float) -> NDArray[np.float64]:
    """Return motor references per q_c and S_c, shape (2, 2), at q = 0 and S [N·m/rad]."""

    def positions(q_c: float, S_c: float) -> NDArray[np.float64]:
        return np.array(decoupler.motor_positions(d, q_c, S_c))

    return np.column_stack(
        [
            (positions(_STEP, S) - positions(-_STEP, S)) / (2.0 * _STEP),
            (positions(0.0, S + _STEP) - positions(0.0, S - _STEP)) / (2.0 * _STEP),
        ]
    )


def stiffness_gradient(d: Decoupler, S: float) -> tuple[float, float, float]:
    """Return dS/dq, dS/dθ_A, dS/dθ_B [N·m/rad per rad] at rest at q = 0 and S."""
    if d.mechanism is None:
        slope = decoupler.stiffness_slope(d, S)
        return 0.0, slope, slope
    at = np.array((0.0, *decoupler.motor_positions(d, 0.0, S)))
    slopes = [
        (decoupler.measured_stiffness(d, *(at + step)) - decoupler.measured_stiffness(d, *(at - step))) / (2.0 * _STEP)
        for step in _STEP * np.eye(3)
    ]
    return slopes[0], slopes[1], slopes[2]


def _decoupler(d: Decoupler, S: float) -> "control.StateSpace":
    import control

    D, names = decoupling_matrix(d, S), ["theta_A_ref", "theta_B_ref"]
    return control.ss([], [], [], D, inputs=["q_c", "S_c"], outputs=names, name="decoupler")


def _outputs(d: Decoupler, S: float) -> "control.StateSpace":
    import control

    D = np.array([[1.0, 0.0, 0.0], stiffness_gradient(d, S)])
    return control.ss([], [], [], D, inputs=["q", "theta_A", "theta_B"], outputs=["q_out", "S_out"], name="outputs")


# Cache ---------------------------------------------------------------------------------------------
# Cache of results that take python-control and a while to compute, and never change for the same inputs.
#
# ``backend.services.tuning_state`` stores ``FIGURES`` across starts, so that a start neither loads the library nor
# waits for it.


FIGURES: dict[str, tuple[float, ...]] = {}
"""Cached results by the digest of their key; the least recently used ones are dropped first."""

MOST = 400


def cached(cache_key: tuple[object, ...], count: int, compute: Callable[[], tuple[float, ...]]) -> tuple[float, ...]:
    """Return the ``count`` numbers of ``compute()``, cached by ``cache_key``.

    ``cache_key`` contains the name of the computation and all its inputs: strings, numbers, frozen dataclasses of
    numbers. A cached value of another length, or that is not finite, is recomputed; exceptions are not cached.
    """
    key = hashlib.sha256(repr(cache_key).encode()).hexdigest()
    result = FIGURES.get(key, ())
    if len(result) != count or not all(map(math.isfinite, result)):
        result = compute()
    FIGURES.pop(key, None)
    FIGURES[key] = result
    for oldest in list(FIGURES)[:-MOST]:  # a copy, since other threads add results too
        FIGURES.pop(oldest, None)
    return result


# Robustness ----------------------------------------------------------------------------------------
# M_s, margins and ranges of λ of the outer loops, computed on the high-order models (erratum E6).


M_S_MAX = 1.7
"""Largest permitted sensitivity peak (method section 5)."""

_OMEGA = np.logspace(-2, 3, 801)


@dataclass(frozen=True)
class Robustness:
    """Robustness of a loop: ``M_s`` [1], gain margins [1] and phase margin [rad].

    An unstable loop has M_s = inf. ``gain_margin`` is the factor by which the gain may rise, inf without bound;
    ``gain_reduction`` is the factor to which it may fall, 0 without bound.
    """

    M_s: float
    gain_margin: float
    gain_reduction: float
    phase_margin: float
    stable: bool


class OuterProcess:
    """Process of an outer loop, from control signal to measurement.

    It includes the frequency response. ``system`` has one input, one output and no direct feedthrough.
    """

    def __init__(self, system: "control.StateSpace") -> None:
        self._A, self._B, self._C = (np.asarray(part, dtype=np.float64) for part in (system.A, system.B, system.C))
        resolvent = 1j * _OMEGA[:, None, None] * np.eye(len(self._A)) - self._A
        self.response = (self._C @ np.linalg.solve(resolvent, np.broadcast_to(self._B, (_OMEGA.size, *self._B.shape))))[
            :, 0, 0
        ]

    def loop_response(self, gains: pid.IPGains) -> NDArray[np.complex128]:
        """Return the frequency response of the loop opened at the control signal."""
        return np.asarray(self.response * (gains.k_p + gains.k_i / (1j * _OMEGA)))

    def is_stable(self, gains: pid.IPGains) -> bool:
        """Return whether all poles of the I-P loop are in the left half plane."""
        states = len(self._A)
        closed = np.zeros((states + 1, states + 1))
        closed[:states, :states] = self._A - gains.k_p * self._B @ self._C
        closed[:states, states:], closed[states:, :states] = gains.k_i * self._B, -self._C
        return bool(np.all(np.linalg.eigvals(closed).real < 0.0))

    def robustness(self, gains: pid.IPGains) -> Robustness:
        """Return the robustness of the I-P loop with this process."""
        return summarize_loop(self.is_stable(gains), self.loop_response(gains), _OMEGA)

    def sensitivity_peak(self, gains: pid.IPGains) -> float:
        """Return M_s alone; inf for an unstable loop."""
        return peak(self.loop_response(gains)) if self.is_stable(gains) else math.inf


def compute_robustness(
    loop: "control.StateSpace", response: NDArray[np.complex128], omega: NDArray[np.float64]
) -> Robustness:
    """Return the robustness of a continuous or sampled loop.

    ``response`` (n,) is at ``omega`` (n,) [rad/s], evenly spaced in log. Gain margins are determined on both sides: a
    conditionally stable loop also becomes unstable when its gain falls.
    """
    return summarize_loop(_is_stable(loop), response, omega)


def summarize_loop(stable: bool, response: NDArray[np.complex128], omega: NDArray[np.float64]) -> Robustness:
    """Return the robustness of a loop whose stability is known, from its response (n,) at ``omega`` (n,)."""
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
    """Return the gain factors (k,) [1] and phase shifts (m,) [rad] that reach −1.

    ``response`` (n,) at ``omega`` (n,) [rad/s], evenly spaced in log. Between the points modulus and phase are cubic in
    log ω: with 160 points per decade the error is below 1e-6.
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
    """Return the cubic through four points around the interval from ``k``.

    The results are its coefficients and its first point.
    """
    first = min(max(k - 1, 0), y.size - 4)
    return np.polyfit(np.arange(4.0), y[first : first + 4], 3), first


def _at(y: NDArray[np.float64], k: int, x: float) -> float:
    coefficients, first = _cubic(y, k)
    return float(np.polyval(coefficients, x - first))


def _crossings(y: NDArray[np.float64], k: int) -> list[float]:
    """Return the zeros of ``y`` between the points ``k`` and ``k + 1``, in points."""
    from scipy.optimize import brentq

    if y[k] == 0.0:
        return [float(k)]
    if y[k] * y[k + 1] >= 0.0:
        return []
    coefficients, first = _cubic(y, k)
    return [first + float(brentq(lambda x: float(np.polyval(coefficients, x)), k - first, k + 1 - first))]


def peak(response: NDArray[np.complex128]) -> float:
    """Return max |1/(1 + L)| of a response (n,).

    The peak is interpolated by a parabola through the three nearest values.
    """
    sensitivity = np.abs(1.0 / (1.0 + response))
    k = int(np.argmax(sensitivity))
    if k in (0, sensitivity.size - 1):
        return float(sensitivity[k])
    low, middle, high = sensitivity[k - 1 : k + 2]
    return float(middle + (high - low) ** 2 / (8.0 * (2.0 * middle - high - low)))


def _is_stable(loop: "control.StateSpace") -> bool:
    import control

    poles = control.feedback(loop, 1).poles()
    return bool(np.all(np.abs(poles) < 1.0) if loop.isdtime(strict=True) else np.all(poles.real < 0.0))


def safe_lambda(process: OuterProcess, gains_for: Callable[[float], pid.IPGains], M_s: float = M_S_MAX) -> float:
    """Return the smallest λ [s] from which the sensitivity peak stays below ``M_s``.

    This applies to an outer loop, up to LAM_MAX. ``gains_for`` returns the gains for a λ. Raises TuningError if no λ is
    that robust.
    """
    from scipy.optimize import brentq

    def excess(lam: float) -> float:
        return peak(process.loop_response(gains_for(lam))) - M_s

    grid = np.geomspace(0.05, LAM_MAX, 60)
    # A fast loop can be unstable with a small peak: only the range connected to the slow end counts.
    above = [k for k, lam in enumerate(grid) if excess(lam) > 0.0]
    if not above:
        return float(grid[0])
    if above[-1] == grid.size - 1:
        raise TuningError(messages.no_robust_lambda(maximum_s=LAM_MAX, M_s=M_s))
    return float(brentq(excess, grid[above[-1]], grid[above[-1] + 1], xtol=1e-6))


# Motor loop ----------------------------------------------------------------------------------------
# The motor loop as executed: sampled each period, with the motor's electrical lag (erratum E5).
#
# On the plain K_m/(s (T_m s + 1)) of table 2 the loop appears more robust than it is, the more so the smaller λ is.


LAM_MOTOR_MIN = 0.05
"""Smallest permitted λ [s]. The loop then needs a 25th of its gain to be stable; with a smaller λ it needs more, and
saturation reduces the gain."""

LAM_MOTOR_MAX = 0.2
"""Largest permitted λ [s]; for the paper's motor M_s falls with λ up to here (erratum E5)."""

_MOTOR_LOOP_OMEGA = np.geomspace(1e-2, np.pi / T_s, 900)
_Z = np.exp(1j * _MOTOR_LOOP_OMEGA * T_s)
_LAMBDAS = 25


def motor_robustness(motor: MotorModel, gains: pid.IPDGains) -> Robustness:
    """Return the robustness of the sampled loop of an unloaded motor.

    Tendons change M_s by less than half a percent.
    """
    import control

    loop = _discretize_motor(motor) * _law(gains)
    return compute_robustness(control.tf2ss(loop), loop(_Z), _MOTOR_LOOP_OMEGA)


def motor_range(motor: MotorModel) -> tuple[float, float]:
    """Return the smallest and largest permitted λ [s]. Raises TuningError.

    M_s stays at or below M_S_MAX, λ well below 4 T_m.
    """
    low, _, high = _range(motor)
    return low, high


def common_lambda_range(motors: Iterable[MotorModel]) -> tuple[float, float]:
    """Return the smallest and largest permitted λ [s] for all of these motors.

    Raises TuningError.
    """
    ranges = [motor_range(motor) for motor in motors]
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if low > high:
        raise TuningError(messages.no_lambda_for_both_motors(minimum_s=low, maximum_s=high))
    return low, high


def motor_lambda(motor: MotorModel, M_s: float) -> float:
    """Return λ [s] for a required M_s where M_s falls with λ, within the range.

    Raises TuningError with the possible range of M_s.
    """
    from scipy.optimize import brentq

    low, end, _ = _range(motor)
    highest, lowest = _peak(motor, low), _peak(motor, end)
    if not lowest <= M_s <= highest:
        raise TuningError(
            messages.M_s_not_attainable(M_s=M_s, lowest=lowest, lam_lowest=end, highest=highest, lam_highest=low)
        )
    return float(brentq(lambda lam: _peak(motor, lam) - M_s, low, end, xtol=1e-7))


def _range(motor: MotorModel) -> tuple[float, float, float]:
    """Return the smallest λ [s], the one with the least M_s, and the largest."""
    low, end, high = cached(("motor range", motor), 3, lambda: _computed_range(motor))
    return low, end, high


def _computed_range(motor: MotorModel) -> tuple[float, float, float]:
    from scipy.optimize import brentq

    high = min(LAM_MOTOR_MAX, 3.8 * motor.T_m)
    if high <= LAM_MOTOR_MIN:
        raise TuningError(messages.motor_too_quick(T_m=motor.T_m, minimum_s=LAM_MOTOR_MIN))
    lambdas = np.geomspace(LAM_MOTOR_MIN, high, _LAMBDAS)
    peaks = np.array([_peak(motor, lam) for lam in lambdas])
    fragile = np.flatnonzero(peaks > M_S_MAX)
    if fragile.size == _LAMBDAS or (fragile.size and fragile[-1] == _LAMBDAS - 1):
        raise TuningError(messages.no_robust_motor_loop(maximum_s=high, M_s=M_S_MAX))
    first = int(fragile[-1]) + 1 if fragile.size else 0
    low = float(lambdas[0])
    if fragile.size:
        low = float(brentq(lambda lam: _peak(motor, lam) - M_S_MAX, lambdas[first - 1], lambdas[first], xtol=1e-7))
    rising = np.flatnonzero(np.diff(peaks[first:]) > 0.0)
    end = float(lambdas[first + rising[0]]) if rising.size else high
    return low, end, high


def _peak(motor: MotorModel, lam: float) -> float:
    return peak((_discretize_motor(motor) * _law(motor_gains(motor.K_m, motor.T_m, lam)))(_Z))


@cache
def _discretize_motor(motor: MotorModel) -> "control.TransferFunction":
    """Return the model from the voltage over a period to the position at its end."""
    import control

    s = control.tf("s")
    process = motor.K_m / (s * (motor.T_m * s + 1.0) * (motor.tau_e * s + 1.0))
    return control.sample_system(process, T_s, "zoh")


def _law(gains: pid.IPDGains) -> "control.TransferFunction":
    """Return ``step_i_pd`` as a difference equation from position to negated voltage."""
    import control

    decay = float(np.exp(-T_s / gains.t_f))
    proportional = (1.0 - decay) * gains.k_p * np.array([1.0, -1.0, 0.0])
    integral = (1.0 - decay) * T_s * gains.k_i * np.array([0.0, 1.0, 0.0])
    derivative = decay * gains.k_d / gains.t_f * np.array([1.0, -2.0, 1.0])
    return control.tf(proportional + integral + derivative, np.polymul([1.0, -decay], [1.0, -1.0]), T_s)


# Loop margins --------------------------------------------------------------------------------------
# Robustness of all three loops with the active gains, on the identified model or on the plant itself.
#
# The controller uses the identified model. On a plant that differs, the same gains have other sensitivity peaks and
# margins, which are known for a simulated plant. Friction is neglected in both.


@dataclass(frozen=True)
class LoopMargins:
    """Margins of the loops of ``q``, of ``S`` and of the motors.

    Each is the worst of all points of a bank, or of both motors.
    """

    q: Robustness
    S: Robustness
    motor: Robustness


def compute_loop_margins(
    parameters: PlantParameters, points: Sequence[PointModel], lambdas: TuningParameters, *, true_plant: bool
) -> LoopMargins:
    """Return the robustness of the gains of ``lambdas`` at ``points``.

    They apply to the true plant or to its identified model and, without points, to the 20 N point from geometry. Each
    outer loop is opened at its control signal while the other one is open, each motor loop is sampled and unloaded.
    Raises TuningError for a λ without gains.
    """
    points = points or (designed_point(parameters, lambdas.lam_motor),)
    loops = make_motor_loops(parameters, lambdas.lam_motor)
    q, S = [], []
    for point in points:
        model = decoupled_model(parameters, loops, point.S_nominal, true_plant=true_plant)
        q.append(OuterProcess(model[0, 0]).robustness(position_gains(parameters, point, lambdas)))
        S.append(OuterProcess(model[1, 1]).robustness(stiffness_gains(parameters, point, lambdas)))
    inner = []
    for side in SIDES:
        motor = motor_model(parameters, side)
        gains = motor_gains(motor.K_m, motor.T_m, lambdas.lam_motor)
        inner.append(motor_robustness(true_motor_model(parameters, side) if true_plant else motor, gains))
    return LoopMargins(_worst(q), _worst(S), _worst(inner))


def _worst(found: Iterable[Robustness]) -> Robustness:
    """Return the worst of each quantity, whichever loop it is of."""
    loops = list(found)
    return Robustness(
        max(loop.M_s for loop in loops),
        min(loop.gain_margin for loop in loops),
        max(loop.gain_reduction for loop in loops),
        min(loop.phase_margin for loop in loops),
        stable=all(loop.stable for loop in loops),
    )
