"""Texts of reports: one sentence per result, in the units of the reader."""

import copy
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from matplotlib.figure import Figure as Drawn

from backend.models.run import CRITERIA, METRICS
from backend.models.upgrades import NO_STORED_REASON, upgrade_criteria, upgrade_metrics
from backend.reports import messages
from backend.reports.build import build_metrics_document, build_report
from backend.reports.model import Code, Figure, Paragraph, Report, Table, exact, format_measured
from backend.reports.plotting import forget_drawings
from backend.reports.run_data import RunData
from backend.schemas.run import EvaluationView
from backend.services.runs import build_experiment_view, build_run_view
from backend.units import AngleUnit, format_text
from plant.quantity import Angle
from tests.reports.tracking_run import PLAN, samples, source_of


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.6789, "1.68"),
        (9.996, "10.0"),
        (-0.0051, "−0.00510"),
        (123456.0, "1.23·10^5"),
        (4321.0, "4321"),
        (-2.5e-7, "−2.50·10^−7"),
        (None, "–"),
        (math.nan, "–"),
    ],
)
def test_measured_numbers_show_three_significant_digits(value: float | None, text: str) -> None:
    assert format_measured(value) == text


def test_exact_numbers_keep_all_digits_without_trailing_zeros() -> None:
    assert [exact(value) for value in (0.0854, 10.0, -1.0471976, 1e5)] == ["0.0854", "10", "−1.0472", "100000"]


# Verdicts and reasons of missing metrics agree between report, interface and metrics file.


def failed() -> RunData:
    columns = samples(PLAN)
    columns["F_A"] = columns["F_A"].copy()
    columns["F_A"][5_000] = 3.0
    return source_of(columns)


SOURCES: dict[str, Callable[[], RunData]] = {
    "passed": lambda: source_of(samples(PLAN)),
    "failed": failed,
    "not measured": lambda: source_of(samples(PLAN, lam_q=3.0)),
    "stopped": lambda: source_of({name: column[:9_500] for name, column in samples(PLAN).items()}, end_state="stopped"),
}


@pytest.mark.parametrize("name", SOURCES)
def test_report_interface_and_metrics_file_agree(name: str) -> None:
    source = SOURCES[name]()
    report, document = build_report(source), build_metrics_document(source)
    view = build_experiment_view(source.run, source.result, 1.0)
    assert (view.outcome, view.verdict) == (report.outcome, report.verdict)
    assert document["verdict"] == report.verdict
    assert document["not_measured"] == {item.name: item.reason for item in view.metrics if item.reason}
    assert {item.name for item in view.metrics if item.value is None} <= set(document["not_measured"])
    for criterion in view.criteria:
        assert (criterion.passed is None) == (criterion.reason != ""), criterion.name
    if name != "passed":
        assert view.outcome != "passed"


def test_a_result_without_reasons_is_described_as_older() -> None:
    source = source_of(samples(PLAN, lam_q=3.0))
    assert source.result is not None

    metrics, criteria = METRICS.write(source.result.metrics), CRITERIA.write(source.result.criteria)
    for item in [*metrics["figures"], *criteria]:
        del item["reason"]
    metrics, criteria = upgrade_metrics(metrics), upgrade_criteria(criteria)
    old = replace(source.result, metrics=METRICS.read(metrics, "run 12"), criteria=CRITERIA.read(criteria, "run 12"))
    view = build_experiment_view(source.run, old, 1.0)
    missing = [item.reason for item in view.metrics if item.value is None]
    assert missing
    assert set(missing) == {NO_STORED_REASON}


def test_settings_of_a_run_have_units_wherever_they_are_shown() -> None:
    """Programs store declared settings; sessions store a tuning."""

    run = source_of(samples(PLAN)).run
    settings = {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "b": 0.0, "interpolate": False}}
    view = build_run_view(replace(run, settings=settings), EvaluationView.NONE, 10, 0.01, 0)
    assert {item.name: (item.symbol, item.unit, item.value) for item in view.settings} == {
        "lam_q": ("λ_q", "s", 0.5),
        "lam_S": ("λ_S", "s", 0.42),
        "b": ("b", "1", 0.0),
        "interpolate": ("interpolate", "1", False),
    }


# Every text and axis of a report has the unit of the reader; the tests convert independently.

DEG, RAD = AngleUnit.DEGREES, AngleUnit.RADIANS
NUMBER = re.compile(r"(?<![\w.])[-−]?\d+\.?\d*(?![\w.:])")
BARE_RADIAN = re.compile(r"(?<![/·\w])m?rad\b(?!/\(|/rad)")
"""A radian that is not part of a gain (N·m/rad, rad/(V·s), rad/rad, "per rad") or of an angular frequency."""

TRIP = f"q = {Angle(1.60207)}; the limit is {Angle(1.5708)} in either direction"


