"""Samples as comma-separated text, as Parquet and as JSON messages."""

import io
import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from backend.exports import messages
from backend.exports.base import Batch, Described, Export, Facts, ImportRefusedError, Sink, read_facts
from backend.plain_text import escape_json_for_csv, format_csv_cell, format_csv_comment

if TYPE_CHECKING:
    import pyarrow as pa


# CSV file ------------------------------------------------------------------------------------------
# Samples as comma-separated text: metadata in lines that begin with #, a header, a line per sample.


_MARK = "# sinew-export: "
_LONGEST = 16_000_000
"""Most characters of a line of metadata: parameters and settings of a run have some ten thousand."""


_SHOWN = 100
"""Most characters of a line in a message."""


def write_csv(export: Export) -> Iterator[bytes]:
    """Yield the file; missing values are nan, and numbers are written exactly."""
    import pyarrow.csv

    facts = export.facts
    yield _make_heading(facts).encode()
    plain = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
    for batch in export.batches():
        buffer = io.BytesIO()
        pyarrow.csv.write_csv(table(facts, batch), buffer, plain)
        yield buffer.getvalue()


def table(facts: Facts, batch: Batch) -> "pa.Table":
    """Return a batch as an Arrow table, each column with its notation."""
    import pyarrow as pa

    return pa.table([pa.array(np.asarray(batch[name])) for name in facts.names], schema=csv_schema(facts))


def csv_schema(facts: Facts) -> "pa.Schema":
    """Return the Arrow schema of the columns, with symbol, unit and meaning.

    Signals are in single precision, as stored.
    """
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


