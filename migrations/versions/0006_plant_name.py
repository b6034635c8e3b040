"""Longer names of plants, for those of packages."""

import sqlalchemy as sa
from alembic import op

revision = "0006_plant_name"
down_revision = "0005_bring_up"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Extend the column to 100 characters."""
    _resize(20, 100)


def downgrade() -> None:
    """Reduce the column to 20 characters, cutting longer names.

    PostgreSQL would reject longer ones.
    """
    op.execute("UPDATE run SET plant = SUBSTR(plant, 1, 20)")
    _resize(100, 20)


def _resize(before: int, after: int) -> None:
    """Change the length of the column.

    SQLite recreates the table, so the highest number used must be restored explicitly.
    """
    connection = op.get_bind()
    is_sqlite = connection.dialect.name == "sqlite"
    given_out = connection.scalar(sa.text("SELECT seq FROM sqlite_sequence WHERE name = 'run'")) if is_sqlite else None
    with op.batch_alter_table("run", table_kwargs={"sqlite_autoincrement": True}) as table:
        table.alter_column("plant", existing_type=sa.String(before), type_=sa.String(after), existing_nullable=False)
    if given_out is not None:
        connection.execute(sa.text("DELETE FROM sqlite_sequence WHERE name = 'run'"))
        connection.execute(sa.text("INSERT INTO sqlite_sequence VALUES ('run', :seq)"), {"seq": given_out})
