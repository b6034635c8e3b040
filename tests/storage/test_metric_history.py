"""A metric over the dates of its runs: whatever any of them has can be asked for."""

from dataclasses import replace

import pytest

from backend.models.run import MeasuredFigure
from backend.services.comparison import build_metric_history
from backend.storage import results, runs
from backend.storage.database import Database
from backend.storage.results import NewResult
from backend.storage.runs import EndState, RunKind
from backend.storage.search import QueryError
from tests.storage.test_lineage import METRICS, NEW_RUN

NEWER = 25
"""More than are looked through for what their metrics are."""


def test_a_metric_that_only_older_runs_have_is_shown(database: Database) -> None:
    older = MeasuredFigure("settling", "s", "Settling", "", 0.7)
    with database.session() as session:
        for figures in ((*METRICS.figures, older), *[METRICS.figures] * NEWER):
            run = runs.create(session, replace(NEW_RUN, kind=RunKind.TRACKING)).id
            runs.end(session, run, EndState.COMPLETED)
            results.add(session, NewResult(run, replace(METRICS, figures=figures), (), "1"))
    with database.reading() as session:
        found = build_metric_history(session, "tracking", "settling", "", everywhere=False)
        assert found.metric is not None
        assert (found.metric.label, [point.value for point in found.points]) == ("Settling", [0.7])
        assert found.without == NEWER
        assert [one.name for one in found.metrics] == ["overshoot", "settling"]
        assert len(build_metric_history(session, "tracking", "", "", everywhere=False).points) == NEWER + 1
        for unknown in ("setling", "overshoot.x"):
            with pytest.raises(QueryError, match="have no metric"):
                build_metric_history(session, "tracking", unknown, "", everywhere=False)
        with pytest.raises(QueryError, match="have no metric 'settling'"):
            build_metric_history(session, "compliance", "settling", "", everywhere=False)
