"""A migrated database has documents of the present form, and loses nothing."""

import json
from contextlib import closing
from pathlib import Path
from typing import Any

from sqlalchemy import text

from backend.experiments.library import find_experiment, list_stored_values
from backend.models.upgrades import NO_STORED_REASON, upgrade_quality
from backend.storage import identifications, results, runs
from backend.storage.database import Database
from tests.migrations.old_schema import migrated
from tests.models import earlier_identifications as earlier
from tests.models.earlier import BEFORE, CRITERIA, METRICS, put, put_result, put_run
from tests.models.earlier_identifications import put_identification

TABLES = ("run", "result", "identification", "setting")
LOOP: dict[str, Any] = {"lam_q": 0.5, "lam_S": 0.42, "interpolate": False}
BUDGET = {"plan": {"tension_N": 20.0}, "loop": {**LOOP, "u_plan": 7.5}, "version": 1}
PRESENT = {"mode": "run", "loop": {**LOOP, "motion": "lambda", "u_plan": 8.5}, "version": 1}
TUNING = {"lam_q": 0.8, "lam_S": 0.6, "lam_motor": 0.09, "interpolate": True, "bank": None, "parameters": "ab"}
NO_GRADE = {name: part for name, part in earlier.MOTOR_QUALITY.items() if name != "grade"}
BAND = {**earlier.QUALITY, "residuals": {"whiteness": earlier.BAND, "input_correlation": earlier.BAND}}
BANDS = earlier.ACTUATOR | {"quality": {"G_q": BAND, "G_S": BAND}}
UNGRADED = earlier.MOTORS | {"quality": {"A": NO_GRADE, "B": NO_GRADE}}
BROKEN = earlier.MOTORS | {"quality": {"A": NO_GRADE, "B": 3}}


def keep(database: Database, name: str, value: Any) -> None:
    put(database, "setting", name=name, value=json.dumps(value), who="Ana", at="2026-03-04 10:20:30", station="rig")


def rows(database: Database) -> dict[str, list[dict[str, Any]]]:
    """Return all rows by table; on SQLite with their documents as the text that they are."""
    with database.reading() as session:
        found = {name: session.execute(text(f"SELECT * FROM {name} ORDER BY id")).mappings() for name in TABLES}
        return {name: [dict(row) for row in told] for name, told in found.items()}


def found_by(database: Database, name: str) -> dict[int, Any]:
    """Return the search values of the runs under a name."""
    query = (
        "SELECT run_id, value, word FROM run_value JOIN value_name ON value_name.id = name_id "
        f"WHERE source = 'setting' AND name = '{name}'"
    )
    with database.reading() as session:
        return {row.run_id: row.word or row.value for row in session.execute(text(query))}


def test_a_database_of_an_earlier_version_is_migrated_once(database: Database, tmp_path: Path) -> None:
    put_run(database, 1, "session", {"mode": "run", **LOOP, "bank": None})
    put_run(database, 2, "tracking", BUDGET)
    put_run(database, 3, "session", PRESENT)
    put_run(database, 4, "session", {"mode": "run", **LOOP, "lam_q": "fast"})
    put_result(database, 2, METRICS, CRITERIA)
    put_result(database, 3, {**METRICS, "played_s": "long"}, CRITERIA)
    for number, (kind, documents) in enumerate(
        (("actuator", BANDS), ("motor", UNGRADED), ("motor", BROKEN), ("spring", earlier.SPRINGS)), start=5
    ):
        put_identification(database, number, kind, documents)
    keep(database, "tuning in force", TUNING)
    keep(database, "tuning in force", {"lam_q": 0.8})
    keep(database, "tuning/3", TUNING)
    assert found_by(database, "motion") == {3: "lambda"}

    before = rows(database)
    database = migrated(database, tmp_path, BEFORE)
    once = rows(database)
    database = migrated(database, tmp_path, BEFORE)
    with closing(database):
        assert rows(database) == once
        changed = {
            name: [one["id"] for one, was in zip(once[name], before[name], strict=True) if one != was]
            for name in TABLES
        }
        assert changed == {"run": [1, 2], "result": [1, 2], "identification": [1, 2], "setting": [1]}
        with database.reading() as session:
            told = [runs.get(session, number).settings for number in (1, 2)]
            result = results.newest(session, 2)
            actuator, motor = identifications.of_run(session, 5), identifications.of_run(session, 6)
            tuning = session.execute(text("SELECT value FROM setting WHERE id = 1")).scalar_one()
        assert told[0] == {"mode": "run", "loop": {**LOOP, "bank": None}}
        assert told[1] == BUDGET | {"loop": {**LOOP, "u_plan": 7.5, "motion": "time-optimal"}}
        assert result is not None
        assert (result.metrics.definitions, [item.reason for item in result.criteria]) == (0, [NO_STORED_REASON])
        for found, documents in ((actuator, BANDS), (motor, UNGRADED)):
            assert found.model == documents["model"]
            assert found.quality == upgrade_quality(found.kind, found.model, documents["quality"])
            found.readable()
        later = {"b": 0.0, "bank": 0, "motion": "lambda", "u_plan": 8.5, "k_ext": 0.0}
        assert (json.loads(tuning) if isinstance(tuning, str) else tuning) == TUNING | later
        assert found_by(database, "motion") == {2: "time-optimal", 3: "lambda"}
        assert found_by(database, "lam_q") == {1: 0.5, 2: 0.5, 3: 0.5}


