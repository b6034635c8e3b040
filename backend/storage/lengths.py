"""No row is written with a text that is longer than its column.

PostgreSQL refuses such a text, SQLite stores it. Checked here, both refuse it, before anything is sent.
"""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import String, event, inspect
from sqlalchemy.orm import Mapper

from backend.storage.errors import UnfitError
from backend.storage.schema import Base


def require_lengths(table: Any, values: Mapping[str, Any]) -> None:
    """Raise UnfitError for the first of ``values``, by column, that is a text longer than its column of ``table``."""
    for column in inspect(table).local_table.columns:
        value = values.get(column.name)
        length = column.type.length if isinstance(column.type, String) else None
        if length is not None and isinstance(value, str) and len(value) > length:
            raise UnfitError(
                f"{column} cannot be {value[:40]!r}...: the text has {len(value)} characters, "
                f"{length} are the most: shorten it"
            )


@event.listens_for(Base, "before_insert", propagate=True)
def _check_new(mapper: Mapper[Any], _connection: object, row: Any) -> None:
    require_lengths(mapper, {column.key: getattr(row, column.key) for column in mapper.column_attrs})


@event.listens_for(Base, "before_update", propagate=True)
def _check_changed(mapper: Mapper[Any], _connection: object, row: Any) -> None:
    """Check what changes: a row that an earlier version wrote may hold a longer text elsewhere."""
    changed = (column.key for column in mapper.column_attrs if inspect(row).attrs[column.key].history.has_changes())
    require_lengths(mapper, {key: getattr(row, key) for key in changed})
