"""What a run came to is one sentence, and a missing figure has one reason: in report, interface and metrics file."""

from dataclasses import replace
from typing import Any

import pytest

from backend.api.stored import experiment_view
from backend.reports.build import build_report
from backend.reports.files import metrics_document
from backend.reports.source import Source
from tests.reports.tracking_run import PLAN, samples, source_of


def failed() -> Source:
    columns = samples(PLAN)
    columns["F_A"] = columns["F_A"].copy()
    columns["F_A"][5_000] = 3.0
    return source_of(columns)


SOURCES = {
    "passed": lambda: source_of(samples(PLAN)),
    "failed": failed,
    "not measured": lambda: source_of(samples(PLAN, lam_q=3.0)),
    "stopped": lambda: source_of({name: column[:9_500] for name, column in samples(PLAN).items()}, end_state="stopped"),
}


@pytest.mark.parametrize("name", SOURCES)
def test_report_interface_and_file_say_the_same(name: str) -> None:
    source = SOURCES[name]()
    report, document = build_report(source), metrics_document(source)
    view = experiment_view(source.run, source.result, 1.0)
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

    def without(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
        return [{name: value for name, value in item.items() if name != "reason"} for item in items]

    metrics = source.result.metrics | {"figures": without(source.result.metrics["figures"])}
    old = replace(source.result, metrics=metrics, criteria=without(source.result.criteria))
    view = experiment_view(source.run, old, 1.0)
    missing = [item.reason for item in view.metrics if item.value is None]
    assert missing
    assert set(missing) == {"evaluated by an older version, which kept no reason; evaluate the run again to have one"}
