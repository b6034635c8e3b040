"""Queued experiments, which survive a restart."""

import sqlalchemy as sa
from alembic import op

revision = "0014_queue"
down_revision = "0013_method_length"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "queued_experiment",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("station", sa.String(40), nullable=False, server_default=""),
        sa.Column("place", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("settings", sa.JSON(), nullable=False),
        sa.Column("who", sa.String(200), nullable=False),
        sa.Column("added_at", sa.DateTime(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_queued_experiment_station", "queued_experiment", ["station"])


def downgrade() -> None:
    """Drop the table; queued experiments are lost."""
    op.drop_table("queued_experiment")
