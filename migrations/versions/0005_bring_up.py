"""Results of commissioning steps."""

import sqlalchemy as sa
from alembic import op

revision = "0005_bring_up"
down_revision = "0004_evaluation_problem"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table; rigs must be commissioned again."""
    op.create_table(
        "bring_up",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("step", sa.String(40), nullable=False),
        sa.Column("wiring", sa.String(200), nullable=False),
        sa.Column("fingerprint", sa.String(64), nullable=False),
        sa.Column("passed", sa.Boolean(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("figures", sa.JSON(), nullable=False),
        sa.Column("calibrations", sa.JSON(), nullable=False),
        sa.Column("who", sa.String(200), nullable=False),
        sa.Column("at", sa.DateTime(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_bring_up"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_bring_up_step", "bring_up", ["step"])
    op.create_index("ix_bring_up_fingerprint", "bring_up", ["fingerprint"])


def downgrade() -> None:
    """Drop the table."""
    op.drop_table("bring_up")
