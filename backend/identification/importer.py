"""Import of records from tables, MATLAB and Parquet files: columns, time, units."""

import math
import re
import struct
import warnings
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from backend.identification import messages
from backend.identification.records import (
    Controller,
    DataFileError,
    FileFault,
    Record,
    RecordError,
    Signal,
    check_period,
    mean_period,
)
from backend.identification.tables import DAY_FIRST, LARGEST_EXACT, MAX_SAMPLES, MONTH_FIRST, Columns, read_dates
from plant import Message

if TYPE_CHECKING:
    import pyarrow


# Timebase ------------------------------------------------------------------------------------------
# The time column, its unit and order, and resampling of rows at even times.


NO_COLUMN = "none"
"""Name in place of a time column: the file has none."""
MAX_BRIDGED = 10.0
"""Longest gap that is interpolated, in sample times: beyond it the output is unknown."""

SECONDS = {
    "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millis": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "usec": 1e-6, "micros": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "minutes": 60.0, "h": 3600.0, "hours": 3600.0, "d": 86400.0, "days": 86400.0,
}  # fmt: skip
UNITS = "s, ms, us, ns, min, h, d"
_TIME_UNIT = "|".join(sorted((re.escape(unit) for unit in SECONDS), key=len, reverse=True))
_SHORT = "s|sec|seconds?|ms|msec|us|usec|µs|μs|ns|nsec"
_CERTAIN = re.compile(
    rf"^(?:(?:time|times|timestamps?|time_?stamps?|datetime|date_?time|elapsed|elapsed_?time|sim_?time|epoch)"
    rf"(?:[_ .-]*(?P<unit>{_TIME_UNIT}))?|(?P<alone>seconds|milliseconds|millis|microseconds|micros"
    r"|nanoseconds|tout))$",
    re.IGNORECASE,
)
_CERTAIN_T = re.compile(rf"^t(?:[_ .-]+(?P<unit>{_SHORT}))?$")
_DOUBTFUL = re.compile(rf"^t[_ .-]*(?P<unit>{_TIME_UNIT})?$|^date$|^x_value$", re.IGNORECASE)
"""Ambiguous names: time, but also sample time (Ts), temperature or torque (T), or lowest temperature (Tmin)."""
_EPOCHS = {"ms": 1e12, "us": 1e15, "ns": 1e18}
"""Magnitude of a time since 1970 by its unit; since 2001 it is between one and four times that."""
_LONGEST_PERIOD_S = 0.5
"""Largest row distance that is assumed to be in seconds."""
_SAME = 0.1
_COUNTERS = {bits: 2.0**bits for bits in (16, 31, 32)}


@dataclass(frozen=True)
class TimeColumn:
    """Time of each row [s] from the first row on, shape (n,).

    ``unit`` is its unit in the file, ``unit_from`` the source of this unit.
    """

    name: str
    seconds: Signal
    unit: str
    unit_from: str


def find_time_column(
    columns: Columns,
    taken: Collection[str],
    *,
    asked: str | None = None,
    unit: str | None = None,
    period_s: float | None = None,
) -> TimeColumn | None:
    """Return the time column: the ``asked`` one, else the one named like a time.

    ``taken`` are the columns that serve as signals, ``unit`` is that of the time if the file does not name it. With a
    sample time ``period_s`` [s] an ambiguous column, such as T, is not the time. None without a time column. Raises
    DataFileError if the column, its unit, or its dates are ambiguous.
    """
    if unit is not None and unit not in (*SECONDS, DAY_FIRST, MONTH_FIRST):
        raise DataFileError(messages.unknown_time_unit(unit=unit, known=UNITS), FileFault.OPTION, option="--time-unit")
    if asked == NO_COLUMN and asked not in columns:
        return None
    name = asked or _named_like_one(columns, taken, period_s)
    if name is None:
        return None
    if name in columns.texts:
        return _read_dates(name, columns.texts[name], unit)
    return _read_sample_numbers(name, columns, unit, period_s)


