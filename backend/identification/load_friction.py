"""Coulomb friction that grows with the tendon load, from actuator identifications at several tensions.

    u = (J θ'' + B θ' + r_m F + (c0 + c1 r_m F) sign θ') / K_t + τ_e u' + u_0

The friction acts at the gearbox outlet of the motor that is excited. Voltage, encoder and load cell of that motor are
enough: the load cell measures r_m F, so that K_t need not be known. All signals pass through one smoothing kernel. A
sample counts only where the motor turns one way throughout its kernel, fast enough for the friction to be fully
developed: there the sign commutes with the kernel, and neither the smoothing of a Coulomb step nor the Stribeck effect
matters. What is left is one least-squares problem over all runs. Its standard errors allow for coloured residuals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backend.identification.record import Signal
from backend.identification.uncertainty import sandwich

COLUMNS = ("u_A", "theta_A", "q", "F_A")
"""What is used of a run: voltage [V], motor and joint angle [rad], load cell [N]."""

MIN_TENSION_SPREAD_N = 5.0
"""Two runs whose mean tensions are nearer do not tell c0 from c1."""

MIN_SPEED_RAD_S = 0.15
"""Slower samples are left out: three times the Stribeck speed, and seven times the width of a smoothed Coulomb step."""

MIN_SAMPLES = 2000
_KERNEL_S = 0.012
_REACH = 4.0
_MAX_DELAY_S = 0.03
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
class LoadFriction:
    """c0 [N·m] and c1 [1] of motor A with standard errors; ``K_t`` [N·m/V] comes out of the same fit.

    ``c0_c1_covariance`` [N·m] is that of the two estimates, which are strongly correlated. ``runs`` are those that were
    used, ``tensions_N`` their mean tensions, ``samples`` how many samples counted.
    """

    c0: float
    c1: float
    K_t: float
    c0_std: float
    c1_std: float
    K_t_std: float
    c0_c1_covariance: float
    runs: tuple[int, ...]
    tensions_N: tuple[float, ...]
    samples: int


@dataclass(frozen=True)
class LoadFrictionResult:
    """What the runs say of the friction: ``estimate``, or None and the reason in ``problem``.

    ``left_out`` names each run that was not used, with the reason.
    """

    estimate: LoadFriction | None
    problem: str = ""
    left_out: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The result in one line."""
        if self.estimate is None:
            return f"Coulomb friction of motor A over the load: not measured, {self.problem}"
        e = self.estimate
        tensions = ", ".join(f"{one:.3g}" for one in e.tensions_N)
        return (
            f"Coulomb friction of motor A over the load: c0 = {with_error(e.c0, e.c0_std)} N·m,"
            f" c1 = {with_error(e.c1, e.c1_std)} (c0 + c1 r_m F, ± standard error; runs at {tensions} N)"
        )


def with_error(value: float, std: float) -> str:
    """Write a value and its standard error, both to the second digit of the error."""
    digits = 1 - int(np.floor(np.log10(std))) if std > 0.0 else 6
    digits = min(max(digits, 0), 9)
    return f"{value:.{digits}f} ± {std:.{digits}f}".replace("-", "−")


