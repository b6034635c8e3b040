from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.services.downloads import stream_bundle
from backend.storage.database import Database, open_database
from tests.exports.stored import tracked


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Database]:
    """Return the installation that exports."""
    opened = open_database(tmp_path / "here")
    yield opened
    opened.close()


@pytest.fixture
def there(tmp_path: Path) -> Iterator[Database]:
    """Return an empty installation."""
    opened = open_database(tmp_path / "there")
    yield opened
    opened.close()


@pytest.fixture
def run(here: Database) -> int:
    """Store a tracking run with its lineage; return its number."""
    return tracked(here)


@pytest.fixture
def file(here: Database, run: int, tmp_path: Path) -> Path:
    """Write the bundle of the run; return its path."""
    found = tmp_path / "run.zip"
    found.write_bytes(b"".join(stream_bundle(here, run, tmp_path)))
    return found
