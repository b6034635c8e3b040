"""Room for the method of an identification whose channels were estimated by different estimators."""

import sqlalchemy as sa
from alembic import op

revision = "0013_method_length"
down_revision = "0012_chunk_digest"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make room for 200 characters."""
    _resize(40, 200)


def downgrade() -> None:
    """Go back to 40; a longer method is cut, which PostgreSQL would refuse."""
    op.execute("UPDATE identification SET method = SUBSTR(method, 1, 40)")
    _resize(200, 40)


def _resize(before: int, after: int) -> None:
    """SQLite makes the table anew; the highest number given out has to be restored, so that none is used twice."""
    connection = op.get_bind()
    is_sqlite = connection.dialect.name == "sqlite"
    of_table = "FROM sqlite_sequence WHERE name = 'identification'"
    given_out = connection.scalar(sa.text(f"SELECT seq {of_table}")) if is_sqlite else None
    with op.batch_alter_table("identification", table_kwargs={"sqlite_autoincrement": True}) as table:
        table.alter_column("method", existing_type=sa.String(before), type_=sa.String(after), existing_nullable=False)
    if given_out is not None:
        connection.execute(sa.text(f"DELETE {of_table}"))
        connection.execute(sa.text("INSERT INTO sqlite_sequence VALUES ('identification', :seq)"), {"seq": given_out})
