"""Evaluate a stored run once more, from nothing but what is stored of it."""

from backend.experiments.plans.stored_plan import stored_plan
from backend.experiments.results.evaluation import Evaluation, evaluate
from backend.storage import Database, runs
from backend.storage.runs import EndState, Run, RunKind
from plant.parameters import parameters_of


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


def require_evaluable(run: Run) -> None:
    """Raise NotEvaluableError for a run that cannot have a result."""
    if run.kind == RunKind.SESSION:
        raise NotEvaluableError(f"run {run.id} was driven by hand: a session has samples and no result")
    if run.end_state == EndState.RUNNING:
        raise NotEvaluableError(f"run {run.id} is not over yet: it is evaluated when it is")
