"""Long ranges are read in a process of their own, with the same result, and no longer than somebody waits."""

import asyncio
import multiprocessing

import numpy as np
import pytest

from backend.errors import OutOfRangeError, RequestRejectedError
from backend.services import signals
from backend.services.signals import RangeAnalysis, RangeQuery, stream_statistics
from backend.storage.database import Database
from tests.recording.stored_run import store_run

COUNT = 120_000


@pytest.fixture
def asked(database: Database) -> RangeQuery:
    run = store_run(database, {"q": np.sin(np.arange(COUNT) * 1e-3)})
    return RangeQuery(run, 0.0, None, ("q", "u_A"))


@pytest.mark.parametrize("at_hand", [COUNT, 1000])
def test_threads_and_process_give_the_same_lines(
    database: Database, asked: RangeQuery, at_hand: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signals, "AT_HAND_SAMPLES", at_hand)

    async def read() -> tuple[bytes, int]:
        stream = await RangeAnalysis(database).stream_statistics(asked)
        beside = len(multiprocessing.active_children())
        return b"".join([piece async for piece in stream]), beside

    found, beside = asyncio.run(read())
    assert found == b"".join(stream_statistics(database, asked))
    assert beside == int(at_hand < COUNT)


@pytest.mark.parametrize("at_hand", [COUNT, 1000])
def test_a_stream_that_is_left_frees_its_place(
    database: Database, asked: RangeQuery, at_hand: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signals, "AT_HAND_SAMPLES", at_hand)
    monkeypatch.setattr(signals, "MAX_RANGES", 1)

    async def leave() -> None:
        recorded = RangeAnalysis(database)
        left = await recorded.stream_statistics(asked)
        with pytest.raises(RequestRejectedError) as refused:
            await recorded.stream_spectra(asked)
        assert refused.value.retry_after_s > 0
        await left.aclose()
        assert not multiprocessing.active_children()
        with pytest.raises(OutOfRangeError):  # what is refused takes no place
            await recorded.stream_csv(RangeQuery(asked.run, COUNT, None, ("q",)))
        lines = b"".join([piece async for piece in await recorded.stream_statistics(asked)])
        assert lines.count(b"\n") > 1

    asyncio.run(leave())
