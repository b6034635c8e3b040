"""Digest of each chunk of samples as recorded."""

import sqlalchemy as sa
from alembic import op

revision = "0012_chunk_digest"
down_revision = "0011_remarks"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the column.

    Earlier chunks have no digest, as their samples may have been changed since.
    """
    op.add_column("chunk", sa.Column("sha256", sa.String(64), nullable=False, server_default=""))


def downgrade() -> None:
    """Drop the column."""
    op.drop_column("chunk", "sha256")