def estimate_load_friction(runs: Sequence[TensionRun], r_m: float) -> LoadFrictionResult:
    """Return c0 and c1 of motor A from runs at several tensions, or why they are not measured.

    ``r_m`` [m] is the radius of the motor's reel. A run counts where its signals are complete and the motor turns
    one way for long enough.
    """
    used: list[TensionRun] = []
    equations: list[tuple[Signal, Signal]] = []
    left_out: list[str] = []
    for run in runs:
        made = _equations(run, r_m)
        if isinstance(made, str):
            left_out.append(f"run {run.run}: {made}")
        else:
            used.append(run)
            equations.append(made)
    tensions = tuple(run.tension_N for run in used)
    if not tensions or max(tensions) - min(tensions) < MIN_TENSION_SPREAD_N:
        return LoadFrictionResult(None, _too_few(tensions), tuple(left_out))
    columns, u = np.vstack([one for one, _ in equations]), np.concatenate([one for _, one in equations])
    found = _solve(columns, u)
    if isinstance(found, str):
        return LoadFrictionResult(None, found, tuple(left_out))
    (c0, c1, K_t), covariance = found
    stds = np.sqrt(np.diag(covariance))
    if not (np.all(np.isfinite((c0, c1, K_t))) and np.all(np.isfinite(stds))):
        return LoadFrictionResult(None, "the standard errors could not be computed; record again", tuple(left_out))
    estimate = LoadFriction(
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


def _solve(columns: Signal, u: Signal) -> tuple[tuple[float, float, float], Signal] | str:
    """c0, c1, K_t and their covariance, shape (3, 3), by least squares; the reason where there is no solution."""
    size = np.linalg.norm(columns, axis=0)
    if not np.all(size > 0.0):
        return "the motor did not turn both ways; excite more"
    solution, _, rank, _ = np.linalg.lstsq(columns / size, u)
    if rank < columns.shape[1]:
        return "the records do not tell friction, inertia and load apart; excite more"
    solution = solution / size
    covariance = sandwich(columns, columns, u - columns @ solution)
    load, sign, sign_load = (_PARAMETERS.index(name) for name in ("load", "sign", "sign_load"))
    if not solution[load] > 0.0:
        return "the voltage does not rise with the load cell's force; check the load cell of tendon A"
    K_t = 1.0 / float(solution[load])
    c0, c1 = K_t * float(solution[sign]), K_t * float(solution[sign_load])
    gradient = np.zeros((3, columns.shape[1]))
    gradient[0, [sign, load]] = K_t, -K_t * c0
    gradient[1, [sign_load, load]] = K_t, -K_t * c1
    gradient[2, load] = -(K_t**2)
    return (c0, c1, K_t), np.asarray(gradient @ covariance @ gradient.T)


def _too_few(tensions: Sequence[float]) -> str:
    there = (
        "there is none" if not tensions else f"there is {', '.join(f'{one:.3g} N' for one in sorted(tensions))} only"
    )
    return (
        f"it needs usable runs at two tensions at least {MIN_TENSION_SPREAD_N:g} N apart, {there};"
        " identify at further tensions"
    )


def _equations(run: TensionRun, r_m: float) -> tuple[Signal, Signal] | str:
    """Regressors, shape (n, 7), and voltage, shape (n,), 0 where a sample does not count; the reason if too few do."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    missing = [name for name in COLUMNS if name not in run.columns]
    if missing:
        return f"its record has no {', '.join(missing)}"
    u, theta, q, F = (np.asarray(run.columns[name], dtype=np.float64) for name in COLUMNS)
    if not all(np.all(np.isfinite(values)) for values in (u, theta, q, F)):
        return "its record has samples that are not finite"
    period_s = run.period_s
    if u.size < MIN_SAMPLES:
        return f"its record has {u.size} samples, fewer than {MIN_SAMPLES}"
    reach, most = int(np.ceil(_REACH * _KERNEL_S / period_s)), int(_MAX_DELAY_S / period_s)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * period_s / _KERNEL_S) ** 2)
    kernel /= np.sum(kernel)

    def smoothed(values: Signal) -> Signal:
        return np.convolve(values, kernel, mode="same")

    theta_d, u = np.gradient(smoothed(theta), period_s), smoothed(u)
    load = smoothed(r_m * _undelayed(F, theta, q, most))
    # One way for the whole kernel: the slowest speed within its reach is fast, and has the sign of the middle.
    width = 2 * reach + 1
    one_way = (minimum_filter1d(theta_d, width) > MIN_SPEED_RAD_S) | (
        maximum_filter1d(theta_d, width) < -MIN_SPEED_RAD_S
    )
    one_way[: 2 * reach] = one_way[-2 * reach - most :] = False
    counted = int(np.count_nonzero(one_way))
    if counted < MIN_SAMPLES:
        return f"motor A turns one way in {counted} samples, fewer than {MIN_SAMPLES}"
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
    return np.column_stack(columns) * one_way[:, np.newaxis], u * one_way


def _undelayed(F: Signal, theta: Signal, q: Signal, most: int) -> Signal:
    """Shift the load cell's force earlier by its delay, whole samples and at most ``most``.

    The delay is the one after which the force fits a quadratic in both angles best, which stands for the spring.
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
