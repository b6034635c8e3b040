"""Each kind of identification is played, bundled, and taken into an empty SQLite and PostgreSQL database."""

import asyncio
from pathlib import Path

import pytest

from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    IdentificationPlan,
    LoopSettings,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
)
from backend.exports.importer import import_bundle
from backend.identification.fitting import Method
from backend.services.downloads import stream_bundle
from backend.storage import identifications
from backend.storage.database import Database, open_database
from backend.storage.identifications import Identification
from plant.parameters import load_parameters

PLANS: dict[str, IdentificationPlan] = {
    "motor": MotorIdentificationPlan(levels=2),
    "spring": SpringIdentificationPlan(sweep_s=5.0, cycles=1),
    "actuator": ActuatorIdentificationPlan(bits=6),
    "actuator by ARX": ActuatorIdentificationPlan(bits=6, estimator=Method.ARX),
}
SETTINGS = LoopSettings(seed=2)


@pytest.fixture(scope="module", params=PLANS)
def played(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Identification]:
    """A bundle of a run that identified something, and what was found."""
    folder = tmp_path_factory.mktemp("played")
    database = open_database(folder)
    with open_headless_rig(database, load_parameters("lab"), SETTINGS) as station:
        outcome = asyncio.run(run_experiment(station, RunRequest(PLANS[request.param], SETTINGS, "A. Operator")))
    assert outcome.evaluation.problem == ""
    bundle = folder / "run.zip"
    bundle.write_bytes(b"".join(stream_bundle(database, outcome.run.id, folder)))
    with database.reading() as session:
        found = identifications.of_run(session, outcome.run.id)
    database.close()
    return bundle, found


def test_an_identification_is_the_same_where_it_is_taken_in(
    played: tuple[Path, Identification], database: Database, tmp_path: Path
) -> None:
    bundle, found = played
    taken = import_bundle(database, bundle, "Ben", tmp_path)
    assert taken.new
    with database.reading() as session:
        there = identifications.of_run(session, taken.run)
    parts = ("kind", "method", "options", "data", "model", "quality", "usable", "verdict", "created_at")
    assert {part: getattr(there, part) for part in parts} == {part: getattr(found, part) for part in parts}
