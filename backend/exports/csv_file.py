"""Samples as comma-separated text: facts in lines that begin with #, a heading, a line for each sample."""

import io
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from backend.exports.errors import ImportRefusedError
from backend.exports.facts import Batch, Facts, read_facts
from backend.exports.source import Export
from backend.plain_text import as_cell, as_comment, as_json_cells

if TYPE_CHECKING:
    import pyarrow as pa

_MARK = "# sinew-export: "
_LONGEST = 16_000_000
"""Characters of a line of facts: parameters and settings of a run take some ten thousand."""


_SHOWN = 100
"""Characters of a line that are told."""


def write(export: Export) -> Iterator[bytes]:
    """Yield the file; a value that does not exist is nan, and each number has the digits that give it back exactly."""
    import pyarrow.csv

    facts = export.facts
    yield _heading(facts).encode()
    plain = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
    for batch in export.batches():
        buffer = io.BytesIO()
        pyarrow.csv.write_csv(table(facts, batch), buffer, plain)
        yield buffer.getvalue()


def table(facts: Facts, batch: Batch) -> "pa.Table":
    """Return a batch as a table of Arrow, each column with its notation."""
    import pyarrow as pa

    return pa.table([pa.array(np.asarray(batch[name])) for name in facts.names], schema=schema(facts))


def schema(facts: Facts) -> "pa.Schema":
    """Return the columns as Arrow knows them, with symbol, unit and meaning; signals in single precision, as stored."""
    import pyarrow as pa

    return pa.schema(
        [
            pa.field(
                column.name,
                pa.float64() if column.name == "t" else pa.float32(),
                metadata={"unit": column.unit, "symbol": column.symbol, "meaning": column.meaning},
            )
            for column in facts.columns
        ]
    )


def read(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return facts and samples of what ``write`` wrote. Raises ImportRefusedError, or what a library raises."""
    lines = heading_lines(file)
    told = next((line for line in lines if line.startswith(_MARK)), None)
    if told is None:
        raise ImportRefusedError("it has no line that says which samples these are: it is no export of a run")
    facts = read_facts(told.removeprefix(_MARK))
    return facts, _batches(file, facts, len(lines))


def heading_lines(file: Path) -> list[str]:
    """Return the lines before the heading, which begin with #. Raises OSError, UnicodeDecodeError."""
    lines: list[str] = []
    with file.open(encoding="utf-8-sig") as text:  # editors put a byte order mark before the first line
        while (line := text.readline(_LONGEST)).startswith("#"):
            lines.append(line)
    return lines


def heading_problem(file: Path, facts: Facts) -> str:
    """Return how the lines before the samples are not those that belong to the facts, "" where they are.

    A person reads units and meanings there. Raises OSError, UnicodeDecodeError.
    """
    found, wanted = [line.rstrip("\n") for line in heading_lines(file)], _heading(facts).split("\n")[:-2]
    as_before = f"{_MARK}{facts.to_json()}"  # of a file from before cells were guarded
    for number, (line, due) in enumerate(zip_longest(found, wanted, fillvalue=""), start=1):
        if line not in (due, as_before if due.startswith(_MARK) else due):
            return f"line {number} is “{line[:_SHOWN]}” where “{due[:_SHOWN]}” belongs"
    return ""


def _batches(file: Path, facts: Facts, skip: int) -> Iterator[Batch]:
    import pyarrow
    import pyarrow.csv

    types = {name: pyarrow.float64() if name == "t" else pyarrow.float32() for name in facts.names}
    convert = pyarrow.csv.ConvertOptions(column_types=types, null_values=[], strings_can_be_null=False)
    reading = pyarrow.csv.ReadOptions(skip_rows=skip)
    with pyarrow.csv.open_csv(file, read_options=reading, convert_options=convert) as rows:
        if rows.schema.names != facts.names:
            raise ImportRefusedError("its heading does not name the columns that it says it has")
        for part in rows:
            yield {name: part.column(name).to_numpy(zero_copy_only=False) for name in facts.names}


def _heading(facts: Facts) -> str:
    told = [as_comment(f"{facts.of}, Sinew {facts.software}; {facts.notation}")]
    told += [as_comment(f"{one.name} [{one.unit}] {one.symbol}: {one.meaning}") for one in facts.columns]
    return "\n".join([*told, f"{_MARK}{as_json_cells(facts.to_json())}", ",".join(map(as_cell, facts.names))]) + "\n"
