"""A run moves from one installation to another by the command line, and its report holds there."""

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from backend.storage.database import open_database
from backend.storage.runs import RunKind
from tests.cli.conftest import Command
from tests.exports.stored import NEW, recorded


def test_a_run_its_lineage_and_its_report_move_to_an_empty_installation(command: Command, tmp_path: Path) -> None:
    out, here, there = tmp_path / "out", tmp_path / "here", tmp_path / "there"
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    assert command("experiment", "tracking", *short, folder=here).returncode == 0
    (out / "data.csv").unlink()
    file, report = tmp_path / "run.zip", out / "report.html"
    assert command("runs", "bundle", "1", str(file), folder=here).returncode == 0
    assert command("report", "verify", str(report), folder=there).returncode == 2  # the samples are not there yet
    taken = command("runs", "import", str(file), "--json", folder=there)
    assert json.loads(taken.stdout) == {"run": 1, "was": 1, "new": True}, taken.stderr
    held = command("report", "verify", str(report), folder=there)
    assert (held.returncode, "holds: every number" in held.stdout) == (0, True), held.stderr
    again = command("runs", "import", str(file), folder=there)
    assert (again.returncode, again.stdout.strip()) == (0, "run 1 is here already, as run 1: nothing is done")
    one, other = (json.loads(command("runs", "lineage", "1", "--json", folder=data).stdout) for data in (here, there))
    assert [node["sha256"] for node in other["nodes"]] == [node["sha256"] for node in one["nodes"]]


def test_a_run_is_taken_in_tagged_and_handed_on_for_a_station(command: Command, tmp_path: Path) -> None:
    with closing(open_database(tmp_path / "here")) as here, here.session() as session:
        for _ in range(2):
            recorded(session, replace(NEW, kind=RunKind.SESSION))
    file, there, of = tmp_path / "run.csv", tmp_path / "there", ("--station", "rig-b")
    assert command("runs", "export", "1", str(file), *of, folder=tmp_path / "here").returncode == 0
    assert command("runs", "import", str(file), *of, folder=there).returncode == 0
    assert command("runs", "tag", "1", "--add", "worn", *of, folder=there).returncode == 0
    elsewhere = command("runs", "tag", "1", "--add", "mine", folder=there)
    assert (elsewhere.returncode, "is one of station rig-b" in elsewhere.stderr) == (1, True)
    (listed,) = json.loads(command("runs", "list", "--json", *of, folder=there).stdout)
    assert (listed["station"], listed["tags"]) == ("rig-b", ["worn"])
    assert command("runs", "bundle", "1", str(tmp_path / "run.zip"), *of, folder=there).returncode == 0
    assert command("runs", "compare", "1", "2", *of, folder=tmp_path / "here").returncode == 0


def test_what_is_refused_says_why_and_ends_with_2(command: Command, tmp_path: Path) -> None:
    file = tmp_path / "run.zip"
    file.write_bytes(b"no zip")
    for words in (("import", str(file)), ("import", str(tmp_path / "none.csv")), ("bundle", "7", str(file))):
        refused = command("runs", *words, folder=tmp_path / "data")
        assert refused.returncode == 2
        assert "Traceback" not in refused.stderr
    assert file.read_bytes() == b"no zip"
