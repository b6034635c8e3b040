from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.storage import Database, open_database


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
