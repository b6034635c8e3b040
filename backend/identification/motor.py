"""Motor from unloaded voltage steps (equation 17): the paper's 63.21 % rule, and least squares on position.

Position obeys T_m w' + w = K_m (u - u_c sign w), w = theta': K_m / (s (T_m s + 1)) with a Coulomb voltage u_c, the part
of the voltage that only overcomes dry friction. After a step from rest, with v = K_m (u - u_c sign u),

    theta(t) = theta_0 + v (t - T_m (1 - e^(-t/T_m))).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from backend.identification.errors import NotConvergedError, RecordError
from backend.identification.record import Signal
from backend.identification.result import Grade, Verdict, worst
from backend.identification.uncertainty import sandwich
from backend.identification.unseen import Beside
from backend.identification.validation import (
    CAUTION_MISFIT_PERCENT,
    CAUTION_STD_PERCENT,
    MAX_STD_PERCENT,
    graded,
)

LEVEL = 0.01
MIN_RUNS = 2
MIN_MOTION_COUNTS = 200.0
MAX_LOAD_N = 0.5
MAX_MISFIT_COUNTS = 10.0
MAX_MOTOR_MISFIT_PERCENT = 10.0
_STEADY_PART = 0.2
_MIN_LENGTH_LAGS = 3.0
_SMOOTHING_PART = 0.02


@dataclass(frozen=True)
class VoltageStep:
    """One run: ``u`` [V] steps once from zero and stays; ``theta`` [rad] at the outlet; both shape (n,).

    ``tension_N`` is the tendon's force, shape (n,), where it is measured; ``u_max`` [V] the output's limit and
    ``count_rad`` the encoder's resolution. Raises RecordError for a run that saturates, that the load touches, that
    hardly moves, or that is not a step.
    """

    period_s: float
    u: Signal
    theta: Signal
    u_max: float
    count_rad: float
    tension_N: Signal | None = None

    def __post_init__(self) -> None:
        if self.u.shape != self.theta.shape or self.u.ndim != 1 or self.u.size < 50:
            raise RecordError("length of the run", self.u.size, 50, None, "samples", "give u and theta of one length")
        for name, values in (("u", self.u), ("theta", self.theta)):
            bad = int(np.count_nonzero(~np.isfinite(values)))
            if bad:
                raise RecordError(
                    f"number of samples of {name} that are not finite", bad, None, 0, "1", "repeat the run"
                )
        if float(np.max(np.abs(self.u))) >= self.u_max:
            raise RecordError(
                "voltage", float(np.max(np.abs(self.u))), None, self.u_max, "V", "the output saturates: step lower"
            )
        after = self.u[self.first :]
        if self.voltage == 0.0 or float(np.ptp(after)) > 1e-3 * abs(self.voltage):
            raise RecordError(
                "change of voltage after the step", float(np.ptp(after)), None, 1e-3 * abs(self.voltage), "V", "hold it"
            )
        if self.tension_N is not None and float(np.max(np.abs(self.tension_N))) > MAX_LOAD_N:
            raise RecordError(
                "tendon force", float(np.max(np.abs(self.tension_N))), None, MAX_LOAD_N, "N",
                "the load touches: step towards the slack side or take the tendon off",
            )  # fmt: skip
        counts = float(np.ptp(self.theta)) / self.count_rad
        if counts < MIN_MOTION_COUNTS:
            raise RecordError("motion", counts, MIN_MOTION_COUNTS, None, "counts", "step higher or record for longer")

    @property
    def first(self) -> int:
        """Index of the first sample with voltage."""
        return int(np.argmax(self.u != 0.0))

    @property
    def voltage(self) -> float:
        """Height of the step [V]."""
        return float(self.u[-1])


@dataclass(frozen=True)
class RuleResult:
    """The 63.21 % rule on one run."""

    voltage: float
    K_m: float
    T_m: float


@dataclass(frozen=True)
class MotorIdentification:
    """Both results. ``rule`` has one entry per run, ``rule_mean`` and ``rule_spread`` are (K_m, T_m) over the runs.

    K_m [rad/(V·s)], T_m [s] and u_c [V] come from least squares on position over all runs; ``std_errors`` are theirs.
    ``rms_counts`` is what they leave over of the position, in encoder counts. ``coulomb`` says whether u_c differs
    from zero at the 1 % level; where it does not, it is left out of the fit.
    """

    K_m: float
    T_m: float
    u_c: float
    std_errors: tuple[float, float, float]
    coulomb: bool
    rule: tuple[RuleResult, ...]
    rule_mean: tuple[float, float]
    rule_spread: tuple[float, float]
    rms_counts: float
    verdict: Verdict


def identify_motor(runs: Sequence[VoltageStep]) -> MotorIdentification:
    """Identify the motor from steps of different voltages. Raises RecordError, NotConvergedError."""
    from scipy.stats import norm

    voltages = {abs(run.voltage) for run in runs}
    if len(voltages) < MIN_RUNS:
        raise RecordError(
            "number of different voltages", len(voltages), MIN_RUNS, None, "1",
            "one voltage cannot tell the gain from dry friction: step to several",
        )  # fmt: skip
    rule = tuple(rule_of_63_percent(run) for run in runs)
    gains, lags = np.array([[result.K_m, result.T_m] for result in rule]).T
    start = np.array([np.mean(gains), np.mean(lags), 0.0])
    solution, covariance, rms = _least_squares(runs, start, coulomb=True)
    significant = abs(solution[2]) > norm.ppf(1.0 - LEVEL / 2.0) * np.sqrt(covariance[2, 2])
    if not significant:
        solution, covariance, rms = _least_squares(runs, start, coulomb=False)
    _check_length(runs, float(solution[1]))
    std = np.sqrt(np.diag(covariance))
    counts = rms / runs[0].count_rad
    return MotorIdentification(
        K_m=float(solution[0]),
        T_m=float(solution[1]),
        u_c=float(solution[2]),
        std_errors=(float(std[0]), float(std[1]), float(std[2])),
        coulomb=bool(significant),
        rule=rule,
        rule_mean=(float(np.mean(gains)), float(np.mean(lags))),
        rule_spread=(float(np.std(gains, ddof=1)), float(np.std(lags, ddof=1))),
        rms_counts=float(counts),
        verdict=_verdict(solution, std, bool(significant), float(counts), 100.0 * rms / _motion(runs)),
    )


def rule_of_63_percent(run: VoltageStep) -> RuleResult:
    """Take K_m from the steady speed and T_m where the speed reaches 63.21 % of it, as the paper does."""
    t = np.arange(run.u.size - run.first) * run.period_s
    theta = run.theta[run.first :]
    width = max(1, int(_SMOOTHING_PART * t.size))
    speed = (theta[2 * width :] - theta[: -2 * width]) / (2.0 * width * run.period_s)
    middle = t[width:-width]
    steady = float(
        np.polyfit(t[int((1.0 - _STEADY_PART) * t.size) :], theta[int((1.0 - _STEADY_PART) * t.size) :], 1)[0]
    )
    reached = int(np.argmax(speed / steady >= 1.0 - np.exp(-1.0)))
    return RuleResult(run.voltage, steady / run.voltage, float(middle[reached]))


def _least_squares(runs: Sequence[VoltageStep], start: Signal, *, coulomb: bool) -> tuple[Signal, Signal, float]:
    """Parameters (K_m, T_m, u_c), their covariance, shape (3, 3), and the RMS error [rad]."""
    from scipy.optimize import least_squares

    free = 3 if coulomb else 2

    def residuals(parameters: Signal) -> Signal:
        full = np.concatenate((parameters, start[free:]))
        return np.concatenate([_without_mean(run.theta[run.first :] - _position(run, full)) for run in runs])

    found = least_squares(residuals, start[:free], x_scale=np.maximum(np.abs(start[:free]), 0.1), method="trf")
    if not found.success or found.x[1] <= 0.0:
        raise NotConvergedError(
            "no motor K_m/(s (T_m s + 1)) describes these runs: check that they are steps from rest"
        )
    covariance = np.zeros((3, 3))
    sensitivities = -np.asarray(found.jac, dtype=np.float64)
    covariance[:free, :free] = sandwich(sensitivities, sensitivities, found.fun)
    return np.concatenate((found.x, start[free:])), covariance, float(np.sqrt(np.mean(found.fun**2)))


def turn_from_rest(t: ArrayLike, speed: float, T_m: float) -> Signal:
    """Turn [rad] after times ``t`` [s] of a motor that comes to a steady ``speed`` [rad/s] with ``T_m`` [s] (17)."""
    passed = np.asarray(t, np.float64)
    return np.asarray(speed * (passed + T_m * np.expm1(-passed / T_m)))


def steady_speed(voltage: float, K_m: float, u_c: float) -> float:
    """Speed [rad/s] at a ``voltage`` [V] of which the Coulomb voltage ``u_c`` [V] only overcomes dry friction."""
    return K_m * (voltage - math.copysign(u_c, voltage))


def _position(run: VoltageStep, parameters: Signal) -> Signal:
    K_m, T_m, u_c = parameters
    t = np.arange(run.u.size - run.first) * run.period_s
    return turn_from_rest(t, steady_speed(run.voltage, K_m, u_c), T_m)


def step_beside(run: VoltageStep, K_m: float, T_m: float, u_c: float) -> Beside:
    """Set a motor beside a step that it was not fitted to; where the motor stood before is no part of the model."""
    measured, turn = run.theta[run.first :], _position(run, np.array([K_m, T_m, u_c]))
    return Beside(run.first, measured, turn + np.mean(measured - turn))


def _motion(runs: Sequence[VoltageStep]) -> float:
    """Root mean square of the turn about its mean [rad], over all runs."""
    turned = np.concatenate([_without_mean(run.theta[run.first :]) for run in runs])
    return float(np.sqrt(np.mean(turned**2)))


def _without_mean(error: Signal) -> Signal:
    return np.asarray(error - np.mean(error))


def _check_length(runs: Sequence[VoltageStep], T_m: float) -> None:
    shortest = min((run.u.size - run.first) * run.period_s for run in runs)
    if shortest < _MIN_LENGTH_LAGS * T_m:
        raise RecordError(
            "time recorded after the step",
            shortest,
            _MIN_LENGTH_LAGS * T_m,
            None,
            "s",
            "wait until the speed is steady",
        )


def judge_motor(K_m: float, T_m: float, spread_percent: float, counts: float, misfit_percent: float) -> Grade:
    """Grade a motor: how well K_m and T_m are known [%], and what is left over in encoder counts and of the turn [%].

    A figure that could not be had never counts in favour.
    """
    if not (K_m > 0.0 and T_m > 0.0):
        return Grade.UNUSABLE
    return worst(
        graded(spread_percent, CAUTION_STD_PERCENT, MAX_STD_PERCENT),
        graded(counts, MAX_MISFIT_COUNTS, np.inf),
        graded(misfit_percent, CAUTION_MISFIT_PERCENT, MAX_MOTOR_MISFIT_PERCENT),
    )


def spread_percent(K_m: float, T_m: float, std_K_m: float, std_T_m: float) -> float:
    """How well K_m and T_m are known [%]; NaN where that could not be had."""
    return float(100.0 * np.max([std_K_m / abs(K_m), std_T_m / abs(T_m)]))


def _verdict(solution: Signal, std: Signal, coulomb: bool, counts: float, misfit_percent: float) -> Verdict:
    K_m, T_m, u_c = (float(value) for value in solution)
    spread = spread_percent(K_m, T_m, float(std[0]), float(std[1]))
    known = f"known to ±{spread:.2g} %" if np.isfinite(spread) else "known to no measured error"
    reasons = [
        f"K_m and T_m {known}",
        f"dry friction takes {u_c:.3f} V" if coulomb else "no dry friction found",
        f"position fitted to {counts:.1f} counts, {misfit_percent:.2g} % of the turn",
    ]
    if K_m <= 0.0:
        reasons.insert(0, "the motor turns against its voltage (check the wiring)")
    return Verdict(judge_motor(K_m, T_m, spread, counts, misfit_percent), tuple(reasons))
