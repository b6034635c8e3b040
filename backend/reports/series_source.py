"""Loads the runs of a series, limited in number and length."""

from collections.abc import Sequence
from contextlib import suppress

from backend.analysis import evaluate_pending_runs
from backend.errors import RequestRejectedError
from backend.reports import messages
from backend.reports.run_data import RunData, load_source
from backend.storage import Database, EndState, RunKind, UnknownRecordError, recordings, runs
from backend.units import AngleUnit
from plant import ErrorCode

LEAST_RUNS = 2
MOST_RUNS = 100
MOST_SAMPLES = 3_000_000
"""Limit for all runs together, 50 minutes: their samples are in memory at the same time."""


def load_series(database: Database, numbers: Sequence[int], angles: AngleUnit) -> list[RunData]:
    """Load the data of each run; pending evaluations are done first.

    Raises RequestRejectedError or UnknownRecordError before samples are read.
    """
    chosen = list(dict.fromkeys(numbers))
    if not LEAST_RUNS <= len(chosen) <= MOST_RUNS:
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE,
            messages.wrong_number_of_runs(runs=len(chosen), minimum=LEAST_RUNS, maximum=MOST_RUNS),
        )
    samples = 0
    with database.reading() as session:
        for number in chosen:
            run = runs.get(session, number)
            with suppress(UnknownRecordError):  # a run that ended before its first sample has no recording
                samples += recordings.extent(session, number).count
            if run.kind == RunKind.SESSION:
                raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.run_is_a_session(run_id=number))
            if run.end_state == EndState.RUNNING:
                raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.run_not_ended(run_id=number))
    if samples > MOST_SAMPLES:
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE, messages.too_many_samples(samples=samples, maximum=MOST_SAMPLES)
        )
    evaluate_pending_runs(database, chosen)
    return [load_source(database, number, angles) for number in chosen]
