"""What an earlier version has exported comes in in the present form, and once."""

import json
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from backend.exports.base import export_run
from backend.exports.formats import DataFormat, write_export
from backend.exports.importer import ImportResult, import_bundle, import_export
from backend.models.upgrades import NO_STORED_REASON
from backend.services.downloads import stream_bundle
from backend.storage import identifications, results, runs
from backend.storage.database import Database
from tests.exports.stored import held
from tests.migrations.old_schema import migrated
from tests.models.earlier import BEFORE
from tests.models.earlier_identifications import BAND, QUALITY


def rewrite(database: Database, table: str, column: str, change: Callable[[Any], Any]) -> None:
    """Change a document of all rows as it stands in the database."""
    with database.session() as session:
        for number, value in session.execute(text(f"SELECT id, {column} FROM {table}")).all():
            told = {"value": json.dumps(change(json.loads(value))), "id": number}
            session.execute(text(f"UPDATE {table} SET {column} = :value WHERE id = :id"), told)


def with_limit_alone(settings: Any) -> Any:
    loop = {name: part for name, part in settings.get("loop", {}).items() if name != "motion"}
    return settings | {"loop": loop | {"u_plan": 7.5}}


def without_reasons(items: list[Any]) -> list[Any]:
    return [{name: part for name, part in item.items() if name != "reason"} for item in items]


def without_definitions(metrics: Any) -> Any:
    kept = {name: part for name, part in metrics.items() if name != "definitions"}
    return kept | {"figures": without_reasons(metrics["figures"])}


def with_bands(quality: Any) -> Any:
    channel = QUALITY | {"residuals": {"whiteness": BAND, "input_correlation": BAND}}
    return quality | {"G_q": channel, "G_S": channel}


@pytest.fixture
def earlier(here: Database, run: int) -> Database:
    """The installation that exports, as an earlier version has left it."""
    rewrite(here, "run", "settings", with_limit_alone)
    rewrite(here, "result", "metrics", without_definitions)
    rewrite(here, "result", "criteria", without_reasons)
    rewrite(here, "identification", "quality", with_bands)
    return here


def test_a_bundle_of_an_earlier_version_comes_in_whole(
    earlier: Database, there: Database, run: int, tmp_path: Path
) -> None:
    file, later = tmp_path / "earlier.zip", tmp_path / "later.zip"
    file.write_bytes(b"".join(stream_bundle(earlier, run, tmp_path)))
    assert import_bundle(there, file, "Ben", tmp_path / "there") == ImportResult(run=2, was=run, new=True)
    before = held(there)
    with closing(migrated(earlier, tmp_path / "here", BEFORE)) as here:
        with here.reading() as one, there.reading() as other:
            for number in (1, 2):
                assert runs.get(other, number).settings == runs.get(one, number).settings
            assert runs.get(other, 2).set_to.loop.budget == 7.5
            first, second = results.newest(one, 2), results.newest(other, 2)
            assert first is not None
            assert second is not None
            assert (second.metrics, second.criteria) == (first.metrics, first.criteria)
            assert second.metrics.definitions == 0
            assert {item.reason for item in second.metrics.figures} <= {"", NO_STORED_REASON}
            ours = identifications.of_run(other, 1)
            assert ours.quality == identifications.of_run(one, 1).quality
            assert ours.actuator.quality.G_q.residuals.whiteness.bound[0] == pytest.approx(0.109, abs=5e-4)
        later.write_bytes(b"".join(stream_bundle(here, run, tmp_path)))
        for known in (file, later):
            assert import_bundle(there, known, "Ben", tmp_path / "there") == ImportResult(run=2, was=run, new=False)
            assert import_bundle(here, known, "Ben", tmp_path / "here") == ImportResult(run=2, was=run, new=False)
    assert held(there) == before


@pytest.mark.parametrize("kind", DataFormat)
def test_an_export_of_an_earlier_version_comes_in_once(
    earlier: Database, there: Database, run: int, kind: DataFormat, tmp_path: Path
) -> None:
    file, later = tmp_path / f"earlier.{kind}", tmp_path / f"later.{kind}"
    write_export(export_run(earlier, run), kind, file)
    assert import_export(there, file, "Ben") == ImportResult(run=1, was=run, new=True)
    with there.reading() as session:
        assert runs.get(session, 1).set_to.loop.motion == "time-optimal"
    with closing(migrated(earlier, tmp_path / "here", BEFORE)) as here:
        write_export(export_run(here, run), kind, later)
        for known in (file, later):
            assert import_export(there, known, "Ben") == ImportResult(run=1, was=run, new=False)
            assert import_export(here, known, "Ben") == ImportResult(run=run, was=run, new=False)
