"""Longer method of an identification, for channels with different estimators."""

import sqlalchemy as sa
from alembic import op

revision = "0013_method_length"
down_revision = "0012_chunk_digest"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Extend the column to 200 characters."""
    _resize(40, 200)


def downgrade() -> None:
    """Reduce the column to 40 characters, cutting longer methods.

    PostgreSQL would reject longer ones.
    """
    op.execute("UPDATE identification SET method = SUBSTR(method, 1, 40)")
    _resize(200, 40)


def _resize(before: int, after: int) -> None:
    """Change the length of the column.

    SQLite recreates the table, so the highest number used must be restored explicitly.
    """
    connection = op.get_bind()
    is_sqlite = connection.dialect.name == "sqlite"
    of_table = "FROM sqlite_sequence WHERE name = 'identification'"
    given_out = connection.scalar(sa.text(f"SELECT seq {of_table}")) if is_sqlite else None
    with op.batch_alter_table("identification", table_kwargs={"sqlite_autoincrement": True}) as table:
        table.alter_column("method", existing_type=sa.String(before), type_=sa.String(after), existing_nullable=False)
    if given_out is not None:
        connection.execute(sa.text(f"DELETE {of_table}"))
        connection.execute(sa.text("INSERT INTO sqlite_sequence VALUES ('identification', :seq)"), {"seq": given_out})
