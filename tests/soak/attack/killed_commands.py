"""Commands killed at random moments, and on a full disk: the next start has the old state or the new one.

Each command works on a copy of a prepared folder. Afterwards a start of the service recovers the folder. The state must
then be one of the two, the database must be intact, and no unfinished files of the command may remain.
"""

import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from backend.data_folder import lock_for_service
from backend.storage.database import find_database_errors, open_database, recover_database
from tests.migrations.old_schema import at_revision
from tests.soak.attack.isolation import mount_small, unmount
from tests.soak.attack.tally import Tally

KILLS = 200
SIZES = 10
OLD_SCHEMA = "0012_chunk_digest"
_OURS = {"data", "backups", "sinew.db", "sinew.db-wal", "sinew.db-shm", "service.lock", "commands.lock"}

State = Callable[[Path], str]


@dataclass(frozen=True)
class Trial:
    """A command with ``{}`` for its folder, which is a copy of ``prepared``."""

    name: str
    prepared: Path
    words: tuple[str, ...]
    state: State


def kill_commands(kills: int, console: Console) -> bool:
    """Kill commands ``times`` times in total, spread over the kinds, and run each on ``SIZES`` sizes of a full disk."""
    tally = Tally("commands killed", console)
    dice = random.Random(int(time.time()))
    with tempfile.TemporaryDirectory() as made:
        trials = _trials(Path(made))
        for trial in trials:
            before, after, lasts_s, needs = _whole(trial, Path(made))
            outcomes = {"old": 0, "new": 0}
            for number in range(max(1, kills // len(trials))):
                folder = _copied(trial, Path(made) / "killed")
                process = _begun(trial, folder)
                try:
                    process.wait(dice.uniform(0.0, 1.1 * lasts_s))
                except subprocess.TimeoutExpired:
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                _judge(trial, folder, before, after, tally, outcomes, f"{trial.name}, kill {number}")
            tally.note(f"{trial.name}: {outcomes['old']} times the old state, {outcomes['new']} times the new one")
            for number in range(SIZES):
                _on_full_disk(trial, before, after, needs * (number + 1) / SIZES, tally)
    return tally.close()


def _trials(made: Path) -> list[Trial]:
    """Prepare the folders: a run with a backup from before its tag, an old schema, and a bundle from elsewhere."""
    with_run, old, other = made / "run", made / "old", made / "other"
    for folder in (with_run, other):
        _sinew("experiment", "compliance", "--data", str(folder / "data"), "--params", "ideal")
    _sinew("db", "backup", str(with_run / "data" / "backups" / "then.db"), "--data", str(with_run / "data"))
    _sinew("runs", "tag", "1", "--add", "later", "--data", str(with_run / "data"))
    _sinew("runs", "bundle", "1", str(made / "bundle.zip"), "--data", str(other / "data"))
    with at_revision(old / "data", OLD_SCHEMA):
        pass
    data, out = "{}/data", "{}/out"
    return [
        Trial("restore", with_run, ("db", "restore", "{}/data/backups/then.db", "--data", data), _tags),
        Trial("upgrade", old, ("db", "upgrade", "--data", data), _schema),
        Trial("import", with_run, ("runs", "import", str(made / "bundle.zip"), "--data", data), _runs),
        Trial("export", with_run, ("runs", "export", "1", f"{out}.csv", "--data", data), _is_there("out.csv")),
        Trial("backup", with_run, ("db", "backup", "{}/data/backups/now.db", "--data", data), _is_whole("now.db")),
        Trial("report", with_run, ("runs", "report", "1", out, "--data", data), _is_there("out/report.html")),
    ]


def _asked(folder: Path, query: str) -> str:
    with closing(sqlite3.connect(f"file:{folder / 'data' / 'sinew.db'}?mode=ro", uri=True)) as database:
        return str(database.execute(query).fetchall())


def _tags(folder: Path) -> str:
    return _asked(folder, "SELECT tag FROM run_tag")


def _schema(folder: Path) -> str:
    return _asked(folder, "SELECT version_num FROM alembic_version")


def _runs(folder: Path) -> str:
    return _asked(folder, "SELECT kind FROM run ORDER BY id")


def _is_there(name: str) -> State:
    """Return the size of a file, or that it is absent: an incomplete file is a third state."""
    return lambda folder: str((folder / name).stat().st_size) if (folder / name).exists() else "not there"


def _is_whole(name: str) -> State:
    def state(folder: Path) -> str:
        file = folder / "data" / "backups" / name
        if not file.exists():
            return "not there"
        with closing(sqlite3.connect(f"file:{file}?immutable=1", uri=True)) as copy:
            return str(copy.execute("PRAGMA integrity_check").fetchall())

    return state


def _whole(trial: Trial, made: Path) -> tuple[str, str, float, int]:
    """Run the command undisturbed; return the states before and after, its duration [s], and its output [bytes]."""
    folder = _copied(trial, made / "whole")
    before, begun, size = trial.state(folder), time.monotonic(), _size(folder)
    process = _begun(trial, folder)
    if process.wait() != 0:
        raise AssertionError(f"{trial.name}: {process.stderr.read().decode() if process.stderr else ''}")
    lasts_s = time.monotonic() - begun
    after = trial.state(folder)
    if before == after:
        raise AssertionError(f"{trial.name} changes nothing: {before}")
    return before, after, lasts_s, max(_size(folder) - size, 100_000)


def _judge(
    trial: Trial, folder: Path, before: str, after: str, tally: Tally, outcomes: dict[str, int], what: str
) -> None:
    """Start as the service does, and compare the state."""
    with lock_for_service(folder / "data"):
        recover_database(folder / "data" / "sinew.db")
    found = trial.state(folder)
    tally.lost(found not in (before, after), f"{what}: {found}, neither {before} nor {after}")
    outcomes["new" if found == after else "old"] += 1
    left = {one.name for one in (folder / "data").iterdir()} - _OURS
    tally.lost(any(".before-restore-" not in name for name in left), f"{what}: left {sorted(left)}")
    copies = {one.name for one in (folder / "data" / "backups").glob("*")}
    tally.lost(any(not name.endswith(".db") for name in copies), f"{what}: left {sorted(copies)}")
    with closing(open_database(folder / "data")) as database:
        tally.lost(bool(problems := find_database_errors(database.engine)), f"{what}: {problems}")


def _on_full_disk(trial: Trial, before: str, after: str, room: float, tally: Tally) -> None:
    """Run the command with space for a part of its output; a failed command must name the file."""
    with tempfile.TemporaryDirectory() as mount:
        size = _size(trial.prepared)
        mount_small(mount, max(1, round((size + room) / 2**20 + 0.5)))
        try:
            folder = _copied(trial, Path(mount) / "work")
            process = _begun(trial, folder)
            status = process.wait()
            said = process.stderr.read().decode() if process.stderr else ""
            what = f"{trial.name} with room for {room / 2**20:.1f} MB"
            tally.lost(status != 0 and "Traceback" in said, f"{what}: {said[-300:]}")
            tally.lost(status != 0 and not said.strip(), f"{what}: status {status} without a word")
            _give_room(mount)
            _judge(trial, folder, before, after, tally, {"old": 0, "new": 0}, what)
        finally:
            unmount(mount)


def _give_room(mount: str) -> None:
    """Clear the disk, because the next start needs space."""
    subprocess.run(["mount", "-o", "remount,size=512m", mount], check=True, capture_output=True)


def _copied(trial: Trial, folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(trial.prepared, folder)
    return folder


def _begun(trial: Trial, folder: Path) -> subprocess.Popen[bytes]:
    words = [word.format(folder) for word in trial.words]
    return subprocess.Popen(
        [sys.executable, "-m", "backend", *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=os.environ
    )


def _sinew(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "backend", *words], check=True, capture_output=True)


def _size(folder: Path) -> int:
    return sum(one.stat().st_size for one in folder.rglob("*") if one.is_file())
