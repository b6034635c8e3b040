"""What a run came to is one sentence, and a missing figure has one reason: in report, interface and metrics file."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from backend.models.run import CRITERIA, METRICS
from backend.models.upgrades import NO_STORED_REASON, upgrade_criteria, upgrade_metrics
from backend.reports.build import build_metrics_document, build_report
from backend.reports.run_data import RunData
from backend.schemas.run import EvaluationView
from backend.services.runs import build_experiment_view, build_run_view
from tests.reports.tracking_run import PLAN, samples, source_of


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
def test_report_interface_and_file_say_the_same(name: str) -> None:
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


def test_a_result_without_reasons_says_that_it_is_old() -> None:
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
    """Programs keep them declared; sessions have a tuning."""

    run = source_of(samples(PLAN)).run
    settings = {"mode": "run", "loop": {"lam_q": 0.5, "lam_S": 0.42, "b": 0.0, "interpolate": False}}
    view = build_run_view(replace(run, settings=settings), EvaluationView.NONE, 10, 0.01, 0)
    assert {item.name: (item.symbol, item.unit, item.value) for item in view.settings} == {
        "lam_q": ("λ_q", "s", 0.5),
        "lam_S": ("λ_S", "s", 0.42),
        "b": ("b", "1", 0.0),
        "interpolate": ("interpolate", "1", False),
    }
