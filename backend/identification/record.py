"""The data object that every estimator takes: one input, one output, sampled evenly."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backend.identification.errors import RecordError

Signal = NDArray[np.float64]

MIN_SAMPLES = 200
MAX_SATURATED_PERCENT = 2.0
MAX_PERIOD_ERROR = 1e-3
MAX_STEP, MIN_STEP = 1.5, 0.5
_EVEN = 1e-3
FEW_LEVELS = 20
"""Inputs of so few levels are sequences, which rest at their extremes by design."""


@dataclass(frozen=True)
class Controller:
    """Proportional-integral feedback u = k_p (r - y) + k_i integral of (r - y), whatever else is added to u."""

    k_p: float
    k_i: float


@dataclass(frozen=True)
class Record:
    """One identification record; refused by RecordError where nothing can be learnt from it.

    ``u`` and ``y``, shape (n,), any units: sample k of ``y`` is taken at the instant at which sample k of ``u``
    is applied, and ``u`` is held until sample k + 1 (zero-order hold). ``r`` is a signal from outside the loop, set
    point or excitation, free of the measurement noise; ``controller`` is the feedback law from y to u. Either one
    lets the estimators build instruments that are valid in closed loop. ``t`` [s], where given, is checked against
    ``period_s``. Signals that rest at their own extremes, as limits make them, are refused.
    """

    period_s: float
    u: Signal
    y: Signal
    r: Signal | None = None
    controller: Controller | None = None
    t: Signal | None = None

    def __post_init__(self) -> None:
        for name in ("u", "y", "r", "t"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _signal(name, values))
        _check_period(self.period_s, self.t)
        for name in ("y", "r", "t"):
            values = getattr(self, name)
            if values is not None and values.size != self.u.size:
                raise RecordError(
                    f"length of {name}", values.size, self.u.size, self.u.size, "samples", "give columns of one length"
                )
        _require("length of the record", self.u.size, MIN_SAMPLES, "samples", "record for longer")
        for name in ("u", "y"):
            _check_moves(name, getattr(self, name))
        _check_saturation("u", self.u)
        if np.unique(self.y).size > self.y.size // 4:  # a coarse sensor rests at its extremes without being at a limit
            _check_saturation("y", self.y)

    @property
    def time(self) -> Signal:
        """Time since the first sample [s], shape (n,)."""
        return np.asarray(np.arange(self.u.size) * self.period_s)

    @property
    def duration_s(self) -> float:
        """Length of the record [s]."""
        return self.u.size * self.period_s

    def part(self, start: int, stop: int) -> "Record":
        """Return the samples start..stop-1 as a record of their own."""
        window = slice(start, stop)
        return replace(
            self,
            u=self.u[window],
            y=self.y[window],
            r=None if self.r is None else self.r[window],
            t=None if self.t is None else self.t[window],
        )


def coarse_resolution(values: Signal) -> float | None:
    """Return the step of a signal, shape (n,), of few, evenly spaced values, as a coarse sensor gives; else None."""
    levels = np.unique(values)
    if levels.size > values.size // 4:
        return None
    steps = np.diff(levels)
    step = float(np.min(steps))
    whole = np.abs(steps / step - np.round(steps / step)) < _EVEN
    return step if bool(np.all(whole)) else None


def _signal(name: str, values: ArrayLike) -> Signal:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise RecordError(f"number of dimensions of {name}", array.ndim, 1, 1, "1", "give one column per signal")
    bad = int(array.size - np.count_nonzero(np.isfinite(array)))
    if bad:
        first = int(np.argmin(np.isfinite(array)))
        raise RecordError(
            f"number of samples of {name} that are not finite (first at index {first})",
            bad, None, 0, "1", "cut the record before or after them",
        )  # fmt: skip
    array.setflags(write=False)
    return array


def _require(quantity: str, value: float, minimum: float, unit: str, remedy: str) -> None:
    if not value >= minimum:
        raise RecordError(quantity, value, minimum, None, unit, remedy)


def _check_period(period_s: float, t: Signal | None) -> None:
    if not (np.isfinite(period_s) and 1e-7 <= period_s <= 1e3):
        raise RecordError("sample time", period_s, 1e-7, 1e3, "s", "give the sample time in seconds")
    if t is not None:
        check_time(t, period_s)


def mean_period(t: Signal) -> float:
    """Sample time [s] that a time column, shape (n,), has on the whole. Raises RecordError."""
    if t.size < 2 or not t[-1] > t[0]:
        raise RecordError("length of the time column", float(t[-1] - t[0]) if t.size else 0.0, 0.0, None, "s", "record")
    return float((t[-1] - t[0]) / (t.size - 1))


def check_time(t: Signal, period_s: float) -> None:
    """Raise RecordError where a time column, shape (n,) [s], has holes, runs back or is not of this sample time."""
    if t.size < 2:
        return
    steps = np.diff(t)
    if not float(np.min(steps)) > 0.0:
        at = int(np.argmin(steps))
        raise RecordError(
            f"time step after sample {at}", float(steps[at]), MIN_STEP * period_s, MAX_STEP * period_s, "s",
            "the time column must rise from row to row",
        )  # fmt: skip
    largest = float(np.max(steps))
    typical = float(np.median(steps))
    if largest > MAX_STEP * max(period_s, typical):
        raise RecordError(
            f"gap after sample {int(np.argmax(steps))}", largest, None, MAX_STEP * period_s, "s",
            "samples are missing: use the part before or after the gap (--range), or --resample where it is short",
        )  # fmt: skip
    mean = mean_period(t)
    if abs(mean / period_s - 1.0) > MAX_PERIOD_ERROR:
        raise RecordError(
            "sample time of the time column", mean,
            (1.0 - MAX_PERIOD_ERROR) * period_s, (1.0 + MAX_PERIOD_ERROR) * period_s, "s",
            "give the sample time the record was taken with, or --resample",
        )  # fmt: skip


def _check_moves(name: str, values: Signal) -> None:
    spread = float(np.ptp(values))
    if spread <= 1e-12 * max(1.0, float(np.max(np.abs(values)))):
        raise RecordError(
            f"peak-to-peak of {name}", spread, 1e-12, None, f"(unit of {name})",
            "a constant signal identifies nothing: excite the input and record again",
        )  # fmt: skip


def _check_saturation(name: str, values: Signal) -> None:
    """Refuse a signal of many levels that spends far more time at its extreme ones than at the others."""
    levels, counts = np.unique(values, return_counts=True)
    if levels.size <= FEW_LEVELS:
        return
    at_limits = int(max(counts[0], counts[-1]))
    usual = float(np.mean(counts[1:-1]))
    share = 100.0 * at_limits / values.size
    if at_limits > 10.0 * usual and share > MAX_SATURATED_PERCENT:
        raise RecordError(
            f"time that {name} spends at its limit", share, None, MAX_SATURATED_PERCENT, "%",
            "the signal is saturated: excite with a smaller amplitude",
        )  # fmt: skip
