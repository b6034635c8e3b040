"""Whether a report holds, as the command line says it and as programs read its end."""

import json
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path
from subprocess import DEVNULL

from backend.recording.codec import pack_table, unpack
from backend.storage import recordings
from backend.storage.database import open_database
from backend.storage.orm import UnknownRecordError
from plant.parameters import load_parameters
from tests.cli.conftest import Command


def sinew(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own."""
    command = [sys.executable, "-m", "backend", *words, "--data", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_a_report_holds_until_somebody_touches_it(command: Command, tmp_path: Path) -> None:
    out, here = tmp_path / "out", tmp_path / "here"
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    assert command("experiment", "tracking", *short, folder=here).returncode == 0
    report = out / "report.html"
    held = sinew("report", "verify", str(report), folder=tmp_path / "elsewhere")  # which draws it anew
    assert (held.returncode, "holds: every number" in held.stdout) == (0, True), held.stderr
    samples = (out / "data.csv").read_text(encoding="utf-8")
    (out / "data.csv").write_text(samples.replace("\n0.5,", "\n0.5001,", 1), encoding="utf-8")
    later = command("report", "verify", str(report), folder=tmp_path / "elsewhere")
    assert (later.returncode, "samples of t from 0 s to 1 s" in later.stderr) == (1, True)
    assert "the file of the samples: the report says samples as they were exported" in later.stderr
    (out / "data.csv").unlink()
    by_the_run = command("report", "verify", str(report), "--json", folder=here)
    assert json.loads(by_the_run.stdout) == {
        "holds": True,
        "samples": "run 1 of the data folder",
        "checked": ["run 1 of the data folder", str(out / "metrics.json")],
        "differences": [],
        "left_out": [],
        "signature": {"state": "none", "key": None, "fingerprint": None, "name": None},
    }
    nowhere = command("report", "verify", str(report), folder=tmp_path / "elsewhere")
    assert nowhere.returncode == 2
    assert not (tmp_path / "elsewhere").exists()  # who only reads makes no folder
    assert "the samples that it was made of are not here" in nowhere.stderr
    page = report.read_text(encoding="utf-8")
    report.write_text(page.replace("simulator, parameters", "rig, parameters", 1), encoding="utf-8")
    touched = command("report", "verify", str(report), folder=here)
    assert touched.returncode == 1
    assert "does not hold: 1 differences" in touched.stderr


def change_a_sample(folder: Path, run: int, of: str, by: float) -> None:
    """Change one stored sample in the middle of a chunk, packed as it was; its summary stays."""
    with closing(sqlite3.connect(folder / "sinew.db")) as database, database:
        (fields,) = database.execute("select fields from recording where run_id = ?", (run,)).fetchone()
        column = json.loads(fields).index(of)
        chunks = database.execute("select first_tick, samples from chunk where run_id = ? order by first_tick", (run,))
        first_tick, packed = chunks.fetchall()[1]
        table = unpack(packed, len(json.loads(fields))).copy()
        table[123, column] += by
        changed = (pack_table(table), run, first_tick)
        database.execute("update chunk set samples = ? where run_id = ? and first_tick = ?", changed)


def test_all_that_lies_beside_a_report_is_compared(command: Command, tmp_path: Path) -> None:
    """A metric in metrics.json, a unit in data.csv, a sample in the database: each is found where it was changed."""
    out, here = tmp_path / "out", tmp_path / "here"
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    assert command("experiment", "tracking", *short, folder=here).returncode == 0
    report, metrics, samples = out / "report.html", out / "metrics.json", out / "data.csv"

    def verified(file: Path = report) -> tuple[int, list[str], dict[str, object]]:
        done = command("report", "verify", str(file), "--json", folder=here)
        told = json.loads(done.stdout)
        return done.returncode, [one["name"] for one in told["differences"]], told

    status, names, told = verified()
    assert (status, names, told["holds"]) == (0, [], True)
    assert told["samples"] == str(samples)
    assert told["checked"] == [str(samples), "run 1 of the data folder", str(metrics)]

    as_written = metrics.read_text(encoding="utf-8")
    document = json.loads(as_written)
    document["metrics"]["peak_voltage_V"] += 0.01
    metrics.write_text(json.dumps(document), encoding="utf-8")
    assert verified()[:2] == (1, ["metrics.json, metrics, peak_voltage_V"])
    assert verified(out / "report.pdf")[:2] == (1, ["metrics.json, metrics, peak_voltage_V"])
    document = json.loads(as_written)
    document["units"]["peak_voltage_V"] = "mV"
    metrics.write_text(json.dumps(document), encoding="utf-8")
    assert verified()[:2] == (1, ["metrics.json, units, peak_voltage_V"])
    metrics.write_text(as_written[:-10], encoding="utf-8")
    assert verified()[:2] == (1, ["metrics.json"])
    metrics.write_text(as_written, encoding="utf-8")

    exported = samples.read_text(encoding="utf-8")
    samples.write_text(exported.replace("# q [rad]", "# q [deg]", 1), encoding="utf-8")
    assert verified()[:2] == (1, ["units and meanings in data.csv"])
    samples.write_text(exported, encoding="utf-8")
    assert verified()[0] == 0

    assert command("db", "check", folder=here).returncode == 0
    change_a_sample(here, 1, "q", 1e-5)
    status, names, told = verified()
    assert (status, told["samples"]) == (1, str(samples))
    assert names == ["run 1 of the data folder, samples of q from 1 s to 2 s"]
    done = command("report", "verify", str(report), folder=here)
    assert f"computed from {samples}; compared with it: run 1 of the data folder" in " ".join(done.stderr.split())
    checked = command("db", "check", "--json", folder=here)
    document = json.loads(checked.stdout)
    assert (checked.returncode, document["whole"], document["recordings"]) == (1, False, 1)
    assert ["run 1: the samples from 1 s on" in problem for problem in document["problems"]] == [True]


def test_samples_from_before_digests_were_kept_are_compared_as_far_as_they_can_be(
    command: Command, tmp_path: Path
) -> None:
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5")
    assert command("experiment", "tracking", *short, folder=tmp_path).returncode == 0
    with closing(sqlite3.connect(tmp_path / "sinew.db")) as database, database:
        database.execute("update chunk set sha256 = ''")
    unknown = command("db", "check", "--json", folder=tmp_path)
    told = json.loads(unknown.stdout)
    assert (unknown.returncode, told["whole"], len(told["not_compared"])) == (0, True, 1)
    change_a_sample(tmp_path, 1, "q", 3.0)  # beyond the largest value that is kept beside it
    assert command("db", "check", folder=tmp_path).returncode == 1


def test_what_a_killed_command_left_behind_has_a_report_that_holds(command: Command, tmp_path: Path) -> None:
    here, out, series = tmp_path / "here", tmp_path / "out", tmp_path / "series.html"
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5")
    assert command("experiment", "tracking", *short, folder=here).returncode == 0
    words = ("experiment", "tracking", "--set", "q_duration_s=60", "--data", str(here))
    with subprocess.Popen([sys.executable, "-m", "backend", *words], stdout=DEVNULL, stderr=DEVNULL) as playing:
        _until_recorded(here, 2)
        playing.send_signal(signal.SIGSTOP)
        alive = command("runs", "show", "2", "--json", folder=here)
        assert json.loads(alive.stdout)["end_state"] == "running"
        playing.kill()
    assert command("runs", "report", "2", str(out), folder=here).returncode == 0
    told = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    assert (told["end_state"], told["complete"]) == ("service_died", False)
    assert "s were played" in told["verdict"]
    held = command("report", "verify", str(out / "report.html"), folder=here)
    assert (held.returncode, "holds: every number" in held.stdout) == (0, True), held.stderr
    assert command("report", "series", "1", "2", "--to", str(series), folder=here).returncode == 0
    assert command("report", "verify", str(series), folder=here).returncode == 0


def _until_recorded(folder: Path, run: int) -> None:
    database = open_database(folder)
    for _ in range(600):
        with suppress(UnknownRecordError), database.reading() as session:
            recordings.extent(session, run)
            break
        time.sleep(0.1)
    database.close()


def test_several_experiments_play_in_turn_with_files_for_each(command: Command, tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    shown = command("experiments", "text", "step_battery", folder=tmp_path / "here")
    own.write_text(shown.stdout.replace("name: step_battery\n", "name: mine\n", 1), encoding="utf-8")
    assert command("experiments", "keep", str(own), folder=tmp_path / "here").returncode == 0
    ordered = ("mine@1", str(own), "--set", "hold_s=1.5", "--set", "sizes=1", "--json", "--out", str(tmp_path / "out"))
    played = command("experiment", *ordered, folder=tmp_path / "here")
    assert played.returncode == 0, played.stderr
    documents = json.loads(played.stdout)
    assert [one["run"] for one in documents] == [1, 2]
    assert documents[0]["settings"]["plan"] == documents[1]["settings"]["plan"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"run-1", "run-2"}
    series = tmp_path / "series.html"
    written = command("report", "series", "1", "2", "--to", str(series), "--json", folder=tmp_path / "here")
    assert json.loads(written.stdout) == {"runs": [1, 2], "files": [str(series)]}
    assert command("report", "verify", str(series), folder=tmp_path / "here").returncode == 0
    assert command("report", "verify", str(series), folder=tmp_path / "elsewhere").returncode == 2
    pdf = tmp_path / "out" / "run-1" / "report.pdf"
    assert sinew("report", "verify", str(pdf), folder=tmp_path / "elsewhere").returncode == 0
    pdf.write_bytes((tmp_path / "out" / "run-2" / "report.pdf").read_bytes())
    other = command("report", "verify", str(pdf), folder=tmp_path / "elsewhere")
    assert (other.returncode, "the PDF: the report says other pages" in other.stderr) == (1, True)
    alone = command("report", "series", "1", "--to", str(series), folder=tmp_path / "here")
    assert (alone.returncode, "number of runs: 1 is outside 2 to 100" in alone.stderr) == (1, True)
    refused = command("experiment", "mine@2", folder=tmp_path / "here")
    assert refused.returncode == 1
    assert "there is no such experiment; known: tracking" in refused.stderr


def test_identifications_at_several_tensions_tell_the_friction_over_the_load(command: Command, tmp_path: Path) -> None:
    short = ("--set", "bits=5", "--set", "settle_s=1", "--json")
    played = command("identify", "actuator", "--params", "lab", "--tensions", "10,30", *short, folder=tmp_path / "here")
    assert played.returncode == 0, played.stderr
    found = [one["load_friction"] for one in json.loads(played.stdout)]
    assert found[0] == found[1]
    lab = load_parameters("lab").motor
    estimate = found[0]["estimate"]
    assert estimate["runs"] == [1, 2]
    assert abs(estimate["c0"] - lab.c0) < 0.15 * lab.c0
    assert abs(estimate["c1"] - lab.c1) < 0.10 * lab.c1
    alone = command("identify", "actuator", "--params", "lab", *short, folder=tmp_path / "here")
    assert alone.returncode == 0, alone.stderr
    assert json.loads(alone.stdout)["load_friction"]["estimate"] is None
