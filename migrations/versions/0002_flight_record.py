"""Flight records: the seconds around each trip, stored with its event."""

import sqlalchemy as sa
from alembic import op

revision = "0002_flight_record"
down_revision = "0001_first_schema"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "flight_record",
        sa.Column("event_id", sa.Integer(), sa.ForeignKey("event.id"), primary_key=True, autoincrement=False),
        sa.Column("fault", sa.String(40), nullable=False),
        sa.Column("first_tick", sa.BigInteger(), nullable=False),
        sa.Column("trip_tick", sa.BigInteger(), nullable=False),
        sa.Column("count", sa.Integer(), nullable=False),
        sa.Column("fields", sa.JSON(), nullable=False),
        sa.Column("samples", sa.LargeBinary(), nullable=False),
    )


def downgrade() -> None:
    """Drop the table."""
    op.drop_table("flight_record")
