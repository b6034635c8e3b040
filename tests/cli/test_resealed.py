"""A plan that was made to hold the interpreter, sealed again with right digests: refused by all that reads it."""

import json
import re
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.experiments.library import build_ready_plan, list_stored_values
from backend.experiments.parser import ExperimentError
from backend.exports.base import SEAL, ImportRefusedError
from backend.models.document import document_digest
from backend.services.downloads import check_run_settings
from backend.services.runs import read_planned_run
from backend.storage import runs
from backend.storage.database import open_database
from backend.storage.runs import Run
from tests.reports.tracking_run import PLAN, samples, source_of
from tests.soak.attack.costly import HOLDING

MARK = "# sinew-export: "


def sinew(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own, which is ended where it hangs."""
    command = [sys.executable, "-m", "backend", *words, "--data", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def held_up(plan: dict[str, Any]) -> None:
    """Put the expression into the experiment of a plan."""
    assert '"duration_s":"q_duration_s"' in plan["experiment"]
    plan["experiment"] = plan["experiment"].replace('"duration_s":"q_duration_s"', f'"duration_s":"{HOLDING}"')


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A data folder with a tracking run, and the folder of its report."""
    folder, out = tmp_path_factory.mktemp("here"), tmp_path_factory.mktemp("out")
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    ended = sinew("experiment", "tracking", *short, folder=folder)
    assert ended.returncode == 0, ended.stderr
    return folder, out


def sealed(text: str, change: Callable[[dict[str, Any]], None]) -> str:
    head, line, tail = re.split(rf"({re.escape(MARK)}.*)\n", text, maxsplit=1)
    said = json.loads(line.removeprefix(MARK))
    said.pop(SEAL)
    change(said["run"])
    return f"{head}{MARK}{json.dumps(said | {SEAL: document_digest(said)}, ensure_ascii=False)}\n{tail}"


def test_an_export_that_was_sealed_again_is_not_taken_in(played: tuple[Path, Path], tmp_path: Path) -> None:
    _, out = played
    file = tmp_path / "run.csv"
    exported = (out / "data.csv").read_text("utf-8")
    file.write_text(sealed(exported, lambda run: held_up(run["settings"]["plan"])), "utf-8")
    refused = sinew("runs", "import", str(file), folder=tmp_path / "there")
    assert refused.returncode == 2
    assert "duration_s" in refused.stderr
    assert "-15 to 15" in refused.stderr
    listed = sinew("runs", "list", "--json", folder=tmp_path / "there")
    assert json.loads(listed.stdout) == []
    file.write_text(sealed(exported, lambda run: None), "utf-8")
    assert sinew("runs", "import", str(file), folder=tmp_path / "there").returncode == 0


def test_a_run_that_is_stored_so_is_refused_by_all_that_opens_it(played: tuple[Path, Path], tmp_path: Path) -> None:
    folder, _ = played
    with closing(sqlite3.connect(folder / "sinew.db")) as here, closing(sqlite3.connect(tmp_path / "sinew.db")) as copy:
        here.backup(copy)
        settings = json.loads(copy.execute("SELECT settings FROM run").fetchone()[0])
        held_up(settings["plan"])
        copy.execute("UPDATE run SET settings = ?", (json.dumps(settings),))
        copy.execute("DELETE FROM result")
        copy.execute("DELETE FROM report")
        copy.commit()
    for words in (("evaluate", "1"), ("bundle", "1", str(tmp_path / "run.zip"))):
        refused = sinew("runs", *words, folder=tmp_path)
        assert refused.returncode != 0, words
        assert "-15 to 15" in refused.stderr, words
    database = open_database(tmp_path)
    with pytest.raises(ExperimentError):
        read_planned_run(database, 1)
    with database.reading() as session, pytest.raises(ImportRefusedError):
        check_run_settings(runs.get(session, 1))
    database.close()


def test_a_report_that_says_so_is_not_verified(played: tuple[Path, Path], tmp_path: Path) -> None:
    _, out = played
    page, csv = (out / "report.html").read_text("utf-8"), (out / "data.csv").read_bytes()
    escaped = '\\"duration_s\\":\\"q_duration_s\\"'
    assert escaped in page
    (tmp_path / "report.html").write_text(page.replace(escaped, f'\\"duration_s\\":\\"{HOLDING}\\"'), "utf-8")
    (tmp_path / "data.csv").write_bytes(csv)
    refused = sinew("report", "verify", str(tmp_path / "report.html"), folder=tmp_path / "none")
    assert refused.returncode in (1, 2)
    assert "Traceback" not in refused.stderr


def run_with(**settings: Any) -> Run:
    run = source_of(samples(PLAN)).run
    return replace(run, settings={**run.settings, **settings})


OF_PLAN = list_stored_values(build_ready_plan("tracking"))


@pytest.mark.parametrize(
    "settings",
    [
        {"plan": {**OF_PLAN, "q_duration_s": 1e9}},
        {"plan": {**OF_PLAN, "nobody_knows": 1.0}},
        {"plan": {**OF_PLAN, "experiment": "{"}},
        {"plan": {**OF_PLAN, "experiment": " " * 400_001}},
        {"plan": {**OF_PLAN, "experiment": str(OF_PLAN["experiment"]).replace("Tracking", "Track\\u202eing")}},
        {"loop": {"lam_q": 1e9}},
        {"loop": {"lam_q": 0.5, "u_plan": 99.0}},
        {"loop": {"lam_q": 0.5, "motion": "fast"}},
    ],
    ids=lambda settings: str(settings)[-60:],
)
def test_what_no_request_could_have_ordered_is_not_taken_in(settings: dict[str, Any]) -> None:
    check_run_settings(run_with())
    with pytest.raises(ImportRefusedError):
        check_run_settings(run_with(**settings))
