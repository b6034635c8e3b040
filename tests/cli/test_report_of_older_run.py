"""The report of a run that an earlier version recorded and evaluated: read with a note, held once evaluated again."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from pypdf import PdfReader

from backend.models.run import DEFINITIONS
from backend.recording.codec import pack_table, unpack
from backend.sample import ADDED_LATER
from backend.storage.database import open_database
from tests.cli.conftest import Command
from tests.migrations.old_schema import migrated
from tests.models.earlier import BEFORE

SHORT = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5")


def make_older(folder: Path) -> None:
    """Leave of each recording and result what an earlier version stored: fewer signals, no version, no digests."""
    with closing(sqlite3.connect(folder / "sinew.db")) as database, database:
        for run, text in database.execute("select run_id, fields from recording").fetchall():
            fields = json.loads(text)
            kept = [place for place, name in enumerate(fields) if name not in ADDED_LATER]
            assert len(kept) == len(fields) - len(ADDED_LATER)
            words = json.dumps([fields[place] for place in kept])
            database.execute("update recording set fields = ? where run_id = ?", (words, run))
            for column in ("samples", "summary"):
                chunks = database.execute(f"select first_tick, {column} from chunk where run_id = ?", (run,)).fetchall()
                for first_tick, packed in chunks:
                    fewer = pack_table(np.ascontiguousarray(unpack(packed, len(fields))[:, kept]))
                    database.execute(
                        f"update chunk set {column} = ?, sha256 = '' where run_id = ? and first_tick = ?",
                        (fewer, run, first_tick),
                    )
        for number, text in database.execute("select id, metrics from result").fetchall():
            metrics = json.loads(text)
            assert metrics.pop("definitions") == DEFINITIONS
            database.execute("update result set metrics = ? where id = ?", (json.dumps(metrics), number))
    migrated(open_database(folder), folder, BEFORE).close()


def test_it_is_not_verified_until_the_run_is_evaluated_again(command: Command, tmp_path: Path) -> None:
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
            status, told = verified(file, folder)
            assert (status, told["holds"], told["differences"]) == (2, None, [])
            assert [remedy in one for one in told["left_out"]] == [True]
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
            status, told = verified(file, folder)
            assert (status, told["holds"], told["left_out"]) == (0, True, []), told
    assert command("report", "sign", str(report), folder=here).returncode == 0
    assert verified(report)[0] == 0
