"""The digest of each chunk of samples as it was recorded."""

import sqlalchemy as sa
from alembic import op

revision = "0012_chunk_digest"
down_revision = "0011_remarks"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add it; what was recorded before has none, as its samples may have been changed since."""
    op.add_column("chunk", sa.Column("sha256", sa.String(64), nullable=False, server_default=""))


def downgrade() -> None:
    """Drop it."""
    op.drop_column("chunk", "sha256")
