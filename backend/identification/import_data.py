"""Columns from elsewhere: CSV text, a .mat or a Parquet file, checked, as a record for the estimators."""

import re
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np
import pyarrow
import pyarrow.parquet
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from backend.identification.errors import DataFileError
from backend.identification.record import Controller, Record, Signal

MAX_SAMPLES = 5_000_000
_TIME_NAMES = ("t", "time")
_TIME_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_HEADING = re.compile(r"^\s*(?P<name>[^\[\(]*?)\s*(?:[\[\(](?P<unit>[^\]\)]*)[\]\)])?\s*$")

Columns = dict[str, Signal]


def read_csv(text: str) -> Columns:
    """Columns by name of a table with one heading line; names may carry a unit, as in ``u [V]``.

    Separators are comma, semicolon or tab; with semicolons or tabs numbers may have decimal commas. A time column in ms
    or us becomes seconds. Raises DataFileError.
    """
    lines = [line for line in text.lstrip("\ufeff").splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise DataFileError("the file holds no heading line with rows of numbers below it")
    if len(lines) - 1 > MAX_SAMPLES:
        raise DataFileError(f"the file holds {len(lines) - 1} rows, at most {MAX_SAMPLES} are read: cut it")
    separator = max(";\t,", key=lines[0].count)
    headings = [heading.strip().strip('"') for heading in lines[0].split(separator)]
    if all(_is_number(heading) for heading in headings):
        raise DataFileError("the first line holds numbers: put the names of the columns there")
    rows = lines[1:] if separator == "," else [line.replace(",", ".") for line in lines[1:]]
    for number, row in enumerate(rows, start=2):
        if row.count(separator) != len(headings) - 1:
            raise DataFileError(f"row {number} has {row.count(separator) + 1} columns, the heading has {len(headings)}")
    try:
        table = np.loadtxt(rows, delimiter=separator, ndmin=2, comments=None)
    except ValueError as error:
        raise DataFileError(f"not a table of numbers: {error}") from None
    return _named(headings, table.T)


def read_mat(stream: BinaryIO) -> Columns:
    """Numeric vectors by name of a MATLAB file (version 7 or older). Raises DataFileError."""
    try:
        # The stubs know file names only; loadmat reads from open files as well.
        content = loadmat(stream, squeeze_me=True)  # type: ignore[arg-type]  # the stubs know paths only
    except NotImplementedError:
        raise DataFileError("the file is MATLAB 7.3: save it with save(..., '-v7')") from None
    except (ValueError, TypeError, MatReadError, OSError, IndexError) as error:
        raise DataFileError(f"not a readable MATLAB file: {error}") from None
    vectors = {
        name: np.asarray(values, dtype=np.float64)
        for name, values in content.items()
        if isinstance(values, np.ndarray) and values.ndim == 1 and np.issubdtype(values.dtype, np.number)
    }
    if not vectors:
        raise DataFileError("the MATLAB file holds no numeric vectors")
    return vectors


def read_parquet(stream: BinaryIO) -> Columns:
    """Numeric columns by name of a Parquet file. Raises DataFileError."""
    try:
        table = pyarrow.parquet.read_table(stream)
    except (pyarrow.ArrowException, OSError) as error:
        raise DataFileError(f"not a readable Parquet file: {error}") from None
    if table.num_rows > MAX_SAMPLES:
        raise DataFileError(f"the file holds {table.num_rows} rows, at most {MAX_SAMPLES} are read: cut it")
    numeric = (name for name in table.column_names if _holds_numbers(table.schema.field(name).type))
    return {name: np.asarray(table[name].to_numpy(), dtype=np.float64) for name in numeric}


def record_from(
    columns: Mapping[str, Signal],
    u: str,
    y: str,
    period_s: float,
    *,
    setpoint: str | None = None,
    controller: Controller | None = None,
) -> Record:
    """Record made of the columns of that name; a column t or time is checked against ``period_s``.

    Raises DataFileError where a column is missing and RecordError where the data identify nothing.
    """
    time = next((columns[name] for name in _TIME_NAMES if name in columns), None)
    return Record(
        period_s,
        _column(columns, u),
        _column(columns, y),
        r=None if setpoint is None else _column(columns, setpoint),
        controller=controller,
        t=time,
    )


def _column(columns: Mapping[str, Signal], name: str) -> Signal:
    if name not in columns:
        raise DataFileError(f"there is no column '{name}'; the file has {', '.join(columns)}")
    return columns[name]


def _named(headings: list[str], values: Signal) -> Columns:
    columns: Columns = {}
    for heading, column in zip(headings, values, strict=True):
        match = _HEADING.match(heading)
        name, unit = (match["name"], match["unit"] or "") if match else (heading, "")
        if not name:
            raise DataFileError("a column has no name")
        if name in columns:
            raise DataFileError(f"two columns are called '{name}'")
        if name in _TIME_NAMES:
            if unit not in _TIME_UNITS:
                raise DataFileError(f"the time column is in '{unit}': give it in s, ms or us")
            column = column * _TIME_UNITS[unit]
        columns[name] = column
    return columns


def _holds_numbers(kind: pyarrow.DataType) -> bool:
    return bool(pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
