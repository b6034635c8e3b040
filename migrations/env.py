"""How Alembic reaches the database: over the connection it is handed, or the URL of alembic.ini for developers."""

from alembic import context
from sqlalchemy import Connection

from backend.storage import FormulaRow, QueuedRow, RunIndexRow, StudyRow, connect_database

# Each module of tables has to be loaded for them to be known.
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
