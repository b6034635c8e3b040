"""Which column is the time, in which unit, whether it runs forward, and rows that are taken at even instants."""

import re
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from backend.identification.dates import DAY_FIRST, MONTH_FIRST, read_dates
from backend.identification.errors import DataFileError, FileFault, RecordError
from backend.identification.record import Signal
from backend.identification.table import MAX_SAMPLES, Columns

NO_COLUMN = "none"
"""In place of the name of a time column: none of them is the time."""
MAX_BRIDGED = 10.0
"""Longest gap that is bridged, in sample times: across more than that nobody knows what the output did."""

SECONDS = {
    "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millis": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "usec": 1e-6, "micros": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0, "d": 86400.0, "days": 86400.0,
}  # fmt: skip
UNITS = "s, ms, us, ns, min, h, d"
_UNIT = "|".join(sorted((re.escape(unit) for unit in SECONDS), key=len, reverse=True))
_SHORT = "s|sec|seconds?|ms|msec|us|usec|µs|μs|ns|nsec"
_CERTAIN = re.compile(
    rf"^(?:(?:time|times|timestamps?|time_?stamps?|datetime|date_?time|elapsed|elapsed_?time|sim_?time|epoch)"
    rf"(?:[_ .-]*(?P<unit>{_UNIT}))?|(?P<alone>seconds|milliseconds|millis|microseconds|micros|nanoseconds|tout))$",
    re.IGNORECASE,
)
_CERTAIN_T = re.compile(rf"^t(?:[_ .-]+(?P<unit>{_SHORT}))?$")
_DOUBTFUL = re.compile(rf"^t[_ .-]*(?P<unit>{_UNIT})?$|^date$|^x_value$", re.IGNORECASE)
"""Names of a time, of a sample time, a temperature, a torque, a lowest temperature."""
_EPOCHS = {"ms": 1e12, "us": 1e15, "ns": 1e18}
"""About the size of a time since 1970, by its unit; since 2001 it is between once and four times that."""
_LONGEST_PERIOD_S = 0.5
"""Rows further apart are not taken to be in seconds without a word."""
_SAME = 0.1
_COUNTERS = {bits: 2.0**bits for bits in (16, 31, 32)}


@dataclass(frozen=True)
class TimeColumn:
    """The time of each row [s], from the first row on, shape (n,); its unit in the file and what says so."""

    name: str
    seconds: Signal
    unit: str
    unit_from: str


def time_of(
    columns: Columns,
    taken: Collection[str],
    *,
    asked: str | None = None,
    unit: str | None = None,
    period_s: float | None = None,
) -> TimeColumn | None:
    """Return the time column: the one that is ``asked`` for, else the one that is named like one; None without.

    ``taken`` are the columns that serve as signals, ``unit`` that of the time where the file leaves it open. With a
    sample time ``period_s`` [s] a column that may be something else, such as T, is not the time. Raises DataFileError
    where the column, its unit, or its dates cannot be told.
    """
    if unit is not None and unit not in (*SECONDS, DAY_FIRST, MONTH_FIRST):
        raise DataFileError(
            f"--time-unit {unit}: give it in {UNITS}; for dates {DAY_FIRST} or {MONTH_FIRST}",
            FileFault.OPTION,
            option="--time-unit",
        )
    if asked == NO_COLUMN and asked not in columns:
        return None
    name = asked or _named_like_one(columns, taken, period_s)
    if name is None:
        return None
    if name in columns.texts:
        return _dated(name, columns.texts[name], unit)
    return _counted(name, columns, unit, period_s)


