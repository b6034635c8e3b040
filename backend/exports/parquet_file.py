"""Samples as Parquet: a row group for each batch, notation with each column, facts with the file."""

from collections.abc import Iterator
from pathlib import Path

from backend.exports.csv_file import schema, table
from backend.exports.errors import ImportRefusedError
from backend.exports.facts import Batch, Facts, read_facts
from backend.exports.sink import Sink
from backend.exports.source import Export

FACTS = "sinew"
"""Name of the facts in the metadata of the file."""
_ROWS = 50_000
_LARGEST_GROUP = 64_000_000
"""Bytes of a group of rows, unpacked."""


def write(export: Export) -> Iterator[bytes]:
    """Yield the file."""
    import pyarrow.parquet

    facts, sink = export.facts, Sink()
    columns = schema(facts).with_metadata({FACTS: facts.to_json(), "notation": facts.notation})
    with pyarrow.parquet.ParquetWriter(sink, columns, compression="zstd") as writer:
        for batch in export.batches():
            writer.write_table(table(facts, batch).replace_schema_metadata(columns.metadata))
            yield sink.taken()
    yield sink.taken()


def read(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return facts and samples of what ``write`` wrote. Raises ImportRefusedError, or what a library raises."""
    import pyarrow.parquet

    opened = pyarrow.parquet.ParquetFile(file, pre_buffer=False)  # or it would hold all of the file
    told = (opened.schema_arrow.metadata or {}).get(FACTS.encode())
    if told is None:
        raise ImportRefusedError("its metadata do not say which samples these are: it is no export of a run")
    facts = read_facts(told)
    groups = [opened.metadata.row_group(number) for number in range(opened.metadata.num_row_groups)]
    if opened.schema_arrow.names != facts.names or opened.metadata.num_rows != facts.samples:
        raise ImportRefusedError("it has not the columns or the samples that it says it has")
    if any(group.total_byte_size > _LARGEST_GROUP for group in groups):
        raise ImportRefusedError("it has larger groups of rows than an export of a run")

    def batches() -> Iterator[Batch]:
        with opened:
            for part in opened.iter_batches(_ROWS):
                yield {name: part.column(name).to_numpy(zero_copy_only=False) for name in facts.names}

    return facts, batches()


def schema_problem(file: Path, facts: Facts) -> str:
    """Return how units, symbols and meanings of the columns are not those of the facts, "" where they are."""
    import pyarrow.parquet

    for found, due in zip(pyarrow.parquet.read_schema(file), schema(facts), strict=True):
        if (found.metadata or {}) != due.metadata:
            said = {key.decode(): value.decode("utf-8", "replace") for key, value in (found.metadata or {}).items()}
            return f"{found.name} has {said}"
    return ""
