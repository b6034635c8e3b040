"""Reports of tracking runs: statements, control laws, and the plant."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from backend.analysis.evaluation import USED_SETTINGS, find_control_law, select_used_settings
from backend.banks.tuning_settings import TUNING_NAMES
from backend.experiments.library import build_ready_plan, describe_plan_values, list_stored_values
from backend.experiments.plans import LoopSettings
from backend.exports.base import export_columns
from backend.models.document import UnreadableDocumentError
from backend.models.run import CRITERIA, METRICS, StepFigures
from backend.models.settings import describe_values
from backend.models.upgrades import NO_STORED_REASON, upgrade_criteria, upgrade_metrics
from backend.realtime.program import Law
from backend.reports import messages
from backend.reports.build import build_report, write_report_files
from backend.reports.experiment_report import PaperLawResponse, make_law_comparison, simulate_paper_law, tracking_report
from backend.reports.model import Fact, Figure, Paragraph, Report, Table, to_html
from backend.reports.pdf import to_pdf
from backend.reports.provenance import tuning_facts
from backend.reports.run_data import RunData
from backend.storage.database import Database
from backend.tuning.gains import (
    TuningParameters,
    make_cascade_tuning,
    make_feedback_linearization_tuning,
    make_single_loop_tuning,
)
from backend.tuning.simulation import simulate_cascade
from backend.units import AngleUnit
from plant.interface import PlantChoice, PlantKind
from plant.parameters import load_parameters
from tests.reasons import Reason, assert_reason
from tests.refusals import refused
from tests.reports.tracking_run import PLAN, samples, source_of

# The report file: complete, without loaded resources or markup from data, and reproducible.


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


def test_the_page_loads_no_resources_and_has_unique_ids(page: str) -> None:
    reader = read(page)
    assert reader.loads == []
    assert "script" not in reader.tags
    assert not re.search(r"@import|url\((?!#)", page)
    assert len(reader.ids) == len(set(reader.ids))
    assert reader.tags.count("svg") == 4


def test_the_page_states_run_tuning_lineage_and_metrics(page: str) -> None:
    text = re.sub(r"\s+", " ", "".join(read(page).text))
    for statement in (
        messages.verdict_on_criteria(criteria=4, failed=(), unmeasured=()),
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


def test_text_that_persons_entered_is_escaped(page: str, pdf: bytes) -> None:
    assert "&lt;b&gt;first&lt;/b&gt; &amp; last; #eval(1)" in page
    assert pdf.startswith(b"%PDF-")


def test_the_report_of_a_run_is_reproducible_byte_for_byte(page: str, pdf: bytes, tracking_source: RunData) -> None:
    again = tracking_report(tracking_source)
    assert to_html(again) == page
    assert to_pdf(again) == pdf


def test_every_table_row_has_a_cell_for_each_column(report: Report) -> None:
    blocks = [block for section in report.sections for block in section.blocks]
    tables = [block for block in blocks if isinstance(block, Table)]
    assert len(tables) == 6
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)
    assert [block.name for block in blocks if isinstance(block, Figure)] == ["separate", "together", "tension", "steps"]


def test_the_report_names_a_failed_criterion_and_a_change_of_lambda() -> None:
    columns = samples(PLAN)
    columns["F_A"] = columns["F_A"].copy()
    columns["F_A"][5_000] = 3.0
    columns["lam_q"][20_000:] = 0.6
    report = tracking_report(source_of(columns))
    assert report.outcome == "failed"
    assert_reason(report.verdict, "verdict_on_criteria", failed=["Smallest tendon tension"])
    changed = messages.lambda_in_use(loop="q", range_s=(0.5, 0.6))
    assert changed != messages.lambda_in_use(loop="q", range_s=(0.5, 0.5))
    assert any(changed in fact.text for fact in report.facts)


def test_the_report_of_a_stopped_run_is_incomplete() -> None:
    part = {name: column[:9_500] for name, column in samples(PLAN).items()}
    report = tracking_report(source_of(part, end_state="stopped"))
    assert report.outcome == "incomplete"
    assert_reason(report.verdict, "run_incomplete", played_s=9.5, planned_s=51.0)
    assert_reason(report.facts[0].text, "run_and_its_end", run_id=12, end=messages.stopped_before_its_end())
    assert to_pdf(report).startswith(b"%PDF-")


def test_every_table_states_unmeasured_metrics_with_their_reason(tracking_source: RunData) -> None:
    """The steps of q are longer than their holds, so they have no result; a dash does not replace the reason."""
    slow = source_of(samples(PLAN, lam_q=3.0))
    assert slow.result is not None
    report = tracking_report(slow)
    assert report.outcome == "incomplete"
    stored = {item.name: item for item in slow.result.criteria}
    unmeasured = [stored[name].title for name in ("overshoot_q", "deviation_S")]
    assert_reason(report.verdict, "verdict_on_criteria", criteria=4, failed=[], unmeasured=unmeasured)
    tables = [block for section in report.sections for block in section.blocks if isinstance(block, Table)]
    criteria, metrics = tables[:2]
    judged = {row[0]: (row[2], row[4]) for row in criteria.rows}
    overshoot = stored["overshoot_q"]
    assert_reason(overshoot.reason, "steps_not_measured", missing=8, steps=8, start_s=4.0, reason=Reason("not_settled"))
    assert judged[overshoot.title] == (messages.not_measured(), f"{messages.not_measured()}; {overshoot.reason}")
    figures = {row[0]: (row[1], row[3]) for row in metrics.rows}
    rise = next(item for item in slow.result.metrics.figures if item.name == "rise_q_s")
    assert_reason(rise.reason, "steps_not_measured", reason=Reason("step_not_reached"))
    assert figures[rise.label] == (messages.not_measured(), f"{rise.definition}; {rise.reason}")
    missing = next(table for table in tables if table.caption == messages.metrics_not_measured_completely())
    assert any(row[1] == "q" and row[3] == Reason("began_away_from_start") for row in missing.rows)
    assert not any(cell == "–" for table in (criteria, metrics, missing) for row in table.rows for cell in row)


def test_a_result_of_an_older_version_is_shown_with_what_is_missing(tracking_source: RunData) -> None:
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
    run = replace(tracking_source.run, evaluation_problem="nothing to evaluate")
    report = tracking_report(RunData(run, None, empty, None))
    assert report.outcome == "incomplete"
    assert_reason(report.verdict, "no_result", problem="nothing to evaluate")
    assert to_html(report)
    assert to_pdf(report).startswith(b"%PDF-")


def test_the_files_of_a_report_folder_agree_with_the_report(
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


# A time-optimal tracking run, compared with the law of the paper for the same references.


def planned(**changed: object) -> RunData:
    """Return a time-optimal run; its samples are closed forms, because these tests do not evaluate them."""
    source = source_of(samples(PLAN))
    settings = source.run.settings
    kept = {**settings["loop"], "motion": "time-optimal", "u_plan": 8.5, "b": 0.0, **changed}
    return replace(source, run=replace(source.run, settings={**settings, "loop": kept}))


@pytest.fixture(scope="module")
def law_plan() -> PaperLawResponse:
    found = simulate_paper_law(planned())
    assert found is not None
    return found


@pytest.fixture(scope="module")
def report_plan() -> Report:
    return tracking_report(planned())


def tables(report: Report) -> list[Table]:
    return [block for section in report.sections for block in section.blocks if isinstance(block, Table)]


def compared(report: Report) -> Table:
    return next(table for table in tables(report) if table.caption == messages.times_to_90_percent())


def number(cell: str) -> float:
    return float(cell.replace("\N{MINUS SIGN}", "-"))


def controller(source: RunData) -> Fact:
    return next(fact for fact in tuning_facts(source) if fact.label == "Controller")


def test_the_report_states_how_references_were_followed() -> None:
    for source, U_plan, k_ext in (
        (planned(), 8.5, 0.0),
        (planned(k_ext=0.7), 8.5, 0.7),
        (planned(motion="lambda"), 0.0, 0.0),
        (source_of(samples(PLAN)), 0.0, 0.0),
    ):
        text = controller(source).text
        assert_reason(text, "cascade_controller", is_position_loop_closed=True, U_plan=U_plan, k_ext=k_ext)
        assert ("U_plan = 8.5 V" in text, "k_ext = 0.7" in text) == (U_plan > 0.0, k_ext > 0.0)


def test_the_times_of_the_papers_law_come_from_a_separate_simulation(report_plan: Report) -> None:
    """The largest step of q in the table is compared with the same step simulated from rest."""
    tuning = make_cascade_tuning(load_parameters("ideal"), TuningParameters(lam_q=0.5, lam_S=0.42))
    high = float(PLAN.values["q_amplitude"])
    q = simulate_cascade(load_parameters("ideal"), tuning, np.repeat([-high, high], (500, 4000)), np.full(4500, 10.0)).q
    took = float(np.argmax(q[500:] >= 0.8 * high)) / 1000.0
    table = compared(report_plan)
    largest = [row for row in table.rows if abs(number(row[2]) - number(row[1])) > 115.0]
    assert largest
    assert float(largest[0][4]) == pytest.approx(took, abs=0.02)
    assert float(largest[0][5]) == pytest.approx(float(largest[0][4]) / float(largest[0][3]), rel=0.01)


def test_the_figures_show_the_papers_law_and_label_it(report_plan: Report) -> None:
    figures = {f.name: f for section in report_plan.sections for f in section.blocks if isinstance(f, Figure)}
    assert figures["separate"].caption == messages.separate_steps_figure(is_simulated=True, is_planned=True)
    assert figures["together"].caption == messages.simultaneous_steps_figure(is_simulated=True, is_planned=True)
    assert figures["steps"].caption == messages.all_steps_figure(is_planned=True)
    plain = {
        f.name: f
        for section in tracking_report(source_of(samples(PLAN))).sections
        for f in section.blocks
        if isinstance(f, Figure)
    }
    assert plain["separate"].caption == messages.separate_steps_figure(is_simulated=False, is_planned=False)
    assert plain["steps"].caption == messages.all_steps_figure(is_planned=False)
    assert len({messages.separate_steps_figure(is_simulated=grey, is_planned=grey) for grey in (True, False)}) == 2
    assert len(re.findall("<path", figures["separate"].svg)) > len(re.findall("<path", plain["separate"].svg))


def test_runs_in_lambda_motion_or_with_another_law_have_no_comparison() -> None:
    assert simulate_paper_law(source_of(samples(PLAN))) is None
    assert simulate_paper_law(planned(motion="lambda")) is None
    other = planned()
    plan = {**other.run.settings["plan"], "controller": "single-loop"}
    settings = {**other.run.settings, "plan": plan}
    assert simulate_paper_law(replace(other, run=replace(other.run, settings=settings))) is None


def test_a_comparison_that_cannot_be_computed_has_a_reason() -> None:
    source = planned()
    changed = {**source.columns, "lam_q": np.linspace(0.5, 0.6, source.columns["t"].size)}
    gaps = {name: np.delete(column, 500) for name, column in source.columns.items()}
    for columns, reason in ((changed, messages.lambda_was_changed()), (gaps, messages.samples_have_gaps())):
        found = simulate_paper_law(replace(source, columns=columns))
        assert found == PaperLawResponse(reason=reason)
        assert make_law_comparison([], PaperLawResponse(reason=reason), AngleUnit.DEGREES) == ()
    report = tracking_report(replace(source, columns=changed))
    notes = next(section for section in report.sections if section.heading == "Notes")
    assert Paragraph(messages.paper_law_not_computed(reason=messages.lambda_was_changed())) in notes.blocks


def test_a_step_that_does_not_reach_its_reference_is_not_measured(law_plan: PaperLawResponse) -> None:
    step = StepFigures(
        signal="q", phase="q", start_s=0.0, end_s=0.1, before=0.0, after=9.0, alone=True, rise_s=None, reach_s=None,
        settling_s=None, overshoot_percent=None, steady_error=None, cross_coupling=None,
    )  # fmt: skip
    (table,) = make_law_comparison([step], law_plan, AngleUnit.RADIANS)
    assert table.rows[0][3:] == 3 * (messages.not_measured(),)


# The control law in a report: the settings that the law uses, and its model of the plant.

CASCADE_ONLY = {"lam_motor", "b", "bank", "interpolate", "motion", "u_plan", "k_ext"}


def of_law(law: str) -> RunData:
    tracked = source_of(samples(PLAN))
    plan = build_ready_plan("tracking", controller=law, q_duration_s=4.0, S_duration_s=3.0)
    loop = LoopSettings(motion="time-optimal", u_plan=8.5, k_ext=0.3)
    settings = {
        "plan": list_stored_values(plan),
        "loop": vars(loop),
        "declared": [vars(item) for item in (*describe_plan_values(plan), *describe_values(loop))],
    }
    return replace(tracked, run=replace(tracked.run, settings=settings))


def settings_in(report: Report) -> set[str]:
    tables = [block for section in report.sections for block in section.blocks if isinstance(block, Table)]
    return {row[1] for table in tables if table.caption == messages.settings_of_run() for row in table.rows}


@pytest.mark.parametrize("law", ["single-loop", "feedback-linearization"])
def test_the_report_of_a_comparison_law_lists_only_the_settings_that_it_uses(law: str) -> None:
    source = of_law(law)
    report = build_report(source)
    symbols = settings_in(report)
    assert {"λ_q", "λ_S", "seed", "controller", "t_q"} <= symbols
    assert not symbols & {"λ_motor", "b", "bank", "interpolate", "motion", "U_plan", "k_ext"}
    facts = {fact.label: fact.text for fact in report.facts}
    assert facts["Tuning"] == "λ_q = 0.5 s, λ_S = 0.42 s"
    known = {"feedback-linearization": messages.linearization_model(), "single-loop": messages.single_loop_model()}
    assert facts[messages.model_of_controller()] == known[law]
    assert ("friction" in known[law]) == (law == "feedback-linearization")
    assert "U_plan = 8.5 V" not in facts["Controller"]
    made = next(section for section in report.sections if section.heading == messages.settings_and_origin())
    assert Paragraph(messages.gains_of_geometry()) not in made.blocks


def test_the_report_of_the_cascade_lists_the_whole_tuning() -> None:
    report = build_report(of_law("cascade"))
    assert {"λ_q", "λ_S", "λ_motor", "b", "bank", "interpolate", "motion", "U_plan", "k_ext"} <= settings_in(report)
    facts = {fact.label: fact.text for fact in report.facts}
    assert "U_plan = 8.5 V" in facts["Controller"]
    assert facts[messages.model_of_controller()] == messages.cascade_model()
    made = next(section for section in report.sections if section.heading == messages.settings_and_origin())
    assert Paragraph(messages.gains_of_geometry()) in made.blocks


@pytest.mark.parametrize("tuning_of", [make_single_loop_tuning, make_feedback_linearization_tuning])
def test_settings_that_a_law_does_not_use_do_not_change_its_tuning(tuning_of: Any) -> None:
    lab = load_parameters("lab")
    usual = tuning_of(lab, TuningParameters())
    assert tuning_of(lab, TuningParameters(lam_motor=0.12, b=0.4)) == usual
    assert tuning_of(lab, TuningParameters(lam_q=0.7)) != usual
    assert tuning_of(lab, TuningParameters(lam_S=0.7)) != usual


def test_every_law_has_its_settings() -> None:
    assert set(USED_SETTINGS) == set(Law)
    assert set(USED_SETTINGS[Law.CASCADE]) == set(TUNING_NAMES)
    assert set(TUNING_NAMES) - set(USED_SETTINGS[Law.SINGLE_LOOP]) == CASCADE_ONLY


@pytest.mark.parametrize(
    ("kind", "law", "used"),
    [
        ("motor_identification", Law.MOTOR_STEPS, {"lam_motor"}),
        ("spring_identification", Law.TENSION_SWEEP, {"lam_motor"}),
        ("actuator_identification", Law.FORCE_HOLD, {"lam_motor"}),
    ],
)
def test_an_identification_uses_the_motor_loops_alone(kind: str, law: Law, used: set[str]) -> None:
    source = of_law("cascade")
    settings = {**source.run.settings, "plan": {}}
    identification = replace(source.run, kind=kind, settings=settings)
    assert find_control_law(identification) is law
    assert {item.name for item in select_used_settings(identification)} & set(TUNING_NAMES) == used


def test_the_compliance_experiment_runs_with_its_position_loop_open() -> None:
    plan = build_ready_plan("compliance")
    source = of_law("cascade")
    compliant = replace(
        source.run, kind="compliance", settings={**source.run.settings, "plan": list_stored_values(plan)}
    )
    assert find_control_law(compliant) is Law.COMPLIANCE
    assert "lam_q" not in {item.name for item in select_used_settings(compliant)}


@pytest.mark.parametrize(
    "experiment", ["", "{", "[]", "7", '{"law": "none"}', '{"law": []}', "[" * 100_000], ids=lambda text: text[:15]
)
def test_a_stored_experiment_that_cannot_be_read_is_refused(experiment: str) -> None:
    source = of_law("cascade")
    run = replace(source.run, settings={**source.run.settings, "plan": {"experiment": experiment}})
    with refused(UnreadableDocumentError, "stored_experiment_invalid", run_id=run.id):
        find_control_law(run)


def test_the_error_of_the_shown_stiffness_equals_the_error_of_the_springs() -> None:
    """This checks the note of every report on a plant with 20 % stiffer springs than identified."""
    lab = load_parameters("lab")
    stiffer = replace(lab, asymmetry=replace(lab.asymmetry, spring_A=1.2, spring_B=1.2))
    ticks = 6_000
    found = simulate_cascade(
        stiffer, make_cascade_tuning(lab, TuningParameters()), np.zeros(ticks), np.full(ticks, 12.0)
    )
    rest = slice(-500, None)
    assert found.S[rest].mean() == pytest.approx(12.0, abs=0.02)
    assert found.S_true[rest].mean() == pytest.approx(14.4, abs=0.05)
    paragraphs = [
        getattr(block, "text", "") for section in build_report(of_law("cascade")).sections for block in section.blocks
    ]
    assert messages.S_is_an_estimate() in paragraphs
    assert re.findall(r"[\d.]+(?= (?:%|N·m/rad|is commanded))", messages.S_is_an_estimate()) == ["20", "14.4", "12"]


# A report names the plant; only a simulated plant has a seed.

SEEDED = {"simulator", "virtual card"}
CHOICES = [PlantChoice(kind, package="servo-bench") for kind in PlantKind]


@pytest.mark.parametrize("choice", CHOICES, ids=lambda choice: str(choice.kind))
def test_the_report_names_the_plant(choice: PlantChoice) -> None:
    source = source_of(samples(PLAN))
    report = tracking_report(replace(source, run=replace(source.run, plant=choice.name)))
    facts = {fact.label: fact.text for fact in report.facts}
    assert report.subtitle.endswith(messages.plant_and_parameters(plant=choice.name, parameters="ideal"))
    assert facts["Plant"] == messages.plant_and_parameters(plant=choice.name, parameters="ideal")
    assert ("Seed" in facts) == (choice.name in SEEDED)
