"""Reports of several runs: differences, spread of metrics, and verification where the runs are stored."""

import asyncio
import copy
import json
import math
import re
import statistics
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.errors import RequestRejectedError
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.recording.reader import Columns
from backend.reports import messages
from backend.reports.build import build_report
from backend.reports.evidence import EvidenceError, ReportManifest, SeriesEvidence, read_manifest
from backend.reports.model import Report, Table, to_html
from backend.reports.pdf import to_pdf
from backend.reports.rendering import render_series_report
from backend.reports.run_data import RunData
from backend.reports.series import series_report
from backend.reports.series_source import load_series
from backend.reports.verification import Verified, read_stored_samples, verify_pdf, verify_report, verify_series_report
from backend.storage import runs
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Database, open_database
from backend.storage.orm import UnknownRecordError
from backend.units import AngleUnit
from plant.parameters import load_parameters
from tests.reasons import Reason
from tests.refusals import refused

LAMBDAS = (0.4, 0.5, 0.6)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Database]:
    plan = build_ready_plan("tracking", q_duration_s=1.0, S_duration_s=1.0)
    opened = open_database(tmp_path_factory.mktemp("series"))
    for lam_q in LAMBDAS:
        settings = LoopSettings(lam_q=lam_q)
        with open_headless_rig(opened, load_parameters("ideal"), settings) as station:
            asyncio.run(run_experiment(station, RunRequest(plan, settings, "A. Operator")))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def sources(database: Database) -> list[RunData]:
    return load_series(database, [1, 2, 3], AngleUnit.RADIANS)


@pytest.fixture(scope="module")
def page(sources: list[RunData]) -> str:
    return to_html(series_report(sources))


def tables(report: Report, heading: str) -> list[Table]:
    section = next(one for one in report.sections if one.heading == heading)
    return [block for block in section.blocks if isinstance(block, Table)]


def account(page: str) -> SeriesEvidence:
    found = read_manifest(page)
    assert isinstance(found, SeriesEvidence)
    return found


def test_the_differences_of_the_series_contain_only_lambda(sources: list[RunData]) -> None:
    (differing,) = tables(series_report(sources), "Differences")
    ((title, *cells),) = differing.rows
    assert "λ_q [s]" in title
    assert cells == ["0.4", "0.5", "0.6"]


def test_metrics_and_their_spread_match_the_samples(sources: list[RunData]) -> None:
    beside, spread = tables(series_report(sources), "Metrics")
    rms = [float(np.sqrt(np.mean((s.columns["q"] - s.columns["q_ref"]) ** 2))) for s in sources]
    row = next(row for row in beside.rows if row[0] == "RMSE of q")
    assert [float(cell.split(" ")[0]) for cell in row[2:]] == pytest.approx(rms, rel=5e-3)
    assert float(re.findall(r"\(([^)]*)\)", row[4].replace("−", "-"))[0]) == pytest.approx(rms[2] - rms[0], rel=0.05)
    row = next(row for row in spread.rows if row[0] == "RMSE of q")
    expected = [statistics.fmean(rms), statistics.stdev(rms), min(rms), max(rms)]
    assert row[2] == "3"
    assert [float(cell) for cell in row[3:7]] == pytest.approx(expected, rel=5e-3)


def test_a_table_of_a_series_shows_at_most_five_runs_side_by_side(sources: list[RunData]) -> None:
    many = [replace(sources[0], run=replace(sources[0].run, id=number)) for number in range(1, 8)]
    report = series_report(many)
    first, second, spread = tables(report, "Metrics")
    assert [column.title for column in first.columns[2:]] == [f"Run {number}" for number in range(1, 6)]
    assert [column.title for column in second.columns[2:]] == ["Run 6", "Run 7"]
    assert all(cell in ("0", messages.not_measured()) for cell in (row[4] for row in spread.rows))
    assert messages.runs_do_not_differ() in to_html(report)
    assert to_pdf(report).startswith(b"%PDF-")


