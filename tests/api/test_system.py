"""The System page's view, a backup made while the service works, and bringing it back."""

import sqlite3
from itertools import pairwise
from pathlib import Path

import httpx
import pytest

from backend.data_folder import AlreadyRunningError, lock_for_service
from backend.storage import runs
from backend.storage.database import BackupError, open_database, restore_database
from tests.api.conftest import problem
from tests.storage.test_lineage import NEW_RUN


def test_the_machine_the_timing_and_the_database_are_told(viewer: httpx.Client) -> None:
    system = viewer.get("/api/system").json()
    assert system["granted"]["timer_slack_ns"] >= 0  # a FIFO process has none
    assert (system["granted"]["priority"] > 0) or system["granted"]["refusals"]
    classes = system["lateness"]
    assert all(before["to_us"] == after["from_us"] for before, after in pairwise(classes))
    assert classes[-1]["to_us"] is None
    assert sum(entry["ticks"] for entry in classes) > 0
    assert {"Sinew", "Python", "numpy"} <= set(system["versions"])
    assert system["database"]["schema_revision"]
    assert system["database"]["disk_free_bytes"] > 0


def test_a_backup_is_made_and_checked_while_the_service_works(
    operator: httpx.Client, viewer: httpx.Client, data: Path
) -> None:
    assert viewer.post("/api/system/backups").status_code == 403
    made = operator.post("/api/system/backups").raise_for_status().json()
    assert (data / "backups" / made["name"]).stat().st_size == made["size_bytes"]
    assert made["name"] in [copy["name"] for copy in viewer.get("/api/system").json()["backups"]]
    assert operator.post("/api/system/check").json() == {"problems": []}


def test_recordings_are_listed_and_go_only_when_named(operator: httpx.Client, viewer: httpx.Client) -> None:
    """The service under test keeps within its limit, so nothing may go: naming a run is refused."""
    listed = viewer.get("/api/system/recordings").raise_for_status().json()
    assert listed["limit_bytes"] == 20_000_000_000
    assert (listed["may_go"], listed["says"]) == ([], "")
    assert viewer.post("/api/system/recordings/removal", json={"runs": [1]}).status_code == 403
    assert operator.post("/api/system/recordings/removal", json={"runs": []}).status_code == 422
    refused = operator.post("/api/system/recordings/removal", json={"runs": [1]})
    assert refused.status_code == 409
    assert "nothing was deleted" in str(problem(refused)["message"])


def test_nothing_is_restored_under_a_service_that_works(data: Path) -> None:
    with pytest.raises(AlreadyRunningError), lock_for_service(data):
        pass


def test_a_restored_database_is_the_copy_and_the_one_before_is_kept(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    with database.session() as session:
        first = runs.create(session, NEW_RUN).id
    with sqlite3.connect(tmp_path / "sinew.db") as source, sqlite3.connect(tmp_path / "copy.db") as copy:
        source.backup(copy)
    with database.session() as session:
        second = runs.create(session, NEW_RUN).id
    database.close()
    restore_database(tmp_path / "copy.db", tmp_path / "sinew.db")
    database = open_database(tmp_path)
    with database.reading() as session:
        assert [run.id for run in runs.find(session)] == [first]
    database.close()
    (before,) = tmp_path.glob("sinew.before-restore-*.db")
    kept = open_database(tmp_path, f"sqlite:///{before}")
    with kept.reading() as session:
        assert [run.id for run in runs.find(session)] == [second, first]
    kept.close()


@pytest.mark.parametrize("bad", ["missing", "text", "cut", "foreign"])
def test_a_bad_file_is_refused_and_nothing_changes(tmp_path: Path, bad: str) -> None:
    database = open_database(tmp_path)
    with database.session() as session:
        for _ in range(200):
            runs.create(session, NEW_RUN)
    database.close()
    target, copy = tmp_path / "sinew.db", tmp_path / "copy.db"
    match bad:
        case "text":
            copy.write_text("not a database at all, but long enough to look like a file" * 100)
        case "cut":
            content = target.read_bytes()
            copy.write_bytes(content[: len(content) // 2])
        case "foreign":
            with sqlite3.connect(copy) as other:
                other.execute("CREATE TABLE recipes (id INTEGER)")
        case _:
            assert bad == "missing"
    content = target.read_bytes()
    with pytest.raises(BackupError):
        restore_database(copy, target)
    assert target.read_bytes() == content
    assert not list(tmp_path.glob("*.restoring"))
    assert not list(tmp_path.glob("*before-restore*"))
