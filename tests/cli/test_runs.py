"""``sinew runs``: bundles, exports with formulas, and hostile texts through all writers."""

import csv
import json
import re
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd
import pytest

from backend.experiments.parser import parse_derived_signal
from backend.exports.base import export_run
from backend.exports.formats import DataFormat, write_export
from backend.models.run import MeasuredFigure, Metrics, RunCriterion
from backend.plain_text import escape_line
from backend.reports.build import write_report_files
from backend.schemas.comparison import ComparisonRequest, DifferencesRequest
from backend.services.comparison import stream_curves_file, stream_table_file
from backend.storage import banks, experiments, formulas, results
from backend.storage.banks import BankEntry
from backend.storage.database import open_database
from backend.storage.results import NewResult
from backend.storage.runs import RunKind
from backend.units import AngleUnit
from tests.cli.conftest import Command
from tests.exports.stored import NEW, noise, recorded

# A run is transferred between installations by the command line, and its report is verified there.


def test_a_bundle_transfers_run_lineage_and_report_to_an_empty_installation(command: Command, tmp_path: Path) -> None:
    out, here, there = tmp_path / "out", tmp_path / "here", tmp_path / "there"
    short = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5", "--out", str(out))
    assert command("experiment", "tracking", *short, folder=here).returncode == 0
    (out / "data.csv").unlink()
    file, report = tmp_path / "run.zip", out / "report.html"
    assert command("runs", "bundle", "1", str(file), folder=here).returncode == 0
    assert command("report", "verify", str(report), folder=there).returncode == 2  # the samples are not imported yet
    taken = command("runs", "import", str(file), "--json", folder=there)
    assert json.loads(taken.stdout) == {"run": 1, "was": 1, "new": True}, taken.stderr
    held = command("report", "verify", str(report), folder=there)
    assert (held.returncode, "is verified: every number" in held.stdout) == (0, True), held.stderr
    again = command("runs", "import", str(file), folder=there)
    assert (again.returncode, again.stdout.strip()) == (0, "run 1 is already stored as run 1: nothing was imported")
    one, other = (json.loads(command("runs", "lineage", "1", "--json", folder=data).stdout) for data in (here, there))
    assert [node["sha256"] for node in other["nodes"]] == [node["sha256"] for node in one["nodes"]]


def test_a_run_is_imported_tagged_and_exported_for_a_station(command: Command, tmp_path: Path) -> None:
    with closing(open_database(tmp_path / "here")) as here, here.session() as session:
        for _ in range(2):
            recorded(session, replace(NEW, kind=RunKind.SESSION))
    file, there, of = tmp_path / "run.csv", tmp_path / "there", ("--station", "rig-b")
    assert command("runs", "export", "1", str(file), *of, folder=tmp_path / "here").returncode == 0
    assert command("runs", "import", str(file), *of, folder=there).returncode == 0
    assert command("runs", "tag", "1", "--add", "worn", *of, folder=there).returncode == 0
    elsewhere = command("runs", "tag", "1", "--add", "mine", folder=there)
    assert (elsewhere.returncode, "belongs to station rig-b" in elsewhere.stderr) == (1, True)
    (listed,) = json.loads(command("runs", "list", "--json", *of, folder=there).stdout)
    assert (listed["station"], listed["tags"]) == ("rig-b", ["worn"])
    assert command("runs", "bundle", "1", str(tmp_path / "run.zip"), *of, folder=there).returncode == 0
    assert command("runs", "compare", "1", "2", *of, folder=tmp_path / "here").returncode == 0


def test_invalid_imports_and_bundles_exit_with_2(command: Command, tmp_path: Path) -> None:
    file = tmp_path / "run.zip"
    file.write_bytes(b"no zip")
    for words in (("import", str(file)), ("import", str(tmp_path / "none.csv")), ("bundle", "7", str(file))):
        refused = command("runs", *words, folder=tmp_path / "data")
        assert refused.returncode == 2
        assert "Traceback" not in refused.stderr
    assert file.read_bytes() == b"no zip"


