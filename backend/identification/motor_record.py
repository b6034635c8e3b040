"""Motor from any record of voltage and angle (equation 17): K_m / (s (T_m s + 1)) with dry friction.

The record may hold steps, sequences or anything else that moves the motor; the angle's zero is free. The model is the
one of :mod:`backend.identification.friction`, integrated once.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from backend.identification.errors import NotConvergedError, RecordError
from backend.identification.friction import differences, moving
from backend.identification.motor import LEVEL, judge_motor, spread_percent
from backend.identification.record import Record, Signal, coarse_resolution
from backend.identification.residuals import whiteness
from backend.identification.result import Grade, Verdict, worst
from backend.identification.uncertainty import sandwich
from backend.identification.validation import MIN_COUNTS

_LAGS = 10
_FRICTIONS = (0.0, 0.1, 0.3, 0.6)
_MAX_STEPS = 60
_TRAINING_PART = 2.0 / 3.0


@dataclass(frozen=True)
class MotorRecord:
    """K_m [rad/(V·s)], T_m [s] and u_c [V] with standard errors; u_c is 0 where it does not differ from zero at 1 %.

    ``fit_percent`` is the simulated fit on the last third of the record by a model of the first two, NaN where there is
    none; ``rms`` [unit of y] what the model leaves over.
    """

    K_m: float
    T_m: float
    u_c: float
    std_errors: tuple[float, float, float]
    fit_percent: float
    rms: float
    verdict: Verdict


def identify_motor_record(record: Record, y_resolution: float | None = None) -> MotorRecord:
    """Identify the motor from voltage u and angle y. Raises RecordError, NotConvergedError."""
    resolution = y_resolution or coarse_resolution(record.y)
    counts = float(np.ptp(record.y)) / resolution if resolution else None
    if counts is not None and counts < MIN_COUNTS:
        raise RecordError("motion", counts, MIN_COUNTS, None, "counts", "step higher or record for longer")
    solution, covariance, left = _fitted(record, friction=True)
    if not solution[2] > norm.ppf(1.0 - LEVEL / 2.0) * np.sqrt(covariance[2, 2]):
        solution, covariance, left = _fitted(record, friction=False)
    K_m, T_m, u_c = (float(value) for value in solution[:3])
    std = [float(value) for value in np.sqrt(np.diag(covariance))]
    rms = float(np.sqrt(np.mean(left**2)))
    fit = _held_out(record, friction=u_c > 0.0)
    spread = spread_percent(K_m, T_m, std[0], std[1])
    # What is below a count is the sensor's; more that is not white is the motor's.
    told = whiteness(left, record.period_s).passed or (resolution is not None and rms < resolution)
    grade = worst(
        judge_motor(K_m, T_m, spread, rms / resolution if resolution else 0.0, 100.0 - fit),
        Grade.USABLE if told else Grade.CAUTION,
    )
    reasons = [
        f"K_m and T_m known to ±{spread:.2g} %" if np.isfinite(spread) else "errors of K_m and T_m not measured",
        f"dry friction takes {u_c:.3g} V" if u_c > 0.0 else "no dry friction found",
        f"fit of {fit:.1f} % on unseen data" if np.isfinite(fit) else "fit on unseen data not measured",
    ]
    if not told:
        reasons.append("the residuals are not white: the motor does something that this model leaves out")
    return MotorRecord(K_m, T_m, u_c, (std[0], std[1], std[2]), fit, rms, Verdict(grade, tuple(reasons)))


def _model(record: Record, z: Signal) -> Signal:
    """Turn by K, ln T, first speed and u_c, shape (n,)."""
    return np.asarray(moving(record.u, record.period_s, z[0], float(np.exp(z[1])), z[3], 0.0, z[2])[1])


def _fitted(record: Record, *, friction: bool) -> tuple[Signal, Signal, Signal]:
    """K, T, u_c, first speed, shape (4,); covariance of the first three; what is left over, shape (n,)."""
    free = 4 if friction else 3
    fixed = np.zeros(4 - free)

    def residuals(z: Signal) -> Signal:
        error = record.y - _model(record, np.concatenate((z, fixed)))
        return np.asarray(error - np.mean(error))

    start = _start(record, friction=friction)[:free]
    scale = np.maximum(np.abs(start), 0.1 * np.max(np.abs(start)))
    found = least_squares(residuals, start, jac=differences(residuals), x_scale=scale, max_nfev=_MAX_STEPS)
    sensitivities = -np.asarray(found.jac, dtype=np.float64)
    moves = np.linalg.norm(sensitivities, axis=0) > 0.0
    if not (np.all(np.isfinite(found.x)) and moves[0] and moves[1]):
        raise NotConvergedError("no motor K_m/(s (T_m s + 1)) describes this record: is it voltage and angle?")
    T = float(np.exp(found.x[1]))
    covariance = np.zeros((4, 4))
    covariance[np.ix_(*2 * [np.flatnonzero(moves)])] = sandwich(
        sensitivities[:, moves], sensitivities[:, moves], found.fun
    )
    unit = np.array([1.0, T, 1.0])
    order = [0, 1, 3]
    solution = np.array([found.x[0], T, found.x[3] if friction else 0.0, found.x[2]])
    return solution, covariance[np.ix_(order, order)] * np.outer(unit, unit), np.asarray(found.fun)


def _start(record: Record, *, friction: bool) -> Signal:
    size = float(np.sqrt(np.mean(record.u**2)))
    best, lowest = np.zeros(4), np.inf
    y = record.y - np.mean(record.y)
    for T in np.geomspace(3.0 * record.period_s, record.duration_s / 5.0, _LAGS):
        for share in _FRICTIONS if friction else (0.0,):
            turn = _model(record, np.array([1.0, np.log(T), 0.0, share * size]))
            turn = turn - np.mean(turn)
            K = float(turn @ y) / max(float(turn @ turn), np.finfo(float).tiny)
            error = float(np.linalg.norm(y - K * turn))
            if error < lowest:
                best, lowest = np.array([K, np.log(T), 0.0, share * size]), error
    return best


def _held_out(record: Record, *, friction: bool) -> float:
    """Fit on the last third; the speed at which it begins is that of the model over the whole record."""
    split = int(_TRAINING_PART * record.u.size)
    try:
        trained = _fitted(record.part(0, split), friction=friction)[0]
    except (RecordError, NotConvergedError, np.linalg.LinAlgError):
        return float("nan")
    z = np.array([trained[0], np.log(trained[1]), trained[3], trained[2]])
    y = record.y[split:] - np.mean(record.y[split:])
    turn = _model(record, z)[split:]
    spread = float(np.linalg.norm(y))
    return 100.0 * (1.0 - float(np.linalg.norm(y - turn + np.mean(turn))) / spread) if spread > 0.0 else float("nan")
