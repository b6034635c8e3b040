"""Notes and tags of events, in addition to the unchanging event.

And an index for the newest events.
"""

import sqlalchemy as sa
from alembic import op

revision = "0011_remarks"
down_revision = "0010_origin"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table and the index."""
    op.create_table(
        "event_remark",
        sa.Column("event_id", sa.Integer(), sa.ForeignKey("event.id"), primary_key=True, autoincrement=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.Column("tags", sa.Text(), nullable=False),
        sa.Column("who", sa.String(200), nullable=False),
        sa.Column("at", sa.DateTime(), nullable=False),
    )
    op.create_index("ix_event_station_at", "event", ["station", "at"])


def downgrade() -> None:
    """Drop the table; the events remain."""
    op.drop_index("ix_event_station_at", "event")
    op.drop_table("event_remark")
