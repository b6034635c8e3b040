"""Studies and their points."""

import sqlalchemy as sa
from alembic import op

revision = "0009_studies"
down_revision = "0008_runs_found"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create both tables."""
    op.create_table(
        "study",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("station", sa.String(40), nullable=False, server_default=""),
        sa.Column("name", sa.String(40), nullable=False),
        sa.Column("title", sa.String(100), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("base", sa.JSON(), nullable=False),
        sa.Column("points", sa.Integer(), nullable=False),
        sa.Column("who", sa.String(200), nullable=False),
        sa.Column("created_at", sa.DateTime(), nullable=False),
        sa.Column("runner", sa.String(200), nullable=False),
        sa.Column("seen_at", sa.DateTime(), nullable=True),
        sa.Column("begun_at", sa.DateTime(), nullable=True),
        sa.Column("begun_with", sa.Integer(), nullable=False),
        sa.Column("stop_asked", sa.Boolean(), nullable=False),
        sa.Column("problem", sa.Text(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_study_name", "study", ["name"])
    op.create_index("ix_study_station", "study", ["station"])
    op.create_table(
        "study_point",
        sa.Column("study_id", sa.Integer(), sa.ForeignKey("study.id"), primary_key=True, autoincrement=False),
        sa.Column("number", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("station", sa.String(40), nullable=False, server_default=""),
        sa.Column("state", sa.String(20), nullable=False),
        sa.Column("detail", sa.Text(), nullable=False),
        sa.Column("passed", sa.Boolean(), nullable=True),
        sa.Column("values", sa.JSON(), nullable=False),
        sa.Column("figures", sa.JSON(), nullable=False),
    )
    op.create_index("ix_study_point_station", "study_point", ["station"])


def downgrade() -> None:
    """Drop both tables."""
    for table in ("study_point", "study"):
        op.drop_table(table)
