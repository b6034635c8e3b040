"""Evaluate a stored run once more, from nothing but what is stored of it."""

from typing import Any

from backend.experiments.plans.catalogue import EXPERIMENTS, IDENTIFICATIONS
from backend.experiments.plans.plan import Plan
from backend.experiments.results.evaluation import Evaluation, evaluate
from backend.experiments.settings import from_values
from backend.storage import Database, runs
from backend.storage.runs import EndState, Run, RunKind
from plant.parameters import parameters_of

_PLANS: dict[str, type[Any]] = {entry.plan.kind: entry.plan for entry in EXPERIMENTS.values()} | {
    entry.plan.kind: entry.plan for entry in IDENTIFICATIONS.values()
}


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
    return evaluate(database, parameters_of(run.parameters_name, run.parameters), _plan_of(run), run)


def require_evaluable(run: Run) -> None:
    """Raise NotEvaluableError for a run that cannot have a result."""
    if run.kind == RunKind.SESSION:
        raise NotEvaluableError(f"run {run.id} was driven by hand: a session has samples and no result")
    if run.end_state == EndState.RUNNING:
        raise NotEvaluableError(f"run {run.id} is not over yet: it is evaluated when it is")


def _plan_of(run: Run) -> Plan:
    plan: Plan = from_values(_PLANS[run.kind], run.set_to.plan or {})
    return plan
