"""Coulomb friction from records, and its growth with the tendon load."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numba
import numpy as np

from backend.identification import messages
from backend.identification.models import DryFriction
from backend.identification.records import NotConvergedError, Record, Signal
from backend.identification.validation import sandwich, whiteness
from backend.response_docs import describe_field
from plant import Message, cache_compiled

# Friction ------------------------------------------------------------------------------------------
# Coulomb friction in a record from force, current or voltage to speed or position.
#
#     T w' + w = K (u - u_0 - u_c sign w),   at rest while |u - u_0| <= u_c;      y = w, or y = the integral of w
#
# A linear model of such a record interprets friction as damping: gain and lag are too small, by half if the friction
# takes a third of the input, with standard errors that do not include it and, with little noise, with residuals that do
# not show it. This model is therefore tried on every record of motion in both directions. Between samples u is held,
# and the speed is exact, zero crossings included. If the linear model has a dead time, so has this one.


SIGNIFICANT_STD = 4.0
MOST_EXPLAINED = 0.8
_MOVING_SHARE = 0.1
_RESTING_PART = 0.02
_LAGS = 12
_MAX_STEPS = 60
_STEP = 1e-6
_FRICTIONS = (0.05, 0.2, 0.4, 0.7, 1.0)
"""Starting values of friction, in root mean squares of the input."""


@dataclass(frozen=True)
class FrictionFit:
    """Parameters K, T, u_c, t_d, covariance of the first three, and residual (n,)."""

    parameters: Signal
    covariance: Signal
    residuals: Signal


def has_both_directions(speed: Signal) -> bool:
    """Return whether a speed (n,) has both directions for long enough.

    Only then can friction be distinguished from an offset of the input.
    """
    size = _RESTING_PART * float(np.max(np.abs(speed)))
    return min(float(np.mean(speed > size)), float(np.mean(speed < -size))) > _MOVING_SHARE


def dry_friction(record: Record, linear_error: Signal, dead_time_s: float) -> DryFriction | None:
    """Return the Coulomb friction in a record of a speed, or None.

    The result is None if the record cannot show any. ``linear_error``, shape (n,), is the simulation residual of the
    linear model, ``dead_time_s`` its dead time, 0 if its structure has none.
    """
    if not has_both_directions(record.y):
        return None
    try:
        fitted = fit_friction(record, dead_time_s)
    except (NotConvergedError, np.linalg.LinAlgError):
        return None
    u_c, std = float(fitted.parameters[2]), np.sqrt(np.abs(np.diag(fitted.covariance)))
    left = float(np.linalg.norm(fitted.residuals) / np.linalg.norm(linear_error))
    # Other dynamics may look like friction: it is friction if the residual is white, or much smaller.
    explains = left < MOST_EXPLAINED or (left < 1.0 and whiteness(fitted.residuals, record.period_s).passed)
    is_significant = u_c > SIGNIFICANT_STD * std[2]
    if is_significant and not explains:
        return None
    fit = 100.0 * (1.0 - np.linalg.norm(fitted.residuals) / np.linalg.norm(record.y - np.mean(record.y)))
    K, T, _, t_d = (float(value) for value in fitted.parameters)
    return DryFriction(
        found=bool(is_significant),
        K=K,
        T=T,
        u_c=u_c,
        K_std=float(std[0]),
        T_std=float(std[1]),
        u_c_std=float(std[2]),
        fit_percent=float(fit),
        t_d=t_d,
    )


def fit_friction(record: Record, dead_time_s: float) -> FrictionFit:
    """Fit the friction model to a speed by least squares on its simulation.

    A dead time is fitted as well, also from shorter starting values: a linear model may interpret friction as dead
    time. Raises NotConvergedError.
    """
    from scipy.optimize import least_squares

    scale_u, scale_y = float(np.sqrt(np.mean(record.u**2))), float(np.sqrt(np.mean(record.y**2)))
    u, y, period_s = record.u / scale_u, record.y / scale_y, record.period_s

    def residuals(z: Signal) -> Signal:
        late = period_s * z[5] if z.size > 5 else 0.0
        return np.asarray(
            y
            - simulate_motion(
                u=u,
                period_s=period_s,
                K=z[0],
                T=positive_lag(float(z[1]), period_s),
                u_c=z[2],
                u_0=z[3],
                initial=z[4],
                dead_time_s=late,
            )[0]
        )

    start = _start(u, y, period_s, dead_time_s)
    try:
        found = least_squares(residuals, start, jac=differences(residuals), x_scale=0.1, max_nfev=_MAX_STEPS)
    except ValueError:  # a simulation that overflows
        raise NotConvergedError(messages.no_friction_model_fits()) from None
    if not np.all(np.isfinite(found.x)):
        raise NotConvergedError(messages.no_friction_model_fits())
    sensitivities = -np.asarray(found.jac, dtype=np.float64)
    moves = np.linalg.norm(sensitivities, axis=0) > 0.0  # rest, or an offset, may have no effect
    if not np.all(moves[:3]):
        raise NotConvergedError(messages.friction_not_separable())
    covariance = sandwich(sensitivities[:, moves], sensitivities[:, moves], found.fun)[:3, :3]
    T = float(np.exp(found.x[1]))
    unit = np.array([scale_y / scale_u, T, scale_u])
    t_d = period_s * float(found.x[5]) if found.x.size > 5 else 0.0
    parameters = np.array([found.x[0] * unit[0], T, found.x[2] * unit[2], t_d])
    return FrictionFit(parameters, covariance * np.outer(unit, unit), np.asarray(found.fun * scale_y))


def positive_lag(logarithm: float, period_s: float) -> float:
    """Return the lag [s] of this logarithm, limited to what can be simulated.

    Otherwise a search may overflow.
    """
    return float(period_s * np.exp(np.clip(logarithm - np.log(period_s), -20.0, 40.0)))


def differences(residuals: Callable[[Signal], Signal]) -> Callable[[Signal], Signal]:
    """Return the Jacobian of residuals by central differences with an absolute step.

    Parameters are of size 1, and may be zero.
    """

    def jacobian(z: Signal) -> Signal:
        moves = _STEP * np.eye(z.size)
        return np.column_stack([(residuals(z + move) - residuals(z - move)) / (2.0 * _STEP) for move in moves])

    return jacobian


def _start(u: Signal, y: Signal, period_s: float, dead_time_s: float) -> Signal:
    """Return K, ln T, u_c, u_0, first speed and dead time, the best of a grid.

    The dead time, if there is one, is in samples; K is fitted.
    """
    best, lowest = np.zeros(5), np.inf
    lags = np.geomspace(3.0 * period_s, u.size * period_s / 5.0, _LAGS)
    dead_times = (0.0, 0.5 * dead_time_s, dead_time_s) if dead_time_s else (0.0,)
    for T, u_c, t_d in itertools.product(lags.tolist(), _FRICTIONS, dead_times):
        speed = simulate_motion(u=u, period_s=period_s, K=1.0, T=T, u_c=u_c, u_0=0.0, initial=0.0, dead_time_s=t_d)[0]
        size = float(speed @ speed)
        K = float(speed @ y) / size if size > 0.0 else 0.0
        error = float(np.linalg.norm(y - K * speed))
        if error < lowest:
            best, lowest = np.array([K, np.log(T), u_c, 0.0, y[0], t_d / period_s]), error
    return best if dead_time_s else best[:5]


@cache_compiled
@numba.njit()
def simulate_motion(
    u: Signal, period_s: float, K: float, T: float, u_c: float, u_0: float, initial: float, dead_time_s: float = 0.0
) -> Signal:
    """Return speed and rotation since the first sample, shape (2, n).

    Exact for an input that is held between samples. A dead time need not be whole samples. The input before and after
    the record counts as its first and last value.
    """
    w, turned = initial, 0.0
    motion = np.empty((2, u.size))
    whole = int(np.floor(dead_time_s / period_s))
    part = dead_time_s - whole * period_s
    for k in range(u.size):
        motion[0, k], motion[1, k] = w, turned
        for late, left in ((1, part), (0, period_s - part)):
            drive = u[min(max(k - whole - late, 0), u.size - 1)] - u_0
            while left > 0.0:
                sign = np.sign(w) if w != 0.0 else np.sign(K * drive)
                if w == 0.0 and abs(drive) <= u_c:
                    break
                # Friction opposes the motion, for any sign of K.
                final = K * drive - abs(K) * u_c * sign
                reached = final + (w - final) * np.exp(-left / T)
                if w != 0.0 and reached * w < 0.0:
                    until = T * np.log((w - final) / -final)
                    turned += final * until + w * T  # the lag's part is T (w - 0)
                    left -= until
                    w = 0.0
                else:
                    turned += final * left + (w - reached) * T
                    w = reached
                    left = 0.0
    return motion


# Load friction -------------------------------------------------------------------------------------
# Coulomb friction that grows with the tendon load, from actuator identifications at several tensions.
#
#     u = (J θ'' + B θ' + r_m F + (c0 + c1 r_m F) sign θ') / K_t + τ_e u' + u_0
#
# The friction acts at the gearbox output of the excited motor. Voltage, encoder and load cell of that motor suffice:
# the load cell measures r_m F, so K_t need not be known. All signals are smoothed by the same kernel. A sample counts
# only if the motor turns in one direction within its kernel, fast enough for the friction to be fully developed: the
# sign then commutes with the kernel, and neither the smoothing of a Coulomb step nor the Stribeck effect matters. The
# result is one least-squares problem over all runs. Its standard errors allow for coloured residuals.


COLUMNS = ("u_A", "theta_A", "q", "F_A")
"""Columns used of a run: voltage [V], motor and joint angle [rad], load cell [N]."""

MIN_TENSION_SPREAD_N = 5.0
"""Least difference of mean tensions that distinguishes c0 from c1."""

MIN_SPEED_RAD_S = 0.15
"""Slowest speed of used samples: three times the Stribeck speed, and seven times the width of a smoothed Coulomb
step."""

MIN_SAMPLES = 2000
_KERNEL_S = 0.012
_REACH = 4.0
_MAX_DELAY_S = 0.03
_NO_PROBLEM = Message("")
_PARAMETERS = ("theta_dd", "theta_d", "load", "sign", "sign_load", "u_d", "offset")


@dataclass(frozen=True)
class TensionRun:
    """Excited samples of one actuator identification.

    ``columns`` holds those of COLUMNS, shape (n,) each, evenly spaced by ``period_s`` [s].
    """

    run: int
    period_s: float
    columns: Mapping[str, Signal]

    @property
    def tension_N(self) -> float:
        """Mean tension of tendon A [N]."""
        return float(np.mean(self.columns["F_A"]))


@dataclass(frozen=True)
class LoadFrictionFit:
    """Load-dependent friction of motor A: c0 [N·m], c1 [1], and ``K_t`` [N·m/V].

    ``c0_c1_covariance`` [N·m] is the covariance of the two estimates, which are strongly correlated. ``runs`` are the
    used runs, ``tensions_N`` mean tensions of the used runs, ``samples`` the number of used samples.
    """

    c0: float = field(metadata=describe_field("Coulomb friction without load", "N·m"))
    c1: float = field(metadata=describe_field("increase of Coulomb friction per unit of load torque r_m F"))
    K_t: float = field(metadata=describe_field("stall torque per volt, from the same fit", "N·m/V"))
    c0_std: float = field(metadata=describe_field("standard error of c0", "N·m"))
    c1_std: float = field(metadata=describe_field("standard error of c1"))
    K_t_std: float = field(metadata=describe_field("standard error of K_t", "N·m/V"))
    c0_c1_covariance: float = field(metadata=describe_field("covariance of c0 and c1 [N·m]"))
    runs: tuple[int, ...] = field(metadata=describe_field("runs that were used"))
    tensions_N: tuple[float, ...] = field(metadata=describe_field("mean tensions of the used runs", "N"))
    samples: int = field(metadata=describe_field("number of used samples"))


@dataclass(frozen=True)
class LoadFrictionResult:
    """Result of the estimation: ``estimate``, or None and the reason in ``problem``.

    ``left_out`` names each unused run with the reason.
    """

    estimate: LoadFrictionFit | None
    problem: Message = _NO_PROBLEM
    left_out: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The result in one line."""
        if self.estimate is None:
            return messages.load_friction_not_measured(reason=self.problem)
        e = self.estimate
        return messages.load_friction(c0=e.c0, c0_std=e.c0_std, c1=e.c1, c1_std=e.c1_std, tensions_N=e.tensions_N)


