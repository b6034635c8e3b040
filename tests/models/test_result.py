"""Results of earlier versions are shown, what cannot be read is refused by name, and the list of runs still opens."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from backend.models.document import UnreadableDocumentError
from backend.models.run import CRITERIA, METRICS
from backend.models.upgrades import NO_STORED_REASON
from backend.reports.build import build_metrics_document, build_report
from backend.reports.run_data import load_source
from backend.services.runs import RunQuery, StoredRuns
from backend.storage import results
from backend.storage.database import Database
from backend.storage.results import NewResult
from tests.models import earlier
from tests.models.earlier import earlier_database, put_result


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = earlier_database(tmp_path)
    yield opened
    opened.close()


def test_a_result_without_reasons_says_what_it_lacks(database: Database) -> None:
    source = load_source(database, 1)
    assert source.result is not None
    metrics, criteria = source.result.metrics, source.result.criteria
    assert (metrics.complete, metrics.played_s, metrics.problem) == (True, 28.000000000000004, "")
    assert metrics.definitions == 0
    assert [item.reason for item in metrics.figures] == ["no such step was played to its end", ""]
    assert metrics.steps is not None
    assert (metrics.steps[0].overshoot_percent, metrics.steps[0].reach_s, metrics.steps[0].reasons) == (0.5, None, {})
    assert [item.reason for item in criteria] == [NO_STORED_REASON]
    assert build_metrics_document(source)["criteria"] == [{**earlier.CRITERIA[0], "reason": NO_STORED_REASON}]
    assert build_report(source).outcome == "incomplete"


def test_what_is_written_is_what_was_written_and_a_version(database: Database) -> None:
    with database.session() as session:
        read = results.newest(session, 1)
        assert read is not None
        results.add(session, NewResult(1, read.metrics, read.criteria, "1.0.0"))
        row = session.execute(text("SELECT metrics, criteria FROM result ORDER BY id DESC LIMIT 1")).one()
    metrics, criteria = json.loads(row.metrics), json.loads(row.criteria)
    assert metrics.pop("version") == 1
    assert {name: metrics[name] for name in earlier.METRICS if name not in ("figures", "steps")} == {
        name: value for name, value in earlier.METRICS.items() if name not in ("figures", "steps")
    }
    assert metrics["figures"] == [earlier.FIGURES[0], {**earlier.FIGURES[1], "reason": ""}]
    assert criteria == [{**earlier.CRITERIA[0], "reason": NO_STORED_REASON}]


@pytest.mark.parametrize(
    ("metrics", "criteria", "said"),
    [
        ({**earlier.METRICS, "version": 2}, [], "run 1: its result is of version 2, written by a newer Sinew"),
        (
            {**earlier.METRICS, "played_s": "long"},
            [],
            "run 1: its result cannot be read, field played_s: it should be a valid number",
        ),
        ({**earlier.METRICS, "figures": [{"name": "rmse_q"}]}, [], "field figures.0.unit: it is missing"),
        ({**earlier.METRICS, "figures": 3}, [], "field figures: it should be"),
        ([], [], "run 1: its result cannot be read"),
        (earlier.METRICS, [{**earlier.CRITERIA[0], "bound": None}], "its criteria cannot be read, field 0.bound"),
    ],
)
def test_what_cannot_be_read_is_refused_by_run_and_field(
    database: Database, metrics: Any, criteria: Any, said: str
) -> None:
    put_result(database, 1, metrics, criteria)
    with pytest.raises(UnreadableDocumentError) as refused:
        load_source(database, 1)
    assert said in str(refused.value)
    stored = StoredRuns(database, lambda: None, lambda _run: False)
    listed = stored.find_runs(RunQuery(limit=10))
    assert [run.id for run in listed.runs] == [1]


@pytest.mark.parametrize("version", ["1", 1.5, True, -1])
def test_a_version_that_is_none_is_no_way_around(version: Any) -> None:
    with pytest.raises(UnreadableDocumentError, match="run 7: its result cannot be read, field version"):
        METRICS.read({**earlier.METRICS, "version": version}, "run 7")


def test_criteria_come_back_as_they_were() -> None:
    read = CRITERIA.read([{**earlier.CRITERIA[0], "reason": "no number"}], "run 7")
    assert CRITERIA.write(read) == [{**earlier.CRITERIA[0], "reason": "no number"}]