def _named_like_one(columns: Columns, taken: Collection[str], period_s: float | None) -> str | None:
    """Return the only column named like a time.

    Raises DataFileError for several candidates and for a doubtful one.
    """
    names: list[str] = [name for name in dict.fromkeys((*columns, *columns.texts)) if name not in taken]
    certain = [name for name in names if _is_certain(name, columns.units.get(name, ""))]
    if period_s is not None:  # with a given sample time, t [°C] is a temperature
        certain = [name for name in certain if (columns.units.get(name) or "s").lower() in SECONDS]
    if len(certain) > 1:
        raise DataFileError(
            messages.several_time_columns(names=certain),
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
            messages.doubtful_time_column(name=doubtful[0]),
            FileFault.AMBIGUOUS_TIME,
            column=doubtful[0],
            option="--time",
        )
    return None


def _is_certain(name: str, unit: str) -> bool:
    if _CERTAIN.match(name) or _CERTAIN_T.match(name):
        return True
    return bool(_DOUBTFUL.match(name)) and unit.lower() in SECONDS


def _read_dates(name: str, texts: list[str], unit: str | None) -> TimeColumn:
    if unit in SECONDS:
        raise DataFileError(
            messages.time_unit_of_dates(name=name, cell=texts[0]),
            FileFault.OPTION,
            column=name,
            option="--time-unit",
        )
    dates = read_dates(name, texts, unit)
    return TimeColumn(name, dates.seconds, messages.dates_of_form(form=dates.form, has_zone=dates.has_zone), "dates")


def _read_sample_numbers(name: str, columns: Columns, unit: str | None, period_s: float | None) -> TimeColumn:
    values = columns.column(name)
    if unit in (DAY_FIRST, MONTH_FIRST):
        raise DataFileError(
            messages.date_order_of_numbers(name=name, known=UNITS),
            FileFault.OPTION,
            column=name,
            option="--time-unit",
        )
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise RecordError(messages.rows_without_time(name=name, count=bad.size, first_row=int(bad[0]) + 1))
    whole = columns.whole.get(name)
    since = values - values[:1] if whole is None else (whole - whole[:1]).astype(np.float64)
    unit, unit_from = (unit, "--time-unit") if unit else _find_time_unit(name, columns, since, period_s)
    return TimeColumn(name, np.asarray(since * SECONDS[unit]), unit, unit_from)


