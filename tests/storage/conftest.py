from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.storage.database import Database, open_database
from tests.postgres import new_database, postgres_server


@pytest.fixture(scope="session")
def postgres() -> Iterator[str]:
    """URL of a PostgreSQL server of our own."""
    with postgres_server() as url:
        yield url


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Database]:
    """An empty database, on each of the two kinds in use."""
    url = None
    if request.param == "postgresql":
        name = f"test_{tmp_path.name.lower()}".translate({ord(c): "_" for c in "[]-"})[:60]
        url = new_database(request.getfixturevalue("postgres"), name)
    opened = open_database(tmp_path, url)
    yield opened
    opened.close()


@pytest.fixture
def sqlite(tmp_path: Path) -> Iterator[Database]:
    """An empty SQLite database in ``tmp_path``."""
    opened = open_database(tmp_path)
    yield opened
    opened.close()