def estimate_load_friction(runs: Sequence[TensionRun], r_m: float) -> LoadFrictionResult:
    """Return c0 and c1 of motor A from runs at several tensions, or the reason for none.

    ``r_m`` [m] is the radius of the motor's reel. A run is used if its signals are complete and the motor turns in one
    direction for long enough.
    """
    used: list[TensionRun] = []
    equations: list[tuple[Signal, Signal]] = []
    left_out: list[str] = []
    for run in runs:
        made = _equations(run, r_m)
        if isinstance(made, Message):
            left_out.append(messages.run_left_out(run=run.run, reason=made))
        else:
            used.append(run)
            equations.append(made)
    tensions = tuple(run.tension_N for run in used)
    if not tensions or max(tensions) - min(tensions) < MIN_TENSION_SPREAD_N:
        problem = messages.too_few_tensions(tensions_N=tensions, minimum_distance_N=MIN_TENSION_SPREAD_N)
        return LoadFrictionResult(None, problem, tuple(left_out))
    columns, u = np.vstack([one for one, _ in equations]), np.concatenate([one for _, one in equations])
    found = _solve(columns, u)
    if isinstance(found, Message):
        return LoadFrictionResult(None, found, tuple(left_out))
    (c0, c1, K_t), covariance = found
    stds = np.sqrt(np.diag(covariance))
    if not (np.all(np.isfinite((c0, c1, K_t))) and np.all(np.isfinite(stds))):
        return LoadFrictionResult(None, messages.load_friction_without_errors(), tuple(left_out))
    estimate = LoadFrictionFit(
        c0=c0,
        c1=c1,
        K_t=K_t,
        c0_std=float(stds[0]),
        c1_std=float(stds[1]),
        K_t_std=float(stds[2]),
        c0_c1_covariance=float(covariance[0, 1]),
        runs=tuple(run.run for run in used),
        tensions_N=tensions,
        samples=int(np.count_nonzero(np.any(columns, axis=1))),
    )
    return LoadFrictionResult(estimate, left_out=tuple(left_out))