def test_the_differences_list_versions_text_bank_and_granted_scheduling(sources: list[RunData]) -> None:
    run = sources[0].run
    settings = copy.deepcopy(run.settings)
    settings["versions"]["NumPy"] = "1.0"
    settings["plan"]["experiment"] += " "
    refused = {"priority": 0, "memory_locked": False, "timer_slack_ns": 50, "refusals": ["no rights", "no memory"]}
    settings["granted"] = refused
    entry = BankEntry(10.55, {"K_q": 0.05, "T_q": 0.34, "K_S": 0.72, "T_S": 0.34})
    bank = Bank(1, "set 2", 3, "", "", run.started_at, (entry,))
    other = replace(sources[0], run=replace(run, settings=settings, parameters_name="mine"), bank=bank)
    (differing,) = tables(series_report([sources[0], other]), "Differences")
    rows = {row[0]: row[1:] for row in differing.rows}
    assert rows["NumPy"][1] == "1.0"
    assert rows[messages.name_of_parameter_set()] == ("ideal", "mine")
    first, second = rows[messages.hash_of_experiment()]
    assert first != second
    assert rows["bank"] == ("none", messages.bank_and_version(name="set 2", version=3))
    assert len(rows[messages.hash_of_bank()][1]) == 12
    assert rows["Not granted"] == (messages.not_set(), "no rights; no memory")


@pytest.mark.parametrize(("count", "shown"), [(190, True), (210, False)])
def test_values_of_an_experiment_are_compared_by_their_paths(
    sources: list[RunData], count: int, *, shown: bool
) -> None:
    def with_angle(q_ref: float) -> RunData:
        settings = copy.deepcopy(sources[0].run.settings)
        parts = [{"q_ref": q_ref, "why": [None]}, *({"q_ref": 0.0} for _ in range(count))]
        settings["plan"]["experiment"] = json.dumps({"parts": parts})
        return replace(sources[0], run=replace(sources[0].run, settings=settings))

    (differing,) = tables(series_report([with_angle(0.0), with_angle(math.pi)]), "Differences")
    rows = {row[0]: row[1:] for row in differing.rows}
    text = rows.pop(messages.hash_of_experiment())
    assert text[0] != text[1]
    assert rows == ({"experiment.parts[0].q_ref [rad]": ("0", "3.14159")} if shown else {})


def test_values_of_an_experiment_that_are_not_finite_are_compared_as_text(sources: list[RunData]) -> None:
    def with_text(text: str) -> RunData:
        settings = copy.deepcopy(sources[0].run.settings)
        settings["plan"]["experiment"] = text
        return replace(sources[0], run=replace(sources[0].run, settings=settings))

    texts = ('{"a": NaN, "b": 1}', '{"a": NaN, "b": 1e999}')
    (differing,) = tables(series_report([with_text(text) for text in texts]), "Differences")
    rows = {row[0]: row[1:] for row in differing.rows}
    rows.pop(messages.hash_of_experiment())
    assert rows == {"experiment.b": ("1", "inf")}


def test_partially_measured_metrics_are_marked_and_counted_separately(sources: list[RunData]) -> None:
    first = sources[0].result
    assert first is not None
    in_part = tuple(
        replace(item, reason="of 2 of 3 steps") if item.name == "rmse_q" else item for item in first.metrics.figures
    )
    partial = replace(sources[0], result=replace(first, metrics=replace(first.metrics, figures=in_part)))
    for runs_of_series, marked in (([partial, *sources[1:]], 2), ([*sources[1:], partial], 4)):
        section = next(one for one in series_report(runs_of_series).sections if one.heading == "Metrics")
        beside, spread, *notes = section.blocks
        assert isinstance(beside, Table)
        assert isinstance(spread, Table)
        row = next(row for row in beside.rows if row[0] == "RMSE of q")
        assert [place for place, cell in enumerate(row) if cell.endswith(" *")] == [marked]
        assert "(" not in row[marked]
        assert any("(" in cell for cell in row[2:]) == (marked != 2)  # no difference to a partially measured metric
        row = next(row for row in spread.rows if row[0] == "RMSE of q")
        assert (row[2], row[-1]) == ("2", "1")
        reason = messages.metric_and_reason(label="RMSE of q", reason="of 2 of 3 steps")
        assert f"{reason} (run {partial.run.id})" in str(notes)


