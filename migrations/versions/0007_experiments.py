"""Own experiments, each change as a new version."""

import sqlalchemy as sa
from alembic import op

revision = "0007_experiments"
down_revision = "0006_plant_name"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "experiment",
        sa.Column("name", sa.String(length=40), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("who", sa.String(length=200), nullable=False),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.Column("id", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_experiment")),
        sa.UniqueConstraint("name", "version", name=op.f("uq_experiment_name")),
        sqlite_autoincrement=True,
    )


def downgrade() -> None:
    """Drop the table with its content."""
    op.drop_table("experiment")
