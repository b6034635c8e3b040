"""Size of recordings, and the time at which their samples were deleted."""

import sqlalchemy as sa
from alembic import op

revision = "0003_recording_size"
down_revision = "0002_flight_record"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns and compute the sizes of stored recordings."""
    op.add_column("recording", sa.Column("size_bytes", sa.BigInteger(), nullable=False, server_default="0"))
    op.add_column("recording", sa.Column("removed_at", sa.DateTime(), nullable=True))
    op.execute(
        "UPDATE recording SET size_bytes = (SELECT COALESCE(SUM(LENGTH(samples) + LENGTH(summary)), 0) "
        "FROM chunk WHERE chunk.run_id = recording.run_id)"
    )


def downgrade() -> None:
    """Drop the columns."""
    op.drop_column("recording", "removed_at")
    op.drop_column("recording", "size_bytes")