def _find_time_unit(name: str, columns: Columns, since: Signal, period_s: float | None) -> tuple[str, str]:
    """Return the unit of a time and its source. Raises DataFileError if unknown."""
    unit_text = columns.units.get(name) or _unit_in(name)
    if unit_text:
        known = unit_text if unit_text in SECONDS else unit_text.lower()
        if known in SECONDS:
            return known, "heading"
        raise DataFileError(
            messages.unknown_unit_of_time_column(name=name, unit=unit_text, known=UNITS),
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
            return one, messages.time_unit_from_magnitude()
    is_whole = bool(np.all(since == np.round(since)))
    is_day = size > 1e4 and 0.0 < step < 1e-4
    if (is_whole or is_day or step > _LONGEST_PERIOD_S) and step > 0.0:
        raise DataFileError(
            messages.no_unit_of_time_column(name=name, step=step, known=UNITS, period_s=period_s),
            FileFault.TIME_UNIT,
            column=name,
            option="--time-unit",
        )
    return "s", messages.time_unit_assumed()


def _unit_in(name: str) -> str:
    for pattern in (_CERTAIN, _CERTAIN_T, _DOUBTFUL):
        match = pattern.match(name)
        if match:
            groups = match.groupdict()
            alone = {"tout": "s"}.get((groups.get("alone") or "").lower(), groups.get("alone"))
            return (groups.get("unit") or alone or "").lower()
    return ""


def require_forward(time: TimeColumn, first_row: int) -> None:
    """Raise RecordError if the time decreases.

    ``first_row`` rows of the file precede these.
    """
    steps = np.diff(time.seconds)
    if not steps.size or float(np.min(steps)) >= 0.0:
        return
    if float(np.max(steps)) <= 0.0:
        raise RecordError(messages.rows_in_reverse_order(largest_step_s=float(np.max(steps))))
    at = int(np.argmax(steps < 0.0))
    raise RecordError(
        messages.time_decreases_after_row(
            row=first_row + at + 1,
            time_s=float(time.seconds[at]),
            step_s=float(steps[at]),
            cause=_cause(float(steps[at]), SECONDS.get(time.unit, 1.0)),
            skipped=first_row,
            rows=at + 1,
        )
    )


def _cause(step_s: float, unit_s: float) -> str:
    """Return the usual cause of a backward step of this size."""
    for bits, size in _COUNTERS.items():
        if abs(-step_s / unit_s / size - 1.0) < 0.05:
            return messages.counter_overflows(bits=bits)
    if abs(step_s + 3600.0) < 60.0:
        return messages.daylight_saving_ends()
    if abs(step_s + 86400.0) < 60.0:
        return messages.day_begins()
    return ""


def even(t: Signal, values: Signal, period_s: float, *, held: bool) -> Signal:
    """Return values at even times: held, or linearly interpolated.

    ``held``: the last value before each time. Raises RecordError if the time decreases or a gap is too long.
    """
    steps = np.diff(t)
    if not float(np.min(steps)) >= 0.0:
        at = int(np.argmin(steps))
        raise RecordError(messages.time_decreases(sample=at, step_s=float(steps[at])))
    if float(np.max(steps)) > MAX_BRIDGED * period_s:
        at = int(np.argmax(steps))
        raise RecordError(
            messages.gap_too_long(
                sample=at,
                gap_s=float(np.max(steps)),
                maximum_s=MAX_BRIDGED * period_s,
                start_s=float(t[0]),
                before_s=float(t[at]),
                after_s=float(t[at + 1]),
            )
        )
    count = (t[-1] - t[0]) / period_s
    if count > MAX_SAMPLES:
        raise RecordError(messages.too_many_resampled(count=float(count), maximum=MAX_SAMPLES))
    instants = t[0] + period_s * np.arange(int((t[-1] - t[0]) / period_s * (1.0 + 1e-12)) + 1)
    if not held:
        return np.asarray(np.interp(instants, t, values))
    # A time stamp late by a rounding error still counts.
    before = np.searchsorted(t, instants + 1e-6 * period_s, side="right") - 1
    return np.asarray(values[before])


# Import data ---------------------------------------------------------------------------------------
# Samples from external files (table, .mat or Parquet), checked, as a record, with a summary of the import.


_LARGEST_WHOLE = 2.0**63
_CONTROL = re.compile("[\0-\x08\x0e-\x1f\x7f]")
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}


def decode_text(content: bytes, name: str) -> str:
    """Return the text of a file in UTF-8, or UTF-16 with a byte order mark.

    Raises DataFileError.
    """
    encoding = next((encoding for mark, encoding in _MARKS.items() if content.startswith(mark)), "utf-8")
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        raise DataFileError(messages.not_utf_8(file=name), FileFault.ENCODING) from None
    found = _CONTROL.search(text)
    if found is not None:
        line = text.count("\n", 0, found.start()) + 1
        raise DataFileError(
            messages.control_character(file=name, line=line, character=found[0]), FileFault.ENCODING, line=line
        )
    return text