def tripped(source: RunData) -> RunData:
    return replace(source, run=replace(source.run, end_state="tripped", end_detail=TRIP))


def texts(report: Report) -> Iterator[str]:
    yield from (report.title, report.subtitle, report.verdict, report.footer)
    yield from (f"{fact.label}: {fact.text}" for fact in report.facts)
    for section in report.sections:
        for block in section.blocks:
            match block:
                case Paragraph(text):
                    yield text
                case Figure(_, _, caption) | Code(caption, _):
                    yield caption
                case Table(caption, columns, rows):
                    yield caption
                    yield from (f"{column.title} [{column.unit}]" for column in columns)
                    yield from (cell for row in rows for cell in row)


def significant(number: str) -> int:
    digits = re.sub(r"\D", "", number).lstrip("0")
    return len(digits.rstrip("0") if "." not in number else digits)


def table(report: Report, caption: str) -> list[dict[str, str]]:
    found = next(
        block
        for section in report.sections
        for block in section.blocks
        if isinstance(block, Table) and block.caption.startswith(caption)
    )
    titles = [f"{column.title} [{column.unit}]" if column.unit else column.title for column in found.columns]
    return [dict(zip(titles, row, strict=True)) for row in found.rows]


@pytest.fixture
def axes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Record the labels of the value axes of all figures drawn during the test."""
    seen: list[str] = []
    saved = Drawn.savefig

    def save_checked(self: Drawn, *args: Any, **how: Any) -> None:
        seen.extend(axis.get_ylabel() for axis in self.axes)
        saved(self, *args, **how)

    monkeypatch.setattr(Drawn, "savefig", save_checked)
    forget_drawings()
    return seen


@pytest.mark.parametrize("angles", [DEG, RAD])
def test_report_texts_use_the_selected_angle_unit_and_significant_digits(
    tracking_source: RunData, angles: AngleUnit, axes: list[str]
) -> None:
    report = build_report(replace(tripped(tracking_source), angles=angles))
    for text in (*texts(report), *axes):
        bare = text.replace("N·m/rad per rad", "")
        if angles is DEG:
            assert not BARE_RADIAN.search(bare), text
        else:
            assert not re.search(r"\bdeg\b|°", bare), text
        for number in NUMBER.findall(text):
            assert significant(number) <= 6, text
    assert f"q [{'°' if angles is DEG else 'rad'}]" in axes
    assert "S [N·m/rad]" in axes


def test_metrics_settings_steps_and_reasons_are_converted(tracking_source: RunData) -> None:
    """A value in degrees is the value in radians times 180/π."""
    degrees, radians = (build_report(replace(tripped(tracking_source), angles=angles)) for angles in (DEG, RAD))
    metrics = table(degrees, "Metrics")
    assert [row["Unit"] for row in metrics if row["Quantity"] == "RMSE of q"] == ["°"]
    assert tracking_source.result is not None
    stored = {item.label: item for item in tracking_source.result.metrics.figures}
    for row, plain in zip(metrics, table(radians, "Metrics"), strict=True):
        value, unit = stored[row["Quantity"]].value, stored[row["Quantity"]].unit
        assert row["Unit"] == ("°" if unit == "rad" else "" if unit == "1" else unit)
        if unit == "rad" and value is not None:
            assert float(row["Value"]) == pytest.approx(360.0 * value / (2.0 * math.pi), rel=5e-3)
            assert float(plain["Value"]) == pytest.approx(value, rel=5e-3)
        else:
            assert row["Value"] == plain["Value"]
    amplitude = table(degrees, "Settings")[0]
    assert (amplitude["Value"], amplitude["Unit"]) == ("60", "°")
    first = next(row for row in table(degrees, messages.all_completed_steps()) if row["Step"].startswith("q"))
    assert (first["Step"], first["to"]) == ("q [°]", "60.0")
    assert any("q = 91.7918°; the limit is 90°" in fact.text for fact in degrees.facts)
    assert any(format_text(TRIP, RAD) in fact.text for fact in radians.facts)


def test_texts_that_persons_wrote_are_not_converted(tracking_source: RunData) -> None:
    note_text, source = "limit 1.5 rad, see mail", "datasheet: 0.5 rad at 20 N"
    parameters = copy.deepcopy(tracking_source.run.parameters)
    parameters["geometry"]["r_j"]["source"] = source
    run = replace(
        tripped(tracking_source).run, note=note_text, parameters=parameters, parameters_name="bent by 0.1 rad"
    )
    report = build_report(replace(tracking_source, run=run, angles=DEG))
    assert f"Note: {note_text}" in list(texts(report))
    assert source in list(texts(report))
    assert any("parameters “bent by 0.1 rad”" in fact.text for fact in report.facts)
    assert any("q = 91.7918°" in fact.text for fact in report.facts)
