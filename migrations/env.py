"""Connection of Alembic to the database: a given one, or the URL of alembic.ini.

The URL is for developers.
"""

from alembic import context
from sqlalchemy import Connection

from backend.storage import FormulaRow, QueuedRow, RunIndexRow, StudyRow, connect_database

# All modules with tables must be imported, so that their tables are registered.
METADATA = RunIndexRow.metadata
assert StudyRow.metadata is QueuedRow.metadata is FormulaRow.metadata is METADATA


def _migrate(connection: Connection) -> None:
    context.configure(connection=connection, target_metadata=METADATA, render_as_batch=True, transactional_ddl=True)
    with context.begin_transaction():
        context.run_migrations()


handed_over: Connection | None = context.config.attributes.get("connection")
if handed_over is not None:
    _migrate(handed_over)
else:
    url = context.config.get_main_option("sqlalchemy.url")
    if url is None:
        raise RuntimeError("alembic.ini names no sqlalchemy.url")
    with connect_database(url).begin() as opened:
        _migrate(opened)