def read_parquet(stream: BinaryIO) -> Columns:
    """Return the columns of numbers and Booleans of a Parquet file.

    Raises DataFileError.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.ParquetFile(stream).read()  # unlike read_table it accepts duplicate column names
    except (pyarrow.ArrowException, OSError, ValueError):
        raise DataFileError(messages.not_parquet(), FileFault.UNREADABLE) from None
    if table.num_rows > MAX_SAMPLES:
        raise DataFileError(messages.too_many_rows(rows=table.num_rows, maximum=MAX_SAMPLES), FileFault.TOO_LONG)
    columns = Columns()
    columns.layout |= {"format": messages.parquet_file(), "rows": table.num_rows}
    for index, (written, values) in enumerate(zip(table.column_names, table.columns, strict=True)):
        name = written if written.isprintable() else ascii(written)[1:-1]
        if name in columns or name in columns.reasons:
            columns.texts.pop(name, None)
            columns.leave_out(name, messages.two_columns_of_parquet(name=name), FileFault.AMBIGUOUS_COLUMN)
        else:
            try:
                _take(columns, name, values)
            except pyarrow.ArrowException:
                columns.leave_out(name, messages.unreadable_values(name=name, kind=str(values.type)))
            unit = (table.schema.field(index).metadata or {}).get(b"unit", b"").decode(errors="replace")
            columns.units.setdefault(name, unit)
    return columns


def _take(columns: Columns, name: str, values: "pyarrow.ChunkedArray") -> None:
    import pyarrow

    kind = values.type
    if pyarrow.types.is_dictionary(kind):
        values, kind = values.cast(kind.value_type), kind.value_type
    if pyarrow.types.is_boolean(kind):
        values, kind = values.cast(pyarrow.uint8()), pyarrow.uint8()
    if pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind) or pyarrow.types.is_decimal(kind):
        columns[name] = np.asarray(values.cast(pyarrow.float64(), safe=False).to_numpy(), dtype=np.float64)
        is_whole = pyarrow.types.is_integer(kind) and not values.null_count
        if is_whole and LARGEST_EXACT < float(np.max(np.abs(columns[name]), initial=0.0)) < _LARGEST_WHOLE:
            columns.whole[name] = values.to_numpy().astype(np.int64)
    elif pyarrow.types.is_timestamp(kind):
        columns.texts[name] = [
            "" if value is None else str(value) for value in values.cast(pyarrow.timestamp("ns")).to_numpy()
        ]
        columns.leave_out(name, messages.dates_not_numbers(name=name), FileFault.NOT_A_NUMBER)
    elif pyarrow.types.is_duration(kind):
        columns[name] = (
            np.asarray(values.cast(pyarrow.duration("ns")).cast(pyarrow.int64()).to_numpy(), dtype=np.float64) * 1e-9
        )
        columns.units[name] = "s"
    elif pyarrow.types.is_time(kind):
        of_day = values.cast(pyarrow.time64("ns")).cast(pyarrow.int64())
        columns[name] = np.asarray(of_day.to_numpy(), dtype=np.float64) * 1e-9
        columns.units[name] = "s"
    else:
        columns.leave_out(name, messages.values_not_numbers(name=name, kind=str(kind)))


@dataclass(frozen=True)
class Selection:
    """Rows of a file that make the record.

    ``skip`` rows are omitted at the start and ``take`` of the others are used; of these the ones from ``start_s`` to
    ``end_s`` [s] from the first row of the file on; ``resample`` interpolates them at even times.
    """

    skip: int = 0
    start_s: float = 0.0
    end_s: float = math.inf
    resample: bool = False
    take: int | None = None

    @property
    def has_range(self) -> bool:
        """Whether the rows are selected by time."""
        return self.start_s > 0.0 or self.end_s < math.inf


WHOLE = Selection()


@dataclass(frozen=True)
class TimeChoice:
    """Time column, or ``NO_COLUMN``, and its unit; None if the file names them."""

    column: str | None = None
    unit: str | None = None


BY_THE_FILE = TimeChoice()


@dataclass(frozen=True)
class ImportSummary:
    """Summary of an import, for the reader of a result.

    ``columns`` by role, ``units`` by column; ``layout`` is the format of the file. Rows count from 1, the first below
    the heading. ``not_read`` are the other columns, each with the reason. ``least_step_s`` and ``largest_step_s`` [s]
    are those between rows, None without a time column.
    """

    file: str
    layout: dict[str, str | int]
    columns: dict[str, str]
    units: dict[str, str]
    time_column: str | None
    time_unit: str | None
    time_unit_from: str | None
    sample_time_s: float
    sample_time_from: str
    least_step_s: float | None
    largest_step_s: float | None
    rows_in_file: int
    first_row: int
    last_row: int
    rows_used: int
    samples: int
    resampled: bool
    not_read: dict[str, str]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain dictionaries, lists and numbers."""
        return asdict(self)


class Imported(NamedTuple):
    """A record, and the summary of its import."""

    record: Record
    reading: ImportSummary


