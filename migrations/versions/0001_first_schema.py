"""First schema.

It has runs with their samples, identifications, banks, results, reports, events and settings.
"""

import sqlalchemy as sa
from alembic import op

revision = "0001_first_schema"
down_revision = None
branch_labels = None
depends_on = None


def _id() -> sa.Column[int]:
    return sa.Column("id", sa.Integer(), primary_key=True)


def _at(name: str, *, nullable: bool = False) -> sa.Column[object]:
    return sa.Column(name, sa.DateTime(), nullable=nullable)


def _text(name: str, length: int | None = None) -> sa.Column[str]:
    return sa.Column(name, sa.Text() if length is None else sa.String(length), nullable=False)


def _document(name: str) -> sa.Column[object]:
    return sa.Column(name, sa.JSON(), nullable=False)


def _reference(name: str, target: str, *, nullable: bool = False, key: bool = False) -> sa.Column[int]:
    return sa.Column(name, sa.Integer(), sa.ForeignKey(target), nullable=nullable, primary_key=key, autoincrement=False)


def upgrade() -> None:
    """Create all tables."""
    op.create_table(
        "bank",
        _id(),
        _text("name", 200),
        sa.Column("version", sa.Integer(), nullable=False),
        _text("note"),
        _text("who", 200),
        _at("created_at"),
        sa.UniqueConstraint("name", "version", name="uq_bank_name"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "run",
        _id(),
        _text("kind", 40),
        _text("plant", 20),
        _text("parameters_name", 200),
        _document("parameters"),
        _document("settings"),
        _reference("bank_id", "bank.id", nullable=True),
        _text("who", 200),
        _text("software", 40),
        _at("started_at"),
        _at("ended_at", nullable=True),
        _text("end_state", 20),
        _text("end_detail"),
        _text("note"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "recording",
        _reference("run_id", "run.id", key=True),
        _document("fields"),
        sa.Column("period_s", sa.Float(), nullable=False),
        sa.Column("missed", sa.BigInteger(), nullable=False),
        _text("problem"),
    )
    op.create_table(
        "chunk",
        _reference("run_id", "recording.run_id", key=True),
        sa.Column("first_tick", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("count", sa.Integer(), nullable=False),
        sa.Column("summary", sa.LargeBinary(), nullable=False),
        sa.Column("samples", sa.LargeBinary(), nullable=False),
    )
    op.create_table(
        "identification",
        _id(),
        _reference("run_id", "run.id", nullable=True),
        _text("kind", 40),
        _document("data"),
        _text("method", 40),
        _document("options"),
        _document("model"),
        _document("quality"),
        sa.Column("usable", sa.Boolean(), nullable=False),
        _text("verdict"),
        _text("who", 200),
        _text("software", 40),
        _at("created_at"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "bank_entry",
        _reference("bank_id", "bank.id", key=True),
        sa.Column("position", sa.Integer(), primary_key=True, autoincrement=False),
        _reference("identification_id", "identification.id", nullable=True),
        sa.Column("S_nominal", sa.Float(), nullable=False),
        _document("model"),
    )
    op.create_table(
        "result",
        _id(),
        _reference("run_id", "run.id"),
        _document("metrics"),
        _document("criteria"),
        _text("software", 40),
        _at("created_at"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "report",
        _id(),
        _reference("run_id", "run.id"),
        _text("format", 10),
        _at("created_at"),
        sa.Column("content", sa.LargeBinary(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "event",
        _id(),
        _at("at"),
        _text("kind", 40),
        _text("who", 200),
        _text("text"),
        _reference("run_id", "run.id", nullable=True),
        sa.Column("tick", sa.BigInteger()),
        _document("detail"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "setting",
        _id(),
        _text("name", 200),
        _document("value"),
        _text("who", 200),
        _at("at"),
        sqlite_autoincrement=True,
    )
    for table, column in _INDEXED:
        op.create_index(f"ix_{table}_{column}", table, [column])


def downgrade() -> None:
    """Drop all tables, with all data."""
    for table in _TABLES:
        op.drop_table(table)


_INDEXED = (
    ("run", "kind"),
    ("run", "started_at"),
    ("run", "end_state"),
    ("identification", "run_id"),
    ("identification", "kind"),
    ("bank_entry", "identification_id"),
    ("result", "run_id"),
    ("report", "run_id"),
    ("event", "at"),
    ("event", "run_id"),
    ("setting", "name"),
)

_TABLES = (
    "setting",
    "event",
    "report",
    "result",
    "bank_entry",
    "identification",
    "chunk",
    "recording",
    "run",
    "bank",
)
