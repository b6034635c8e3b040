from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.realtime.ring_buffer import Ring
from backend.storage.database import Database, open_database
from tests.recording.stand_in import Writer


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def writer() -> Iterator[Writer]:
    ring = Ring.create(8192)
    yield Writer(ring)
    ring.close()


@pytest.fixture
def long_writer() -> Iterator[Writer]:
    ring = Ring.create()
    yield Writer(ring)
    ring.close()
