"""A run that identified the actuator shows the lower fit of its newest estimate as its key figure."""

from dataclasses import replace
from typing import Any

from backend.services.runs import RunQuery, StoredRuns
from backend.storage import identifications
from backend.storage.database import Database
from tests.exports.stored import ESTIMATE, recorded
from tests.models.earlier_identifications import QUALITY


def fit_of(value: float, other: float) -> dict[str, dict[str, Any]]:
    return {"G_q": QUALITY | {"fit_percent": value}, "G_S": QUALITY | {"fit_percent": other}}


def test_the_newest_estimate_tells_the_key_figure(database: Database) -> None:
    with database.session() as session:
        run, bare = recorded(session), recorded(session)
        identifications.add(session, replace(ESTIMATE, run_id=run, quality=fit_of(50.0, 60.0)))
        identifications.add(session, replace(ESTIMATE, run_id=run, quality=fit_of(97.0, 91.5)))
    with database.reading() as session:
        assert identifications.fits_of_runs(session, [run, bare]) == {run: {"G_q": 97.0, "G_S": 91.5}}
    listed = {one.id: one for one in StoredRuns(database, lambda: None, lambda _run: False).find_runs(RunQuery()).runs}
    headline = listed[run].headline
    assert headline is not None
    assert (headline.name, headline.label, headline.value, headline.unit) == ("fit_percent", "Fit of G_S", 91.5, "%")
    assert listed[bare].headline is None
