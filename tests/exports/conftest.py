from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.services.downloads import stream_bundle
from backend.storage.database import Database, open_database
from tests.exports.stored import tracked


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Database]:
    """The installation that exports."""
    opened = open_database(tmp_path / "here")
    yield opened
    opened.close()


@pytest.fixture
def there(tmp_path: Path) -> Iterator[Database]:
    """One that is empty."""
    opened = open_database(tmp_path / "there")
    yield opened
    opened.close()


@pytest.fixture
def run(here: Database) -> int:
    """A tracking run with all that it came from."""
    return tracked(here)


@pytest.fixture
def file(here: Database, run: int, tmp_path: Path) -> Path:
    """Its bundle."""
    found = tmp_path / "run.zip"
    found.write_bytes(b"".join(stream_bundle(here, run, tmp_path)))
    return found
