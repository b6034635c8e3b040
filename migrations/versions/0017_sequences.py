"""Conversion of runs of sequences to equivalent experiments.

That is the only supported form.
"""

import json
from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from alembic import op

from backend.models import upgrades

revision = "0017_sequences"
down_revision = "0016_current_documents"
branch_labels = None
depends_on = None

_AT_ONCE = 200


def upgrade() -> None:
    """Convert the settings of runs of sequences; leave unreadable ones unchanged."""
    _rewrite(upgrades.upgrade_run_settings)


def downgrade() -> None:
    """Convert them to the lists of segments that the previous version reads."""
    _rewrite(_with_segments)


def _rewrite(rewritten: Callable[[Any], Any]) -> None:
    connection = op.get_bind()
    number, settings = sa.column("id", sa.Integer()), sa.column("settings", sa.JSON())
    run = sa.table("run", number, settings)
    index = sa.table("run_index", sa.column("run_id", sa.Integer()))
    # As text: on SQLite a damaged document would abort the migration.
    query = sa.select(number, sa.cast(settings, sa.Text())).where(sa.column("kind") == upgrades.SEQUENCE)
    query = query.select_from(run).order_by(number).limit(_AT_ONCE)
    last = 0
    while rows := connection.execute(query.where(number > last)).all():
        for last, text in rows:
            try:
                before = json.loads(text)
                after = rewritten(before)
            except (ValueError, LookupError, TypeError):
                continue
            if after != before:
                connection.execute(sa.update(run).where(number == last).values(settings=after))
                # The search entries of a run depend on its settings: they are rebuilt when the database is opened.
                connection.execute(sa.delete(index).where(index.c.run_id == last))


def _with_segments(settings: dict[str, Any]) -> dict[str, Any]:
    (section,) = json.loads(settings["plan"]["experiment"])["phases"]
    segments = [
        {name: value for name, value in part.items() if name != "do"}
        | ({} if part["do"] == "step" else {"shape": part["do"]})
        for part in section["parts"]
    ]
    value = json.dumps(segments)
    declared = {"name": upgrades.SEGMENTS, "symbol": upgrades.SEGMENTS, "unit": "1", "meaning": "JSON list of segments"}
    plan = {upgrades.SEGMENTS: value}
    return {**settings, "plan": plan, "declared": [{**declared, "value": value}, *settings["declared"]]}