def _named_like_one(columns: Columns, taken: Collection[str], period_s: float | None) -> str | None:
    """Return the one column that is named like a time. Raises DataFileError for several and for none for sure."""
    names: list[str] = [name for name in dict.fromkeys((*columns, *columns.texts)) if name not in taken]
    certain = [name for name in names if _is_certain(name, columns.units.get(name, ""))]
    if period_s is not None:  # t [°C] beside a sample time is a temperature
        certain = [name for name in certain if (columns.units.get(name) or "s").lower() in SECONDS]
    if len(certain) > 1:
        raise DataFileError(
            f"each of the columns {', '.join(certain)} may be the time: say which by --time COLUMN",
            FileFault.AMBIGUOUS_TIME,
            column=certain[1],
            option="--time",
        )
    if certain:
        return certain[0]
    unread = [name for name in columns.reasons if name not in columns.texts and _is_certain(name, "")]
    if unread and period_s is None:
        columns.column(unread[0])
    doubtful = [name for name in names if _DOUBTFUL.match(name) and not columns.units.get(name)]
    if doubtful and period_s is None:
        raise DataFileError(
            f"column '{doubtful[0]}' may be the time or something else: --time {doubtful[0]} takes it, else give the"
            " sample time by --period",
            FileFault.AMBIGUOUS_TIME,
            column=doubtful[0],
            option="--time",
        )
    return None


def _is_certain(name: str, unit: str) -> bool:
    if _CERTAIN.match(name) or _CERTAIN_T.match(name):
        return True
    return bool(_DOUBTFUL.match(name)) and unit.lower() in SECONDS


def _dated(name: str, texts: list[str], unit: str | None) -> TimeColumn:
    if unit in SECONDS:
        raise DataFileError(
            f"the time column '{name}' holds '{texts[0]}', so it has no unit: leave --time-unit out",
            FileFault.OPTION,
            column=name,
            option="--time-unit",
        )
    dates = read_dates(name, texts, unit)
    zone = "an offset from UTC" if dates.has_zone else "no zone"
    return TimeColumn(name, dates.seconds, f"dates, {dates.form}, with {zone}", "dates")


def _counted(name: str, columns: Columns, unit: str | None, period_s: float | None) -> TimeColumn:
    values = columns.column(name)
    if unit in (DAY_FIRST, MONTH_FIRST):
        raise DataFileError(
            f"the time column '{name}' holds numbers, not dates: --time-unit takes {UNITS}",
            FileFault.OPTION,
            column=name,
            option="--time-unit",
        )
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise RecordError(
            f"number of rows without a time in '{name}' (first in row {bad[0] + 1})", bad.size, None, 0, "1",
            f"cut the file, or give the sample time by --period with --time {NO_COLUMN}",
        )  # fmt: skip
    whole = columns.whole.get(name)
    since = values - values[:1] if whole is None else (whole - whole[:1]).astype(np.float64)
    unit, unit_from = (unit, "--time-unit") if unit else _unit_of(name, columns, since, period_s)
    return TimeColumn(name, np.asarray(since * SECONDS[unit]), unit, unit_from)


def _unit_of(name: str, columns: Columns, since: Signal, period_s: float | None) -> tuple[str, str]:
    """Return the unit of a time and what says so. Raises DataFileError where nothing does."""
    said = columns.units.get(name) or _unit_in(name)
    if said:
        known = said if said in SECONDS else said.lower()
        if known in SECONDS:
            return known, "heading"
        raise DataFileError(
            f"the time column '{name}' is in '{said}': say which of {UNITS} that is by --time-unit",
            FileFault.TIME_UNIT,
            column=name,
            option="--time-unit",
        )
    values = columns[name]
    step = float(np.median(np.abs(np.diff(since)))) if since.size > 1 else 0.0
    if period_s:
        fitting = [one for one in ("s", "ms", "us", "ns") if abs(step * SECONDS[one] / period_s - 1.0) < _SAME]
        if fitting:
            return fitting[0], "--period"
    size = float(np.min(values)) if values.size else 0.0
    for one, least in _EPOCHS.items():
        if least <= size < 4.1 * least and 0.0 < step * SECONDS[one] <= 1.0:
            return one, "its size, a time since 1970"
    is_whole = bool(np.all(since == np.round(since)))
    is_day = size > 1e4 and 0.0 < step < 1e-4
    if (is_whole or is_day or step > _LONGEST_PERIOD_S) and step > 0.0:
        raise DataFileError(
            f"nothing says in which unit the time column '{name}' is, whose rows are {step:.6g} apart: give it by"
            f" --time-unit, one of {UNITS}"
            + (f"; where it is no time, by --time {NO_COLUMN} beside --period" if period_s else ""),
            FileFault.TIME_UNIT,
            column=name,
            option="--time-unit",
        )
    return "s", "assumed, as neither heading nor option says"


