"""Banks, rejections, command line and reports name an identification by the number of its run."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from backend.banks.builder import BankError, build_bank
from backend.cli import app
from backend.reports.model import Table
from backend.reports.provenance import lineage
from backend.reports.run_data import load_source
from backend.services.banks import _build_entry_lineage
from backend.services.runs import build_bank_view
from backend.storage import banks, identifications, runs
from backend.storage.database import Database, open_database
from backend.storage.identifications import NewIdentification
from backend.storage.orm import UnknownRecordError
from backend.storage.runs import NewRun, RunKind
from plant.parameters import load_parameters
from tests.models.earlier_identifications import ACTUATOR, MODEL

PARAMETERS = load_parameters("ideal")
POINTS = {4: (10.0, 8.24), 5: (20.0, 10.55), 6: (30.0, 12.43)}
"""Tension [N] and stiffness [N·m/rad] by the number of the run; the estimates' own numbers are 2, 3 and 4."""


def new_run(kind: RunKind, bank_id: int | None = None) -> NewRun:
    return NewRun(
        kind=kind,
        who="Ana",
        plant="simulator",
        parameters_name="ideal",
        parameters=PARAMETERS.to_document(),
        software="0.1.0",
        settings={},
        bank_id=bank_id,
    )


def estimate(run_id: int, *, usable: bool = True) -> NewIdentification:
    tension_N, S = POINTS[run_id]
    channels = {name: MODEL | {"first_order": {"K": K, "T": 0.342}} for name, K in (("G_q", 0.05), ("G_S", 0.7209))}
    return NewIdentification(
        kind="actuator",
        run_id=run_id,
        data={},
        method="output error",
        options={"tension_N": tension_N},
        model={"S_nominal": S} | channels,
        quality=ACTUATOR["quality"],
        usable=usable,
        verdict="fits badly",
        who="Ana",
        software="0.1.0",
    )


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    """Three runs without an estimate, then a spring's table, then three identifications."""
    opened = open_database(tmp_path)
    with opened.session() as session:
        for _ in range(3):
            runs.create(session, new_run(RunKind.TRACKING))
        identifications.add(session, replace(estimate(4), kind="spring", run_id=None))
        for number in POINTS:
            assert runs.create(session, new_run(RunKind.ACTUATOR_IDENTIFICATION)).id == number
            assert identifications.add(session, estimate(number)).id == number - 2
    yield opened
    opened.close()


def test_bank_command_line_and_report_name_the_same_runs(database: Database, tmp_path: Path) -> None:
    bank = build_bank(database, PARAMETERS, "bench", list(POINTS), "Ana")
    with database.session() as session:
        view = build_bank_view(bank, identifications.find_estimate_runs(session), {}, None)
        follower = runs.create(session, new_run(RunKind.TRACKING, bank.id))
    assert [entry.identification for entry in view.entries] == list(POINTS)

    shown = CliRunner().invoke(app, ["bank", "show", str(bank.id), "--json", "--data", str(tmp_path)])
    assert [entry["identification"] for entry in json.loads(shown.stdout)["entries"]] == list(POINTS)

    with database.reading() as session:
        lines = [_build_entry_lineage(session, entry) for entry in bank.entries]
    assert [(line.identification, line.run, line.method) for line in lines if line] == [
        (number, number, "output error") for number in POINTS
    ]

    (table,) = lineage(load_source(database, follower.id))
    assert isinstance(table, Table)
    assert [(row[0], row[-3]) for row in table.rows] == [
        (f"{tension_N:g} N", f"identification {number}") for number, (tension_N, _) in POINTS.items()
    ]


def test_a_bank_is_built_from_the_newest_estimate_of_a_run_and_refusals_name_the_run(database: Database) -> None:
    with database.session() as session:
        again = identifications.add(session, estimate(5))
        identifications.add(session, estimate(6, usable=False))
    bank = build_bank(database, PARAMETERS, "bench", [4, 5], "Ana")
    with database.reading() as session:
        assert [entry.identification_id for entry in banks.get(session, bank.id).entries] == [2, again.id]
    with pytest.raises(BankError, match=r"^identification 6 is not usable"):
        build_bank(database, PARAMETERS, "bench", [4, 6], "Ana")
    with pytest.raises(UnknownRecordError, match="there is no identification 2 with a model"):
        build_bank(database, PARAMETERS, "bench", [2], "Ana")