# ``sinew runs export --formula``: a derived signal follows the recorded columns, an unknown one is rejected.


def test_formulas_are_additional_columns_of_an_export(command: Command, tmp_path: Path) -> None:
    folder, file = tmp_path / "data", tmp_path / "run.csv"
    with closing(open_database(folder)) as database, database.session() as session:
        run = recorded(session)
        steps = [asdict(step) for step in parse_derived_signal("F_mean", "N", "(F_A + F_B) / 2").steps]
        formulas.save(session, "F_mean", "(F_A + F_B) / 2", steps, "N", "", "Ana")
    printed = command("runs", "export", str(run), str(file), "--formula", "F_mean", folder=folder)
    assert printed.returncode == 0, printed.stderr
    rows = list(csv.DictReader(line for line in file.read_text().splitlines() if not line.startswith("#")))
    assert rows
    for row in rows:
        assert float(row["F_mean"]) == pytest.approx((float(row["F_A"]) + float(row["F_B"])) / 2, abs=1e-6)
    refused = command("runs", "export", str(run), str(file), "--formula", "F_sum", folder=folder)
    assert (refused.returncode, "unknown derived signal: F_sum" in refused.stderr) == (2, True)


# Texts that a terminal, a spreadsheet or a reader would interpret, stored by an older version, through all writers.
#
# All output has them as escapes, and no cell of a CSV file is a formula.

EVIL = '=HYPERLINK("http://x"),+1;@SUM(1)\x1b]0;x\x07\x1b[2J\u202egpj\r\nrun 9: no\t\x9b31m'
SYMBOL = "@SUM(1)\r\x1b[31m"
OBEYED = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069]")
FORMULA = ("=", "+", "-", "@")


def written(value: float) -> dict[str, object]:
    setting = {
        "name": "gain",
        "symbol": SYMBOL,
        "unit": SYMBOL,
        "meaning": EVIL,
        "default": 1,
        "minimum": 0,
        "maximum": 9,
    }
    part = {"do": "hold", "duration_s": value}
    return {
        "format": 1,
        "name": "evil",
        "title": EVIL[:100],
        "description": EVIL,
        "settings": [setting],
        "phases": [{"name": "a", "title": EVIL, "parts": [part]}],
        "criteria": [{"figure": "peak_voltage_V", "below": 9, "title": EVIL}],
    }


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[int], int]:
    """A data folder, its runs and its bank."""
    folder = tmp_path_factory.mktemp("evil")
    database = open_database(folder)
    made = []
    with database.session() as session:
        bank = banks.add(session, EVIL, [BankEntry(10.5, {"K_q": 0.5, "T_q": 0.1, "K_S": 9.0, "T_S": 0.1})], who=EVIL)
        experiments.add(session, "evil", json.dumps(written(1.0)), EVIL)
        for value in (1.0, 2.0):
            declared = [{"name": SYMBOL, "symbol": SYMBOL, "unit": SYMBOL, "meaning": EVIL, "value": f"{EVIL}{value}"}]
            settings = {"plan": {"experiment": json.dumps(written(value)), "gain": value}, "declared": declared}
            new = replace(
                NEW, kind=RunKind.EXPERIMENT, settings=settings, who=EVIL, note=EVIL, bank_id=bank.id, plant=EVIL[:40]
            )
            run = recorded(session, new, noise(1_200))
            figure = MeasuredFigure(SYMBOL, SYMBOL, EVIL, EVIL, value, EVIL)
            criterion = RunCriterion(SYMBOL, EVIL, "<", 1.0, value, SYMBOL, True, EVIL)
            measured = Metrics(complete=True, played_s=1.0, planned_s=1.0, figures=(figure,), problem=EVIL)
            results.add(session, NewResult(run, measured, (criterion,), EVIL[:40]))
            made.append(run)
    database.close()
    return folder, made, bank.id


