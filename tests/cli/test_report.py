"""Reports on the command line: verification, signatures, reproduction, and forged plans."""

import base64
import json
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace
from html import unescape
from pathlib import Path
from subprocess import DEVNULL
from typing import Any

import numpy as np
import pytest
from pypdf import PdfReader

from backend.experiments.library import build_ready_plan, list_stored_values
from backend.experiments.parser import ExperimentError
from backend.exports.base import SEAL, ImportRefusedError
from backend.models.document import document_digest
from backend.models.run import DEFINITIONS
from backend.recording.codec import pack_table, unpack
from backend.sample import ADDED_LATER
from backend.services.downloads import check_run_settings
from backend.services.runs import read_planned_run
from backend.storage import recordings, runs
from backend.storage.database import open_database
from backend.storage.orm import UnknownRecordError
from backend.storage.runs import Run
from plant.parameters import load_parameters
from tests.cli.conftest import Command
from tests.migrations.old_schema import migrated
from tests.models.earlier import BEFORE
from tests.reports.tracking_run import PLAN, samples, source_of
from tests.soak.attack.costly import HOLDING

# Verification of a report on the command line, and its result for programs.


def sinew(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own."""
    command = [sys.executable, "-m", "backend", *words, "--data", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_a_report_is_verified_until_it_is_changed(command: Command, tmp_path: Path) -> None:
    out, here = tmp_path / "out", tmp_path / "here"
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    assert command("experiment", "tracking", *short, folder=here).returncode == 0
    report = out / "report.html"
    held = sinew("report", "verify", str(report), folder=tmp_path / "elsewhere")  # which draws it again
    assert (held.returncode, "is verified: every number" in held.stdout) == (0, True), held.stderr
    samples = (out / "data.csv").read_text(encoding="utf-8")
    (out / "data.csv").write_text(samples.replace("\n0.5,", "\n0.5001,", 1), encoding="utf-8")
    later = command("report", "verify", str(report), folder=tmp_path / "elsewhere")
    assert (later.returncode, "samples of t from 0 s to 1 s" in later.stderr) == (1, True)
    assert "the file of the samples: the report has samples as they were exported" in later.stderr
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
    assert not (tmp_path / "elsewhere").exists()  # a command that only reads creates no folder
    assert "the samples of the report are missing" in nowhere.stderr
    page = report.read_text(encoding="utf-8")
    report.write_text(page.replace("simulator, parameters", "rig, parameters", 1), encoding="utf-8")
    touched = command("report", "verify", str(report), folder=here)
    assert touched.returncode == 1
    assert "verification failed, 1 difference" in touched.stderr


def change_a_sample(folder: Path, run: int, of: str, by: float) -> None:
    """Change one stored sample in the middle of a chunk; its summary is unchanged."""
    with closing(sqlite3.connect(folder / "sinew.db")) as database, database:
        (fields,) = database.execute("select fields from recording where run_id = ?", (run,)).fetchone()
        column = json.loads(fields).index(of)
        chunks = database.execute("select first_tick, samples from chunk where run_id = ? order by first_tick", (run,))
        first_tick, packed = chunks.fetchall()[1]
        table = unpack(packed, len(json.loads(fields))).copy()
        table[123, column] += by
        changed = (pack_table(table), run, first_tick)
        database.execute("update chunk set samples = ? where run_id = ? and first_tick = ?", changed)


def test_verification_compares_all_files_of_a_report(command: Command, tmp_path: Path) -> None:
    """A metric in metrics.json, a unit in data.csv, a sample in the database: each change is found."""
    out, here = tmp_path / "out", tmp_path / "here"
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    assert command("experiment", "tracking", *short, folder=here).returncode == 0
    report, metrics, samples = out / "report.html", out / "metrics.json", out / "data.csv"

    def verified(file: Path = report) -> tuple[int, list[str], dict[str, object]]:
        done = command("report", "verify", str(file), "--json", folder=here)
        output = json.loads(done.stdout)
        return done.returncode, [one["name"] for one in output["differences"]], output

    status, names, output = verified()
    assert (status, names, output["holds"]) == (0, [], True)
    assert output["samples"] == str(samples)
    assert output["checked"] == [str(samples), "run 1 of the data folder", str(metrics)]

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
    status, names, output = verified()
    assert (status, output["samples"]) == (1, str(samples))
    assert names == ["run 1 of the data folder, samples of q from 1 s to 2 s"]
    done = command("report", "verify", str(report), folder=here)
    assert f"computed from {samples}; also compared: run 1 of the data folder" in " ".join(done.stderr.split())
    checked = command("db", "check", "--json", folder=here)
    document = json.loads(checked.stdout)
    assert (checked.returncode, document["whole"], document["recordings"]) == (1, False, 1)
    assert ["run 1: the samples from 1 s on" in problem for problem in document["problems"]] == [True]


def test_samples_without_digests_are_compared_with_their_summary(command: Command, tmp_path: Path) -> None:
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5")
    assert command("experiment", "tracking", *short, folder=tmp_path).returncode == 0
    with closing(sqlite3.connect(tmp_path / "sinew.db")) as database, database:
        database.execute("update chunk set sha256 = ''")
    unknown = command("db", "check", "--json", folder=tmp_path)
    output = json.loads(unknown.stdout)
    assert (unknown.returncode, output["whole"], len(output["not_compared"])) == (0, True, 1)
    change_a_sample(tmp_path, 1, "q", 3.0)  # beyond the largest value in its summary
    assert command("db", "check", folder=tmp_path).returncode == 1


def test_the_report_of_a_killed_command_is_verified(command: Command, tmp_path: Path) -> None:
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
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    assert (metrics["end_state"], metrics["complete"]) == ("service_died", False)
    assert "s were executed" in metrics["verdict"]
    held = command("report", "verify", str(out / "report.html"), folder=here)
    assert (held.returncode, "is verified: every number" in held.stdout) == (0, True), held.stderr
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


def test_several_experiments_run_in_sequence_with_separate_files(command: Command, tmp_path: Path) -> None:
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
    assert (other.returncode, "the PDF: the report has other pages" in other.stderr) == (1, True)
    alone = command("report", "series", "1", "--to", str(series), folder=tmp_path / "here")
    assert (alone.returncode, "number of runs: 1 is outside 2 to 100" in alone.stderr) == (1, True)
    refused = command("experiment", "mine@2", folder=tmp_path / "here")
    assert refused.returncode == 1
    assert "tracking" in refused.stderr, "the refusal lists the known experiments"


def test_identifications_at_several_tensions_estimate_load_friction(command: Command, tmp_path: Path) -> None:
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


# The report of a run of an older version: readable with a note, verified after a new evaluation.

SHORT = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5")


def make_older(folder: Path) -> None:
    """Remove from each recording and result what an older version lacked: signals, version, digests."""
    with closing(sqlite3.connect(folder / "sinew.db")) as database, database:
        for run, text in database.execute("select run_id, fields from recording").fetchall():
            fields = json.loads(text)
            retained = [place for place, name in enumerate(fields) if name not in ADDED_LATER]
            assert len(retained) == len(fields) - len(ADDED_LATER)
            words = json.dumps([fields[place] for place in retained])
            database.execute("update recording set fields = ? where run_id = ?", (words, run))
            for column in ("samples", "summary"):
                chunks = database.execute(f"select first_tick, {column} from chunk where run_id = ?", (run,)).fetchall()
                for first_tick, packed in chunks:
                    fewer = pack_table(np.ascontiguousarray(unpack(packed, len(fields))[:, retained]))
                    database.execute(
                        f"update chunk set {column} = ?, sha256 = '' where run_id = ? and first_tick = ?",
                        (fewer, run, first_tick),
                    )
        for number, text in database.execute("select id, metrics from result").fetchall():
            metrics = json.loads(text)
            assert metrics.pop("definitions") == DEFINITIONS
            database.execute("update result set metrics = ? where id = ?", (json.dumps(metrics), number))
    migrated(open_database(folder), folder, BEFORE).close()


def test_a_report_of_an_older_run_is_verified_only_after_a_new_evaluation(command: Command, tmp_path: Path) -> None:
    here, out = tmp_path / "here", tmp_path / "out"
    assert command("experiment", "tracking", *SHORT, folder=here).returncode == 0
    assert command("experiment", "tracking", *SHORT, folder=here).returncode == 0
    make_older(here)
    report, series, remedy = out / "report.html", out / "series.html", "sinew runs evaluate 1"

    def verified(file: Path, folder: Path = here) -> tuple[int, dict[str, Any]]:
        done = command("report", "verify", str(file), "--json", folder=folder)
        return done.returncode, json.loads(done.stdout)

    def written() -> tuple[str, str]:
        assert command("runs", "report", "1", str(out), folder=here).returncode == 0
        pdf = " ".join(" ".join(sheet.extract_text().split()) for sheet in PdfReader(out / "report.pdf").pages)
        return report.read_text(encoding="utf-8"), pdf

    page, pdf = written()
    heading = (out / "data.csv").read_text(encoding="utf-8").split("\nt,", 1)[1].splitlines()[0].split(",")
    assert not ADDED_LATER & {*heading}
    assert page.partition("<main>")[0].count(remedy) == 1
    assert remedy in pdf
    for file in (report, out / "report.pdf"):
        for folder in (here, tmp_path / "elsewhere"):  # by the stored samples, and by data.csv alone
            status, output = verified(file, folder)
            assert (status, output["holds"], output["differences"]) == (2, None, [])
            assert [remedy in one for one in output["left_out"]] == [True]
    assert command("report", "sign", str(report), folder=here).returncode == 2
    assert command("report", "series", "1", "2", "--to", str(series), folder=here).returncode == 0
    text = series.read_text(encoding="utf-8").partition("<main>")[0]
    assert [f"sinew runs evaluate {number}" in text for number in (1, 2)] == [True, True]
    assert verified(series)[0] == 2

    assert command("runs", "evaluate", "1", folder=here).returncode == 0
    page, pdf = written()
    assert remedy not in page
    assert remedy not in pdf
    for file in (report, out / "report.pdf"):
        for folder in (here, tmp_path / "elsewhere"):
            status, output = verified(file, folder)
            assert (status, output["holds"], output["left_out"]) == (0, True, []), output
    assert command("report", "sign", str(report), folder=here).returncode == 0
    assert verified(report)[0] == 0


# A report is signed by the installation that has its run, and verified elsewhere with the public key alone.


def test_a_signature_proves_the_origin_of_a_report(command: Command, tmp_path: Path) -> None:
    here, out, elsewhere = tmp_path / "here", tmp_path / "out", tmp_path / "elsewhere"
    assert command("experiment", "tracking", *SHORT, "--out", str(out), folder=here).returncode == 0
    report, public = out / "report.html", tmp_path / "rig-2.pub"

    def verified(*words: str, folder: Path = elsewhere, file: Path = report) -> tuple[int, Any, dict[str, Any]]:
        done = command("report", "verify", str(file), "--json", *words, folder=folder)
        output = json.loads(done.stdout)
        return done.returncode, output["holds"], output["signature"]

    assert verified() == (0, True, {"state": "none", "key": None, "fingerprint": None, "name": None})
    assert not elsewhere.exists()
    assert not (here / "signing-key").exists()

    line = command("report", "key", "--station", "rig-2", folder=here).stdout
    public.write_text(line, encoding="utf-8")
    key = json.loads(command("report", "key", "--station", "rig-2", "--json", folder=here).stdout)
    assert line.split() == [*key["public_key"].split(), key["fingerprint"], "rig-2"]
    assert len(line.splitlines()) == 1
    assert verified("--key", str(public))[:2] == (1, False)  # not signed yet

    before = report.read_bytes()
    report.chmod(0o640)
    signed = command("report", "sign", str(report), "--station", "rig-2", folder=here)
    assert signed.returncode == 0, signed.stderr
    assert key["fingerprint"] in signed.stdout
    once = report.read_bytes()
    assert report.stat().st_mode & 0o777 == 0o640
    assert re.sub(rb'<template id="signature">[^<]*</template>', b"", once) == before
    assert command("report", "sign", str(report), "--station", "rig-2", folder=here).returncode == 0
    assert report.read_bytes() == once
    assert {path.name for path in out.iterdir()} == {"report.html", "report.pdf", "data.csv", "metrics.json"}

    by = {"state": "valid", "fingerprint": key["fingerprint"], "name": "rig-2"}
    assert verified() == (0, True, {**by, "key": "unknown"})
    assert verified(folder=here) == (0, True, {**by, "key": "own"})
    assert verified("--key", str(public)) == (0, True, {**by, "key": "given"})
    assert verified("--key", key["public_key"], file=out / "report.pdf") == (0, True, {**by, "key": "given"})
    assert not elsewhere.exists()
    unknown = command("report", "verify", str(report), folder=elsewhere).stdout
    assert "an unknown key: it does not prove" in " ".join(unknown.split())
    other = json.loads(command("report", "key", "--json", folder=tmp_path / "third").stdout)["public_key"]
    status, holds, of = verified("--key", other)
    assert (status, holds, of["key"]) == (1, False, "unknown")
    junk = command("report", "verify", str(report), "--key", "junk", folder=elsewhere)
    assert (junk.returncode, junk.stdout) == (2, "")

    alone = tmp_path / "alone" / "report.html"  # without samples the signature is verified, the numbers are not
    alone.parent.mkdir()
    alone.write_bytes(once)
    assert verified("--key", str(public), file=alone) == (2, None, {**by, "key": "given"})
    for touched in (once.replace(b"</h1>", b" </h1>", 1), once.replace(b"</h1>", b"\xff</h1>", 1)):
        report.write_bytes(touched)
        alone.write_bytes(touched)
        assert verified()[2]["state"] == "broken"
        assert verified()[:2] == verified(file=alone)[:2] == (1, False)
    report.write_bytes(once)


def test_only_reports_verified_by_the_runs_of_the_folder_are_signed(command: Command, tmp_path: Path) -> None:
    here, out, elsewhere = tmp_path / "here", tmp_path / "out", tmp_path / "elsewhere"
    for _ in range(2):
        assert command("experiment", "tracking", *SHORT, "--out", str(out), folder=here).returncode == 0
    report, series = out / "report.html", out / "series.html"
    page = report.read_bytes()
    refused = command("report", "sign", str(report), folder=elsewhere)
    assert (refused.returncode, elsewhere.exists()) == (2, False)
    pdf = (out / "report.pdf").read_bytes()
    assert command("report", "sign", str(out / "report.pdf"), folder=here).returncode == 2
    assert (out / "report.pdf").read_bytes() == pdf
    for forged, status in (
        (page.replace(b"</h1>", b" </h1>", 1), 1),
        (page.replace(b'"Sinew":"', b'"Sinew":"0.', 1), 1),
        (b"<html></html>", 2),
        (b"\xff", 2),
    ):
        assert forged != page
        report.write_bytes(forged)
        assert command("report", "sign", str(report), folder=here).returncode == status
        assert report.read_bytes() == forged
    assert not (here / "signing-key").exists()

    assert command("report", "series", "1", "2", "--to", str(series), folder=here).returncode == 0
    assert command("report", "sign", str(series), folder=here).returncode == 0
    public = command("report", "key", folder=here).stdout.strip()
    assert command("report", "verify", str(series), "--key", public, folder=here).returncode == 0
    series.write_bytes(series.read_bytes().replace(b"</h1>", b" </h1>", 1))
    assert command("report", "verify", str(series), folder=here).returncode == 1


def test_the_private_key_is_in_no_backup_bundle_or_export(command: Command, tmp_path: Path) -> None:
    here, out = tmp_path / "here", tmp_path / "out"
    assert command("experiment", "tracking", *SHORT, "--out", str(out), folder=here).returncode == 0
    assert command("report", "sign", str(out / "report.html"), folder=here).returncode == 0
    pem = (here / "signing-key").read_bytes()
    body = base64.b64decode(b"".join(pem.splitlines()[1:-1]))
    secret = body[-32:]
    assert command("db", "backup", str(tmp_path / "backup.db"), folder=here).returncode == 0
    assert command("runs", "bundle", "1", str(tmp_path / "run.zip"), folder=here).returncode == 0
    assert command("runs", "export", "1", str(tmp_path / "run.mcap"), folder=here).returncode == 0
    files = [path for path in tmp_path.rglob("*") if path.is_file() and path.name != "signing-key"]
    assert {"backup.db", "run.zip", "run.mcap", "report.html", "sinew.db"} <= {path.name for path in files}
    forms = (pem, secret, secret.hex().encode(), base64.b64encode(secret), base64.b64encode(body)[-44:])
    assert [path for path in files if any(form in path.read_bytes() for form in forms)] == []


# The command in a report reproduces its run: extracted from page and PDF, executed unchanged, metrics compared.

_BLOCK = re.compile(r'<p class="code">(.*?)</p>\n<pre[^>]*><code>(.*?)</code></pre>', re.DOTALL)


def blocks_of(page: str) -> dict[str, str]:
    """Return the code blocks of a page, by the first word of their captions."""
    return {unescape(caption).split()[0].rstrip(","): unescape(text) for caption, text in _BLOCK.findall(page)}


def played_again(command: Command, report: Path, monkeypatch: pytest.MonkeyPatch, folder: Path) -> dict[str, object]:
    """Run the command of a report in an empty folder, with the files listed below it; return the metrics."""
    blocks = blocks_of(report.read_text(encoding="utf-8"))
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name in ("parameters.toml", "experiment.json"):
        if name in blocks:
            Path(name).write_text(blocks[name], encoding="utf-8")
    line = blocks["Repeat"]
    assert line.isascii()
    words = shlex.split(line.replace("\\\n", " "))
    assert words[0] == "sinew"
    again = command(*words[1:])
    assert again.returncode == 0, again.stderr
    return metrics_of(folder / "reproduced" / "report")


def metrics_of(folder: Path) -> dict[str, object]:
    document = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    return {name: document[name] for name in ("metrics", "criteria", "steps", "settings", "verdict")}


def test_the_command_in_a_report_reproduces_the_metrics(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    values = {"q_duration_s": 1.5, "S_duration_s": 1, "lam_q": 0.61, "b": 0.3, "u_plan": 0, "seed": 11}
    words = [word for name, value in values.items() for word in ("--set", f"{name}={value}")]
    assert command("experiment", "tracking", *words, "--out", str(out), folder=tmp_path / "here").returncode == 0
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again == metrics_of(out)
    page = blocks_of((out / "report.html").read_text(encoding="utf-8"))["Repeat"]
    pdf = "\n".join(sheet.extract_text() for sheet in PdfReader(out / "report.pdf").pages)
    assert [line.strip() for line in page.splitlines()] == [
        line.strip() for line in pdf[pdf.index("sinew experiment") :].splitlines()[: len(page.splitlines())]
    ]


def test_a_user_experiment_is_reproduced_from_the_files_in_its_report(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, own, plant = tmp_path / "out", tmp_path / "Nudge.yaml", tmp_path / "bench.toml"
    own.write_text(
        "format: 1\nname: nudge\ntitle: Nudge\nmeasures: [steps]\nphases:\n"
        "  - name: only\n    title: Only\n    parts:\n"
        "      - {do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 1.0}\n"
        "      - {do: step, q_ref: 0.2, S_ref: 10.0, duration_s: 1.5}\n",
        encoding="utf-8",
    )
    lab = Path("plant/parameters/ideal.toml").read_text(encoding="utf-8")
    plant.write_text(re.sub(r"(J_j = \{ value = )[^,]+", r"\g<1>6.1e-4", lab), encoding="utf-8")
    words = ("experiment", str(own), "--params", str(plant), "--out", str(out))
    done = command(*words, folder=tmp_path / "here")
    assert done.returncode == 0, done.stderr
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again == metrics_of(out)


def test_the_command_in_a_report_reproduces_a_sequence(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    segments = '[{"duration_s": 1, "q_ref": 0.1, "S_ref": 9}, {"duration_s": 1, "q_ref": 0, "S_ref": 9}]'
    words = ("experiment", "sequence", "--set", f"segments={segments}", "--out", str(out))
    assert command(*words, folder=tmp_path / "here").returncode == 0
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again["metrics"] == metrics_of(out)["metrics"]
    assert again["verdict"] == metrics_of(out)["verdict"]


def test_the_command_in_a_report_reproduces_an_identification(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    short = ("--set", "periods=1", "--set", "bits=6", "--set", "settle_s=4")
    assert command("identify", "actuator", *short, "--out", str(out), folder=tmp_path / "here").returncode == 0
    stored = json.loads((out / "metrics.json").read_text(encoding="utf-8"))["identification"]["model"]
    again = played_again(command, out / "report.html", monkeypatch, tmp_path / "again")
    assert again == metrics_of(out)
    monkeypatch.chdir(out)
    lines = blocks_of((out / "report.html").read_text(encoding="utf-8"))["To"].replace("\\\n", " ").splitlines()
    for key, line in zip(("G_q", "G_S"), lines, strict=True):
        found = command(*shlex.split(line)[1:], "--json")
        assert found.returncode == 0, found.stderr
        output = json.loads(found.stdout)
        assert output["parameters"] == pytest.approx(stored[key]["parameters"], rel=1e-4)


# A plan that would block the interpreter, with valid digests: rejected by every reader.

MARK = "# sinew-export: "


def sinew_resealed(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own, with a timeout."""
    command = [sys.executable, "-m", "backend", *words, "--data", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def with_costly_expression(plan: dict[str, Any]) -> None:
    """Insert the expression into the experiment of a plan."""
    assert '"duration_s":"q_duration_s"' in plan["experiment"]
    plan["experiment"] = plan["experiment"].replace('"duration_s":"q_duration_s"', f'"duration_s":"{HOLDING}"')


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A data folder with a tracking run, and the folder of its report."""
    folder, out = tmp_path_factory.mktemp("here"), tmp_path_factory.mktemp("out")
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    ended = sinew_resealed("experiment", "tracking", *short, folder=folder)
    assert ended.returncode == 0, ended.stderr
    return folder, out


def sealed(text: str, change: Callable[[dict[str, Any]], None]) -> str:
    head, line, tail = re.split(rf"({re.escape(MARK)}.*)\n", text, maxsplit=1)
    document = json.loads(line.removeprefix(MARK))
    document.pop(SEAL)
    change(document["run"])
    return f"{head}{MARK}{json.dumps(document | {SEAL: document_digest(document)}, ensure_ascii=False)}\n{tail}"


def test_a_forged_export_with_a_valid_digest_is_rejected(played: tuple[Path, Path], tmp_path: Path) -> None:
    _, out = played
    file = tmp_path / "run.csv"
    exported = (out / "data.csv").read_text("utf-8")
    file.write_text(sealed(exported, lambda run: with_costly_expression(run["settings"]["plan"])), "utf-8")
    refused = sinew_resealed("runs", "import", str(file), folder=tmp_path / "there")
    assert refused.returncode == 2
    assert "duration_s" in refused.stderr
    assert "-15 to 15" in refused.stderr
    listed = sinew_resealed("runs", "list", "--json", folder=tmp_path / "there")
    assert json.loads(listed.stdout) == []
    file.write_text(sealed(exported, lambda run: None), "utf-8")
    assert sinew_resealed("runs", "import", str(file), folder=tmp_path / "there").returncode == 0


def test_a_stored_run_with_a_forged_plan_is_rejected_by_every_command(
    played: tuple[Path, Path], tmp_path: Path
) -> None:
    folder, _ = played
    with closing(sqlite3.connect(folder / "sinew.db")) as here, closing(sqlite3.connect(tmp_path / "sinew.db")) as copy:
        here.backup(copy)
        settings = json.loads(copy.execute("SELECT settings FROM run").fetchone()[0])
        with_costly_expression(settings["plan"])
        copy.execute("UPDATE run SET settings = ?", (json.dumps(settings),))
        copy.execute("DELETE FROM result")
        copy.execute("DELETE FROM report")
        copy.commit()
    for words in (("evaluate", "1"), ("bundle", "1", str(tmp_path / "run.zip"))):
        refused = sinew_resealed("runs", *words, folder=tmp_path)
        assert refused.returncode != 0, words
        assert "-15 to 15" in refused.stderr, words
    database = open_database(tmp_path)
    with pytest.raises(ExperimentError):
        read_planned_run(database, 1)
    with database.reading() as session, pytest.raises(ImportRefusedError):
        check_run_settings(runs.get(session, 1))
    database.close()


def test_a_report_with_a_forged_plan_is_not_verified(played: tuple[Path, Path], tmp_path: Path) -> None:
    _, out = played
    page, csv = (out / "report.html").read_text("utf-8"), (out / "data.csv").read_bytes()
    escaped = '\\"duration_s\\":\\"q_duration_s\\"'
    assert escaped in page
    (tmp_path / "report.html").write_text(page.replace(escaped, f'\\"duration_s\\":\\"{HOLDING}\\"'), "utf-8")
    (tmp_path / "data.csv").write_bytes(csv)
    refused = sinew_resealed("report", "verify", str(tmp_path / "report.html"), folder=tmp_path / "none")
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
def test_settings_that_no_request_allows_are_rejected_at_import(settings: dict[str, Any]) -> None:
    check_run_settings(run_with())
    with pytest.raises(ImportRefusedError):
        check_run_settings(run_with(**settings))


# Actuators without tendons: the experiment, its report, and the commands that require tendons.


@pytest.mark.parametrize("name", ["awas2", "maccepa"])
def test_tracking_on_an_actuator_without_tendons_passes_and_is_verified(
    name: str, command: Command, tmp_path: Path
) -> None:
    out, here = tmp_path / "out", tmp_path / "here"
    played = command("experiment", "tracking", "--params", name, "--json", "--out", str(out), folder=here)
    assert played.returncode == 0, played.stderr
    text = unescape((out / "report.html").read_text(encoding="utf-8"))
    assert "second derivative of the identified mechanism's energy" in text
    for of_tendons in ("Smallest tendon tension", "20 N operating point", "k_2 r_m"):
        assert of_tendons not in text
    with (out / "data.csv").open(encoding="utf-8") as lines:
        rows = [line.rstrip("\n").split(",") for line in lines if not line.startswith("#")]
    assert {row[rows[0].index("F_A")] for row in rows[1:]} <= {"", "nan", "NaN"}
    verified = command("report", "verify", str(out / "report.html"), folder=tmp_path / "elsewhere")
    assert verified.returncode == 0, verified.stderr


def test_without_friction_in_the_gains_only_the_overshoot_of_S_fails(command: Command, tmp_path: Path) -> None:
    """As docs/how-to/experiments.md states for qbmove and bavs."""
    for name in ("qbmove", "bavs"):
        played = command("experiment", "tracking", "--params", name, "--json", folder=tmp_path)
        criteria = json.loads(played.stdout)["criteria"]
        assert [one["name"] for one in criteria if not one["passed"]] == ["overshoot_S"], name


@pytest.mark.parametrize("words", [("serve", "--port", "0"), ("identify", "motor"), ("identify", "actuator")])
def test_commands_that_require_tendons_are_refused_without_them(words: tuple[str, ...], tmp_path: Path) -> None:
    refused = sinew(*words, "--params", "qbmove", folder=tmp_path)
    assert refused.returncode == 1
    assert "qbmove" in refused.stderr
    assert "(bidirectional)" in refused.stderr


def test_an_obstacle_is_refused_without_tendons(command: Command, tmp_path: Path) -> None:
    refused = command("experiment", "impact", "--params", "qbmove", folder=tmp_path)
    assert refused.returncode == 1
    assert "obstacle" in refused.stderr
