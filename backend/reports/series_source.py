"""Loads the runs of a series, limited in number and length."""

from collections.abc import Sequence
from contextlib import suppress

from backend.analysis import evaluate_pending_runs
from backend.errors import RequestRejectedError
from backend.reports.run_data import RunData, load_source
from backend.storage import Database, EndState, RunKind, UnknownRecordError, recordings, runs
from backend.units import AngleUnit
from plant import ErrorCode

MOST_RUNS = 100
MOST_SAMPLES = 3_000_000
"""Limit for all runs together, 50 minutes: their samples are in memory at the same time."""


def load_series(database: Database, numbers: Sequence[int], angles: AngleUnit) -> list[RunData]:
    """Load the data of each run; pending evaluations are done first.

    Raises RequestRejectedError or UnknownRecordError before samples are read.
    """
    chosen = list(dict.fromkeys(numbers))
    if not 2 <= len(chosen) <= MOST_RUNS:
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE,
            f"number of runs: {len(chosen)} is outside 2 to {MOST_RUNS}: choose another number of runs",
        )
    samples = 0
    with database.reading() as session:
        for number in chosen:
            run = runs.get(session, number)
            with suppress(UnknownRecordError):  # a run that ended before its first sample has no recording
                samples += recordings.extent(session, number).count
            if run.kind == RunKind.SESSION:
                raise RequestRejectedError(
                    ErrorCode.BAD_VALUE, f"run {number} is a session without computed results: leave it out"
                )
            if run.end_state == EndState.RUNNING:
                raise RequestRejectedError(
                    ErrorCode.BAD_VALUE, f"run {number} has not ended yet: leave it out, or wait for its end"
                )
    if samples > MOST_SAMPLES:
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE, f"samples of all runs: {samples} is above {MOST_SAMPLES}: choose fewer runs"
        )
    evaluate_pending_runs(database, chosen)
    return [load_source(database, number, angles) for number in chosen]
