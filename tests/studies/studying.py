"""Fixtures of the tests of studies: a short study, and computations that return at once or die."""

import os
import signal
import time
from pathlib import Path
from typing import Any

from backend.banks.tuning_settings import TuningSettings
from backend.services.studies import Studies
from backend.storage import studies
from backend.storage.database import Database
from backend.storage.studies import StudyPoint
from backend.studies.point import Point, StudyBase
from plant.parameters import load_parameters

SHORT = """
format: 1
name: short
title: Short
settings: {q_duration_s: 0.5, S_duration_s: 0.5, S_high: 12.0}
axes:
  - {over: lam_q, values: [0.5, 0.8]}
  - {over: sensors.force_noise, values: [0.0, 0.2]}
spread:
  - {of: motor.c0, by: normal, relative: 0.1}
draws: 2
seeds: 2
seed: 7
"""
"""16 runs; tracking for 6.5 s each."""


def begun(database: Database, text: str = SHORT) -> int:
    """Store a study on the lab's plant; return its number."""
    return Studies(database).create(text, "Ana", load_parameters("lab"), TuningSettings().to_document()).id


def table(database: Database, study: int) -> list[StudyPoint]:
    with database.reading() as session:
        return studies.points(session, study)


def quick(base: StudyBase, point: Point) -> StudyPoint:
    """Return a row without a simulation."""
    return _row(point)


def die_once(base: StudyBase, point: Point) -> StudyPoint:
    """Kill this process at point 5, the first time."""
    mark = _folder(base) / "died"
    if point.number == 5 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return _row(point)


def die_always(base: StudyBase, point: Point) -> StudyPoint:
    """Kill this process at point 5, each time."""
    if point.number == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return _row(point)


def patient(base: StudyBase, point: Point) -> StudyPoint:
    """From point 4 on, wait for the file ``go``; create a marker file for each computed point."""
    while point.number >= 4 and not (_folder(base) / "go").exists():
        time.sleep(0.01)
    (_folder(base) / f"{point.number}-{os.getpid()}").touch()
    return _row(point)


def _folder(base: StudyBase) -> Path:
    return Path(str(base.parameters["folder"]))


def _row(point: Point) -> StudyPoint:
    figures: dict[str, float | None] = {"overshoot_q_percent": float(point.number)}
    return StudyPoint(point.number, "completed", "", True, {**point.settings, **point.plant}, figures)


def in_folder(base: StudyBase, folder: Path) -> StudyBase:
    """Return a study base that passes the folder of the marker files to the computations."""
    document: dict[str, Any] = {**base.parameters, "folder": str(folder)}
    return StudyBase(**{**vars(base), "parameters": document})