def _solve(columns: Signal, u: Signal) -> tuple[tuple[float, float, float], Signal] | Message:
    """Return c0, c1, K_t and their covariance, shape (3, 3), or an error message."""
    size = np.linalg.norm(columns, axis=0)
    if not np.all(size > 0.0):
        return messages.motor_turned_one_way()
    solution, _, rank, _ = np.linalg.lstsq(columns / size, u)
    if rank < columns.shape[1]:
        return messages.load_friction_not_separable()
    solution = solution / size
    covariance = sandwich(columns, columns, u - columns @ solution)
    load, sign, sign_load = (_PARAMETERS.index(name) for name in ("load", "sign", "sign_load"))
    if not solution[load] > 0.0:
        return messages.voltage_does_not_follow_force()
    K_t = 1.0 / float(solution[load])
    c0, c1 = K_t * float(solution[sign]), K_t * float(solution[sign_load])
    gradient = np.zeros((3, columns.shape[1]))
    gradient[0, [sign, load]] = K_t, -K_t * c0
    gradient[1, [sign_load, load]] = K_t, -K_t * c1
    gradient[2, load] = -(K_t**2)
    return (c0, c1, K_t), np.asarray(gradient @ covariance @ gradient.T)


def _equations(run: TensionRun, r_m: float) -> tuple[Signal, Signal] | Message:
    """Return regressors, shape (n, 7), and voltage, shape (n,), or an error message.

    Unused samples are 0.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    missing = [name for name in COLUMNS if name not in run.columns]
    if missing:
        return messages.run_without_columns(missing=missing)
    u, theta, q, F = (np.asarray(run.columns[name], dtype=np.float64) for name in COLUMNS)
    if not all(np.all(np.isfinite(values)) for values in (u, theta, q, F)):
        return messages.run_not_finite()
    period_s = run.period_s
    if u.size < MIN_SAMPLES:
        return messages.run_too_short(length=u.size, minimum=MIN_SAMPLES)
    reach, most = int(np.ceil(_REACH * _KERNEL_S / period_s)), int(_MAX_DELAY_S / period_s)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * period_s / _KERNEL_S) ** 2)
    kernel /= np.sum(kernel)

    def smooth(values: Signal) -> Signal:
        return np.convolve(values, kernel, mode="same")

    theta_d, u = np.gradient(smooth(theta), period_s), smooth(u)
    load = smooth(r_m * _compensate_force_delay(F, theta, q, most))
    # One direction within the kernel: the slowest speed within its reach is fast, and has the sign of the middle.
    width = 2 * reach + 1
    is_one_direction = (minimum_filter1d(theta_d, width) > MIN_SPEED_RAD_S) | (
        maximum_filter1d(theta_d, width) < -MIN_SPEED_RAD_S
    )
    is_one_direction[: 2 * reach] = is_one_direction[-2 * reach - most :] = False
    counted = int(np.count_nonzero(is_one_direction))
    if counted < MIN_SAMPLES:
        return messages.run_reverses_too_often(count=counted, minimum=MIN_SAMPLES)
    sign = np.sign(theta_d)
    columns = (
        np.gradient(theta_d, period_s),
        theta_d,
        load,
        sign,
        sign * load,
        np.gradient(u, period_s),
        np.ones(u.size),
    )
    return np.column_stack(columns) * is_one_direction[:, np.newaxis], u * is_one_direction


def _compensate_force_delay(F: Signal, theta: Signal, q: Signal, most: int) -> Signal:
    """Shift the load cell's force earlier by its delay.

    The delay is in whole samples, at most ``most``. With the delay the force best fits a quadratic in both angles,
    which approximates the spring.
    """
    angles = np.column_stack((theta - np.mean(theta), q - np.mean(q)))
    columns = np.column_stack((np.ones(F.size), angles, angles**2, angles[:, :1] * angles[:, 1:]))
    used = slice(0, F.size - most)
    basis = np.linalg.qr(columns[used])[0]

    def left_over(delay: int) -> float:
        late = F[delay : delay + F.size - most]
        return float(late @ late - np.sum((basis.T @ late) ** 2))

    delay = min(range(most + 1), key=left_over)
    return np.concatenate((F[delay:], np.full(delay, F[-1])))
