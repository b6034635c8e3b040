"""Reports of frequency responses, disturbances and rest: all of it in figure and table, and held by its samples."""

import asyncio
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.models.run import ENTRY, LAMBDA, MOTIONS, TIME_OPTIMAL, EntryModel
from backend.reports.build import build_report
from backend.reports.experiment_report import find_frequency_responses
from backend.reports.model import NO_FIGURE, Figure, Report, Table, to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData, load_source
from backend.reports.series import series_report
from backend.reports.verification import Verified, verify_report
from backend.storage import banks
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from plant.parameters import load_parameters

LAB = load_parameters("lab")
QUICK: dict[str, dict[str, float]] = {
    "frequency_response": {"period_s": 4.0, "lines": 8, "q_amplitude": 0.1, "S_amplitude": 0.5},
    "disturbance_battery": {"levels": 2, "hold_s": 3.0},
    "hold_at_rest": {"levels": 2, "settle_s": 5.0, "hold_s": 3.0},
}
SHOWN = {"frequency_response": "bode", "disturbance_battery": "pushes", "hold_at_rest": "holds"}
ROWS = {"frequency_response": 8, "disturbance_battery": 8, "hold_at_rest": 6}


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Database]:
    opened = open_database(tmp_path_factory.mktemp("batteries"))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def bank(database: Database) -> int:
    """A bank whose gains differ much from those of geometry."""
    entries = [
        BankEntry(S, ENTRY.write(EntryModel(K_q=0.05, T_q=T, K_S=0.72, T_S=T, tension_N=F)))
        for S, T, F in ((8.24, 0.5, 10.0), (12.43, 0.6, 30.0))
    ]
    with database.session() as session:
        return banks.add(session, "slow ones", entries, "A. Operator").id


def played(database: Database, name: str, plan: dict[str, Any] | None = None, **loop: Any) -> RunData:
    settings = LoopSettings(**loop)
    with open_headless_rig(database, LAB, settings) as station:
        outcome = asyncio.run(
            run_experiment(
                station, RunRequest(build_ready_plan(name, **QUICK[name] | (plan or {})), settings, "A. Operator")
            )
        )
    assert outcome.run.end_state == "completed"
    return load_source(database, outcome.run.id)


def tables_of(report: Report, drawn: str) -> list[Table]:
    section = next(
        one for one in report.sections if any(isinstance(part, Figure) and part.name == drawn for part in one.blocks)
    )
    return [part for part in section.blocks if isinstance(part, Table)]


@pytest.mark.parametrize("name", QUICK)
def test_what_is_measured_stands_in_figure_and_table_and_is_held_by_the_samples(
    database: Database, bank: int, name: str
) -> None:
    source = played(
        database, name, bank=bank, lam_q=0.7, lam_S=0.7, motion=TIME_OPTIMAL if name == "hold_at_rest" else LAMBDA
    )
    report = build_report(source)
    table = tables_of(report, SHOWN[name])[0]
    assert len(table.rows) == ROWS[name]
    page = to_html(report)
    assert verify_report(page, source.columns) == Verified((), ())
    assert to_pdf(report).startswith(b"%PDF")
    cell = next(cell for cell in table.rows[1] if cell not in ("", NO_FIGURE) and "." in cell)
    assert page.count(cell) >= 1
    place = page.index(cell, page.index(f'id="{SHOWN[name]}-'))
    forged = page[:place] + cell.replace(".", ".9") + page[place + len(cell) :]
    assert verify_report(forged, source.columns).differences


def test_the_prediction_is_of_the_bank_that_was_in_use(database: Database, bank: int) -> None:
    """Gains of geometry would expect another response: it is the bank's that the lab's friction spares."""
    source = played(database, "frequency_response", {"period_s": 8.0}, bank=bank, lam_q=0.7, lam_S=0.7)
    assert source.result is not None
    with_bank = source.result.metrics.find_value("bandwidth_q_predicted_Hz")
    plain = played(database, "frequency_response", {"period_s": 8.0}, lam_q=0.7, lam_S=0.7)
    assert plain.result is not None
    without = plain.result.metrics.find_value("bandwidth_q_predicted_Hz")
    assert with_bank is not None
    assert without is not None
    assert abs(with_bank / without - 1.0) > 0.05
    measured = source.result.metrics.find_value("bandwidth_q_Hz")
    assert measured == pytest.approx(with_bank, rel=0.15)


def test_a_series_shows_both_laws_on_the_same_axes(database: Database) -> None:
    """In lambda motion the response falls off at the last line; in time-optimal motion it follows."""
    sources = [played(database, "frequency_response", motion=motion) for motion in MOTIONS]
    paper, planned = (find_frequency_responses(source) for source in sources)
    assert [one.signal for one in paper] == [one.signal for one in planned] == ["q", "S"]
    assert np.abs(paper[0].H[-1]) < 0.2
    assert np.abs(planned[0].H[-1]) > 0.7
    report = series_report(sources)
    shown = {part.name: part for section in report.sections for part in section.blocks if isinstance(part, Figure)}
    assert shown["bode"].svg.startswith("<svg")
    still = played(database, "hold_at_rest")
    assert find_frequency_responses(still) == ()
    names = {
        part.name
        for section in series_report([still, still]).sections
        for part in section.blocks
        if isinstance(part, Figure)
    }
    assert "bode" not in names


def test_lines_that_a_limit_spoilt_say_so_and_have_no_figures(database: Database) -> None:
    name = "frequency_response"
    wild = {**QUICK[name], "q_amplitude": 1.0}
    settings = LoopSettings()
    with open_headless_rig(database, LAB, settings) as station:
        outcome = asyncio.run(
            run_experiment(station, RunRequest(build_ready_plan(name, **wild), settings, "A. Operator"))
        )
    source = load_source(database, outcome.run.id)
    report = build_report(source)
    table = tables_of(report, "bode")[0]
    assert all("not measured: " in row[-1] and row[1] == row[3] == NO_FIGURE for row in table.rows)
    assert all(row[2] != NO_FIGURE for row in table.rows)
    assert verify_report(to_html(report), source.columns) == Verified((), ())
