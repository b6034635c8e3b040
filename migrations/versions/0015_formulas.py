"""Formulas of derived signals of a station; each change is a new row."""

import sqlalchemy as sa
from alembic import op

revision = "0015_formulas"
down_revision = "0014_queue"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "formula",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("station", sa.String(40), nullable=False, server_default=""),
        sa.Column("name", sa.String(20), nullable=False),
        sa.Column("expression", sa.Text(), nullable=False),
        sa.Column("steps", sa.JSON(), nullable=False),
        sa.Column("unit", sa.String(20), nullable=False),
        sa.Column("meaning", sa.Text(), nullable=False),
        sa.Column("removed", sa.Boolean(), nullable=False),
        sa.Column("who", sa.String(200), nullable=False),
        sa.Column("at", sa.DateTime(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_formula_station", "formula", ["station"])
    op.create_index("ix_formula_name", "formula", ["name"])


def downgrade() -> None:
    """Drop the table; the formulas are lost."""
    op.drop_table("formula")
