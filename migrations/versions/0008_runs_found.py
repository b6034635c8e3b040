"""Stations of rows, tags of runs, and tables for the search of runs.

The search tables are derived from other data, and filled at the next opening of the database for all runs that lack
entries: see ``backend/storage/search_index.py``.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import sqlalchemy as sa
from alembic import op
from alembic.operations import BatchOperations

revision = "0008_runs_found"
down_revision = "0007_experiments"
branch_labels = None
depends_on = None

_OF_STATION = ("run", "identification", "bank", "experiment", "event", "setting", "bring_up")
_VERSIONED = ("bank", "experiment")


def upgrade() -> None:
    """Add the station column to tables of stations, and create the search tables."""
    for table in _OF_STATION:
        op.add_column(table, sa.Column("station", sa.String(40), nullable=False, server_default=""))
        op.create_index(f"ix_{table}_station", table, ["station"])
    for table in _VERSIONED:
        _rename_unique(table, f"uq_{table}_name", f"uq_{table}_station", ["station", "name", "version"])
    op.create_table(
        "run_index",
        sa.Column("run_id", sa.Integer(), sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("station", sa.String(40), nullable=False),
        sa.Column("kind", sa.String(40), nullable=False),
        sa.Column("experiment", sa.Text(), nullable=False),
        sa.Column("title", sa.Text(), nullable=False),
        sa.Column("bank_name", sa.Text(), nullable=False),
        sa.Column("bank", sa.Text(), nullable=False),
        sa.Column("plant", sa.Text(), nullable=False),
        sa.Column("parameters", sa.Text(), nullable=False),
        sa.Column("parameters_sha256", sa.String(64), nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("started_at", sa.DateTime(), nullable=False),
        sa.Column("lasted_s", sa.Float(), nullable=True),
        sa.Column("end_state", sa.String(20), nullable=False),
        sa.Column("outcome", sa.String(20), nullable=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.Column("words", sa.Text(), nullable=False),
    )
    op.create_table(
        "value_name",
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("source", sa.String(12), nullable=False),
        sa.Column("name", sa.String(200), nullable=False),
        sa.UniqueConstraint("source", "name", name="uq_value_name_source"),
    )
    op.create_table(
        "run_value",
        sa.Column("run_id", sa.Integer(), sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("name_id", sa.Integer(), sa.ForeignKey("value_name.id"), primary_key=True, autoincrement=False),
        sa.Column("value", sa.Float(), nullable=True),
        sa.Column("word", sa.Text(), nullable=True),
    )
    op.create_index("ix_run_value_name_id", "run_value", ["name_id", "value", "run_id"])
    op.create_table(
        "parameter_value",
        sa.Column("parameters_sha256", sa.String(64), primary_key=True),
        sa.Column("name_id", sa.Integer(), sa.ForeignKey("value_name.id"), primary_key=True, autoincrement=False),
        sa.Column("value", sa.Float(), nullable=False),
    )
    op.create_index("ix_parameter_value_name_id", "parameter_value", ["name_id", "value"])
    op.create_table(
        "run_tag",
        sa.Column("run_id", sa.Integer(), sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("tag", sa.String(40), primary_key=True),
    )
    op.create_index("ix_run_tag_tag", "run_tag", ["tag", "run_id"])


def downgrade() -> None:
    """Drop columns and tables.

    Fails if several stations have banks or experiments of the same name.
    """
    for table in ("run_tag", "parameter_value", "run_value", "value_name", "run_index"):
        op.drop_table(table)
    for table in _VERSIONED:
        _rename_unique(table, f"uq_{table}_station", f"uq_{table}_name", ["name", "version"])
    for table in _OF_STATION:
        op.drop_index(f"ix_{table}_station", table)
        with _made_anew(table) as batch:
            batch.drop_column("station")


def _rename_unique(table: str, before: str, after: str, columns: list[str]) -> None:
    with _made_anew(table) as batch:
        batch.drop_constraint(before, type_="unique")
        batch.create_unique_constraint(after, columns)


@contextmanager
def _made_anew(table: str) -> Iterator[BatchOperations]:
    """Recreate a table in SQLite, restoring the highest number used."""
    connection = op.get_bind()
    of_table = {"table": table}
    is_sqlite = connection.dialect.name == "sqlite"
    asked = sa.text("SELECT seq FROM sqlite_sequence WHERE name = :table")
    given_out = connection.scalar(asked, of_table) if is_sqlite else None
    with op.batch_alter_table(table, table_kwargs={"sqlite_autoincrement": True}) as batch:
        yield batch
    if given_out is not None:
        connection.execute(sa.text("DELETE FROM sqlite_sequence WHERE name = :table"), of_table)
        connection.execute(sa.text("INSERT INTO sqlite_sequence VALUES (:table, :seq)"), {**of_table, "seq": given_out})
