"""Records of one input and one output at even times, and their errors."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backend.identification import messages
from plant import ErrorCode, SinewError

# Errors --------------------------------------------------------------------------------------------
# Errors of an identification. Each message names the problem and the remedy.


class IdentificationError(SinewError, ValueError):
    """Base class of errors of the estimators."""

    category = ErrorCode.BAD_VALUE


class RecordError(IdentificationError):
    """An unsuitable record; the message has quantity, value, bound, unit and remedy."""


class FileFault(StrEnum):
    """Error of a file with samples, for programs and tests."""

    UNREADABLE = "unreadable"
    FORMAT = "format"
    ENCODING = "encoding"
    TOO_LONG = "too_long"
    NO_HEADING = "no_heading"
    AMBIGUOUS_HEADING = "ambiguous_heading"
    ROW_WIDTH = "row_width"
    NOT_A_NUMBER = "not_a_number"
    AMBIGUOUS_DECIMALS = "ambiguous_decimals"
    MIXED_DECIMALS = "mixed_decimals"
    NO_COLUMN = "no_column"
    AMBIGUOUS_COLUMN = "ambiguous_column"
    OBJECTS = "objects"
    NO_TIME = "no_time"
    AMBIGUOUS_TIME = "ambiguous_time"
    TIME_UNIT = "time_unit"
    DATES = "dates"
    ROWS = "rows"
    OPTION = "option"


class DataFileError(IdentificationError):
    """A file that cannot be read as columns of numbers: the fault and its place.

    ``option`` is the option of the command line that resolves it, None if only another file does.
    """

    def __init__(
        self,
        message: str,
        fault: FileFault,
        *,
        column: str | None = None,
        line: int | None = None,
        option: str | None = None,
    ) -> None:
        super().__init__(message)
        self.fault = fault
        self.column = column
        self.line = line
        self.option = option

    @property
    def fields(self) -> dict[str, Any]:
        """Code and place of the fault: the field of the form that resolves it, the line."""
        field = {"--header": "header", "--decimal": "decimal"}.get(self.option or "", "table")
        return {"code": self.fault, "quantity": field, "path": [field], "line": self.line}


class StructureError(IdentificationError):
    """An unknown structure; the message lists the known ones."""


class NoStartError(IdentificationError):
    """No starting value gives a stable model."""


class NotConvergedError(IdentificationError):
    """The iteration found no minimum; the record does not determine this structure."""


class NotContinuousError(IdentificationError):
    """A sampled model without a continuous-time equivalent of the same order."""


class UnstableModelError(IdentificationError):
    """Parameters of a system that is unstable or has poles outside the sampled band."""


# Record --------------------------------------------------------------------------------------------
# The input of every estimator: one input and one output signal at even times.


Signal = NDArray[np.float64]

MIN_SAMPLES = 200
MIN_PERIOD_S, MAX_PERIOD_S = 1e-7, 1e3
MAX_SATURATED_PERCENT = 2.0
MOVES = 0.1
"""Fraction of its peak-to-peak by which an input must change to count as moving."""
MAX_PERIOD_ERROR = 1e-3
MAX_STEP, MIN_STEP = 1.5, 0.5
_EVEN = 1e-3
_USUAL_DWELLS = 10.0
_ABRUPT = 0.05
_WRAPPED_JUMP = 0.8
_TRAVEL_STEPS = 5.0
_FINEST = 1e-7


@dataclass(frozen=True)
class Controller:
    """Proportional-integral feedback u = k_p (r - y) + k_i integral of (r - y).

    Other signals may be added to u.
    """

    k_p: float
    k_i: float


@dataclass(frozen=True)
class Record:
    """One identification record; RecordError if it is unsuitable.

    ``u`` and ``y``, shape (n,), any units: sample k of ``y`` is taken at the time at which sample k of ``u`` is
    applied, and ``u`` is held until sample k + 1 (zero-order hold). ``r`` is an external signal of the loop, setpoint
    or excitation, free of measurement noise; ``controller`` is the feedback law from y to u. With either one the
    estimators build instruments that are valid in closed loop. ``t`` [s], if given, is compared with ``period_s``. An
    output that repeatedly stops abruptly at its extreme value while the input moves is rejected as saturated. An input
    at its limit is not: the model is valid for the input as applied.
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
                object.__setattr__(self, name, read_signal(name, values))
        check_period(self.period_s)
        if self.t is not None:
            check_time(self.t, self.period_s)
        for name in ("y", "r", "t"):
            values = getattr(self, name)
            if values is not None and values.size != self.u.size:
                raise RecordError(
                    messages.columns_of_unequal_length(name=name, length=values.size, expected=self.u.size)
                )
        if self.u.size < MIN_SAMPLES:
            raise RecordError(messages.record_too_short(length=self.u.size, minimum=MIN_SAMPLES))
        for name in ("u", "y"):
            check_moves(name, getattr(self, name))
        _check_saturation(self.u, self.y)

    @property
    def time(self) -> Signal:
        """Time since the first sample [s], shape (n,)."""
        return np.asarray(np.arange(self.u.size) * self.period_s)

    @property
    def duration_s(self) -> float:
        """Duration of the record [s]."""
        return self.u.size * self.period_s

    def part(self, start: int, stop: int) -> "Record":
        """Return the samples start..stop-1 as a separate record."""
        window = slice(start, stop)
        return replace(
            self,
            u=self.u[window],
            y=self.y[window],
            r=None if self.r is None else self.r[window],
            t=None if self.t is None else self.t[window],
        )


