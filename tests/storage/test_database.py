"""How the database is opened: durable on disk, writers one after the other, trouble told in one sentence."""

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import text

from backend.storage import runs
from backend.storage.database import BackupError, Database, backup_database, find_database_errors, open_database
from backend.storage.orm import StorageError
from backend.storage.runs import EndState
from tests.storage.test_lineage import NEW_RUN

PAGE = 4096


def test_every_connection_is_durable_and_checked(sqlite: Database) -> None:
    for connect in (sqlite.session, sqlite.reading):
        with connect() as session:
            assert session.scalar(text("PRAGMA journal_mode")) == "wal"
            assert session.scalar(text("PRAGMA synchronous")) == 2  # FULL
            assert session.scalar(text("PRAGMA foreign_keys")) == 1
            assert session.scalar(text("PRAGMA busy_timeout")) == 5000


def test_an_error_in_the_block_leaves_nothing(database: Database) -> None:
    def fail_midway() -> None:
        with database.session() as session:
            runs.create(session, NEW_RUN)
            raise KeyError("midway")

    with pytest.raises(KeyError):
        fail_midway()
    with database.reading() as session:
        assert runs.find(session) == []


def test_a_reader_sees_one_state_while_others_write(database: Database) -> None:
    with database.reading() as before:
        assert runs.count(before) == 0
        with database.session() as session:
            runs.create(session, NEW_RUN)
        assert runs.count(before) == 0
    with database.reading() as after:
        assert runs.count(after) == 1


def test_a_second_writer_is_told_after_waiting(sqlite: Database, tmp_path: Path) -> None:
    with sqlite.session() as session:
        run = runs.create(session, NEW_RUN)
    other = sqlite3.connect(tmp_path / "sinew.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with sqlite.reading() as session:
        session.connection().connection.cursor().execute("PRAGMA busy_timeout=1")
        assert runs.get(session, run.id) == run
    with pytest.raises(StorageError, match="locked"), sqlite.session() as session:
        runs.end(session, run.id, EndState.COMPLETED)
    other.close()


def test_a_folder_that_cannot_hold_a_database_is_told(tmp_path: Path) -> None:
    (tmp_path / "sinew.db").mkdir()
    with pytest.raises(StorageError, match="unable to open database file"):
        open_database(tmp_path)


def test_a_backup_is_complete_and_never_overwrites(sqlite: Database, tmp_path: Path) -> None:
    with sqlite.session() as session:
        run = runs.create(session, replace(NEW_RUN, note="kept"))
    target = tmp_path / "copies" / "monday.db"
    backup_database(sqlite.engine, target)
    copied = open_database(target.parent, f"sqlite:///{target}")
    with copied.reading() as session:
        assert runs.get(session, run.id) == run
    assert find_database_errors(copied.engine) == []
    copied.close()
    with pytest.raises(BackupError, match="exists already"):
        backup_database(sqlite.engine, target)
    (tmp_path / "file").touch()
    with pytest.raises(BackupError, match="could not be written"):
        backup_database(sqlite.engine, tmp_path / "file" / "below.db")


def test_check_finds_what_is_wrong(database: Database) -> None:
    assert find_database_errors(database.engine) == []
    with database.session() as session:
        session.execute(text("DROP TABLE report"))
    assert any("report" in problem for problem in find_database_errors(database.engine))


def test_check_finds_references_to_nothing(sqlite: Database, tmp_path: Path) -> None:
    careless = sqlite3.connect(tmp_path / "sinew.db")
    names = "run_id, fields, period_s, missed, problem, size_bytes"
    careless.execute(f"INSERT INTO recording ({names}) VALUES (77, '[]', 0.001, 0, '', 0)")
    careless.commit()
    careless.close()
    assert find_database_errors(sqlite.engine) == ["table recording refers to rows that are not there"]


def test_check_finds_a_damaged_file(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    with database.session() as session:
        for _ in range(200):
            runs.create(session, NEW_RUN)
    database.close()
    file = tmp_path / "sinew.db"
    content = bytearray(file.read_bytes())
    content[-3 * PAGE :] = b"\xff" * 3 * PAGE
    file.write_bytes(content)
    damaged = open_database(tmp_path)
    assert any("damaged" in problem for problem in find_database_errors(damaged.engine))
    damaged.close()
