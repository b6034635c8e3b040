"""Columns from elsewhere, of a table, a .mat or a Parquet file, checked, as a record for the estimators."""

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from backend.identification.errors import DataFileError
from backend.identification.record import Controller, Record, mean_period
from backend.identification.table import MAX_SAMPLES, Columns
from backend.identification.timebase import even, time_of

if TYPE_CHECKING:
    import pyarrow

_HDF5 = b"\x89HDF\r\n\x1a\n"
_VERSION_7_3 = (
    "the file is of MATLAB version 7.3 (HDF5), which is not read: load it in MATLAB or Octave and save it again with "
    "save('new.mat', 'u', 'y', '-v7'), the names of its variables in place of u and y"
)


def read_mat(stream: BinaryIO) -> Columns:
    """Numeric vectors by name of a MATLAB file (version 7 or older). Raises DataFileError.

    Columns of a matrix x are x_1, x_2 ..; fields of a struct s are read as if they stood alone, or as s.field where
    that name is taken.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    begin = stream.read(len(_HDF5))
    stream.seek(0)
    if begin == _HDF5:
        raise DataFileError(_VERSION_7_3)
    try:
        with warnings.catch_warnings():
            # SciPy warns of objects that it cannot name; what could not be read is said below.
            warnings.simplefilter("ignore")
            # The stubs know file names only; loadmat reads from open files as well.
            content = loadmat(stream, squeeze_me=True)  # type: ignore[arg-type]  # the stubs know paths only
    except NotImplementedError:
        raise DataFileError(_VERSION_7_3) from None
    except (ValueError, TypeError, MatReadError, OSError, IndexError) as error:
        raise DataFileError(f"not a readable MATLAB file: {error}") from None
    columns = Columns()
    for name, values in content.items():
        if not name.startswith("__"):
            _take(columns, name, values)
    if not columns:
        objects = sorted({kind for values in content.values() for kind in _object_classes(values)})
        if objects:
            raise DataFileError(
                f"the MATLAB file holds objects ({', '.join(objects)}) and no numeric vectors: save the columns as"
                " vectors or as a struct, as in u = T.u; y = T.y; save('new.mat', 'u', 'y', '-v7')"
            )
        raise DataFileError("the MATLAB file holds no numeric vectors")
    return columns


def _object_classes(values: Any) -> list[str]:
    """Names of the classes of a MATLAB object, as of a table; none for arrays and structs."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if isinstance(values, MatlabOpaque):
        names = np.atleast_1d(values["s2"]).tolist()
        return [name.decode("latin1") if isinstance(name, bytes) else str(name) for name in names]
    if isinstance(values, MatlabObject):
        return [str(values.classname)]
    return ["function"] if isinstance(values, MatlabFunction) else []


def _take(columns: Columns, name: str, values: Any) -> None:
    if not isinstance(values, np.ndarray) or _object_classes(values):
        return
    if values.dtype.names is not None and values.ndim == 0:
        for field in values.dtype.names:
            taken = field in columns
            _take(columns, f"{name}.{field}" if taken else field, np.asarray(values[field][()]))
    elif np.issubdtype(values.dtype, np.number) and not np.iscomplexobj(values):
        if values.ndim == 1:
            columns[name] = np.asarray(values, dtype=np.float64)
        elif values.ndim == 2:
            upright = values if values.shape[0] >= values.shape[1] else values.T
            for index in range(upright.shape[1]):
                columns[f"{name}_{index + 1}"] = np.asarray(upright[:, index], dtype=np.float64)


def read_parquet(stream: BinaryIO) -> Columns:
    """Numeric columns by name of a Parquet file. Raises DataFileError."""
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(stream)
    except (pyarrow.ArrowException, OSError) as error:
        raise DataFileError(f"not a readable Parquet file: {error}") from None
    if table.num_rows > MAX_SAMPLES:
        raise DataFileError(f"the file holds {table.num_rows} rows, at most {MAX_SAMPLES} are read: cut it")
    columns = Columns()
    for name in table.column_names:
        kind = table.schema.field(name).type
        if _holds_numbers(kind):
            columns[name] = np.asarray(table[name].to_numpy(), dtype=np.float64)
        elif pyarrow.types.is_timestamp(kind):
            columns.texts[name] = [str(value) for value in table[name].to_numpy()]
            columns.reasons[name] = f"column '{name}' holds dates, not numbers"
    return columns


@dataclass(frozen=True)
class Selection:
    """Which rows of a file make the record.

    ``skip`` rows are left out at the start; of the others those from ``start_s`` to ``end_s`` [s] count, from the first
    row of the file on; ``resample`` takes them at even instants.
    """

    skip: int = 0
    start_s: float = 0.0
    end_s: float = math.inf
    resample: bool = False


WHOLE = Selection()


def record_from(
    columns: Columns,
    u: str,
    y: str,
    period_s: float | None = None,
    *,
    setpoint: str | None = None,
    controller: Controller | None = None,
    selection: Selection = WHOLE,
) -> Record:
    """Record made of the columns of that name; a time column gives the sample time, or is checked against it.

    Raises DataFileError where a column is missing and RecordError where the data identify nothing.
    """
    names = [u, y] if setpoint is None else [u, y, setpoint]
    signals = {name: columns.column(name) for name in names}
    t = time_of(columns, names)
    count = min(values.size for values in signals.values())
    if t is None and (period_s is None or selection.resample):
        raise DataFileError("the file has no time column (t, time, timestamp, ...): give the sample time by --period")
    at = t if t is not None else np.arange(count) * (period_s or 0.0)
    rows = np.flatnonzero((at >= selection.start_s) & (at <= selection.end_s) & (np.arange(at.size) >= selection.skip))
    if not rows.size:
        raise DataFileError(
            f"no row is left: the file holds {at.size} rows from 0 to {at[-1] if at.size else 0.0:.6g} s"
        )
    part = slice(int(rows[0]), int(rows[-1]) + 1)
    signals, t = {name: values[part] for name, values in signals.items()}, None if t is None else t[part]
    if period_s is None:
        assert t is not None
        period_s = float(np.median(np.diff(t))) if selection.resample else mean_period(t)
    if selection.resample and t is not None:
        signals = {name: even(t, values, period_s, held=name != y) for name, values in signals.items()}
        t = None
    r = None if setpoint is None else signals[setpoint]
    return Record(period_s, signals[u], signals[y], r=r, controller=controller, t=t)


def _holds_numbers(kind: "pyarrow.DataType") -> bool:
    import pyarrow

    return bool(pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind))
