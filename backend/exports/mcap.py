"""Samples as MCAP for Foxglove and Lichtblick, with a matching layout."""

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np

from backend.exports import messages, writers
from backend.exports.base import Batch, Export, Facts, ImportRefusedError, Sink, read_facts
from backend.sample import FIELDS

if TYPE_CHECKING:
    from mcap.records import Chunk, McapRecord


# Foxglove layout -----------------------------------------------------------------------------------
# Layout for Foxglove and Lichtblick, for an MCAP export or the live stream: plots as on the page, and a table.


TOPIC = "/sample"
"""Topic of the samples."""

_PLOTS: dict[str, tuple[str, ...]] = {
    "Joint position": ("q", "q_ref", "q_ref_gov"),
    "Joint stiffness": ("S", "S_ref", "S_ref_gov", "S_true"),
    "Motor positions": ("theta_A", "theta_A_ref", "theta_B", "theta_B_ref"),
    "Tendon forces": ("F_A", "F_B", "F_push"),
    "Motor voltages": ("u_A", "u_B"),
    "Mode, limits, fault": ("mode", "limits", "fault"),
}
_COLOURS = ("#1c7ed6", "#e8590c", "#2f9e44", "#862e9c")
_FIELD = {field.name: field for field in FIELDS}


def foxglove_layout() -> str:
    """Return the layout as a file that both programs import."""
    panels = {f"Plot!sinew{number}": _plot(title, names) for number, (title, names) in enumerate(_PLOTS.items())}
    table = {"RawMessages!sinew": {"topicPath": TOPIC, "expansion": "all", "diffEnabled": False}}
    left, right = list(panels)[::2], [*list(panels)[1::2]]
    document = {
        "configById": panels | table,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": {"direction": "row", "first": _column(left), "second": _column(right), "splitPercentage": 50},
            "second": "RawMessages!sinew",
            "splitPercentage": 80,
        },
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _plot(title: str, names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "title": f"{title} [{_FIELD[names[0]].unit}]",
        "foxglovePanelTitle": f"{title} [{_FIELD[names[0]].unit}]",
        "paths": [
            {
                "value": f"{TOPIC}.{name}",
                "label": _FIELD[name].symbol,
                "color": colour,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for name, colour in zip(names, _COLOURS, strict=False)
        ],
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }


def _column(panels: list[str]) -> Any:
    """Return panels in a column with equal heights."""
    if len(panels) == 1:
        return panels[0]
    share = 100.0 / len(panels)
    return {"direction": "column", "first": panels[0], "second": _column(panels[1:]), "splitPercentage": share}


# MCAP file -----------------------------------------------------------------------------------------
# Samples as MCAP, which Foxglove and Lichtblick play: a JSON message for each sample.


FACTS = "sinew"
"""Name of the metadata record."""
_LAYOUT = "foxglove-layout.json"
_BATCH = 10_000
_LARGEST = 8 << 20
"""Most bytes of a record, packed or not, that are read at once; a chunk has one million."""


def write(export: Export) -> Iterator[bytes]:
    """Yield the file. The time of a message is that of its sample.

    It counts from the start of the run.
    """
    from mcap.writer import Writer

    facts, sink = export.facts, Sink()
    writer = Writer(cast(IO[bytes], sink))
    writer.start(profile="", library=f"Sinew {facts.software}")
    writer.add_metadata(FACTS, {"facts": facts.to_json(), "notation": facts.notation})
    writer.add_attachment(0, 0, _LAYOUT, "application/json", foxglove_layout().encode())
    facts_schema = writers.json_schema(facts.columns, facts.notation)
    schema = writer.register_schema(writers.NAME, "jsonschema", facts_schema)
    channel = writer.register_channel(TOPIC, "json", schema, {"of": facts.of})
    began = 0 if facts.started_at is None else _nanoseconds(datetime.fromisoformat(facts.started_at))
    number = 0
    for batch in export.batches():
        stamps = began + np.rint(batch["t"] * 1e9).astype(np.int64)
        for stamp, text in zip(stamps.tolist(), writers.lines(facts.names, batch), strict=True):
            writer.add_message(channel, stamp, text, stamp, number)
            number = (number + 1) & 0xFFFFFFFF
        yield sink.take()
    writer.finish()  # type: ignore[no-untyped-call]  # the package does not say that it returns nothing
    yield sink.take()


def _nanoseconds(at: datetime) -> int:
    since = at.astimezone(UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1_000


def read_mcap(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return metadata and samples of a file of ``write``.

    Raises ImportRefusedError, or errors of a library.
    """
    from mcap.records import Metadata

    with file.open("rb") as opened:
        metadata = (one for one in _records(opened) if isinstance(one, Metadata) and one.name == FACTS)
        metadata_record = next(metadata, None)
    if metadata_record is None or "facts" not in metadata_record.metadata:
        raise ImportRefusedError(messages.mcap_without_metadata())
    facts = read_facts(metadata_record.metadata["facts"])

    def batches() -> Iterator[Batch]:
        rows: list[list[float | None]] = []
        for text in _messages(file):
            message = json.loads(text, parse_int=float)  # without float, -0 would lose its sign
            rows.append([message[name] for name in facts.names])
            if len(rows) == _BATCH:
                yield _batch(facts, rows)
                rows = []
        if rows:
            yield _batch(facts, rows)

    return facts, batches()


def _messages(file: Path) -> Iterator[bytes]:
    """Yield the messages with samples in file order, unpacking one chunk at a time."""
    from mcap.records import Channel, Chunk, Message
    from mcap.stream_reader import breakup_chunk

    channels: set[int] = set()
    with file.open("rb") as opened:
        chunks = (record for record in _records(opened) if isinstance(record, Chunk))
        for chunk in chunks:
            _require_small(chunk)
            for part in breakup_chunk(chunk, validate_crc=True):
                if isinstance(part, Channel) and part.topic == TOPIC:
                    channels.add(part.id)
                elif isinstance(part, Message) and part.channel_id in channels:
                    yield part.data


def _records(opened: IO[bytes]) -> "Iterator[McapRecord]":
    """Yield the records of a file, chunks unopened, none larger than ``_LARGEST``."""
    from mcap.stream_reader import StreamReader

    return StreamReader(opened, emit_chunks=True, record_size_limit=_LARGEST).records


def _require_small(chunk: "Chunk") -> None:
    """Raise ImportRefusedError for a chunk that would expand too much.

    Checked before unpacking, by the chunk's own numbers.
    """
    from zstandard import frame_content_size

    if chunk.compression not in ("", "zstd"):
        raise ImportRefusedError(messages.unknown_compression(compression=chunk.compression))
    inside = frame_content_size(chunk.data) if chunk.compression else len(chunk.data)
    if (size := max(inside, chunk.uncompressed_size)) > _LARGEST:
        raise ImportRefusedError(messages.chunk_too_large(size=size, maximum=_LARGEST))


def _batch(facts: Facts, rows: list[list[float | None]]) -> Batch:
    table = np.array(rows, np.float64)  # None becomes NaN
    return {
        name: table[:, place] if name == "t" else table[:, place].astype(np.float32)
        for place, name in enumerate(facts.names)
    }
