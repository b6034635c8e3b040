"""Reports of batteries, impacts, compliance and sessions."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.analysis.disturbance_metrics import compute_compliance_metrics, find_hits
from backend.analysis.evaluation import build_metric_documents
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan, find_experiment, list_stored_values
from backend.experiments.plans import LoopSettings
from backend.models.run import ENTRY, LAMBDA, MOTIONS, TIME_OPTIMAL, EntryModel, Metrics
from backend.reports import messages
from backend.reports.build import build_report
from backend.reports.experiment_report import find_frequency_responses
from backend.reports.model import NO_FIGURE, Figure, Paragraph, Report, Table, to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData, load_source
from backend.reports.sections import hits_table, reaction_tables
from backend.reports.series import series_report
from backend.reports.verification import Verified, verify_report
from backend.storage import banks
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from backend.units import AngleUnit
from plant.parameters import load_parameters
from tests.experiments.judging import LEAD_IN_S, compliance_criteria
from tests.reports.tracking_run import PLAN, samples, source_of

# The report of an impact experiment: a table of all hits, figures over time and speed, and verification.

PLAN_IMPACT = build_ready_plan("impact", speeds=2, v_slow=0.3)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    folder: Path = tmp_path_factory.mktemp("impact")
    database = open_database(folder)
    with open_headless_rig(database, load_parameters("lab"), LoopSettings()) as station:
        run = asyncio.run(run_experiment(station, RunRequest(PLAN_IMPACT, LoopSettings(), "A. Operator"))).run
    source = load_source(database, run.id)
    database.close()
    return source


def test_the_impact_report_passes_lists_every_hit_and_is_verified(source: RunData) -> None:
    report = build_report(source)
    assert (report.title, report.outcome) == ("Impact", "passed")
    blocks = {section.heading: section.blocks for section in report.sections}
    assert [block.name for block in blocks["Figures"] if isinstance(block, Figure)][1:] == ["hits", "tension"]
    table, beside = blocks["Hits"]
    assert isinstance(table, Table)
    assert isinstance(beside, Table)
    assert [row[1] for row in table.rows] == ["8.00"] * 2 + ["15.0"] * 4 + ["8.00"] * 2
    assert [row[0] for row in beside.rows] == ["8.00", "8.00", "15.0", "15.0"]
    assert verify_report(to_html(report), source.columns) == Verified((), ())


def test_the_table_of_hits_matches_the_recording_in_the_angle_unit_of_the_reader(source: RunData) -> None:
    hits = find_hits(source.columns, PLAN_IMPACT.program())
    limits, estimate = source.columns["limits"].astype(int), np.abs(source.columns["F_ext_hat"])
    for angles, factor in ((AngleUnit.RADIANS, 1.0), (AngleUnit.DEGREES, 180.0 / np.pi)):
        table = hits_table(hits, angles)
        for row, hit in zip(table.rows, hits, strict=True):
            seen = [float(cell) for cell in row if cell != NO_FIGURE]
            window = np.abs(source.columns["F_wall"][hit.window])
            expected = [hit.speed * factor, window.max(), window.sum() * 1e-3, 1e3 * np.count_nonzero(window) * 1e-3]
            assert seen[2:6] == pytest.approx(expected, rel=6e-3)
            if not hit.reacts:
                assert row[6:] == (NO_FIGURE,) * 4
                continue
            touch = hit.window.start
            felt, gave = (int(np.argmax(from_touch)) for from_touch in (estimate[touch:] > 1.2, limits[touch:] & 64))
            assert seen[6:] == [1.2, felt, gave - felt, int(np.argmax(window)) - felt]
    assert [hit.speed for hit in hits] == pytest.approx([0.3, 0.6] * 4, rel=0.05)


def test_the_reaction_table_pairs_hits_with_and_without_reaction(source: RunData) -> None:
    hits = find_hits(source.columns, PLAN_IMPACT.program())
    (table,) = reaction_tables(hits, AngleUnit.RADIANS)
    for row, plain, reacted in zip(table.rows, (*hits[:2], *hits[2:4]), (*hits[6:], *hits[4:6]), strict=True):
        expected = [plain.peak_N, reacted.peak_N, reacted.peak_N / plain.peak_N]
        expected += [plain.impulse_Ns, reacted.impulse_Ns, reacted.impulse_Ns / plain.impulse_Ns]
        assert [float(cell) for cell in row[2:]] == pytest.approx(expected, rel=6e-3)
    assert reaction_tables(hits[:4], AngleUnit.RADIANS) == ()


def test_an_undetected_hit_is_shown_as_not_detected(source: RunData) -> None:
    hit = find_hits(source.columns, PLAN_IMPACT.program())[-1]._replace(
        detection_s=float("nan"), reaction_s=float("nan")
    )
    assert hits_table([hit], AngleUnit.RADIANS).rows[0][7:9] == 2 * (messages.not_detected(),)


def test_the_missing_speed_of_a_hit_is_shown_as_not_measured(source: RunData) -> None:
    table = hits_table([find_hits(source.columns)[0]._replace(speed=float("nan"))], AngleUnit.RADIANS)
    assert table.rows[0][2] == messages.not_measured()


# Reports of compliance runs, sessions and sequences, from computed records.


def names_of_figures(report: Report) -> list[str]:
    return [block.name for section in report.sections for block in section.blocks if isinstance(block, Figure)]


def compliance_source() -> RunData:
    plan = build_ready_plan("compliance", profile="steps", hold_s=0.5)
    tracked = source_of(samples(PLAN))
    t = np.arange(round(plan.program().duration_s * 1000)) * 1e-3
    columns = {name: np.zeros_like(t) for name in tracked.columns} | {"t": t}
    push = np.where(t < 6.0, 0.0, 10.0 * np.sin(3.0 * (t - 6.0)))
    columns |= {
        "S": 10.0 + 0 * t,
        "S_ref": 10.0 + 0 * t,
        "q": 0.0075 * push,
        "F_A": 17 - push / 2,
        "F_B": 17 + push / 2,
    }
    figures = compute_compliance_metrics(columns, 0.075, LEAD_IN_S)
    metrics = Metrics(
        complete=True, played_s=t[-1], planned_s=t[-1], figures=build_metric_documents(figures), phases=plan.phases()
    )
    assert tracked.result is not None
    criteria = compliance_criteria(figures)
    run = replace(tracked.run, kind="compliance")
    return RunData(run, replace(tracked.result, metrics=metrics, criteria=criteria), columns, None)


def test_the_compliance_report_evaluates_the_force_error_and_draws_figure_8() -> None:
    report = build_report(compliance_source())
    assert (report.title, report.outcome) == ("Compliance experiment", "passed")
    assert report.verdict == messages.verdict_on_criteria(criteria=2, failed=(), unmeasured=())
    assert names_of_figures(report) == ["forces", "tension"]
    criteria = next(block for block in report.sections[0].blocks if isinstance(block, Table))
    assert criteria.rows[0][:2] == ("Force error, aligned", "< 0.5")
    assert "2.239 N" in to_html(report)
    notes = next(section.blocks for section in report.sections if section.heading == "Notes")
    assert Paragraph(messages.push_is_measured_as_reaction()) in notes
    assert to_pdf(report).startswith(b"%PDF-")


def test_the_report_of_a_session_has_no_criteria() -> None:
    tracked = source_of(samples(PLAN))
    columns = dict(tracked.columns)
    columns["q_ref"] = columns["q_ref"].copy()
    columns["q_ref"][:5_000] = np.nan  # no reference was active yet
    settings = {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "interpolate": False}}
    session = RunData(replace(tracked.run, kind="session", settings=settings), None, columns, None)
    report = build_report(session)
    assert (report.title, report.outcome) == ("Session", "neutral")
    assert report.verdict == messages.session_has_no_verdict()
    assert names_of_figures(report) == ["panels", "tension"]
    assert to_pdf(report).startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("settings", "lam_motor_s", "b"),
    [
        (
            {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.09, "b": 0.7, "interpolate": False}},
            0.09,
            0.7,
        ),
        (  # the form of sessions in earlier versions, without b
            {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "interpolate": False}},
            0.0854,
            None,
        ),
    ],
)
def test_the_report_states_the_whole_tuning_or_its_unknown_settings(
    settings: dict[str, object], lam_motor_s: float, b: float | None
) -> None:
    tracked = source_of(samples(PLAN))
    session = RunData(replace(tracked.run, kind="session", settings=settings), None, tracked.columns, None)
    tuning = (
        messages.lambda_in_use(loop="q", range_s=(0.5, 0.5)),
        messages.lambda_in_use(loop="S", range_s=(0.42, 0.42)),
        messages.lambda_motor_in_use(lam_s=lam_motor_s),
        messages.setpoint_weight(b=b),
    )
    assert [fact.text for fact in build_report(session).facts if fact.label == "Tuning"] == [", ".join(tuning)]


def test_the_report_of_a_sequence_has_metrics_but_no_criteria() -> None:
    tracked = source_of(samples(PLAN))
    assert tracked.result is not None
    plan = find_experiment("sequence").make_plan({"segments": '[{"duration_s": 1, "q_ref": 0.1, "S_ref": 10}]'})
    settings = {**tracked.run.settings, "plan": list_stored_values(plan)}
    sequence = RunData(
        replace(tracked.run, kind="sequence", settings=settings),
        replace(tracked.result, criteria=()),
        tracked.columns,
        None,
    )
    report = build_report(sequence)
    assert (report.title, report.outcome) == ("Own sequence", "neutral")
    assert report.verdict == messages.no_criteria()
    (caption,) = [block.caption for block in report.sections[0].blocks if isinstance(block, Table)]
    assert caption.startswith(messages.metrics_of_signals(complete=True))


# Reports of frequency responses, disturbances and rest: figures, tables and verification.

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
    """Store a bank whose gains differ strongly from the geometric gains; return its number."""
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
def test_measurements_are_in_figure_and_table_and_verified_by_the_samples(
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


def test_the_prediction_uses_the_bank_that_was_active(database: Database, bank: int) -> None:
    """The geometric gains would predict another response; friction hardly affects that of the bank."""
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
    """The response at the last line decreases in lambda motion, but not in time-optimal motion."""
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


def test_lines_during_an_active_limit_are_marked_and_have_no_metrics(database: Database) -> None:
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
    assert all(
        row[-1].startswith(messages.line_not_measured(reason="")) and row[1] == row[3] == NO_FIGURE
        for row in table.rows
    )
    assert all(row[2] != NO_FIGURE for row in table.rows)
    assert verify_report(to_html(report), source.columns) == Verified((), ())
