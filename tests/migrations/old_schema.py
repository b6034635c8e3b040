"""Databases as an earlier version of the program left them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from sqlalchemy import Engine

from backend.storage import database
from backend.storage.database import Database, connect_database, open_database, sqlite_url


@contextmanager
def at_revision(data_dir: Path, revision: str) -> Iterator[Engine]:
    """Make the database of a data folder with an earlier schema."""
    data_dir.mkdir(parents=True, exist_ok=True)
    engine = connect_database(sqlite_url(data_dir))
    with engine.connect() as connection, database._free_to_rebuild_tables(connection), connection.begin():
        command.upgrade(database._configuration(connection), revision)
    try:
        yield engine
    finally:
        engine.dispose()


def migrated(opened: Database, data_dir: Path, revision: str) -> Database:
    """Return a database opened again, after a downgrade to a revision."""
    with opened.engine.connect() as connection, database._free_to_rebuild_tables(connection), connection.begin():
        command.downgrade(database._configuration(connection), revision)
    opened.close()
    return open_database(data_dir, None if opened.file else opened.engine.url.render_as_string(hide_password=False))