def read_csv(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return metadata and samples of a file of ``write_csv``.

    Raises ImportRefusedError, or errors of a library.
    """
    lines = heading_lines(file)
    facts_line = next((line for line in lines if line.startswith(_MARK)), None)
    if facts_line is None:
        raise ImportRefusedError(messages.csv_without_metadata())
    facts = read_facts(facts_line.removeprefix(_MARK))
    return facts, _batches(file, facts, len(lines))


def heading_lines(file: Path) -> list[str]:
    """Return the lines with # before the header. Raises OSError, UnicodeDecodeError."""
    lines: list[str] = []
    with file.open(encoding="utf-8-sig") as text:  # some editors write a BOM before the first line
        while (line := text.readline(_LONGEST)).startswith("#"):
            lines.append(line)
    return lines


def find_heading_problem(file: Path, facts: Facts) -> str:
    """Return how the lines before the samples differ from the metadata, "" if equal.

    People read units and meanings there. Raises OSError, UnicodeDecodeError.
    """
    found, wanted = [line.rstrip("\n") for line in heading_lines(file)], _make_heading(facts).split("\n")[:-2]
    as_before = f"{_MARK}{facts.to_json()}"  # of a file from before cells were escaped
    for number, (line, due) in enumerate(zip_longest(found, wanted, fillvalue=""), start=1):
        if line not in (due, as_before if due.startswith(_MARK) else due):
            return messages.heading_line_differs(line_number=number, line=line, expected=due, maximum=_SHOWN)
    return ""


def _batches(file: Path, facts: Facts, skip: int) -> Iterator[Batch]:
    import pyarrow
    import pyarrow.csv

    types = {name: pyarrow.float64() if name == "t" else pyarrow.float32() for name in facts.names}
    convert = pyarrow.csv.ConvertOptions(column_types=types, null_values=[], strings_can_be_null=False)
    reading = pyarrow.csv.ReadOptions(skip_rows=skip)
    with pyarrow.csv.open_csv(file, read_options=reading, convert_options=convert) as rows:
        if rows.schema.names != facts.names:
            raise ImportRefusedError(messages.header_row_differs())
        for part in rows:
            yield {name: part.column(name).to_numpy(zero_copy_only=False) for name in facts.names}


def _make_heading(facts: Facts) -> str:
    lines = [format_csv_comment(messages.heading(content=facts.of, software=facts.software, notation=facts.notation))]
    lines += [format_csv_comment(f"{one.name} [{one.unit}] {one.symbol}: {one.meaning}") for one in facts.columns]
    return (
        "\n".join(
            [*lines, f"{_MARK}{escape_json_for_csv(facts.to_json())}", ",".join(map(format_csv_cell, facts.names))]
        )
        + "\n"
    )


# JSON samples --------------------------------------------------------------------------------------
# A sample as a JSON message, and the schema of such messages, for Foxglove and Lichtblick.
#
# JSON has no NaN or infinity: NaN is null, infinity 1e999, which JSON readers take for infinity.


NAME = "sinew.Sample"
"""Name of the schema."""


def json_schema(columns: Iterable[Described], notation: str) -> bytes:
    """Return the JSON schema of a sample with these columns.

    Each property has a single type, because Lichtblick does not accept lists of types; null is therefore not declared.
    """
    document = {
        "title": NAME,
        "description": notation,
        "type": "object",
        "properties": {
            column.name: {
                "type": "number",
                "title": column.symbol,
                "description": f"{column.meaning} [{column.unit}]",
                "unit": column.unit,
            }
            for column in columns
        },
    }
    return json.dumps(document, ensure_ascii=False).encode()


def lines(names: Sequence[str], batch: Batch) -> list[bytes]:
    """Return a line of JSON per sample, written column by column.

    That takes a tenth of the time of writing sample by sample.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    parts: list[Any] = []
    for place, name in enumerate(names):
        parts += [("{" if place == 0 else ",") + json.dumps(name) + ":", _format_numbers(batch[name])]
    joined = pc.binary_join_element_wise(*parts, "}", "")
    written: list[bytes] = joined.cast(pa.binary()).to_pylist()
    return written


def _format_numbers(values: NDArray[Any]) -> "pa.Array":
    import pyarrow as pa
    import pyarrow.compute as pc

    text = pa.array(values).cast(pa.string())
    if np.isfinite(values).all():
        return text
    for odd, word in ((np.isnan(values), "null"), (values == np.inf, "1e999"), (values == -np.inf, "-1e999")):
        text = pc.if_else(pa.array(odd), word, text)
    return text


# Parquet file --------------------------------------------------------------------------------------
# Samples as Parquet: a row group per batch, notation with each column, metadata with the file.


FACTS = "sinew"
"""Key of the metadata in the file."""
_ROWS = 50_000
_LARGEST_GROUP = 64_000_000
"""Most bytes of a row group, unpacked."""


def write_parquet(export: Export) -> Iterator[bytes]:
    """Yield the file."""
    import pyarrow.parquet

    facts, sink = export.facts, Sink()
    columns = csv_schema(facts).with_metadata({FACTS: facts.to_json(), "notation": facts.notation})
    with pyarrow.parquet.ParquetWriter(sink, columns, compression="zstd") as writer:
        for batch in export.batches():
            writer.write_table(table(facts, batch).replace_schema_metadata(columns.metadata))
            yield sink.take()
    yield sink.take()


def read_parquet(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return metadata and samples of a file of ``write_parquet``.

    Raises ImportRefusedError, or errors of a library.
    """
    import pyarrow.parquet

    opened = pyarrow.parquet.ParquetFile(file, pre_buffer=False)  # pre_buffer would hold the whole file
    facts_text = (opened.schema_arrow.metadata or {}).get(FACTS.encode())
    if facts_text is None:
        raise ImportRefusedError(messages.parquet_without_metadata())
    facts = read_facts(facts_text)
    groups = [opened.metadata.row_group(number) for number in range(opened.metadata.num_row_groups)]
    if opened.schema_arrow.names != facts.names or opened.metadata.num_rows != facts.samples:
        raise ImportRefusedError(messages.columns_or_samples_differ())
    if any(group.total_byte_size > _LARGEST_GROUP for group in groups):
        raise ImportRefusedError(messages.row_groups_too_large())

    def batches() -> Iterator[Batch]:
        with opened:
            for part in opened.iter_batches(_ROWS):
                yield {name: part.column(name).to_numpy(zero_copy_only=False) for name in facts.names}

    return facts, batches()


def find_schema_problem(file: Path, facts: Facts) -> str:
    """Return how the columns' notation differs from the metadata, "" if equal."""
    import pyarrow.parquet

    for found, due in zip(pyarrow.parquet.read_schema(file), csv_schema(facts), strict=True):
        if (found.metadata or {}) != due.metadata:
            metadata = {key.decode(): value.decode("utf-8", "replace") for key, value in (found.metadata or {}).items()}
            return messages.column_metadata_differ(column=found.name, metadata=metadata)
    return ""