def test_rows_beyond_one_batch_are_all_rewritten(sqlite: Database, tmp_path: Path) -> None:
    put_run(sqlite, 1, "tracking", BUDGET)
    for _ in range(401):
        keep(sqlite, "tuning in force", TUNING)
    with closing(migrated(sqlite, tmp_path, BEFORE)) as opened, opened.reading() as session:
        values = [json.loads(value) for value in session.scalars(text("SELECT value FROM setting"))]
    assert [value["bank"] for value in values] == [0] * 401


def test_a_damaged_document_does_not_end_the_migration(sqlite: Database, tmp_path: Path) -> None:
    put_run(sqlite, 1, "tracking", BUDGET)
    put_run(sqlite, 2, "tracking", BUDGET)
    with sqlite.session() as session:
        session.execute(text("UPDATE run SET settings = '{\"loop\": {' WHERE id = 1"))
    with closing(migrated(sqlite, tmp_path, BEFORE)) as opened, opened.reading() as session:
        assert session.scalar(text("SELECT settings FROM run WHERE id = 1")) == '{"loop": {'
        assert runs.get(session, 2).set_to.loop.motion == "time-optimal"


def test_a_sequence_migrates_to_an_experiment_and_back_to_segments(database: Database, tmp_path: Path) -> None:
    segments = json.dumps(
        [
            {"duration_s": 1.5, "q_ref": 0, "S_ref": 10},
            {"duration_s": 2, "q_ref": 0.25, "S_ref": 12.5, "F_push": -3.25, "shape": "ramp"},
            {"duration_s": 8, "q_ref": -0.2, "S_ref": 12, "shape": "sine", "period_s": 4},
        ]
    )
    other = {"name": "b", "symbol": "b", "unit": "1", "meaning": "weight", "value": 0.5}
    declared = [{**other, "name": "segments", "value": segments}, other]
    told = {"plan": {"segments": segments}, "loop": {"b": 0.5}, "declared": declared, "version": 1}
    put_run(database, 1, "sequence", told)
    put_run(database, 2, "sequence", {**told, "plan": {"segments": "step 3"}})
    put_run(database, 3, "tracking", BUDGET)
    put_run(database, 4, "sequence", {**told, "plan": {"segments": "[" * 10_000}})
    before = rows(database)["run"]

    database = migrated(database, tmp_path, "0016_current_documents")
    once = rows(database)["run"]
    assert [one["id"] for one, was in zip(once, before, strict=True) if one != was] == [1]
    with database.reading() as session:
        kept = runs.get(session, 1).set_to
    assert kept.plan == list_stored_values(find_experiment("sequence").make_plan({"segments": segments}))
    assert [one.name for one in kept.declared or ()] == ["b"]
    assert found_by(database, "b") == {1: 0.5, 2: 0.5, 4: 0.5}
    database = migrated(database, tmp_path, "0016_current_documents")
    with closing(database):
        assert rows(database)["run"] == once