def coarse_resolution(values: Signal) -> float | None:
    """Return the step of a signal with few, evenly spaced values, else None.

    ``values`` has shape (n,); a coarse sensor gives such a signal.
    """
    return None if np.unique(values).size > values.size // 4 else quantum(values)


def quantum(values: Signal) -> float | None:
    """Return the step of a signal whose values are all whole steps apart, else None.

    ``values`` has shape (n,). A step below 1e-7 of the signal is the rounding of numbers, not of a sensor.
    """
    levels = np.unique(values)
    steps = np.diff(levels)
    if not steps.size or float(np.min(steps)) < _FINEST * float(np.max(np.abs(levels))):
        return None
    step = float(np.min(steps))
    near = steps < 10.0 * step
    step = float(np.sum(steps[near]) / np.sum(np.round(steps[near] / step)))
    whole = np.abs(steps / step - np.round(steps / step)) < _EVEN
    return step if bool(np.all(whole)) else None


@dataclass(frozen=True)
class RestAtLimit:
    """Rest of an output at one of its extreme values, ``limit`` [% of the record].

    ``moving_percent`` is the part of it during which the input moves. ``abrupt``: the output reaches the limit at full
    speed at least twice, and does not settle there.
    """

    limit: float
    share_percent: float
    moving_percent: float
    abrupt: bool


def rest_at_limit(u: Signal, y: Signal) -> RestAtLimit | None:
    """Return the longer rest of y at an extreme value that indicates a limit, or None.

    ``u`` and ``y`` have shape (n,). The indication is that the output comes to rest there abruptly, or rests while u
    moves, for longer than at ten of its other values and than 2 % of the record.
    """
    levels, counts = np.unique(y, return_counts=True)
    if levels.size < 3:
        return None
    bound = max(_USUAL_DWELLS * float(np.median(counts[1:-1])), 0.01 * MAX_SATURATED_PERCENT * y.size)
    least_move, speed = MOVES * float(np.ptp(u)), float(np.max(np.abs(np.diff(y))))
    found = None
    for limit, count in ((float(levels[0]), counts[0]), (float(levels[-1]), counts[-1])):
        if count <= bound:
            continue
        edges = np.flatnonzero(np.diff(np.concatenate(([False], y == limit, [False])).astype(np.int8)))
        resting, moving, abrupt = 0, 0, 0
        for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            moved = np.abs(u[start:end] - u[max(start - 1, 0)]) > least_move
            if start == 0:
                continue  # everything rests at first, and during a dead time
            resting += end - start
            moving += end - start - int(np.argmax(moved)) - 1 if np.any(moved) else 0
            before = y[max(start - 3, 0)]
            passed = abs(int(np.searchsorted(levels, before)) - int(np.searchsorted(levels, limit)))
            abrupt += passed >= 3 and abs(limit - before) > 3.0 * _ABRUPT * speed
        is_at_limit = moving > bound or (resting > bound and abrupt >= 2)
        if is_at_limit and (found is None or resting > 0.01 * found.share_percent * y.size):
            found = RestAtLimit(limit, 100.0 * resting / y.size, 100.0 * moving / y.size, abrupt >= 2)
    return found


def has_one_step(u: Signal) -> bool:
    """Return whether an input (n,) has one value, then another, and no more."""
    high = u > 0.5 * (float(np.min(u)) + float(np.max(u)))
    if np.count_nonzero(np.diff(high)) != 1:
        return False
    most = 0.02 * float(np.ptp(u))
    return float(np.ptp(u[high])) <= most and float(np.ptp(u[~high])) <= most


def time_at_limit_percent(u: Signal) -> float:
    """Return the time that an input spends at its extreme values [%].

    The result is 0 for an input with few values.
    """
    levels, counts = np.unique(u, return_counts=True)
    if levels.size < 3:
        return 0.0
    usual = float(np.median(counts[1:-1]))
    at_limit = sum(int(count) for count in (counts[0], counts[-1]) if count > _USUAL_DWELLS * usual)
    return 100.0 * at_limit / u.size


