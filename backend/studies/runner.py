"""Computes the missing rows of a study and stores each at once, so that an interrupted study can be resumed."""

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
from backend.studies import messages
from backend.studies.design import Design
from backend.studies.executor import LocalExecutor, PointExecutor
from backend.studies.point import FAILED, LOST, UNSTABLE, StudyBase, require_version
from backend.studies.stored import parse_design
from plant import ErrorCode

CLAIM_REFRESH_S = 1.0
"""Interval [s] at which the computing process renews its claim on the study and checks for a request to stop."""
CLAIM_TIMEOUT_S = 15.0
"""Age [s] from which the claim of a process on another machine counts as abandoned."""


@dataclass(frozen=True)
class Progress:
    """Number of computed points, of all points, and the remaining time [s]; None before the first new point."""

    done: int
    points: int
    left_s: float | None


StudyProgressCallback = Callable[[Progress], None]
MakeExecutor = Callable[[StudyBase], PointExecutor]


class TakenError(RequestRejectedError):
    """Another process computes the study."""

    def __init__(self, study: StoredStudy) -> None:
        super().__init__(ErrorCode.NOT_NOW, messages.computed_elsewhere(study=study.id, runner=study.runner))


def use_local_processes(jobs: int) -> MakeExecutor:
    """Return a factory of executors with ``jobs`` processes of this machine."""
    return lambda base: LocalExecutor(base, jobs)


def run_study(
    database: Database,
    study_id: int,
    make_executor: MakeExecutor,
    notify: StudyProgressCallback = lambda _progress: None,
    *,
    again: bool = False,
) -> bool:
    """Compute all missing rows and return whether the study is complete; False if a person stopped it.

    Each row is stored as soon as it is computed; ``again`` recomputes rows that failed or were lost. Raises
    UnknownRecordError, OtherSoftwareError, TakenError, StorageError, ExecutorUnavailableError.
    """
    runner = f"{socket.gethostname()}:{os.getpid()}"
    with database.session() as session:
        study = studies.get(session, study_id)
        require_version(study.base["software"])
        if is_being_computed(study) and study.runner != runner:
            raise TakenError(study)
        if again:
            studies.forget(session, study_id, (FAILED, LOST))
        if not studies.claim(session, study_id, runner):
            return False
    problem: str = messages.interrupted()
    try:
        design = parse_design(study)
        executor = make_executor(design.base)
        try:
            is_complete = _StudyExecution(
                database=database, study_id=study_id, runner=runner, design=design, executor=executor, notify=notify
            ).run()
        finally:
            executor.close()
        problem = ""
        return is_complete
    except Exception as error:
        problem = str(error) or type(error).__name__
        raise
    finally:
        with suppress(StorageError), database.session() as session:
            studies.release(session, study_id, runner, problem)


class _StudyExecution:
    """Computes the missing points of one study that this process has claimed."""

    def __init__(
        self,
        database: Database,
        study_id: int,
        runner: str,
        design: Design,
        executor: PointExecutor,
        notify: StudyProgressCallback,
    ) -> None:
        self._database, self._study_id, self._runner = database, study_id, runner
        self._design, self._executor, self._notify = design, executor, notify
        with database.reading() as session:
            self._computed = studies.numbers(session, study_id)
        self._started_at, self._initial_count = time.monotonic(), len(self._computed)
        self._submitted_count = 0

    def run(self) -> bool:
        """Compute until no point is missing or the claim is withdrawn; return whether the study is complete."""
        missing = (self._design.point(number) for number in range(len(self._design)) if number not in self._computed)
        is_claimed, last_refresh = True, time.monotonic()
        self._notify_progress()
        while True:
            for point in islice(missing, max(0, self._executor.capacity - self._submitted_count) if is_claimed else 0):
                self._executor.submit(point)
                self._submitted_count += 1
            if not self._submitted_count:
                return len(self._computed) == len(self._design)
            self._store_results(self._executor.collect_results(CLAIM_REFRESH_S))
            if time.monotonic() - last_refresh >= CLAIM_REFRESH_S:
                last_refresh = time.monotonic()
                with self._database.session() as session:
                    is_claimed = studies.refresh_claim(session, self._study_id, self._runner)
                self._notify_progress()

    def _store_results(self, results: list[StudyPoint]) -> None:
        if not results:
            return
        with self._database.session() as session:
            studies.add_points(session, self._study_id, [to_stored_point(result) for result in results])
        self._submitted_count -= len(results)
        self._computed.update(result.number for result in results)

    def _notify_progress(self) -> None:
        done, points = len(self._computed), len(self._design)
        elapsed_s = time.monotonic() - self._started_at
        self._notify(Progress(done, points, estimate_remaining_s(done, self._initial_count, points, elapsed_s)))


def estimate_remaining_s(done: int, initial_count: int, points: int, elapsed_s: float) -> float | None:
    """Return the remaining time [s] at the mean rate so far; None before the first new point."""
    computed = done - initial_count
    return None if computed <= 0 else elapsed_s / computed * (points - done)


def is_being_computed(study: StoredStudy) -> bool:
    """Return whether a process computes the study, as far as this machine can determine."""
    if not study.runner or study.seen_at is None:
        return False
    host, _, number = study.runner.rpartition(":")
    if host == socket.gethostname() and not _is_alive(int(number)):
        return False
    return (datetime.now(UTC) - study.seen_at).total_seconds() < CLAIM_TIMEOUT_S


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def to_stored_point(result: StudyPoint) -> StudyPoint:
    """Return the row to store: infinite values of an unstable loop, which JSON lacks, become UNSTABLE."""
    figures = {
        name: UNSTABLE if isinstance(value, float) and math.isinf(value) else value
        for name, value in result.figures.items()
    }
    return replace(result, values=replace_non_finite(result.values), figures=replace_non_finite(figures))
