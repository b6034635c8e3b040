"""Conversion of earlier documents to the current form, the only one supported."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import sqlalchemy as sa
from alembic import op

from backend.models import upgrades

revision = "0016_current_documents"
down_revision = "0015_formulas"
branch_labels = None
depends_on = None

_AT_ONCE = 200


def upgrade() -> None:
    """Convert documents of earlier forms; leave unreadable ones unchanged."""
    runs = _rewrite("run", partial(upgrades.upgrade_record, "run"), ("settings",))
    # The search entries of a run depend on its settings: they are rebuilt when the database is opened.
    index = sa.table("run_index", sa.column("run_id", sa.Integer()))
    for run in runs:
        op.execute(sa.delete(index).where(index.c.run_id == run))
    _rewrite("result", partial(upgrades.upgrade_record, "result"), ("metrics", "criteria"))
    _rewrite("identification", partial(upgrades.upgrade_record, "identification"), ("model", "quality"), ("kind",))
    _rewrite("setting", _with_tuning, ("value",), where=sa.column("name") == "tuning in force")


def downgrade() -> None:
    """Change nothing: the previous version reads the current form too."""


def _with_tuning(row: Mapping[str, Any]) -> dict[str, Any]:
    return {"value": upgrades.upgrade_tuning(row["value"])}


def _rewrite(
    name: str,
    upgraded: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    documents: tuple[str, ...],
    others: tuple[str, ...] = (),
    where: sa.ColumnElement[bool] | None = None,
) -> list[int]:
    """Convert the rows whose documents change, and return their numbers."""
    connection, number = op.get_bind(), sa.column("id", sa.Integer())
    table = sa.table(name, number, *(sa.column(each, sa.JSON()) for each in documents))
    # As text: on SQLite a damaged document would abort the migration.
    texts = (sa.cast(sa.column(each), sa.Text()).label(each) for each in documents)
    columns: list[Any] = [number, *(sa.column(each) for each in others), *texts]
    query = sa.select(*columns).select_from(table).order_by(number).limit(_AT_ONCE)
    if where is not None:
        query = query.where(where)
    changed, last = [], 0
    while rows := connection.execute(query.where(number > last)).mappings().all():
        for row in rows:
            last = row["id"]
            try:
                before = {**row, **{each: json.loads(row[each]) for each in documents}}
            except ValueError:
                continue
            after = upgraded(before)
            if new := {each: after[each] for each in documents if after[each] != before[each]}:
                connection.execute(sa.update(table).where(number == last).values(new))
                changed.append(last)
    return changed