def find_wrap(values: Signal, least: int = 2) -> tuple[int, float] | None:
    """Return the sample before the first wrap of an angle and its size, or None.

    ``values`` has shape (n,). An angle that wraps jumps from one end of its range to the other, always by about the
    same, and moves slowly otherwise. ``least`` is the required number of such jumps: a single one may be a gap in the
    record.
    """
    span, steps = float(np.ptp(values)), np.diff(values)
    jumps = np.abs(steps) > _WRAPPED_JUMP * span
    rest = float(np.max(np.abs(steps[~jumps]), initial=0.0))
    if np.count_nonzero(jumps) < least or rest > 0.25 * span:
        return None
    turn = float(np.max(np.abs(steps)))
    for whole in (2.0 * np.pi, 360.0, 1.0):
        if abs(whole - turn) <= 2.0 * rest + 0.01 * whole:
            turn = whole
    # Apart from the jumps, the angle continues at its speed, and travels: a sequence of two values does not.
    unwrapped = np.cumsum(steps - np.where(jumps, np.sign(steps) * turn, 0.0))
    on = steps[jumps] - np.sign(steps[jumps]) * turn
    travels = rest > 0.0 and float(np.ptp(unwrapped)) > _TRAVEL_STEPS * rest
    return (int(np.argmax(jumps)), turn) if travels and float(np.max(np.abs(on))) <= 2.0 * rest + 0.05 * span else None


def read_signal(name: str, values: ArrayLike) -> Signal:
    """Return the samples of a signal as a read-only array (n,). Raises RecordError."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise RecordError(messages.signal_is_not_one_column(name=name, dimensions=array.ndim))
    bad = int(array.size - np.count_nonzero(np.isfinite(array)))
    if bad:
        first = int(np.argmin(np.isfinite(array)))
        raise RecordError(messages.samples_not_finite(name=name, count=bad, first=first))
    array.setflags(write=False)
    return array


def check_period(period_s: float) -> None:
    """Raise RecordError for an invalid sample time [s]."""
    if not (np.isfinite(period_s) and MIN_PERIOD_S <= period_s <= MAX_PERIOD_S):
        raise RecordError(
            messages.sample_time_out_of_bounds(period_s=period_s, minimum_s=MIN_PERIOD_S, maximum_s=MAX_PERIOD_S)
        )


def mean_period(t: Signal) -> float:
    """Return the mean sample time [s] of a time column (n,). Raises RecordError."""
    if t.size < 2 or not t[-1] > t[0]:
        duration_s = float(t[-1] - t[0]) if t.size > 1 else 0.0
        raise RecordError(messages.time_does_not_increase(duration_s=duration_s, minimum_s=MIN_PERIOD_S))
    return float((t[-1] - t[0]) / (t.size - 1))


def check_time(t: Signal, period_s: float) -> None:
    """Raise RecordError for an unsuitable time column (n,) [s].

    The time must not decrease or have gaps, and its sample time must be ``period_s``.
    """
    if t.size < 2:
        return
    steps = np.diff(t)
    if not float(np.min(steps)) > 0.0:
        at = int(np.argmin(steps))
        raise RecordError(
            messages.time_step_not_positive(
                sample=at, step_s=float(steps[at]), minimum_s=MIN_STEP * period_s, maximum_s=MAX_STEP * period_s
            )
        )
    largest = float(np.max(steps))
    typical = float(np.median(steps))
    maximum_s = MAX_STEP * max(period_s, typical)
    if largest > maximum_s:
        at = int(np.argmax(steps))
        raise RecordError(
            messages.samples_missing(
                sample=at,
                gap_s=largest,
                maximum_s=maximum_s,
                start_s=float(t[0]),
                before_s=float(t[at]),
                after_s=float(t[at + 1]),
            )
        )
    mean = mean_period(t)
    if abs(mean / period_s - 1.0) > MAX_PERIOD_ERROR:
        raise RecordError(
            messages.sample_time_differs(
                sample_time_s=mean,
                minimum_s=(1.0 - MAX_PERIOD_ERROR) * period_s,
                maximum_s=(1.0 + MAX_PERIOD_ERROR) * period_s,
            )
        )


def check_moves(name: str, values: Signal) -> None:
    """Raise RecordError for a constant signal (n,)."""
    spread = float(np.ptp(values))
    if spread <= 1e-12 * max(1.0, float(np.max(np.abs(values)))):
        raise RecordError(messages.signal_is_constant(name=name, peak_to_peak=spread, minimum=1e-12))


def _check_saturation(u: Signal, y: Signal) -> None:
    """Raise RecordError for an output that stops at its limit while the input moves."""
    rest = rest_at_limit(u, y)
    # At zero, Coulomb friction stops a motor abruptly, too.
    moves = rest is not None and rest.moving_percent > MAX_SATURATED_PERCENT
    if rest is not None and moves and rest.abrupt and rest.limit != 0.0:
        raise RecordError(
            messages.output_is_saturated(
                limit=rest.limit, moving_percent=rest.moving_percent, maximum_percent=MAX_SATURATED_PERCENT
            )
        )