def test_an_additional_drawing_is_detected(database: Database, page: str) -> None:
    more = page.replace("</main>", "<svg><text>0.1</text></svg></main>", 1)
    found = verify_series_report(more, account(more), lambda one: read_stored_samples(database, one)[0])
    assert messages.number_of_drawings() in [one.name for one in found.differences]


def test_a_series_report_is_verified_where_its_runs_are_stored(database: Database, page: str) -> None:
    assert "<script" not in page
    held = verify_series_report(page, account(page), lambda one: read_stored_samples(database, one)[0])
    assert held == Verified((), ())


def test_a_change_in_a_series_is_reported_with_its_run(database: Database, page: str) -> None:
    def bent(one: ReportManifest) -> Columns | None:
        columns, number = read_stored_samples(database, one)
        if columns is None or number != 2:
            return columns
        q = columns["q"].copy()
        q[3200] += 1e-3
        return columns | {"q": q}

    names = [one.name for one in verify_series_report(page, account(page), bent).differences]
    assert messages.part_of_run(run_id=2, part=messages.samples_of_signal(signal="q", start_s=3, end_s=4)) in names
    assert not any(name.startswith(("run 1", "run 3")) for name in names)
    visible = page.replace(">0.5<", ">0.55<", 1)
    found = verify_series_report(visible, account(visible), lambda one: read_stored_samples(database, one)[0])
    assert len(found.differences) == 1
    assert found.differences[0].name == Reason("row_of_table")
    assert "λ_q" in found.differences[0].name


def test_a_series_report_is_rejected_as_a_run_report_and_requires_its_runs(page: str, sources: list[RunData]) -> None:
    with refused(EvidenceError, "report_of_a_series"):
        verify_report(page, sources[0].columns)
    with refused(EvidenceError, "samples_of_run_missing", run_id=1):
        verify_series_report(page, account(page), lambda _: None)


def test_a_run_is_found_by_its_samples_under_another_number(database: Database, sources: list[RunData]) -> None:
    manifest = account(to_html(series_report(sources))).runs[1]
    elsewhere = replace(manifest, run=replace(manifest.run, id=77))
    columns, number = read_stored_samples(database, elsewhere)
    assert number == 2
    assert columns is not None
    with database.reading() as session:
        began = runs.get(session, 1).started_at
    columns, number = read_stored_samples(database, replace(manifest, run=replace(manifest.run, started_at=began)))
    assert number == 1  # another run with the same start: differences are reported
    never = began.replace(year=2001)
    assert read_stored_samples(database, replace(manifest, run=replace(manifest.run, started_at=never))) == (None, None)


@pytest.mark.parametrize("numbers", [[1], [1, 1]])
def test_a_series_with_an_invalid_number_of_runs_is_rejected(database: Database, numbers: list[int]) -> None:
    with refused(RequestRejectedError, "wrong_number_of_runs", runs=1, minimum=2, maximum=100):
        load_series(database, numbers, AngleUnit.DEGREES)


def test_a_series_with_an_unknown_run_is_rejected(database: Database) -> None:
    with pytest.raises(UnknownRecordError, match="no run 99"):
        load_series(database, [1, 99], AngleUnit.DEGREES)


def test_a_pdf_is_verified_with_its_page(sources: list[RunData], tmp_path: Path) -> None:
    report = build_report(sources[0])
    page, pdf = to_html(report), to_pdf(report)
    assert verify_pdf(pdf, page, sources[0].columns) == Verified((), ())
    other = to_pdf(build_report(sources[1]))
    assert [one.name for one in verify_pdf(other, page, sources[0].columns).differences] == [messages.the_pdf()]
    touched = page.replace("by A. Operator", "by B. Operator", 1)
    assert verify_pdf(pdf, touched, sources[0].columns).differences[0].name == Reason("line_of_heading")
    assert render_series_report(sources, "pdf") == to_pdf(series_report(sources))
