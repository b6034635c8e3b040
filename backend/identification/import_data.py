"""Samples from elsewhere, of a table, a .mat or a Parquet file, checked, as a record, with what was read of them."""

import math
import re
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from backend.identification.errors import DataFileError, FileFault, RecordError
from backend.identification.record import Controller, Record, Signal, check_period, mean_period
from backend.identification.table import LARGEST_EXACT, MAX_SAMPLES, Columns
from backend.identification.timebase import TimeColumn, even, require_forward, time_of

if TYPE_CHECKING:
    import pyarrow

_LARGEST_WHOLE = 2.0**63
_CONTROL = re.compile("[\0-\x08\x0e-\x1f\x7f]")
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}


def decoded(content: bytes, name: str) -> str:
    """Return the text of a file in UTF-8, or in UTF-16 where a byte order mark says so. Raises DataFileError."""
    encoding = next((encoding for mark, encoding in _MARKS.items() if content.startswith(mark)), "utf-8")
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        raise DataFileError(f"{name} is not text in UTF-8: save it as CSV in UTF-8", FileFault.ENCODING) from None
    found = _CONTROL.search(text)
    if found is not None:
        line = text.count("\n", 0, found.start()) + 1
        raise DataFileError(
            f"{name} is no table of text: line {line} holds the control character U+{ord(found[0]):04X}",
            FileFault.ENCODING,
            line=line,
        )
    return text


def read_parquet(stream: BinaryIO) -> Columns:
    """Columns of numbers, decimals and Boolean values by name of a Parquet file. Raises DataFileError."""
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.ParquetFile(stream).read()  # unlike read_table it takes two columns of one name
    except (pyarrow.ArrowException, OSError, ValueError):
        raise DataFileError(
            "not a readable Parquet file: it is damaged, or of another kind", FileFault.UNREADABLE
        ) from None
    if table.num_rows > MAX_SAMPLES:
        raise DataFileError(
            f"the file holds {table.num_rows} rows, at most {MAX_SAMPLES} are read: cut it", FileFault.TOO_LONG
        )
    columns = Columns()
    columns.layout |= {"format": "Parquet file", "rows": table.num_rows}
    for index, (written, values) in enumerate(zip(table.column_names, table.columns, strict=True)):
        name = written if written.isprintable() else ascii(written)[1:-1]
        if name in columns or name in columns.reasons:
            columns.texts.pop(name, None)
            columns.leave_out(name, f"two columns are called '{name}'", FileFault.AMBIGUOUS_COLUMN)
        else:
            try:
                _take(columns, name, values)
            except pyarrow.ArrowException:
                columns.leave_out(name, f"column '{name}' holds values of the kind {values.type}, which are not read")
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
        columns.leave_out(name, f"column '{name}' holds dates, not numbers", FileFault.NOT_A_NUMBER)
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
        columns.leave_out(name, f"column '{name}' holds values of the kind {kind}, which are not numbers")


@dataclass(frozen=True)
class Selection:
    """Which rows of a file make the record.

    ``skip`` rows are left out at the start and ``take`` of the others are taken; of these those from ``start_s`` to
    ``end_s`` [s] count, from the first row of the file on; ``resample`` takes them at even instants.
    """

    skip: int = 0
    start_s: float = 0.0
    end_s: float = math.inf
    resample: bool = False
    take: int | None = None

    @property
    def has_range(self) -> bool:
        """Whether times choose the rows."""
        return self.start_s > 0.0 or self.end_s < math.inf


WHOLE = Selection()


@dataclass(frozen=True)
class TimeChoice:
    """The column that is the time, or ``NO_COLUMN``, and its unit; None where the file says so itself."""

    column: str | None = None
    unit: str | None = None


BY_THE_FILE = TimeChoice()


