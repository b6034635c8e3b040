"""An experiment built from a run: pushes, obstacles and tuning with the times and values of its events."""

import asyncio
import re
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.banks.tuning_settings import compute_default_tuning
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import PART_MIN_TICKS, TOLERANCE_Q_RAD, TOLERANCE_S, build_experiment_definition
from backend.experiments.parser import parse_experiment
from backend.experiments.plans import LoopSettings
from backend.realtime.modes import Mode
from backend.recording.reader import read_samples
from backend.schemas.experiment import RecordedExperiment
from backend.schemas.run import RunMark
from backend.schemas.state import PushRequest, TouchOrder, WallOrder, WallView
from backend.schemas.tuning import TuningRequest
from backend.services.actuator import set_obstacle
from backend.services.library import OwnExperiments
from backend.services.lineage import load_marks
from backend.storage import runs
from backend.storage.database import Database, open_database
from plant import Angle
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped
from tests.api.test_pushes_and_walls import in_run

WHO = OPERATOR.name
LATE_S = 0.02
"""Delay of a part after its event: a command is logged one tick before its effect, a part has at least ten ticks."""


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def made(
    database: Database, work: Callable[[Parts], Coroutine[Any, Any, None]]
) -> tuple[int, RecordedExperiment, list[RunMark]]:
    """Run ``work`` in a session; return its run, the experiment built from it, and its events."""

    async def session(parts: Parts) -> None:
        await in_run(parts)
        await parts.supervisor.advance(0.5)
        await work(parts)
        await parts.actuator.set_mode(Mode.PRETENSION, WHO)
        await parts.supervisor.advance(0.2)

    stepped(database, load_parameters("ideal"), session)
    with database.reading() as reading:
        run = max(one.id for one in runs.find(reading))
        marks = load_marks(reading, run).marks
    return run, OwnExperiments(database).build_from_run(run), marks


def timed(experiment: RecordedExperiment) -> list[tuple[float, dict[str, Any]]]:
    """Return each part with the time at which it begins."""
    at_s, found = 0.0, []
    for part in experiment.document["phases"][0]["parts"]:
        found.append((at_s, part))
        at_s += part.get("duration_s", 0.0)
    return found


async def busy(parts: Parts) -> None:
    actuator, advance = parts.actuator, parts.supervisor.advance
    await actuator.set_references(0.2, 10.0, WHO)
    await advance(1.0)
    await actuator.push(PushRequest(F_push=6.3, duration_s=0.8), WHO)
    await advance(1.5)
    await actuator.tuning_service.apply(TuningRequest(lam_q=0.9, lam_S=0.7), WHO)
    await advance(0.5)
    await set_obstacle(actuator, WallOrder(wall=WallView(q_wall=0.4, k_wall=5000.0, c_wall=0.5)), WHO)
    await advance(0.5)
    await actuator.push(PushRequest(F_push=-4.0, duration_s=0.3), WHO)
    await advance(0.6)
    await actuator.tuning_service.apply(TuningRequest(b=0.5), WHO)
    await advance(0.4)
    await set_obstacle(actuator, WallOrder(wall=None), WHO)
    await advance(0.5)


def test_pushes_obstacles_and_tuning_are_taken_from_the_events_of_the_run(database: Database) -> None:
    run, experiment, marks = made(database, busy)
    parts = timed(experiment)
    pushes = [
        (mark.t, float(force), float(time_s))
        for mark in marks
        if (match := re.fullmatch(r"push of (\S+) N for (\S+) s", mark.text))
        for force, time_s in [match.groups()]
    ]
    assert len(pushes) == 2
    repeated = [(at_s, part["F_push"], part["duration_s"]) for at_s, part in parts if part["do"] == "push"]
    assert np.allclose(repeated, pushes, atol=LATE_S)
    assert [force for _, force, _ in repeated] == [6.3, -4.0]

    noted = [mark.t for mark in marks if mark.kind == "tuning"]
    first, *changes = [(at_s, part) for at_s, part in parts if part["do"] == "tuning"]
    with database.reading() as session:
        began_with = runs.get(session, run).set_to.loop
    assert first[0] == 0.0
    assert (first[1]["lam_q"], first[1]["lam_S"], first[1]["lam_motor"], first[1]["b"], first[1]["motion"]) == (
        began_with.lam_q,
        began_with.lam_S,
        began_with.lam_motor,
        began_with.b,
        began_with.motion,
    )
    assert [part for _, part in changes] == [
        {"do": "tuning", "lam_q": 0.9, "lam_S": 0.7},
        {"do": "tuning", "b": 0.5},
    ]
    assert np.allclose([at_s for at_s, _ in changes], noted, atol=LATE_S)

    stood = [mark.t for mark in marks if "obstacle" in mark.text]
    walls = [(at_s, part) for at_s, part in parts if part["do"] in ("wall", "no_wall")]
    assert [part for _, part in walls] == [
        {"do": "wall", "q_wall": 0.4, "side": "above", "k_wall": 5000.0, "c_wall": 0.5},
        {"do": "no_wall"},
    ]
    assert np.allclose([at_s for at_s, _ in walls], stood, atol=LATE_S)
    assert experiment.left_out == []


