"""Eight hours exported in every format, each in its own process: the additional memory.

The recording consists of sixty variants of one second of noise, stored as by the recorder; the content does not affect
the memory of the export.
"""

import multiprocessing
import resource
import shutil
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from rich.console import Console

from backend.exports.base import export_run
from backend.exports.formats import DataFormat, stream_export
from backend.recording.codec import pack_table, summarize_buckets
from backend.recording.recorder import CHUNK_TICKS
from backend.sample import STORED_NAMES
from backend.storage import recordings, runs
from backend.storage.database import open_database
from backend.storage.recordings import Chunk
from backend.storage.runs import EndState, NewRun, RunKind
from plant.interface import T_s

HOURS = 8.0
MOST_MB = 300.0
"""Above idle."""
_ALIKE = 60


def long_exports(hours: float, console: Console) -> bool:
    """Export ``hours`` in every format and print the peaks; return whether all stay below ``MOST_MB``."""
    folder = Path(tempfile.mkdtemp(prefix="sinew-exports-"))
    try:
        run = _recorded(folder, round(hours * 3600))
        found = [_measured(folder, run, kind, hours, console) for kind in DataFormat]
    finally:
        shutil.rmtree(folder)
    return all(found)


def _recorded(folder: Path, seconds: int) -> int:
    random = np.random.default_rng(0)
    shape = (CHUNK_TICKS, len(STORED_NAMES))
    tables = [random.normal(0.4, 0.01, shape).astype(np.float32) for _ in range(_ALIKE)]
    for table in tables:
        table[:, STORED_NAMES.index("S_true")] = np.nan
    packed = [(pack_table(summarize_buckets(table)), pack_table(table)) for table in tables]
    database = open_database(folder)
    try:
        with database.session() as session:
            run = runs.create(session, NewRun(RunKind.SESSION, "simulator", "lab", {}, "soak", "0")).id
            recordings.begin(session, run, list(STORED_NAMES), T_s)
        for begin in range(0, seconds, _ALIKE):
            chunks = [
                Chunk(second * CHUNK_TICKS, CHUNK_TICKS, *packed[second % _ALIKE])
                for second in range(begin, min(begin + _ALIKE, seconds))
            ]
            with database.session() as session:
                recordings.add_chunks(session, run, chunks)
        with database.session() as session:
            runs.end(session, run, EndState.COMPLETED)
    finally:
        database.close()
    return run


def _measured(folder: Path, run: int, kind: DataFormat, hours: float, console: Console) -> bool:
    mine, its = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_export, args=(its, folder, run, kind))
    process.start()
    its.close()
    idle, peak, size, took = mine.recv()
    process.join()
    above = (peak - idle) / 1e6
    console.print(
        f"{hours:g} h as {kind}: {size / 1e9:.2f} GB in {took:.0f} s, {above:.0f} MB above {idle / 1e6:.0f} MB idle"
    )
    return bool(above < MOST_MB)


def _export(connection: Connection, folder: Path, run: int, kind: DataFormat) -> None:
    """Write one format to nowhere, as a download does, and send its memory and duration [bytes, s]."""
    import mcap.writer
    import pyarrow.compute
    import pyarrow.csv
    import pyarrow.parquet
    import scipy.io

    assert all((mcap.writer, pyarrow.compute, pyarrow.csv, pyarrow.parquet, scipy.io))
    database = open_database(folder)
    idle, began, size = _peak(), time.monotonic(), 0
    for piece in stream_export(export_run(database, run), kind, folder):
        size += len(piece)
    connection.send((idle, _peak(), size, time.monotonic() - began))
    database.close()


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