def import_record(
    columns: Columns,
    u: str,
    y: str,
    period_s: float | None = None,
    *,
    setpoint: str | None = None,
    controller: Controller | None = None,
    selection: Selection = WHOLE,
    time: TimeChoice = BY_THE_FILE,
    file: str = "",
) -> Imported:
    """Make a record of named columns, with the sample time of a time column.

    A given sample time is compared with the time column. Raises DataFileError if a column or the time is ambiguous, and
    RecordError if the data are unsuitable.
    """
    roles = {"input": u, "output": y} | ({"setpoint": setpoint} if setpoint is not None else {})
    signals = {name: columns.column(name) for name in roles.values()}
    if time.column in signals:
        raise DataFileError(
            messages.time_is_a_signal(name=time.column),
            FileFault.OPTION,
            column=time.column,
            option="--time",
        )
    if period_s is not None:
        check_period(period_s)
    found = find_time_column(columns, signals, asked=time.column, unit=time.unit, period_s=period_s)
    _require_one_length(signals, found)
    if found is None and time.unit is not None:
        raise DataFileError(messages.time_unit_without_time(), FileFault.NO_TIME, option="--time")
    if found is None and (period_s is None or selection.resample):
        raise DataFileError(messages.no_time_column(), FileFault.NO_TIME, option="--time")
    if found is None and columns.holes:
        raise DataFileError(messages.lines_may_be_missing(lines=columns.holes), FileFault.ROWS, option="--time")
    rows = np.arange(columns[u].size)
    at = np.asarray(rows * (period_s or 0.0), dtype=np.float64) if found is None else found.seconds
    part = _part(found, at, selection)
    signals = {name: values[part] for name, values in signals.items()}
    t = None if found is None else found.seconds[part]
    steps = None if t is None or t.size < 2 else np.diff(t)
    sample_time_from: str = "--period"
    if period_s is None:
        assert t is not None
        period_s = float(np.median(np.diff(t))) if selection.resample and t.size > 1 else mean_period(t)
        sample_time_from = messages.step_of_time_column(is_resampled=selection.resample)
        check_period(period_s)
    used = part.stop - part.start
    if selection.resample and t is not None:
        _require_finite(signals)
        signals = {name: even(t, values, period_s, held=name != y) for name, values in signals.items()}
        t = None
    r = None if setpoint is None else signals[setpoint]
    used_names = {*signals, *([] if found is None else [found.name])}
    record = Record(period_s, signals[u], signals[y], r=r, controller=controller, t=t)
    reading = ImportSummary(
        file=file,
        layout=dict(columns.layout),
        columns=roles,
        units={name: columns.units[name] for name in signals if columns.units.get(name)},
        time_column=None if found is None else found.name,
        time_unit=None if found is None else found.unit,
        time_unit_from=None if found is None else found.unit_from,
        sample_time_s=period_s,
        sample_time_from=sample_time_from,
        least_step_s=None if steps is None else float(np.min(steps)),
        largest_step_s=None if steps is None else float(np.max(steps)),
        rows_in_file=columns[u].size,
        first_row=part.start + 1,
        last_row=part.stop,
        rows_used=used,
        samples=record.u.size,
        resampled=selection.resample,
        not_read={name: reason for name, reason in columns.not_read().items() if name not in used_names},
        notes=tuple(columns.notes),
    )
    return Imported(record, reading)


def _require_one_length(signals: dict[str, Signal], found: TimeColumn | None) -> None:
    """Raise RecordError for columns of different length."""
    sizes = {name: values.size for name, values in signals.items()}
    if found is not None:
        sizes[found.name] = found.seconds.size
    (first, expected), *others = sizes.items()
    for name, size in others:
        if size != expected:
            raise RecordError(
                messages.columns_of_file_of_unequal_length(name=name, length=size, other=first, expected=expected)
            )


def _part(found: TimeColumn | None, at: Signal, selection: Selection) -> slice:
    """Return the selected rows.

    Raises DataFileError if there are none or they are not contiguous, RecordError if the time decreases.
    """
    last = at.size if selection.take is None else min(at.size, selection.skip + selection.take)
    rows = np.arange(min(selection.skip, last), last)
    if selection.has_range:
        rows = rows[(at[rows] >= selection.start_s) & (at[rows] <= selection.end_s)]
    if not rows.size:
        end_s = float(at[-1]) if at.size else 0.0
        raise DataFileError(messages.no_row_selected(rows=at.size, end_s=end_s), FileFault.ROWS)
    part = slice(int(rows[0]), int(rows[-1]) + 1)
    if part.stop - part.start != rows.size:
        apart = int(rows[np.argmax(np.diff(rows) > 1)]) + 1
        raise DataFileError(messages.rows_not_contiguous(row=apart), FileFault.ROWS, option="--take")
    if found is not None:
        require_forward(replace(found, seconds=found.seconds[part]), part.start)
    return part


