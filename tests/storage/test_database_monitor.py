"""A missing, replaced, empty or damaged database is reported, never replaced silently, and can be restored."""

import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from backend.services import maintenance
from backend.services.maintenance import DatabaseMonitor
from backend.storage import runs
from backend.storage.database import Database, backup_database, open_database, require_intact_database, restore_database
from backend.storage.orm import DamagedError, GoneError, StorageError
from tests.storage.test_lineage import NEW_RUN

PAGE = 4096


def store_runs(database: Database, count: int) -> None:
    with database.session() as session:
        for _ in range(count):
            runs.create(session, NEW_RUN)


def count_runs(data: Path) -> int:
    with closing(open_database(data)) as database, database.reading() as session:
        return runs.count(session)


def damage(file: Path) -> None:
    """Write over some pages in the middle, as a failing disk does."""
    with file.open("r+b") as opened:
        opened.seek(file.stat().st_size // PAGE // 2 * PAGE)
        opened.write(b"\xff" * 3 * PAGE)


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    """A database with 200 runs and a backup of it."""
    with closing(open_database(tmp_path)) as opened:
        store_runs(opened, 200)
        backup_database(opened.engine, tmp_path / "backups" / "monday.db")
        yield opened


def delete_folder(data: Path) -> None:
    shutil.rmtree(data)


def move_file(data: Path) -> None:
    (data / "sinew.db").rename(data / "moved.db")


def replace_file(data: Path) -> None:
    shutil.copy(data / "sinew.db", data / "other.db")
    os.replace(data / "other.db", data / "sinew.db")


def delete_log(data: Path) -> None:
    (data / "sinew.db-wal").unlink()


@pytest.mark.parametrize("takes_away", [delete_folder, move_file, replace_file, delete_log])
def test_nothing_is_written_to_a_file_that_nobody_finds(
    database: Database, tmp_path: Path, takes_away: Callable[[Path], None]
) -> None:
    store_runs(database, 1)
    takes_away(tmp_path)
    with pytest.raises(GoneError, match="Put it back"):
        store_runs(database, 1)
    with database.reading() as session:
        assert runs.count(session) == 201  # what is there can still be read


def test_a_file_that_is_back_is_written_to_again(database: Database, tmp_path: Path) -> None:
    aside = tmp_path.rename(tmp_path.with_name(f"{tmp_path.name}-aside"))
    with pytest.raises(GoneError):
        store_runs(database, 1)
    aside.rename(tmp_path)
    store_runs(database, 1)
    assert count_runs(tmp_path) == 201


def test_an_emptied_file_is_refused_with_the_backups_by_name(database: Database, tmp_path: Path) -> None:
    database.close()
    os.truncate(tmp_path / "sinew.db", 0)
    with pytest.raises(DamagedError, match=r"0 bytes.*sinew db restore FILE --data .*monday\.db"):
        open_database(tmp_path)
    assert (tmp_path / "sinew.db").stat().st_size == 0


def test_damaged_pages_are_found_and_the_way_back_works(database: Database, tmp_path: Path) -> None:
    require_intact_database(database, tmp_path)
    database.close()
    damage(tmp_path / "sinew.db")
    told = r"is damaged.*sinew db restore FILE --data .*monday\.db"
    with closing(open_database(tmp_path)) as damaged, pytest.raises(DamagedError, match=told):
        DatabaseMonitor(damaged, tmp_path).check_small_database()
    restore_database(tmp_path / "backups" / "monday.db", tmp_path / "sinew.db")
    assert count_runs(tmp_path) == 200


def test_a_large_file_is_looked_at_in_the_background(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(maintenance, "is_quick_to_check", lambda _file: False)
    database.close()
    damage(tmp_path / "sinew.db")
    with closing(open_database(tmp_path)) as damaged:
        watched = DatabaseMonitor(damaged, tmp_path)
        watched.check_small_database()
        assert watched.problem == ""
        watched.start_check()
        watched.wait_for_check(60.0)
        assert "monday.db" in watched.problem
        assert "Stop the service first" in watched.problem


@pytest.mark.parametrize("content", [b"", b"junk" * 4096])
def test_a_backup_is_brought_back_over_what_is_no_database(database: Database, tmp_path: Path, content: bytes) -> None:
    database.close()
    (tmp_path / "sinew.db").write_bytes(content)
    (tmp_path / "sinew.db-wal").write_bytes(b"of another time")
    with pytest.raises(StorageError, match="sinew db restore"):
        open_database(tmp_path)
    restore_database(tmp_path / "backups" / "monday.db", tmp_path / "sinew.db")
    assert count_runs(tmp_path) == 200
    (kept,) = tmp_path.glob("sinew.before-restore-*.db")
    assert kept.read_bytes() == content


def test_a_start_cut_short_leaves_no_empty_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cut_short(_engine: object) -> None:
        assert not (tmp_path / "sinew.db").exists()
        raise sqlite3.OperationalError("power cut")

    with monkeypatch.context() as patched:
        patched.setattr("backend.storage.database.upgrade", cut_short)
        with pytest.raises(sqlite3.OperationalError):
            open_database(tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert count_runs(tmp_path) == 0