def commands(made: list[int], bank: int) -> list[list[str]]:
    one, other = map(str, made)
    return [
        ["runs", "list"],
        ["runs", "list", "--json"],
        ["runs", "show", one],
        ["runs", "show", one, "--json"],
        ["runs", "compare", one, other],
        ["runs", "compare", one, other, "--json"],
        ["runs", "history", "evil"],
        ["runs", "lineage", one],
        ["runs", "lineage", one, "--json"],
        ["experiments", "list"],
        ["experiments", "list", "--json"],
        ["experiments", "show", "evil"],
        ["experiments", "show", "evil", "--json"],
        ["bank", "list"],
        ["bank", "show", str(bank)],
        ["bank", "show", str(bank), "--json"],
        ["runs", "evaluate", one],
        ["db", "check"],
    ]


def test_commands_print_no_control_sequences(stored: tuple[Path, list[int], int], command: Command) -> None:
    folder, made, bank = stored
    for words in commands(made, bank):
        ended = command(*words, folder=folder)
        printed = ended.stdout + ended.stderr
        assert printed.strip(), words
        assert OBEYED.search(printed) is None, (words, OBEYED.search(printed))
        assert not re.search(r"^run 9: no", printed, re.MULTILINE), words
        if "--json" in words:
            json.loads(ended.stdout)
    listed = command("experiments", "list", "--json", folder=folder).stdout
    assert escape_line(EVIL[:100]) in [one["title"] for one in json.loads(listed)]


def cells(line: str) -> list[str]:
    return [cell for cut in (",", ";") for cell in next(csv.reader([line], delimiter=cut))]


def check_line_is_harmless(line: str) -> None:
    assert OBEYED.search(line) is None, line
    for cell in cells(line):
        if cell.lstrip().startswith(FORMULA):
            float(cell.rstrip("]}"))  # a number


def test_no_cell_of_a_file_is_a_formula(stored: tuple[Path, list[int], int], tmp_path: Path) -> None:
    folder, made, _ = stored
    database = open_database(folder)
    files = {
        "table.csv": b"".join(stream_table_file(database, ComparisonRequest(run=made))),
        "curves.csv": b"".join(stream_curves_file(database, DifferencesRequest(run=made))),
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    write_export(export_run(database, made[0]), DataFormat.CSV, tmp_path / "run.csv")
    database.close()
    for name in ("table.csv", "curves.csv", "run.csv"):
        lines = (tmp_path / name).read_bytes().decode().split("\n")
        for line in lines[:40]:
            check_line_is_harmless(line)
        comments = sum(line.startswith("#") for line in lines)
        assert not any(line.startswith("#") for line in lines[comments:])
        rows = pd.read_csv(tmp_path / name, skiprows=comments)
        assert len(rows) == len(lines) - comments - 2
    rows = pd.read_csv(tmp_path / "table.csv", comment="#")
    assert {"setting", "metric"} == set(rows["what"])
    assert any(str(value).startswith("'=HYPERLINK") for value in rows["value"])
    assert f"'{escape_line(SYMBOL)}" in set(rows["name"])


def test_a_report_has_no_bidirectional_control_characters(
    stored: tuple[Path, list[int], int], tmp_path: Path, command: Command
) -> None:
    folder, made, _ = stored
    database = open_database(folder)
    write_report_files(database, made[0], tmp_path, AngleUnit.DEGREES)
    database.close()
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    title = re.search(r"<h1[^>]*>(.*?)</h1>", page, re.DOTALL)
    assert title is not None
    assert OBEYED.search(title[1]) is None
    assert OBEYED.search(re.sub(r"<template.*?</template>", "", page, flags=re.DOTALL)) is None
    verified = command("report", "verify", str(tmp_path / "report.html"), folder=folder)
    assert verified.returncode == 0, verified.stderr
