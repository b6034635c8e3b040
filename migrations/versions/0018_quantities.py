"""Mark quantities in texts of the service; no others are converted for display."""

import json
import re
from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from alembic import op

from backend.models import upgrades

revision = "0018_quantities"
down_revision = "0017_sequences"
branch_labels = None
depends_on = None

_AT_ONCE = 500
_MARK = "\u202f"
_MARKED = re.compile(f"{_MARK}(\u2060*)")
_TEXTS = (
    ("run", "end_detail"),
    ("run", "evaluation_problem"),
    ("identification", "verdict"),
    ("event", "text"),
    ("bring_up", "text"),
)
_DOCUMENTS = ("metrics", "criteria")


def upgrade() -> None:
    """Mark quantities in texts of the service, not in texts of people."""
    for table, column in _TEXTS:
        _rewrite_texts(table, column, upgrades.mark_event if table == "event" else upgrades.mark_text)
    _rewrite_documents("metrics", upgrades.upgrade_metrics)
    _rewrite_documents("criteria", upgrades.upgrade_criteria)


def downgrade() -> None:
    """Replace each mark by a space, as the version before expects."""
    for table, column in _TEXTS:
        _rewrite_texts(table, column, _without_marks)
    for column in _DOCUMENTS:
        _rewrite_documents(column, _without_marks_in)


def _without_marks(text: str, _kind: str = "") -> str:
    return _MARKED.sub(lambda found: _MARK + found[1][1:] if found[1] else " ", text)


def _without_marks_in(document: Any) -> Any:
    return json.loads(_without_marks(json.dumps(document, ensure_ascii=False)))


def _rewrite_texts(table: str, column: str, rewritten: Callable[[str, str], str]) -> None:
    connection, number, text = op.get_bind(), sa.column("id", sa.Integer()), sa.column(column, sa.Text())
    kind = sa.column("kind", sa.String()) if table == "event" else sa.literal("")
    rows = sa.table(table, number, text)
    query = sa.select(number, text, kind).select_from(rows).order_by(number).limit(_AT_ONCE)
    last = 0
    while found := connection.execute(query.where(number > last)).all():
        for last, before, of_kind in found:
            if isinstance(before, str) and (after := rewritten(before, of_kind)) != before:
                connection.execute(sa.update(rows).where(number == last).values({column: after}))


def _rewrite_documents(column: str, rewritten: Callable[[Any], Any]) -> None:
    connection, number, document = op.get_bind(), sa.column("id", sa.Integer()), sa.column(column, sa.JSON())
    rows = sa.table("result", number, document)
    # Read as text, because on SQLite a damaged document would abort the migration.
    query = sa.select(number, sa.cast(document, sa.Text())).select_from(rows).order_by(number).limit(_AT_ONCE)
    last = 0
    while found := connection.execute(query.where(number > last)).all():
        for last, text in found:
            try:
                before = json.loads(text)
            except (ValueError, TypeError):
                continue
            if (after := rewritten(before)) != before:
                connection.execute(sa.update(rows).where(number == last).values({column: after}))
