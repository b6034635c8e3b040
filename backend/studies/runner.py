"""Compute what a study still lacks, row by row into the database; stopped, killed or done, it can be taken up again."""

import math
import os
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice

from backend.errors import RequestRejectedError
from backend.models import replace_non_finite
from backend.storage import Database, StorageError, StoredStudy, StudyPoint, studies
from backend.studies.crew import Crew, LocalCrew
from backend.studies.design import Design
from backend.studies.point import FAILED, LOST, UNSTABLE, StudyBase, require_version
from backend.studies.stored import parse_design
from plant import ErrorCode

BEAT_S = 1.0
"""How often whoever computes a study tells that it is alive, and looks whether to stop."""
SILENT_S = 15.0
"""One on another machine that was not heard of for so long [s] is taken for dead."""


@dataclass(frozen=True)
class Progress:
    """``done`` of ``points``; ``left_s`` is the time left [s], None before anything can be said of it."""

    done: int
    points: int
    left_s: float | None


StudyProgressCallback = Callable[[Progress], None]
MakeCrew = Callable[[StudyBase], Crew]


class TakenError(RequestRejectedError):
    """Somebody computes the study at this moment."""

    def __init__(self, study: StoredStudy) -> None:
        super().__init__(
            ErrorCode.NOT_NOW,
            f"study {study.id} is being computed by {study.runner}: stop it first, or wait for its end",
        )


def use_local_processes(jobs: int) -> MakeCrew:
    """Return what makes a crew of ``jobs`` processes of this machine."""
    return lambda base: LocalCrew(base, jobs)


def run_study(
    database: Database,
    study_id: int,
    make_crew: MakeCrew,
    notify: StudyProgressCallback = lambda _progress: None,
    *,
    again: bool = False,
) -> bool:
    """Compute all rows that are not there yet; return whether all are there now, or somebody had it stopped.

    Each row is stored as it comes; with ``again`` those that failed or were lost are computed anew. Raises
    UnknownRecordError, OtherSoftwareError, TakenError, StorageError, CrewGoneError.
    """
    runner = f"{socket.gethostname()}:{os.getpid()}"
    with database.session() as session:
        study = studies.get(session, study_id)
        require_version(study.base["software"])
        if is_computed(study) and study.runner != runner:
            raise TakenError(study)
        if again:
            studies.forget(session, study_id, (FAILED, LOST))
        if not studies.claim(session, study_id, runner):
            return False
    problem = "it was interrupted"
    try:
        design = parse_design(study)
        crew = make_crew(design.base)
        try:
            whole = _Work(
                database=database, study_id=study_id, runner=runner, design=design, crew=crew, notify=notify
            ).through()
        finally:
            crew.close()
        problem = ""
        return whole
    except Exception as error:
        problem = str(error) or type(error).__name__
        raise
    finally:
        with suppress(StorageError), database.session() as session:
            studies.let_go(session, study_id, runner, problem)


class _Work:
    def __init__(
        self, database: Database, study_id: int, runner: str, design: Design, crew: Crew, notify: StudyProgressCallback
    ) -> None:
        self._database, self._study_id, self._runner = database, study_id, runner
        self._design, self._crew, self._notify = design, crew, notify
        with database.reading() as session:
            self._there = studies.numbers(session, study_id)
        self._begun, self._begun_with = time.monotonic(), len(self._there)
        self._in_hands = 0

    def through(self) -> bool:
        missing = (self._design.point(number) for number in range(len(self._design)) if number not in self._there)
        may_go_on, beaten = True, time.monotonic()
        self._tell()
        while True:
            for point in islice(missing, max(0, self._crew.width - self._in_hands) if may_go_on else 0):
                self._crew.give(point)
                self._in_hands += 1
            if not self._in_hands:
                return len(self._there) == len(self._design)
            self._keep(self._crew.finished(BEAT_S))
            if time.monotonic() - beaten >= BEAT_S:
                beaten = time.monotonic()
                with self._database.session() as session:
                    may_go_on = studies.refresh_claim(session, self._study_id, self._runner)
                self._tell()

    def _keep(self, results: list[StudyPoint]) -> None:
        if not results:
            return
        with self._database.session() as session:
            studies.add_points(session, self._study_id, [as_stored(result) for result in results])
        self._in_hands -= len(results)
        self._there.update(result.number for result in results)

    def _tell(self) -> None:
        done, points = len(self._there), len(self._design)
        self._notify(
            Progress(done, points, estimate_remaining_s(done, self._begun_with, points, time.monotonic() - self._begun))
        )


def estimate_remaining_s(done: int, begun_with: int, points: int, lasted_s: float) -> float | None:
    """Return how long [s] a study takes on, as fast as it went so far; None where nothing came yet."""
    computed = done - begun_with
    return None if computed <= 0 else lasted_s / computed * (points - done)


def is_computed(study: StoredStudy) -> bool:
    """Return whether somebody computes a study at present, as far as can be seen from this machine."""
    if not study.runner or study.seen_at is None:
        return False
    host, _, number = study.runner.rpartition(":")
    if host == socket.gethostname() and not _is_alive(int(number)):
        return False
    return (datetime.now(UTC) - study.seen_at).total_seconds() < SILENT_S


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def as_stored(result: StudyPoint) -> StudyPoint:
    """Return a row as it is kept: M_s and margins of an unstable loop, for which JSON has no number, by their word."""
    figures = {
        name: UNSTABLE if isinstance(value, float) and math.isinf(value) else value
        for name, value in result.figures.items()
    }
    return replace(result, values=replace_non_finite(result.values), figures=replace_non_finite(figures))
