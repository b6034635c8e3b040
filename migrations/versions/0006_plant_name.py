"""Names of plants may be as long as those that packages give them."""

import sqlalchemy as sa
from alembic import op

revision = "0006_plant_name"
down_revision = "0005_bring_up"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make room for 100 characters."""
    _resize(20, 100)


def downgrade() -> None:
    """Go back to 20; a longer name is cut, which PostgreSQL would refuse."""
    op.execute("UPDATE run SET plant = SUBSTR(plant, 1, 20)")
    _resize(100, 20)


def _resize(before: int, after: int) -> None:
    """SQLite makes the table anew; that no number is given out twice has to be kept by hand."""
    connection = op.get_bind()
    is_sqlite = connection.dialect.name == "sqlite"
    given_out = connection.scalar(sa.text("SELECT seq FROM sqlite_sequence WHERE name = 'run'")) if is_sqlite else None
    with op.batch_alter_table("run", table_kwargs={"sqlite_autoincrement": True}) as table:
        table.alter_column("plant", existing_type=sa.String(before), type_=sa.String(after), existing_nullable=False)
    if given_out is not None:
        connection.execute(sa.text("DELETE FROM sqlite_sequence WHERE name = 'run'"))
        connection.execute(sa.text("INSERT INTO sqlite_sequence VALUES ('run', :seq)"), {"seq": given_out})
