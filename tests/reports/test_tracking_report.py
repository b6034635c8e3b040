"""The report as its reader gets it: everything stated, nothing loaded, no markup from data, same bytes each time."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import cast

import pytest

from backend.exports.base import export_columns
from backend.models.run import CRITERIA, METRICS
from backend.models.upgrades import NO_STORED_REASON, upgrade_criteria, upgrade_metrics
from backend.reports.build import write_report_files
from backend.reports.experiment_report import tracking_report
from backend.reports.model import Figure, Report, Table, to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData
from backend.storage.database import Database
from tests.reports.tracking_run import PLAN, samples, source_of


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id" and value:
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "data", "action") and value and not value.startswith("#"):
                self.loads.append(value)

    def handle_data(self, data: str) -> None:
        self.text.append(data)


@pytest.fixture(scope="module")
def page(report: Report) -> str:
    return to_html(report)


@pytest.fixture(scope="module")
def pdf(report: Report) -> bytes:
    return to_pdf(report)


def read(page: str) -> _Reader:
    reader = _Reader()
    reader.feed(page)
    return reader


def test_page_loads_nothing_and_keeps_its_ids_apart(page: str) -> None:
    reader = read(page)
    assert reader.loads == []
    assert "script" not in reader.tags
    assert not re.search(r"@import|url\((?!#)", page)
    assert len(reader.ids) == len(set(reader.ids))
    assert reader.tags.count("svg") == 4


def test_page_states_run_tuning_lineage_and_figures(page: str) -> None:
    text = re.sub(r"\s+", " ", "".join(read(page).text))
    for statement in (
        "All 4 criteria passed.",
        "12, completed",
        "2026-03-04 10:20:30 UTC by A. Operator",
        "simulator, parameters “ideal”",
        "λq = 0.5 s, λS = 0.42 s, λmotor = 0.0854 s",
        "Sinew 0.1.0, Python 3.11.2",
        "bank “spring set 2” version 2",
        "identification 7",
        "identification 8",
        "Largest tension36.0N",
        "erratum E1",
        "paper, prototype section: motor reel",
    ):
        assert statement in text, statement


def test_text_from_outside_is_never_markup(page: str, pdf: bytes) -> None:
    assert "&lt;b&gt;first&lt;/b&gt; &amp; last; #eval(1)" in page
    assert pdf.startswith(b"%PDF-")


def test_same_run_gives_the_same_bytes(page: str, pdf: bytes, tracking_source: RunData) -> None:
    again = tracking_report(tracking_source)
    assert to_html(again) == page
    assert to_pdf(again) == pdf


def test_every_table_row_has_a_cell_for_each_column(report: Report) -> None:
    blocks = [block for section in report.sections for block in section.blocks]
    tables = [block for block in blocks if isinstance(block, Table)]
    assert len(tables) == 6
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)
    assert [block.name for block in blocks if isinstance(block, Figure)] == ["separate", "together", "tension", "steps"]


def test_a_failed_criterion_is_named_and_so_is_a_change_of_lambda() -> None:
    columns = samples(PLAN)
    columns["F_A"] = columns["F_A"].copy()
    columns["F_A"][5_000] = 3.0
    columns["lam_q"][20_000:] = 0.6
    report = tracking_report(source_of(columns))
    assert report.outcome == "failed"
    assert "Smallest tendon tension" in report.verdict
    assert any("0.5 to 0.6 s (changed during the run)" in fact.text for fact in report.facts)


def test_a_stopped_run_is_incomplete() -> None:
    part = {name: column[:9_500] for name, column in samples(PLAN).items()}
    report = tracking_report(source_of(part, end_state="stopped"))
    assert report.outcome == "incomplete"
    assert report.verdict.startswith("Incomplete: 9.5 s of 51 s were played")
    assert "stopped by the operator" in report.facts[0].text
    assert to_pdf(report).startswith(b"%PDF-")


def test_what_was_not_measured_is_said_with_its_reason_in_every_table(tracking_source: RunData) -> None:
    """The steps of q take longer than their holds: nothing of them can be told, and none is drawn as a dash."""
    report = tracking_report(source_of(samples(PLAN, lam_q=3.0)))
    assert report.outcome == "incomplete"
    assert report.verdict.startswith("2 of 4 criteria were not measured: Overshoot of q, ")
    tables = [block for section in report.sections for block in section.blocks if isinstance(block, Table)]
    criteria, metrics = tables[:2]
    judged = {row[0]: (row[2], row[4]) for row in criteria.rows}
    figure, result = judged["Overshoot of q"]
    assert figure == "not measured"
    assert re.fullmatch(
        r"not measured; 8 of 8 steps were not measured; the one at 4 s: it was not within ±2 % .*", result
    )
    figures = {row[0]: (row[1], row[3]) for row in metrics.rows}
    assert figures["Rise time of q"][0] == "not measured"
    assert "% of its way" in figures["Rise time of q"][1]
    missing = next(table for table in tables if table.caption.startswith("What could not be measured"))
    assert any(row[1] == "q" and "the motion before was not over" in row[3] for row in missing.rows)
    assert not any(cell == "–" for table in (criteria, metrics, missing) for row in table.rows for cell in row)


def test_a_result_of_an_older_version_is_shown_and_says_what_it_lacks(tracking_source: RunData) -> None:
    result = tracking_source.result
    assert result is not None
    metrics, criteria = METRICS.write(result.metrics), CRITERIA.write(result.criteria)
    del metrics["version"]
    for item in metrics["figures"]:
        del item["reason"]
        item["value"] = None
    for item in criteria:
        del item["reason"]
    criteria[0] |= {"passed": None, "figure": None}
    for item in metrics["steps"]:
        del item["reasons"]
    metrics, criteria = upgrade_metrics(metrics), upgrade_criteria(criteria)
    old = replace(result, metrics=METRICS.read(metrics, "run 12"), criteria=CRITERIA.read(criteria, "run 12"))
    report = tracking_report(replace(tracking_source, result=old))
    assert report.outcome == "incomplete"
    assert NO_STORED_REASON in to_html(report)


def test_a_run_without_samples_still_has_a_report(tracking_source: RunData) -> None:
    empty = {name: column[:0] for name, column in tracking_source.columns.items()}
    run = replace(tracking_source.run, evaluation_problem="the run holds no samples of its program")
    report = tracking_report(RunData(run, None, empty, None))
    assert report.outcome == "incomplete"
    assert "no samples" in report.verdict
    assert to_html(report)
    assert to_pdf(report).startswith(b"%PDF-")


def test_files_for_a_folder_say_the_same_as_the_report(
    tracking_source: RunData, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("backend.reports.build.evaluate_pending_runs", lambda *_: None)
    monkeypatch.setattr("backend.reports.build.load_source", lambda *_: tracking_source)
    monkeypatch.setattr(
        "backend.reports.build.export_run_if_recorded", lambda *_: export_columns(tracking_source.columns, "run 12")
    )
    paths = write_report_files(cast("Database", None), 12, tmp_path / "out")
    assert [path.name for path in paths] == ["report.html", "report.pdf", "data.csv", "metrics.json"]
    assert "\nt,q,q_ref,S,S_ref," in (tmp_path / "out" / "data.csv").read_text()
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["metrics"]["max_tension_N"] == pytest.approx(36.0, abs=0.1)
    assert metrics["units"]["max_tension_N"] == "N"
    assert [item["passed"] for item in metrics["criteria"]] == [True] * 4
