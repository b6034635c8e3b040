"""The schema made by the migrations is the one the models describe, from any earlier state, all or nothing."""

import json
import shutil
from pathlib import Path

import pytest
from alembic import command
from alembic.script import ScriptDirectory
from sqlalchemy import inspect, text

from backend.storage import database as migrate
from backend.storage import events, queue, recordings, runs
from backend.storage.database import (
    SCRIPTS,
    SchemaError,
    connect_database,
    newest_revision,
    open_database,
    read_revision,
    require_models_match,
    sqlite_url,
    upgrade,
)
from plant.quantity import UNIT_MARK
from tests.storage.test_lineage import NEW_RUN

REBUILDING = '''
"""Rebuild a table that others refer to."""
import sqlalchemy as sa
from alembic import op
revision = "0099_rebuild"
down_revision = "{before}"

def upgrade():
    with op.batch_alter_table("run", recreate="always") as batch:
        batch.add_column(sa.Column("weather", sa.Text(), nullable=False, server_default="fair"))
    {then}
'''

EARLY_RUN = (
    "INSERT INTO run (id, kind, plant, parameters_name, parameters, settings, who, software, started_at, end_state, "
    "end_detail, note, evaluation_problem) VALUES (:id, 'session', 'simulator', 'ideal', '{\"geometry\": {\"r_j\": "
    "{\"value\": 0.075}}}', '{\"mode\": \"run\"}', 'Ana', '0.1', '2026-01-01 00:00:00', 'completed', '', 'worn', "
    "'')"
)


