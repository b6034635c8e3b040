"""Reason why a run could not be evaluated."""

import sqlalchemy as sa
from alembic import op

revision = "0004_evaluation_problem"
down_revision = "0003_recording_size"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the column, empty for earlier runs."""
    op.add_column("run", sa.Column("evaluation_problem", sa.Text(), nullable=False, server_default=""))


def downgrade() -> None:
    """Drop the column."""
    with op.batch_alter_table("run") as table:
        table.drop_column("evaluation_problem")
