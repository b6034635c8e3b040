"""Samples as MCAP, which Foxglove and Lichtblick play: a message in JSON for each sample."""

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, cast

import numpy as np

from backend.exports import json_samples
from backend.exports.errors import ImportRefusedError
from backend.exports.facts import Batch, Facts, read_facts
from backend.exports.foxglove_layout import TOPIC, layout
from backend.exports.sink import Sink
from backend.exports.source import Export

FACTS = "sinew"
"""Name of the metadata record with the facts."""
_LAYOUT = "foxglove-layout.json"
_BATCH = 10_000


def write(export: Export) -> Iterator[bytes]:
    """Yield the file. The time of a message is that of its sample, from the moment the run began."""
    from mcap.writer import Writer

    facts, sink = export.facts, Sink()
    writer = Writer(cast(IO[bytes], sink))
    writer.start(profile="", library=f"Sinew {facts.software}")
    writer.add_metadata(FACTS, {"facts": facts.to_json(), "notation": facts.notation})
    writer.add_attachment(0, 0, _LAYOUT, "application/json", layout().encode())
    told = json_samples.schema(facts.columns, facts.notation)
    schema = writer.register_schema(json_samples.NAME, "jsonschema", told)
    channel = writer.register_channel(TOPIC, "json", schema, {"of": facts.of})
    began = 0 if facts.started_at is None else _nanoseconds(datetime.fromisoformat(facts.started_at))
    number = 0
    for batch in export.batches():
        stamps = began + np.rint(batch["t"] * 1e9).astype(np.int64)
        for stamp, text in zip(stamps.tolist(), json_samples.lines(facts.names, batch), strict=True):
            writer.add_message(channel, stamp, text, stamp, number)
            number = (number + 1) & 0xFFFFFFFF
        yield sink.taken()
    writer.finish()  # type: ignore[no-untyped-call]  # the package does not say that it returns nothing
    yield sink.taken()


def _nanoseconds(at: datetime) -> int:
    since = at.astimezone(UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1_000


def read(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return facts and samples of what ``write`` wrote. Raises ImportRefusedError, or what a library raises."""
    from mcap.reader import SeekingReader

    with file.open("rb") as opened:
        told = next((one for one in SeekingReader(opened).iter_metadata() if one.name == FACTS), None)
    if told is None or "facts" not in told.metadata:
        raise ImportRefusedError("it does not say which samples these are: it is no export of a run")
    facts = read_facts(told.metadata["facts"])

    def batches() -> Iterator[Batch]:
        rows: list[list[float | None]] = []
        with file.open("rb") as opened:
            for _, _, message in SeekingReader(opened, validate_crcs=True).iter_messages(topics=[TOPIC]):
                said = json.loads(message.data, parse_int=float)  # or -0 would lose its sign
                rows.append([said[name] for name in facts.names])
                if len(rows) == _BATCH:
                    yield _batch(facts, rows)
                    rows = []
        if rows:
            yield _batch(facts, rows)

    return facts, batches()


def _batch(facts: Facts, rows: list[list[float | None]]) -> Batch:
    table = np.array(rows, np.float64)  # None becomes nan
    return {
        name: table[:, place] if name == "t" else table[:, place].astype(np.float32)
        for place, name in enumerate(facts.names)
    }
