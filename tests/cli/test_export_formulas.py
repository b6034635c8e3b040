"""``sinew runs export --formula``: a derived signal stands behind the recorded columns, an unknown one is refused."""

import csv
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import pytest

from backend.experiments.parser import parse_derived_signal
from backend.storage import formulas
from backend.storage.database import open_database
from tests.cli.conftest import Command
from tests.exports.stored import recorded


def test_formulas_are_further_columns_of_an_export(command: Command, tmp_path: Path) -> None:
    folder, file = tmp_path / "data", tmp_path / "run.csv"
    with closing(open_database(folder)) as database, database.session() as session:
        run = recorded(session)
        steps = [asdict(step) for step in parse_derived_signal("F_mean", "N", "(F_A + F_B) / 2").steps]
        formulas.save(session, "F_mean", "(F_A + F_B) / 2", steps, "N", "", "Ana")
    told = command("runs", "export", str(run), str(file), "--formula", "F_mean", folder=folder)
    assert told.returncode == 0, told.stderr
    rows = list(csv.DictReader(line for line in file.read_text().splitlines() if not line.startswith("#")))
    assert rows
    for row in rows:
        assert float(row["F_mean"]) == pytest.approx((float(row["F_A"]) + float(row["F_B"])) / 2, abs=1e-6)
    refused = command("runs", "export", str(run), str(file), "--formula", "F_sum", folder=folder)
    assert (refused.returncode, "there is no formula F_sum" in refused.stderr) == (2, True)