@pytest.fixture
def later_scripts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the migrations that a later version might have."""
    folder = tmp_path / "later"
    shutil.copytree(migrate.SCRIPTS, folder)
    monkeypatch.setattr(migrate, "SCRIPTS", folder)
    return folder


def add_later_revision(folder: Path, before: str, then: str = "") -> None:
    (folder / "versions" / "0099_rebuild.py").write_text(REBUILDING.format(before=before, then=then))


def make_with_data(data_dir: Path) -> str:
    database = open_database(data_dir)
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        session.execute(text("INSERT INTO recording VALUES (:run, '[]', 0.001, 0, '', 0, NULL)"), {"run": run.id})
    database.close()
    newest = newest_revision()
    assert newest is not None
    return newest


def test_migrated_database_matches_models(tmp_path: Path) -> None:
    engine = connect_database(sqlite_url(tmp_path))
    assert read_revision(engine) is None
    upgrade(engine)
    require_models_match(engine)
    assert read_revision(engine) == newest_revision()
    engine.dispose()


def test_opening_again_changes_nothing(tmp_path: Path) -> None:
    open_database(tmp_path).close()
    before = (tmp_path / "sinew.db").read_bytes()
    open_database(tmp_path).close()
    assert (tmp_path / "sinew.db").read_bytes() == before
    assert not (tmp_path / "backups").exists()


def test_a_newer_database_is_rejected_unchanged(tmp_path: Path) -> None:
    opened = open_database(tmp_path)
    with opened.session() as session:
        session.execute(text("UPDATE alembic_version SET version_num = '9999_from_the_future'"))
    opened.close()
    with pytest.raises(SchemaError, match=r"9999_from_the_future.*newer version"):
        open_database(tmp_path)
    engine = connect_database(sqlite_url(tmp_path))
    assert "run" in inspect(engine).get_table_names()
    engine.dispose()


def test_recordings_of_an_earlier_schema_get_a_size(tmp_path: Path, later_scripts: Path) -> None:
    versions = later_scripts / "versions"
    newer = [script for script in versions.glob("0*.py") if script.name >= "0003"]
    texts = {script: script.read_text() for script in newer}
    for script in newer:
        script.unlink()
    old = open_database(tmp_path)
    with old.session() as session:
        session.execute(
            text(
                "INSERT INTO run (id, kind, plant, parameters_name, parameters, settings, who, software, started_at, "
                "end_state, end_detail, note) VALUES (1, 'session', 'simulator', 'ideal', '{}', '{}', 'Ana', '0.1', "
                "'2026-01-01 00:00:00', 'completed', '', '')"
            )
        )
        session.execute(text("INSERT INTO recording VALUES (1, '[]', 0.001, 0, '')"))
        for first_tick in (0, 1000):
            session.execute(text(f"INSERT INTO chunk VALUES (1, {first_tick}, 1000, zeroblob(10), zeroblob(300))"))
    old.close()
    for script, written in texts.items():
        script.write_text(written)
    opened = open_database(tmp_path)
    with opened.reading() as session:
        assert recordings.get(session, 1).size_bytes == 620
        assert recordings.get(session, 1).removed_at is None
    opened.close()


def test_a_wider_plant_name_column_keeps_runs_and_their_numbers(tmp_path: Path, later_scripts: Path) -> None:
    """SQLite rebuilds the table: a number that was assigned once is not assigned again."""
    kept, gone = 1, 2
    newer = [script for script in (later_scripts / "versions").glob("0*.py") if script.name >= "0006"]
    texts = {script: script.read_text() for script in newer}
    for script in newer:
        script.unlink()
    old = open_database(tmp_path)
    with old.session() as session:
        for number in (kept, gone):
            session.execute(text(EARLY_RUN.replace(":id", str(number))), {"id": number})
        session.execute(text("INSERT INTO recording VALUES (:run, '[]', 0.001, 0, '', 0, NULL)"), {"run": kept})
        session.execute(text("DELETE FROM run WHERE id = :id"), {"id": gone})
    old.close()
    for script, written in texts.items():
        script.write_text(written)
    opened = open_database(tmp_path)
    with opened.session() as session:
        assert runs.get(session, kept).plant == "simulator"
        assert recordings.get(session, kept).missed == 0
        assert runs.create(session, NEW_RUN).id == gone + 1
    opened.close()


def test_a_downgrade_assigns_no_number_again(tmp_path: Path) -> None:
    make_with_data(tmp_path)
    engine = connect_database(sqlite_url(tmp_path))
    with engine.connect() as connection, migrate._free_to_rebuild_tables(connection), connection.begin():
        connection.execute(text("DELETE FROM sqlite_sequence"))
        connection.execute(text("INSERT INTO sqlite_sequence VALUES ('run', 7), ('bank', 7), ('identification', 7)"))
        command.downgrade(migrate._configuration(connection), "0007_experiments")
        asked = text("SELECT name, seq FROM sqlite_sequence WHERE seq > 0 ORDER BY name")
        kept = [tuple(row) for row in connection.execute(asked)]
    engine.dispose()
    assert kept == [("bank", 7), ("identification", 7), ("run", 7)]


def test_the_queue_migrates_down_and_up_and_keeps_the_runs(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    with database.session() as session:
        run = runs.create(session, NEW_RUN).id
        queue.add(session, "sequence", {"segments": "[]"}, "Ana")
    database.close()
    engine = connect_database(sqlite_url(tmp_path))
    with engine.connect() as connection, migrate._free_to_rebuild_tables(connection), connection.begin():
        command.downgrade(migrate._configuration(connection), "0013_method_length")
        assert not inspect(connection).has_table("queued_experiment")
        assert connection.scalar(text("SELECT id FROM run")) == run
    upgrade(engine)
    require_models_match(engine)
    engine.dispose()
    database = open_database(tmp_path)
    with database.session() as session:
        assert queue.load_waiting(session) == []
        assert queue.add(session, "sequence", {}, "Ana").settings == {}
    database.close()


def test_a_rebuilt_table_keeps_its_rows_and_their_references(tmp_path: Path, later_scripts: Path) -> None:
    before = make_with_data(tmp_path)
    add_later_revision(later_scripts, before)
    database = open_database(tmp_path)
    with database.reading() as session:
        assert session.scalar(text("SELECT weather FROM run")) == "fair"
        assert session.scalar(text("SELECT count(*) FROM recording")) == 1
        assert session.scalar(text("PRAGMA foreign_keys")) == 1
    database.close()
    (copy,) = (tmp_path / "backups").iterdir()
    engine = connect_database(f"sqlite:///{copy}")
    assert copy.name.startswith(before)
    assert read_revision(engine) == before
    engine.dispose()


@pytest.mark.parametrize(
    ("then", "error"),
    [
        ("raise RuntimeError('power cut')", RuntimeError),
        ('op.execute("UPDATE recording SET run_id = 77")', SchemaError),
    ],
)
def test_a_failing_migration_changes_nothing(
    tmp_path: Path, later_scripts: Path, then: str, error: type[Exception]
) -> None:
    before = make_with_data(tmp_path)
    add_later_revision(later_scripts, before, then)
    with pytest.raises(error):
        open_database(tmp_path)
    engine = connect_database(sqlite_url(tmp_path))
    assert read_revision(engine) == before
    assert "weather" not in {column["name"] for column in inspect(engine).get_columns("run")}
    engine.dispose()


def test_the_newest_revision_matches_alembic() -> None:
    assert newest_revision() == ScriptDirectory(str(SCRIPTS)).get_current_head()


def test_quantities_are_marked_in_service_texts_but_not_in_personal_texts(tmp_path: Path) -> None:
    """Up, down and up again: the texts of version 0.1, which had a space before each unit."""
    texts = {
        "fault": ("q = 1.6 rad, F_A = 7e-05 N", "q = 1.6~rad, F_A = 7e-05~N"),
        "note": ("keep it below 1 rad", "keep it below 1 rad"),
        "references": ("q_ref -1 to 0.5 rad at 10 N·m/rad", "q_ref -1 to 0.5~rad at 10 N·m/rad"),
        "bank": ("bank “1 rad bench” at 2 rad/s", "bank “1 rad bench” at 2~rad/s"),
    }
    judged = {"title": "Back", "relation": "<", "bound": 1.0, "figure": None, "unit": "s", "passed": None}
    criteria = [{"name": "back", **judged, "reason": "still 0.02 rad off"}]
    database = open_database(tmp_path)
    with database.session() as session:
        run = runs.create(session, NEW_RUN).id
        runs.end(session, run, runs.EndState.TRIPPED, "joint_limit: q = 1.6 rad")
        for kind, (before, _) in texts.items():
            events.add(session, events.EventKind(kind), before)
        session.execute(
            text(
                "INSERT INTO result (run_id, metrics, criteria, software, created_at) VALUES (:run, '{}', :c, '', :at)"
            ),
            {"run": run, "c": json.dumps(criteria), "at": "2026-01-01 00:00:00"},
        )
    database.close()
    engine = connect_database(sqlite_url(tmp_path))

    def stored() -> list[str]:
        with engine.connect() as connection:
            found = [str(one) for one in connection.scalars(text("SELECT text FROM event ORDER BY id"))]
            found += [str(one) for one in connection.scalars(text("SELECT end_detail FROM run"))]
            (criteria,) = connection.scalars(text("SELECT criteria FROM result"))
            return [*found, json.loads(criteria)[0]["reason"]]

    unmarked = [*(old for old, _ in texts.values()), "joint_limit: q = 1.6 rad", "still 0.02 rad off"]
    marked = [*(new for _, new in texts.values()), "joint_limit: q = 1.6~rad", "still 0.02~rad off"]
    for change, revision, expected in (
        (command.downgrade, "0017_sequences", unmarked),
        (command.upgrade, "0018_quantities", marked),
        (command.downgrade, "0017_sequences", unmarked),
    ):
        with engine.connect() as connection, migrate._free_to_rebuild_tables(connection), connection.begin():
            change(migrate._configuration(connection), revision)
        assert stored() == [one.replace("~", UNIT_MARK) for one in expected]
    engine.dispose()