def _require_finite(signals: dict[str, Signal]) -> None:
    """Raise DataFileError for missing samples, which resampling would spread or hide."""
    for name, values in signals.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise DataFileError(
                messages.resampled_not_finite(name=name, count=bad.size, first=int(bad[0])),
                FileFault.NOT_A_NUMBER,
                column=name,
            )


# MATLAB file ---------------------------------------------------------------------------------------
# A MATLAB file, version 7 or older, as columns by name; other contents are listed with the reason.


_HDF5 = b"\x89HDF\r\n\x1a\n"
_MATRIX, _COMPRESSED, _OPAQUE = 14, 15, 17
_MOST_NAMED = 64 * 1024
"""Bytes of an element that are searched for the class of an object."""

Found = tuple[str, str, Any]
"""Path of a value, the name by which it is read if that is unique, and the value."""


def read_mat(stream: BinaryIO) -> Columns:
    """Return the numeric vectors by name of a MATLAB file (version 7 or older).

    Columns of a matrix x are x_1, x_2 ..; fields of a struct s have their own names, or s.field if that is not unique;
    those of the elements of a struct array are field_1, field_2 .. Raises DataFileError.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    content = stream.read()
    stream.seek(0)
    if content.startswith(_HDF5):
        raise DataFileError(messages.matlab_of_version_7_3(), FileFault.FORMAT)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            # SciPy warns of objects that it cannot name; unread contents are reported below.
            warnings.simplefilter("ignore")
            # The stubs allow file names only; loadmat reads open files as well.
            variables = loadmat(stream, squeeze_me=True)  # type: ignore[arg-type]  # the stubs know paths only
    except NotImplementedError:
        raise DataFileError(messages.matlab_of_version_7_3(), FileFault.FORMAT) from None
    except (
        ArithmeticError, AttributeError, AssertionError, EOFError, LookupError, MatReadError, MemoryError, OSError,
        TypeError, UnboundLocalError, ValueError, struct.error, zlib.error,
    ):  # fmt: skip
        raise DataFileError(messages.not_matlab(), FileFault.UNREADABLE) from None
    objects = dict(_objects(content))
    columns = _collect_columns(variables, objects)
    columns.layout |= {"format": messages.matlab_file()}
    if not columns:
        if objects:
            name, kind = next(iter(objects.items()))
            raise DataFileError(
                messages.only_matlab_objects(objects=objects, command=messages.save_command(name=name, kind=kind)),
                FileFault.OBJECTS,
                column=name,
            )
        raise DataFileError(messages.no_vectors_in_matlab(others=list(columns.reasons)), FileFault.NO_COLUMN)
    return columns


def _collect_columns(variables: dict[str, Any], objects: dict[str, str]) -> Columns:
    columns = Columns()
    found = [
        one
        for name, values in variables.items()
        if not name.startswith("__") and not _is_object(values)
        for one in _parts(name, name, values)
    ]
    paths = {path for path, _, _ in found}
    shared = Counter(short for path, short, _ in found if short != path)
    places: dict[str, list[str]] = {}
    for path, short, values in found:
        is_alone = short not in paths and shared[short] == 1
        name = path if short == path or not is_alone else short
        if name in columns or name in columns.reasons:
            columns.leave_out(name, messages.two_values_in_matlab(name=name), FileFault.AMBIGUOUS_COLUMN)
            continue
        if short != path and not is_alone:
            places.setdefault(short, []).append(path)
        reason = _reason(name, values)
        if reason is not None:
            columns.leave_out(name, reason)
        else:
            columns[name] = np.asarray(values, dtype=np.float64)
            if np.issubdtype(values.dtype, np.integer) and np.any(np.abs(columns[name]) > LARGEST_EXACT):
                columns.whole[name] = values.astype(np.int64)
    for short, keys in places.items():
        if short not in columns and short not in columns.reasons:
            columns.leave_out(short, messages.several_fields(name=short, paths=keys), FileFault.AMBIGUOUS_COLUMN)
    for name, kind in objects.items():
        reason = messages.matlab_object_with_columns(
            name=name, kind=kind, command=messages.save_command(name=name, kind=kind)
        )
        columns.leave_out(name, reason, FileFault.OBJECTS)
        columns.notes.append(reason)
    return columns


def _parts(path: str, short: str, values: Any) -> Iterator[Found]:
    """Yield the vectors of a variable, also of structs and matrices, and other values."""
    if _is_object(values) or not isinstance(values, np.ndarray):
        yield path, short, values
    elif values.dtype.names is not None and values.ndim == 0:
        for field in values.dtype.names:
            yield from _parts(f"{path}.{field}", field, _element(values[field][()]))
    elif values.dtype.names is not None and values.ndim == 1:
        for at, element in enumerate(values, start=1):
            for field in values.dtype.names:
                yield from _parts(f"{path}({at}).{field}", f"{field}_{at}", _element(element[field]))
    elif values.ndim == 2 and values.dtype.kind in "biuf" and values.size:
        upright = values if values.shape[0] >= values.shape[1] else values.T
        for index in range(upright.shape[1]):
            yield f"{path}_{index + 1}", f"{short}_{index + 1}", upright[:, index]
    else:
        yield path, short, values


def _element(value: Any) -> Any:
    return value if isinstance(value, np.ndarray) or _is_object(value) else np.asarray(value)


def _reason(name: str, values: Any) -> Message | None:
    """Return why a value is not a column, None if it is one."""
    if _is_object(values):
        return messages.matlab_object(name=name)
    if not isinstance(values, np.ndarray):
        is_sparse = hasattr(values, "toarray")
        return messages.matlab_sparse_matrix(name=name) if is_sparse else messages.matlab_not_numeric(name=name)
    if values.dtype.kind in "US":
        return messages.matlab_text(name=name)
    if values.dtype.kind == "c":
        return messages.matlab_complex(name=name)
    if values.dtype.kind not in "biuf":
        return messages.matlab_nested(name=name)
    if values.ndim == 0:
        return messages.matlab_scalar(name=name)
    if values.ndim != 1 or not values.size:
        return messages.matlab_array(name=name, dimensions=values.ndim)
    if values.size > MAX_SAMPLES:
        return messages.matlab_vector_too_long(name=name, length=values.size, maximum=MAX_SAMPLES)
    return None


def _is_object(values: Any) -> bool:
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    return isinstance(values, MatlabOpaque | MatlabObject | MatlabFunction)


def _objects(content: bytes) -> Iterator[tuple[str, str]]:
    """Yield name and class of the objects of a file of version 5.

    SciPy confuses several of them.
    """
    order = "<" if content[126:128] == b"IM" else ">"
    at = 128
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(order + "II", content, at)
        element = content[at + 8 : at + 8 + min(size, _MOST_NAMED)]
        if kind == _COMPRESSED:
            try:
                element = zlib.decompressobj().decompress(element, _MOST_NAMED)
            except zlib.error:
                return
            kind, element = (struct.unpack_from(order + "I", element)[0], element[8:]) if len(element) > 8 else (0, b"")
            at += 8 + size
        else:
            at += 8 + size + (-size % 8)
        if kind == _MATRIX and len(element) > 16 and element[8 if order == "<" else 11] == _OPAQUE:
            words = list(_words(element[16:], order))
            if len(words) == 3 and re.fullmatch(r"[A-Za-z]\w*", words[0]):
                yield words[0], words[2]


def _words(element: bytes, order: str) -> Iterator[str]:
    """Yield the first three texts of an object: name, kind of class, and class."""
    at = 0
    for _ in range(3):
        if at + 8 > len(element):
            return
        kind, size = struct.unpack_from(order + "II", element, at)
        if kind >> 16:  # up to four bytes are stored next to their number
            size = kind >> 16
            word, at = element[at + 4 : at + 4 + size], at + 8
        else:
            word, at = element[at + 8 : at + 8 + size], at + 8 + size + (-size % 8)
        yield word.decode("latin1")
