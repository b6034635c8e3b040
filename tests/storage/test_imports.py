"""Runs and identifications exported as bundles and imported into an empty database."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import READY_NAMES, build_ready_plan, find_experiment, list_settings
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    IdentificationPlan,
    LoopSettings,
    MotorIdentificationPlan,
    Plan,
    SpringIdentificationPlan,
)
from backend.exports.importer import import_bundle
from backend.identification.fitting import Method
from backend.recording.codec import compute_recording_digest
from backend.recording.reader import read_samples
from backend.sample import STORED_NAMES
from backend.services.downloads import import_run_file, stream_bundle
from backend.storage import commissioning, identifications, origins, recordings, results, runs
from backend.storage.commissioning import NewStepResult
from backend.storage.database import Database, open_database
from backend.storage.identifications import Identification
from backend.storage.imports import RESULT, RUN, build_record_document
from backend.storage.runs import RunKind
from plant.parameters import load_parameters
from tests.exports.stored import NEW, noise, recorded

# Each kind of identification is played, bundled, and taken into an empty SQLite and PostgreSQL database.

PLANS: dict[str, IdentificationPlan] = {
    "motor": MotorIdentificationPlan(levels=2),
    "spring": SpringIdentificationPlan(sweep_s=5.0, cycles=1),
    "actuator": ActuatorIdentificationPlan(bits=6),
    "actuator by ARX": ActuatorIdentificationPlan(bits=6, estimator=Method.ARX),
}
SETTINGS = LoopSettings(seed=2)


@pytest.fixture(scope="module", params=PLANS)
def played(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Identification]:
    """A bundle of a run with an identification, and its result."""
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


def test_an_imported_identification_is_unchanged(
    played: tuple[Path, Identification], database: Database, tmp_path: Path
) -> None:
    bundle, found = played
    taken = import_bundle(database, bundle, "Ben", tmp_path)
    assert taken.new
    with database.reading() as session:
        there = identifications.of_run(session, taken.run)
    parts = ("kind", "method", "options", "data", "model", "quality", "usable", "verdict", "created_at")
    assert {part: getattr(there, part) for part in parts} == {part: getattr(found, part) for part in parts}


# Each kind of run is played, bundled and taken into an empty SQLite and PostgreSQL database, and is the same there.
#
# Identifications have a test of their own (above).

MANUAL, BROUGHT_UP = "manual recording", "bring-up"
FURTHER: dict[str, dict[str, float]] = {
    "disturbance_battery": {"impulse_s": 0.01},
    "frequency_response": {"period_s": 4.0, "lines": 3},
    "impact": {"speeds": 2},
}
"""Settings beyond those that shorten any experiment."""

SEED = 7
CALIBRATIONS = {
    "tare": [{"tendon": "A", "offset": 0.1}, {"tendon": "B", "offset": -0.2}],
    "zero": [{"encoder": "q", "offset": 12}],
}


@dataclass(frozen=True)
class Moved:
    """A run in its original database, and its bundle."""

    database: Database
    run: int
    file: Path


def shortest(name: str) -> Plan:
    """Return an experiment with its shortest times and fewest repetitions."""
    if name == "sequence":
        return find_experiment("sequence").default_plan
    small: dict[str, float] = {
        setting.name: setting.minimum
        for setting in list_settings(build_ready_plan(name))
        if setting.minimum is not None
        and ((setting.unit == "s" and not setting.name.startswith("lam_")) or setting.kind == "integer")
    }
    return build_ready_plan(name, **{**small, **FURTHER.get(name, {})})


def play(database: Database, name: str) -> int:
    settings = LoopSettings(seed=SEED, lam_q=0.6, lam_S=0.55)
    with open_headless_rig(database, load_parameters("lab"), settings) as station:
        outcome = asyncio.run(run_experiment(station, RunRequest(shortest(name), settings, "A. Operator")))
    assert outcome.run.end_state == "completed"
    assert outcome.evaluation.problem == ""
    return outcome.run.id


def record(database: Database, name: str) -> int:
    with database.session() as session:
        if name == BROUGHT_UP:
            for step, calibrations in CALIBRATIONS.items():
                commissioning.add(
                    session, NewStepResult(step, "card", "f" * 64, True, "", "Ana", calibrations=calibrations)
                )
        settings = {"mode": "run", "loop": {"lam_q": 0.6, "lam_S": 0.55, "lam_motor": 0.08, "seed": SEED}}
        plant = "rig" if name == BROUGHT_UP else "simulator"
        new = replace(NEW, kind=RunKind.SESSION, plant=plant, settings=settings, note="by hand\nin two lines, 漢字")
        return recorded(session, new, noise(3_300, seed=SEED), cuts=(700, 1_900))


@pytest.fixture(scope="module", params=[*READY_NAMES, "sequence", MANUAL, BROUGHT_UP])
def moved(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Moved]:
    folder = tmp_path_factory.mktemp("made")
    database = open_database(folder)
    name = str(request.param)
    run = record(database, name) if name in (MANUAL, BROUGHT_UP) else play(database, name)
    file = folder / "run.zip"
    file.write_bytes(b"".join(stream_bundle(database, run, folder)))
    yield Moved(database, run, file)
    database.close()


def test_an_imported_run_is_unchanged(moved: Moved, database: Database, tmp_path: Path) -> None:
    taken = import_run_file(database, moved.file, "Ben", tmp_path)
    assert (taken.was, taken.new) == (moved.run, True)
    with moved.database.reading() as here, database.reading() as there:
        assert build_record_document(there, RUN, taken.run) == build_record_document(here, RUN, moved.run)
        made, brought = runs.get(here, moved.run), runs.get(there, taken.run)
        assert brought.set_to == made.set_to
        assert brought.parameters == made.parameters
        theirs = read_samples(here, moved.run, STORED_NAMES)
        ours = read_samples(there, taken.run, STORED_NAMES)
        assert theirs.t.size > 1_000
        np.testing.assert_array_equal(ours.t, theirs.t)
        for name in STORED_NAMES:
            np.testing.assert_array_equal(ours.columns[name], theirs.columns[name], name)
        assert compute_recording_digest(there, taken.run) == compute_recording_digest(here, moved.run)
        before, after = recordings.get(here, moved.run), recordings.get(there, taken.run)
        assert (after.missed, after.problem, after.period_s) == (before.missed, before.problem, before.period_s)
        was, now = results.newest(here, moved.run), results.newest(there, taken.run)
        assert (was is None) == (now is None) == (made.kind == RunKind.SESSION)
        if was is not None and now is not None:
            assert (now.metrics, now.criteria) == (was.metrics, was.criteria)
            assert now.metrics.figures
            old, new = results.numbers(here, moved.run), results.numbers(there, taken.run)
            without = {"run_id": 0}
            assert [build_record_document(there, RESULT, number) | without for number in new] == [
                build_record_document(here, RESULT, number) | without for number in old
            ]
            report = results.newest_report(there, taken.run, "html")
            assert report is not None
        carried = origins.of_runs(there, [taken.run])[taken.run].carried
        steps = {one["step"]: one["calibrations"] for one in carried.get(origins.CALIBRATIONS, [])}
        assert steps == (CALIBRATIONS if made.plant == "rig" else {})
    assert import_run_file(database, moved.file, "Ben", tmp_path) == replace(taken, new=False)
    again = tmp_path / "again.zip"
    again.write_bytes(b"".join(stream_bundle(database, taken.run, tmp_path)))
    other = open_database(tmp_path / "other")
    assert import_run_file(other, again, "Cy", tmp_path / "other").new
    with other.reading() as session, moved.database.reading() as here:
        assert compute_recording_digest(session, 1) == compute_recording_digest(here, moved.run)
    other.close()