def test_the_experiment_of_a_run_reproduces_its_recording(database: Database) -> None:
    run, experiment, _ = made(database, busy)
    plan = build_experiment_definition(*parse_experiment(experiment.text)).default_plan
    settings = LoopSettings(**compute_default_tuning(load_parameters("ideal")).tuning.to_document())
    with open_headless_rig(database, load_parameters("ideal"), settings) as station:
        again = asyncio.run(run_experiment(station, RunRequest(plan, settings, WHO))).run
    assert again.end_state == "completed"
    before, after = (from_first_push(database, number) for number in (run, again.id))
    length = min(len(before["q_ref"]), len(after["q_ref"])) - 50  # the end of either stops the joint
    assert length > 3000
    bounds = {"q_ref": TOLERANCE_Q_RAD, "S_ref": TOLERANCE_S, "F_push": 1e-6, "lam_q": 1e-6, "lam_S": 1e-6}
    for name, within in bounds.items():
        off = np.abs(before[name][:length] - after[name][:length]) > within
        assert np.count_nonzero(off) <= PART_MIN_TICKS, name  # at most one part later, by less than the shortest part
    # the obstacle presses equally: it is at the same angle
    assert after["F_wall"].min() == pytest.approx(before["F_wall"].min(), abs=0.5)


def from_first_push(database: Database, run: int) -> dict[str, np.ndarray[Any, Any]]:
    with database.reading() as session:
        columns = read_samples(session, run, ("q_ref", "S_ref", "F_push", "lam_q", "lam_S", "F_wall")).columns
    first = int(np.argmax(columns["F_push"] != 0.0))
    return {name: column[first:] for name, column in columns.items()}


async def moved_while_pushed(parts: Parts) -> None:
    actuator, advance = parts.actuator, parts.supervisor.advance
    await actuator.push(PushRequest(F_push=5.0, duration_s=1.0), WHO)
    await advance(0.4)
    await actuator.set_references(0.1, 10.0, WHO)
    await advance(1.0)
    await actuator.set_references(0.5, 10.0, WHO)
    await advance(1.0)
    await set_obstacle(actuator, WallOrder(wall=WallView(q_wall=0.6)), WHO)
    await actuator.set_references(0.7, 10.0, WHO)
    await advance(0.5)
    actuator.release_push()
    await actuator.contact.apply(TouchOrder(forget=True), WHO)
    await advance(0.5)


def test_events_that_cannot_be_repeated_are_reported(database: Database) -> None:
    _, experiment, marks = made(database, moved_while_pushed)
    moved = next(mark.t for mark in marks if mark.text.startswith(f"q_ref {Angle(0.1)}"))
    line_text = next(text for text in experiment.left_out if text.startswith("push of 5 N"))
    begins, ends = (float(number) for number in re.findall(r"(\S+) s\b", line_text))
    assert begins == pytest.approx(moved, abs=LATE_S)
    assert ends - begins == pytest.approx(PART_MIN_TICKS * T_s)
    notes = (mark.text for mark in marks if mark.kind == "note")
    (forgotten,) = (text for text in notes if "push" not in text and "obstacle" not in text)
    assert any(text.endswith(forgotten) for text in experiment.left_out)
    assert len(experiment.left_out) == 2