@dataclass(frozen=True)
class Reading:
    """What was read of a file, for the reader of a result.

    ``columns`` by what they serve as, ``units`` by column; ``layout`` is how the file was read. Rows count from 1, the
    first below the heading. ``not_read`` are the other columns, each with the reason. ``least_step_s`` and
    ``largest_step_s`` [s] are those between rows, None without a time column.
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
        """Plain dictionaries, lists and numbers."""
        return asdict(self)


class Imported(NamedTuple):
    """A record, and what was read of the file that it comes from."""

    record: Record
    reading: Reading


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
    """Record made of the columns of that name; a time column gives the sample time, or is checked against it.

    Raises DataFileError where a column or the time cannot be told, and RecordError where the data identify nothing.
    """
    roles = {"input": u, "output": y} | ({"setpoint": setpoint} if setpoint is not None else {})
    signals = {name: columns.column(name) for name in roles.values()}
    if time.column in signals:
        raise DataFileError(
            f"--time {time.column}: that column is a signal, so it is not the time",
            FileFault.OPTION,
            column=time.column,
            option="--time",
        )
    if period_s is not None:
        check_period(period_s)
    found = time_of(columns, signals, asked=time.column, unit=time.unit, period_s=period_s)
    _require_one_length(signals, found)
    if found is None and time.unit is not None:
        raise DataFileError(
            "there is no time column that --time-unit is for: name it by --time COLUMN",
            FileFault.NO_TIME,
            option="--time",
        )
    if found is None and (period_s is None or selection.resample):
        raise DataFileError(
            "the file has no time column (t, time, timestamp, ...): name it by --time COLUMN, or give the sample time"
            " by --period",
            FileFault.NO_TIME,
            option="--time",
        )
    if found is None and columns.holes:
        raise DataFileError(
            f"{columns.holes} lines between rows are empty or commented out: they may be samples that are missing,"
            " which no time column tells. Delete those lines, or name the time by --time COLUMN",
            FileFault.ROWS,
            option="--time",
        )
    rows = np.arange(columns[u].size)
    at = np.asarray(rows * (period_s or 0.0), dtype=np.float64) if found is None else found.seconds
    part = _part(found, at, selection)
    signals = {name: values[part] for name, values in signals.items()}
    t = None if found is None else found.seconds[part]
    steps = None if t is None or t.size < 2 else np.diff(t)
    sample_time_from = "--period"
    if period_s is None:
        assert t is not None
        period_s = float(np.median(np.diff(t))) if selection.resample and t.size > 1 else mean_period(t)
        sample_time_from = f"{'median' if selection.resample else 'mean'} step of the time column"
        check_period(period_s)
    used = part.stop - part.start
    if selection.resample and t is not None:
        _require_finite(signals)
        signals = {name: even(t, values, period_s, held=name != y) for name, values in signals.items()}
        t = None
    r = None if setpoint is None else signals[setpoint]
    used_names = {*signals, *([] if found is None else [found.name])}
    record = Record(period_s, signals[u], signals[y], r=r, controller=controller, t=t)
    reading = Reading(
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
    """Raise RecordError for columns of different length, of which rows would be left out."""
    sizes = {name: values.size for name, values in signals.items()}
    if found is not None:
        sizes[found.name] = found.seconds.size
    (first, expected), *others = sizes.items()
    for name, size in others:
        if size != expected:
            raise RecordError(
                f"length of {name}", size, expected, expected, "samples",
                f"give columns of one length, {first} has {expected}",
            )  # fmt: skip


def _part(found: TimeColumn | None, at: Signal, selection: Selection) -> slice:
    """Return the rows that are chosen. Raises DataFileError for none and for rows apart, RecordError for times back."""
    last = at.size if selection.take is None else min(at.size, selection.skip + selection.take)
    rows = np.arange(min(selection.skip, last), last)
    if selection.has_range:
        rows = rows[(at[rows] >= selection.start_s) & (at[rows] <= selection.end_s)]
    if not rows.size:
        raise DataFileError(
            f"no row is left: the file holds {at.size} rows from 0 to {at[-1] if at.size else 0.0:.6g} s",
            FileFault.ROWS,
        )
    part = slice(int(rows[0]), int(rows[-1]) + 1)
    if part.stop - part.start != rows.size:
        apart = int(rows[np.argmax(np.diff(rows) > 1)]) + 1
        raise DataFileError(
            f"the times of --range are those of rows that do not follow each other, as the time runs back after row"
            f" {apart}: choose rows by --skip and --take",
            FileFault.ROWS,
            option="--take",
        )
    if found is not None:
        require_forward(replace(found, seconds=found.seconds[part]), part.start)
    return part


def _require_finite(signals: dict[str, Signal]) -> None:
    """Raise DataFileError for a sample that is missing, which resampling would spread or pass over."""
    for name, values in signals.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise DataFileError(
                f"{bad.size} samples of '{name}' are not finite (first at index {bad[0]}): cut the record before or"
                " after them",
                FileFault.NOT_A_NUMBER,
                column=name,
            )
