"""Reports of compliance runs, sessions and own sequences, from records made by formula."""

from dataclasses import replace

import numpy as np
import pytest

from backend.analysis.disturbance_metrics import compute_compliance_metrics
from backend.analysis.evaluation import build_metric_documents
from backend.experiments.library import build_ready_plan, find_experiment, list_stored_values
from backend.models.run import Metrics
from backend.reports.build import build_report
from backend.reports.model import Figure, Report, Table, to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData
from tests.experiments.judging import LEAD_IN_S, compliance_criteria
from tests.reports.tracking_run import PLAN, samples, source_of


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


def test_compliance_report_judges_the_force_error_and_draws_figure_8() -> None:
    report = build_report(compliance_source())
    assert (report.title, report.outcome) == ("Compliance experiment", "passed")
    assert report.verdict == "All 2 criteria passed."
    assert names_of_figures(report) == ["forces", "tension"]
    criteria = next(block for block in report.sections[0].blocks if isinstance(block, Table))
    assert criteria.rows[0][:2] == ("Force error, aligned", "< 0.5")
    assert "2.239 N" in to_html(report)
    assert "(equations 22 and 25 of the paper, a linear approximation)" in to_html(report)
    assert to_pdf(report).startswith(b"%PDF-")


def test_a_session_is_shown_and_not_judged() -> None:
    tracked = source_of(samples(PLAN))
    columns = dict(tracked.columns)
    columns["q_ref"] = columns["q_ref"].copy()
    columns["q_ref"][:5_000] = np.nan  # no reference was in force yet
    settings = {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "interpolate": False}}
    session = RunData(replace(tracked.run, kind="session", settings=settings), None, columns, None)
    report = build_report(session)
    assert (report.title, report.outcome) == ("Session", "neutral")
    assert "nothing is judged" in report.verdict
    assert names_of_figures(report) == ["panels", "tension"]
    assert to_pdf(report).startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (
            {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.09, "b": 0.7, "interpolate": False}},
            "λ_q = 0.5 s, λ_S = 0.42 s, λ_motor = 0.09 s, b = 0.7",
        ),
        (  # as earlier versions stored sessions, without b
            {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "interpolate": False}},
            "λ_q = 0.5 s, λ_S = 0.42 s, λ_motor = 0.0854 s, b was not recorded then",
        ),
    ],
)
def test_the_report_says_the_whole_tuning_or_what_is_not_known_of_it(settings: dict[str, object], said: str) -> None:
    tracked = source_of(samples(PLAN))
    session = RunData(replace(tracked.run, kind="session", settings=settings), None, tracked.columns, None)
    assert [fact.text for fact in build_report(session).facts if fact.label == "Tuning"] == [said]


def test_an_own_sequence_has_figures_but_no_criteria() -> None:
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
    assert "No criteria" in report.verdict
    assert [block.caption.split(".")[0] for block in report.sections[0].blocks if isinstance(block, Table)] == [
        "Metrics on measured signals"
    ]
