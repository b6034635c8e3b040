"""Signals that follow from others, of recordings longer than an hour: over all of them, and beside the service."""

import asyncio
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.recording.codec import pack_table, summarise_buckets
from backend.recording.reader import AT_HAND_SAMPLES, read_envelope
from backend.recording.recorder import CHUNK_TICKS
from backend.sample import STORED_NAMES
from backend.services.runs import SampleSlice, StoredRuns
from backend.storage import recordings, runs
from backend.storage.database import Database, open_database
from backend.storage.recordings import Chunk
from backend.storage.runs import NewRun, RunKind
from backend.workers import WorkerProcess
from plant.interface import T_s

SECONDS = 3 * 3600 + 7
"""No whole number of hours, and not as many seconds as are unpacked at once."""
R_M, R_J = 0.0075, 0.075
SPIKES = {5: 0.25, 4000: -0.5, SECONDS - 1: 0.125}
"""Seconds of which one sample has another error q - q_ref [rad] than 0."""
AT = 321


@pytest.fixture(scope="module")
def long_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Database, int]]:
    """A recording as it is stored, made of seconds at rest, and of some with a spike of a millisecond."""
    database = open_database(tmp_path_factory.mktemp("long"))
    geometry = {"r_m": {"value": R_M}, "r_j": {"value": R_J}}
    with database.session() as session:
        new = NewRun(RunKind.SESSION, "simulator", "ideal", {"geometry": geometry}, "Ana", "0.1.0")
        run = runs.create(session, new).id
        recordings.begin(session, run, list(STORED_NAMES), T_s)
    packed = {error: packed_second(error) for error in (0.0, *SPIKES.values())}
    with database.session() as session:
        chunks = [
            Chunk(second * CHUNK_TICKS, CHUNK_TICKS, *packed[SPIKES.get(second, 0.0)]) for second in range(SECONDS)
        ]
        recordings.add_chunks(session, run, chunks)
    yield database, run
    database.close()


def packed_second(error: float) -> tuple[bytes, bytes]:
    table: NDArray[np.float32] = np.zeros((CHUNK_TICKS, len(STORED_NAMES)), np.float32)
    q, q_ref, theta_A = (STORED_NAMES.index(name) for name in ("q", "q_ref", "theta_A"))
    # both move by more than the error: the extremes of a difference are not differences of extremes
    table[:, q] = table[:, q_ref] = np.sin(np.arange(CHUNK_TICKS))
    table[:, theta_A] = 2.0
    table[AT, q] += np.float32(error)
    return pack_table(summarise_buckets(table)), pack_table(table)


def test_the_whole_of_a_long_recording_has_the_extremes_of_every_sample(long_run: tuple[Database, int]) -> None:
    database, run = long_run
    with database.reading() as session:
        found = read_envelope(session, run, 2000, ["q - q_ref", "x_A"])
    low, high = found.minimum["q - q_ref"], found.maximum["q - q_ref"]
    assert found.t[-1] + found.width_s >= SECONDS
    expected = np.zeros((2, len(found.t)))
    for second, error in SPIKES.items():
        expected[int(error > 0), int((second + AT * T_s) // found.width_s)] = error
    np.testing.assert_allclose(low, expected[0], atol=1e-6)
    np.testing.assert_allclose(high, expected[1], atol=1e-6)
    q = np.sin(np.arange(CHUNK_TICKS))
    assert np.median(found.minimum["x_A"]) == pytest.approx(R_M * 2.0 - R_J * q.max(), rel=1e-5)


def test_what_reads_that_many_samples_is_read_in_the_process_beside_the_service(
    long_run: tuple[Database, int],
) -> None:
    database, run = long_run
    deaths: list[str] = []
    lengths_s = {"at hand": AT_HAND_SAMPLES * T_s, "too long": AT_HAND_SAMPLES * T_s + 1.0}

    async def asked() -> dict[str, tuple[bytes, bool]]:
        worker = WorkerProcess(deaths.append)
        stored = StoredRuns(database, lambda: None, lambda _run: False, worker)
        try:
            found = {}
            for name, to_s in lengths_s.items():
                curves = await stored.pack_samples(SampleSlice(run, 0.0, to_s, 500, ["q", "q - q_ref"]))
                found[name] = (curves, worker._pool is not None)
            return found
        finally:
            worker.close()

    async def directly(to_s: float) -> bytes:
        stored = StoredRuns(database, lambda: None, lambda _run: False)
        return await stored.pack_samples(SampleSlice(run, 0.0, to_s, 500, ["q", "q - q_ref"]))

    found = asyncio.run(asked())
    assert {name: elsewhere for name, (_, elsewhere) in found.items()} == {"at hand": False, "too long": True}
    for name, (curves, _) in found.items():
        assert curves == asyncio.run(directly(lengths_s[name]))
    assert not deaths
