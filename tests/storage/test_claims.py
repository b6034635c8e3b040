"""One service uses a database at a time, for every path; a dead service blocks no other."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.storage import claims
from backend.storage import database as migrate
from backend.storage.claims import HEARTBEAT_S, LIFE_S, HeldClaim, describe_claim, is_alive, own_claim
from backend.storage.database import (
    Database,
    OutdatedError,
    SchemaError,
    can_read,
    newest_revision,
    open_database,
    read_revision,
)
from backend.storage.stations import StationTakenError
from plant import Message
from tests.migrations.old_schema import at_revision
from tests.refusals import refused


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path / "data")
    yield opened
    opened.close()


def test_a_second_service_is_rejected_for_every_path(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "LIFE_S", 3600.0)  # it is refused at once, not after a life without a beat
    held = HeldClaim(database.engine, "")
    (tmp_path / "link").symlink_to(tmp_path / "data")
    (tmp_path / "elsewhere").mkdir()
    for url in (None, f"sqlite:///{tmp_path}/data/sinew.db", f"sqlite:///{tmp_path}/link/sinew.db"):
        other = open_database(tmp_path / ("link" if url is None else "elsewhere"), url)
        with pytest.raises(StationTakenError):
            HeldClaim(other.engine, "")
        other.close()
    held.release()
    HeldClaim(database.engine, "").release()


REFUSED = """
import sys
from pathlib import Path
from backend.main import serve
from backend.settings import Settings
from backend.storage.stations import StationTakenError
try:
    serve(Settings(data=Path(sys.argv[1]), database_url=sys.argv[2], port=0), print)
except StationTakenError:
    print(*[name for name in ("backend.app", "backend.api", "fastapi", "viser") if name in sys.modules])
"""


def test_a_start_is_rejected_before_slow_imports(database: Database, tmp_path: Path) -> None:
    held = HeldClaim(database.engine, "")
    ended = subprocess.run(
        [sys.executable, "-c", REFUSED, str(tmp_path / "other"), f"sqlite:///{tmp_path}/data/sinew.db"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stdout == "\n"
    held.release()


def test_stations_of_one_database_are_claimed_separately(database: Database) -> None:
    first, second = HeldClaim(database.engine, "rig-a"), HeldClaim(database.engine, "rig-b")
    with refused(StationTakenError, "station_taken", service=first._claim.describe, station="rig-a"):
        HeldClaim(database.engine, "rig-a")
    first.release()
    second.release()


def test_a_killed_service_blocks_no_other_service(database: Database, tmp_path: Path) -> None:
    claiming = (
        "import os, sys; from pathlib import Path; from backend.storage import open_database; "
        "from backend.storage.claims import HeldClaim; "
        "HeldClaim(open_database(Path(sys.argv[1])).engine, ''); os.kill(os.getpid(), 9)"
    )
    ended = subprocess.run([sys.executable, "-c", claiming, str(tmp_path / "data")], check=False)
    assert ended.returncode == -9
    HeldClaim(database.engine, "").release()


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let each claim appear to come from another machine, and expire soon."""
    monkeypatch.setattr(claims, "_seen_by", lambda: os.urandom(4).hex())
    monkeypatch.setattr(claims, "LIFE_S", 1.0)


@pytest.mark.usefixtures("elsewhere")
def test_a_claim_of_another_machine_is_judged_by_its_heartbeats(database: Database) -> None:
    held = HeldClaim(database.engine, "")
    found = held._claim
    for _ in range(3):
        held.renew()
    assert is_alive(database.engine, "", found)  # a beat came since it was read
    assert not is_alive(database.engine, "", held._claim)  # none came for a life
    HeldClaim(database.engine, "")
    held.renew()
    problem = held.problem()
    assert isinstance(problem, Message)
    assert (problem.code, problem.values["life_s"]) == ("claim_lost", 1.0)
    held.release()  # is not the other's to give up
    assert claims._read_claim(database.engine, "") is not None


@pytest.mark.usefixtures("elsewhere")
def test_a_claim_with_heartbeats_is_never_taken(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    held = HeldClaim(database.engine, "")
    monkeypatch.setattr("backend.storage.claims.time.sleep", lambda _: held.renew())
    with pytest.raises(StationTakenError):
        HeldClaim(database.engine, "")
    assert held.problem() == ""


def test_another_process_with_the_same_pid_does_not_own_the_claim(database: Database) -> None:
    mine = own_claim()
    assert is_alive(database.engine, "", mine)
    assert not is_alive(database.engine, "", replace(mine, began="1"))
    assert not is_alive(database.engine, "", replace(mine, process=2**22 + 1))


def test_a_claim_expires_later_than_a_heartbeat_can_be_delayed() -> None:
    assert LIFE_S > 5.0 + 2.0 * HEARTBEAT_S  # busy_timeout of SQLite


def test_no_database_is_migrated_while_a_service_works_on_it(tmp_path: Path) -> None:
    with at_revision(tmp_path, "0012_chunk_digest") as engine:
        held = HeldClaim(engine, "")
        with refused(
            SchemaError, "outdated_database_in_use", service=describe_claim(engine), schema="0012_chunk_digest"
        ):
            open_database(tmp_path)
        assert read_revision(engine) == "0012_chunk_digest"
        assert describe_claim(engine)
        held.release()
        open_database(tmp_path).close()
        assert read_revision(engine) != "0012_chunk_digest"


def test_readers_migrate_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Readers accept an old schema with all that they read; writers are rejected with the command."""
    open_database(tmp_path / "data").close()
    newest = newest_revision()
    later = tmp_path / "later"
    shutil.copytree(migrate.SCRIPTS, later)
    revised = f'"""Nothing."""\nrevision = "0099_nothing"\ndown_revision = "{newest}"\n\ndef upgrade():\n    pass\n'
    (later / "versions" / "0099_nothing.py").write_text(revised, encoding="utf-8")
    monkeypatch.setattr(migrate, "SCRIPTS", later)
    database = open_database(tmp_path / "data", outdated="read")
    with database.reading() as session:
        assert session.connection().exec_driver_sql("SELECT count(*) FROM run").scalar() == 0
    with refused(OutdatedError, "database_outdated", schema=newest, newest="0099_nothing", folder=tmp_path / "data"):
        open_database(tmp_path / "data", outdated="refuse")
    assert read_revision(database.engine) == newest
    database.close()


@pytest.mark.parametrize("revision", ["0003_recording_size", "0015_formulas"])
def test_unreadable_recordings_are_rejected(tmp_path: Path, revision: str) -> None:
    """A schema without the required tables, and one whose documents may have an earlier form."""
    with at_revision(tmp_path, revision) as engine:
        assert not can_read(engine)
        with refused(OutdatedError, "database_outdated", schema=revision, folder=tmp_path):
            open_database(tmp_path, outdated="read")
        assert read_revision(engine) == revision
