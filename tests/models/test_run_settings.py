"""Settings of runs are read and written as they were; one that cannot be read is listed all the same."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.experiments.plans import LoopSettings
from backend.models.document import UnreadableDocumentError
from backend.models.run import SETTINGS, StoredLoopSettings
from backend.services.identifications import StoredIdentifications
from backend.services.runs import RunQuery, StoredRuns
from backend.services.tuning_state import default_tuning
from backend.storage import runs
from backend.storage.database import Database, open_database
from backend.workers import WorkerProcess
from plant.parameters import load_parameters
from tests.migrations.old_schema import migrated
from tests.models.earlier import BEFORE, put_run

LOOP = {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "b": 0.0, "bank": 0, "interpolate": False, "seed": 7}
PROGRAM: dict[str, Any] = {
    "plan": {"tension_N": 20.0, "bits": 7, "estimator": "default"},
    "loop": LOOP,
    "declared": [{"name": "b", "symbol": "b", "unit": "1", "meaning": "weight of the reference", "value": 0.0}],
    "versions": {"Python": "3.11.2"},
}
SESSION: dict[str, Any] = {"mode": "run", "loop": {name: LOOP[name] for name in LOOP if name != "seed"}}
EARLY_SESSION: dict[str, Any] = {"mode": "run", "lam_q": 0.5, "lam_S": 0.42, "interpolate": False, "bank": None}
TUNING = default_tuning(load_parameters("ideal"))[0]


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    put_run(opened, 1, "actuator_identification", PROGRAM)
    put_run(opened, 2, "session", EARLY_SESSION)
    with closing(migrated(opened, tmp_path, BEFORE)) as found:
        yield found


def test_a_kept_loop_has_every_part_of_a_tuning_and_the_seed() -> None:
    assert [part.name for part in fields(StoredLoopSettings)] == [part.name for part in fields(LoopSettings)]
    kept = StoredLoopSettings(**asdict(LoopSettings(lam_q=0.6, bank=3, seed=4)))
    assert TuningSettings.from_values(kept.get_known_values()) == TuningSettings(lam_q=0.6, bank=3)
    assert kept.get_known_values()["seed"] == 4


@pytest.mark.parametrize("document", [PROGRAM, SESSION])
def test_what_is_read_is_written_as_it_was_with_a_version(document: dict[str, Any]) -> None:
    written = SETTINGS.write(SETTINGS.read(document, "run 7"))
    assert written == {**document, "version": 1}
    assert list(written)[:-1] == list(document)
    assert type(written.get("plan", {}).get("bits", 7)) is int


def test_an_early_session_had_its_tuning_beside_the_mode(database: Database) -> None:
    with database.reading() as session:
        told = runs.get(session, 2).set_to
    assert (told.mode, told.plan, told.declared) == ("run", None, None)
    assert told.loop == StoredLoopSettings(lam_q=0.5, lam_S=0.42, interpolate=False)
    assert told.get_values() == {"lam_q": 0.5, "lam_S": 0.42, "interpolate": False}


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({**PROGRAM, "version": 2}, "run 3: what it was set to is of version 2"),
        ({**PROGRAM, "loop": {**LOOP, "b": "half"}}, "run 3: what it was set to cannot be read, field loop.b"),
        ([], "run 3: what it was set to cannot be read"),
    ],
)
def test_what_cannot_be_read_is_told_by_run_and_field_and_the_lists_open(
    database: Database, settings: Any, said: str
) -> None:
    put_run(database, 3, "actuator_identification", settings)
    with database.reading() as session, pytest.raises(UnreadableDocumentError, match=said):
        assert runs.get(session, 3).set_to
    stored = StoredRuns(database, lambda: None, lambda _run: False)
    listed = stored.find_runs(RunQuery(limit=10)).runs
    assert [(run.id, len(run.settings)) for run in listed] == [
        (3, 0),
        (2, 3),
        (1, 0),
    ]  # an identification uses λ_motor alone
    assert said in listed[0].evaluation_problem
    found = StoredIdentifications(
        database, lambda _run: 1.0, WorkerProcess(print), lambda: TUNING
    ).list_identifications()
    assert [(one.id, one.tension_N) for one in found] == [(3, None), (1, 20.0)]
    assert said in found[0].message


def test_a_number_of_the_plant_that_is_not_there_is_named(database: Database) -> None:
    with database.reading() as session:
        run = runs.get(session, 1)
    assert run.number("geometry", "r_j") == 0.075
    with pytest.raises(UnreadableDocumentError, match=r"run 1: its parameters have no number safety\.F_least"):
        run.number("safety", "F_least")
