"""Samples of a run read back from a file that was exported, as they are stored."""

from pathlib import Path

import numpy as np

from backend.recording.columns import Columns
from backend.sample import STORED_NAMES

SUFFIXES = (".csv", ".parquet")


class SamplesFileError(ValueError):
    """A file that does not hold the samples of a run."""


def read_samples_file(file: Path) -> Columns:
    """Return the columns of a CSV or Parquet file, ``t`` [s] and every stored signal. Raises SamplesFileError."""
    import pyarrow
    import pyarrow.csv
    import pyarrow.parquet

    if file.suffix not in SUFFIXES:
        raise SamplesFileError(f"{file}: samples are read from {' or '.join(SUFFIXES)}")
    try:
        if file.suffix == ".csv":
            types = {name: pyarrow.float64() for name in ("t", *STORED_NAMES)}
            options = pyarrow.csv.ConvertOptions(column_types=types, null_values=[], strings_can_be_null=False)
            table = pyarrow.csv.read_csv(file, convert_options=options)
        else:
            table = pyarrow.parquet.read_table(file)
        missing = [name for name in ("t", *STORED_NAMES) if name not in table.column_names]
        if missing:
            raise SamplesFileError(f"{file}: the column {missing[0]} is missing; it is no export of a run's samples")
        read = {name: np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in ("t", *STORED_NAMES)}
    except (OSError, pyarrow.ArrowException) as error:
        raise SamplesFileError(f"{file} cannot be read: {str(error).splitlines()[0]}") from None
    return {"t": read["t"]} | {name: read[name].astype(np.float32).astype(np.float64) for name in STORED_NAMES}
