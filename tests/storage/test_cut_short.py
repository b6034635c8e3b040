"""A killed command leaves the old or the new database, and no leftovers."""

import itertools
import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from backend.data_folder import lock_for_service
from backend.storage import settings
from backend.storage.database import (
    Database,
    backup_database,
    describe_recovery,
    is_restore_incomplete,
    open_database,
    recover_database,
)
from backend.storage.orm import DamagedError, StorageError
from tests.cli.test_report import sinew
from tests.refusals import refused

KILLED = Path(__file__).with_name("restore_killed.py")


def put(database: Database, value: str) -> None:
    with database.session() as session:
        settings.save(session, "weather", value, "Ana")


def value_of(data: Path) -> object:
    with closing(open_database(data)) as database, database.reading() as session:
        found = settings.newest(session, "weather")
        return None if found is None else found.value


def with_backup(data: Path) -> Path:
    """Make a database that says "new", with a backup from when it said "old", and return the backup."""
    copy = data / "backups" / "then.db"
    with closing(open_database(data)) as database:
        put(database, "old")
        backup_database(database.engine, copy)
        put(database, "new")
    return copy


def test_a_restore_killed_anywhere_is_completed_or_reverted(tmp_path: Path) -> None:
    outcomes: list[str] = []
    for kill in itertools.count():
        data = tmp_path / str(kill)
        copy = with_backup(data)
        command = [sys.executable, str(KILLED), str(copy), str(data / "sinew.db"), str(kill)]
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if ended.returncode == 0:
            break
        assert ended.returncode == -9, ended.stderr
        cut_short = is_restore_incomplete(data / "sinew.db")
        if cut_short:
            with pytest.raises(StorageError):
                open_database(data)  # nobody makes an empty one meanwhile
        said = recover_database(data / "sinew.db")
        assert bool(said) == cut_short
        outcomes.append(str(value_of(data)))
        left = {file.name for file in data.iterdir()} - {"sinew.db", "sinew.db-wal", "sinew.db-shm", "backups"}
        assert all(".before-restore-" in name for name in left), left
        assert len(left) == (outcomes[-1] == "old")
        assert [file.name for file in (data / "backups").iterdir()] == ["then.db"]
    assert set(outcomes) == {"old", "new"}
    assert outcomes == sorted(outcomes)  # new up to a moment, from then on the backup
    assert value_of(data) == "old"


def test_the_next_command_completes_a_restore_and_reports_it(tmp_path: Path) -> None:
    copy = with_backup(tmp_path)
    os.replace(copy, tmp_path / "sinew.db.restored")
    os.replace(tmp_path / "sinew.db", tmp_path / "sinew.before-restore-20260101T000000.0Z.db")
    with lock_for_service(tmp_path):
        held = sinew("runs", "list", folder=tmp_path)  # it is somebody else's to complete
    assert held.returncode == 1
    ended = sinew("runs", "list", folder=tmp_path)
    assert (ended.returncode, "completed" in ended.stderr) == (0, True)
    assert value_of(tmp_path) == "old"


@pytest.mark.parametrize("trace", ["backups/a.db", "sinew.before-restore-20260101T000000.0Z.db"])
def test_a_missing_database_is_not_replaced_by_an_empty_one(tmp_path: Path, trace: str) -> None:
    (tmp_path / trace).parent.mkdir(exist_ok=True)
    with closing(sqlite3.connect(tmp_path / trace)) as copy:
        copy.execute("CREATE TABLE run (id)")
    remedy = describe_recovery(tmp_path / "sinew.db", tmp_path / "backups")
    with refused(DamagedError, "database_missing_beside_copies", copies=[Path(trace).name], remedy=remedy):
        open_database(tmp_path)
    assert sinew("runs", "list", folder=tmp_path).returncode == 1
    assert not (tmp_path / "sinew.db").exists()


def test_leftovers_of_killed_commands_are_removed_and_listed(tmp_path: Path) -> None:
    open_database(tmp_path).close()
    (tmp_path / "backups").mkdir()
    (tmp_path / "importing-x").mkdir()
    names = (
        "backups/a.db.unfinished",
        "backups/a.db.unfinished-journal",
        "sinew.db.77.creating",
        "importing-x/1.parquet",
    )
    for name in names:
        (tmp_path / name).write_bytes(b"half")
    said = recover_database(tmp_path / "sinew.db")
    assert len(said) == 3
    assert not [name for name in names if (tmp_path / name).exists()]
    assert recover_database(tmp_path / "sinew.db") == []
    assert value_of(tmp_path) is None
