"""Evaluate a stored run once more, from nothing but what is stored of it."""

import logging
from collections.abc import Sequence

from backend.experiments.plans.stored_plan import stored_plan
from backend.experiments.results.evaluation import Evaluation, evaluate
from backend.storage import results, runs
from backend.storage.database import Database
from backend.storage.runs import EndState, Run, RunKind
from plant.parameters import parameters_of

_LOG = logging.getLogger(__name__)


class NotEvaluableError(ValueError):
    """A run that gives no result: it goes on, or it is of a kind that is not evaluated."""


def evaluate_again(database: Database, run_id: int) -> Evaluation:
    """Compute the result as at the run's end, with its own settings and parameters, and store it beside earlier ones.

    Raises UnknownRecordError, NotEvaluableError; SettingError or OutOfRangeError for settings that have no meaning any
    more, and ParameterError for such parameters.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
    require_evaluable(run)
    plan = stored_plan(run.kind, run.set_to.plan or {})
    return evaluate(database, parameters_of(run.parameters_name, run.parameters), plan, run)


def left_behind(database: Database, run_ids: Sequence[int]) -> list[int]:
    """Return which of these runs ended with what played them, before their result could be computed.

    Raises UnknownRecordError.
    """
    with database.reading() as session:
        due = [run.id for run in (runs.get(session, number) for number in run_ids) if _is_due(run)]
        evaluated = results.present(session, due)
        return [number for number in due if number not in evaluated]


def catch_up(database: Database, run_ids: Sequence[int]) -> None:
    """Evaluate those of these runs that were left behind; why one has no result is kept with it.

    Raises UnknownRecordError.
    """
    for run_id in left_behind(database, run_ids):
        try:
            evaluate_again(database, run_id)
        except Exception as error:
            _LOG.info("run %d has no result: %s", run_id, error)
            with database.session() as session:
                runs.set_evaluation_problem(session, run_id, f"{type(error).__name__}: {error}")


def _is_due(run: Run) -> bool:
    return run.kind != RunKind.SESSION and run.end_state == EndState.SERVICE_DIED and run.evaluation_problem == ""


def require_evaluable(run: Run) -> None:
    """Raise NotEvaluableError for a run that cannot have a result."""
    if run.kind == RunKind.SESSION:
        raise NotEvaluableError(f"run {run.id} was driven by hand: a session has samples and no result")
    if run.end_state == EndState.RUNNING:
        raise NotEvaluableError(f"run {run.id} is not over yet: it is evaluated when it is")