def _unit_in(name: str) -> str:
    for pattern in (_CERTAIN, _CERTAIN_T, _DOUBTFUL):
        match = pattern.match(name)
        if match:
            groups = match.groupdict()
            alone = {"tout": "s"}.get((groups.get("alone") or "").lower(), groups.get("alone"))
            return (groups.get("unit") or alone or "").lower()
    return ""


def require_forward(time: TimeColumn, first_row: int) -> None:
    """Raise RecordError where the time runs back; so many rows of the file, ``first_row``, are before it."""
    steps = np.diff(time.seconds)
    if not steps.size or float(np.min(steps)) >= 0.0:
        return
    if float(np.max(steps)) <= 0.0:
        raise RecordError(
            "largest time step", float(np.max(steps)), 0.0, None, "s", "the rows are in reverse order: turn them round"
        )
    at = int(np.argmax(steps < 0.0))
    row = first_row + at + 1
    raise RecordError(
        f"time step after row {row} (at {time.seconds[at]:.6g} s)", float(steps[at]), 0.0, None, "s",
        f"the time must not run back{_cause(float(steps[at]), SECONDS.get(time.unit, 1.0))}; take the rows before it"
        f" (--skip {first_row} --take {at + 1}) or after it (--skip {row})",
    )  # fmt: skip


def _cause(step_s: float, unit_s: float) -> str:
    """Name what a step back of this size usually is."""
    for bits, size in _COUNTERS.items():
        if abs(-step_s / unit_s / size - 1.0) < 0.05:
            return f", as a counter of {bits} bits does that overflows"
    if abs(step_s + 3600.0) < 60.0:
        return ", as local time does at the end of daylight saving"
    if abs(step_s + 86400.0) < 60.0:
        return ", as a time of day does at midnight"
    return ""


def even(t: Signal, values: Signal, period_s: float, *, held: bool) -> Signal:
    """Values at even instants: the last one before each where the signal is ``held``, else on the line between two.

    Raises RecordError where the time runs back or a gap is too long to be bridged.
    """
    steps = np.diff(t)
    if not float(np.min(steps)) >= 0.0:
        at = int(np.argmin(steps))
        raise RecordError(
            f"time step after sample {at}", float(steps[at]), 0.0, None, "s", "the time must not run back"
        )
    if float(np.max(steps)) > MAX_BRIDGED * period_s:
        at = int(np.argmax(steps))
        raise RecordError(
            f"gap after sample {at}", float(np.max(steps)), None, MAX_BRIDGED * period_s, "s",
            f"too long to be bridged: use the part before it (--range {t[0]:.6g}:{t[at]:.6g}) or after it"
            f" (--range {t[at + 1]:.6g}:)",
        )  # fmt: skip
    count = (t[-1] - t[0]) / period_s
    if count > MAX_SAMPLES:
        raise RecordError(
            "samples at even instants", float(count), None, MAX_SAMPLES, "1", "give a longer sample time or a --range"
        )
    instants = t[0] + period_s * np.arange(int((t[-1] - t[0]) / period_s * (1.0 + 1e-12)) + 1)
    if not held:
        return np.asarray(np.interp(instants, t, values))
    # A stamp a rounding error after its instant still belongs to it.
    before = np.searchsorted(t, instants + 1e-6 * period_s, side="right") - 1
    return np.asarray(values[before])
