"""The schema made by the migrations is the one the models describe, from any earlier state."""

from pathlib import Path

import pytest
from sqlalchemy import inspect, text

from backend.storage.database import connect, open_database, sqlite_url
from backend.storage.migrate import SchemaError, newest_revision, require_models_match, revision, upgrade


def test_migrated_database_matches_models(tmp_path: Path) -> None:
    engine = connect(sqlite_url(tmp_path))
    assert revision(engine) is None
    upgrade(engine)
    require_models_match(engine)
    assert revision(engine) == newest_revision()
    engine.dispose()


def test_upgrade_twice_changes_nothing(tmp_path: Path) -> None:
    open_database(tmp_path).close()
    before = (tmp_path / "sinew.db").read_bytes()
    open_database(tmp_path).close()
    assert (tmp_path / "sinew.db").read_bytes() == before


def test_newer_database_is_refused_unchanged(tmp_path: Path) -> None:
    opened = open_database(tmp_path)
    with opened.session() as session:
        session.execute(text("UPDATE alembic_version SET version_num = '9999_from_the_future'"))
    opened.close()
    with pytest.raises(SchemaError, match=r"9999_from_the_future.*newer version"):
        open_database(tmp_path)
    engine = connect(sqlite_url(tmp_path))
    assert "run" in inspect(engine).get_table_names()
    engine.dispose()
