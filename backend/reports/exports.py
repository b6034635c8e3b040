"""Samples of a run as files for other programs: CSV, Parquet, MATLAB. SI units, columns named as in the notation."""

import io
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backend.sample import FIELDS, STORED_NAMES

if TYPE_CHECKING:
    import pyarrow as pa

Columns = Mapping[str, NDArray[np.float64]]

_FIRST = ("t", "q", "q_ref", "S", "S_ref", "theta_A", "theta_B", "F_A", "F_B", "u_A", "u_B")
ORDER: tuple[str, ...] = (*_FIRST, *(name for name in STORED_NAMES if name not in _FIRST))
"""Columns in the order of every export; ``t`` [s] counts from the first sample."""

_FIELD = {field.name: field for field in FIELDS}


def to_csv(columns: Columns) -> bytes:
    """Return comma-separated text with a header line; a value that does not exist is nan."""
    import pyarrow.csv

    buffer = io.BytesIO()
    plain = pyarrow.csv.WriteOptions(quoting_style="none", quoting_header="none")
    pyarrow.csv.write_csv(_table(columns), buffer, plain)
    return buffer.getvalue()


def to_parquet(columns: Columns) -> bytes:
    """Return a Parquet file; each column carries unit and meaning in its metadata."""
    import pyarrow.parquet

    buffer = io.BytesIO()
    pyarrow.parquet.write_table(_table(columns), buffer, compression="zstd")
    return buffer.getvalue()


def to_mat(columns: Columns) -> bytes:
    """Return a MATLAB 5 file: one column vector per signal, units in the struct ``units``."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    names = _present(columns)
    content: dict[str, object] = {name: np.asarray(columns[name]).reshape(-1, 1) for name in names}
    content["units"] = {name: _FIELD[name].unit for name in names}
    savemat(buffer, content, do_compression=True)  # type: ignore[arg-type]  # the stubs forget that files may be open
    return buffer.getvalue()


def _table(columns: Columns) -> "pa.Table":
    import pyarrow as pa

    schema = pa.schema([_field(name) for name in _present(columns)])
    arrays = [pa.array(np.asarray(columns[field.name]), type=field.type) for field in schema]
    return pa.table(arrays, schema=schema)


def _field(name: str) -> "pa.Field":
    import pyarrow as pa

    metadata = {"unit": _FIELD[name].unit, "meaning": _FIELD[name].meaning}
    # Signals are stored in single precision: wider columns would only print digits that mean nothing.
    return pa.field(name, pa.float64() if name == "t" else pa.float32(), metadata=metadata)


def _present(columns: Iterable[str]) -> list[str]:
    return [name for name in ORDER if name in set(columns)]
