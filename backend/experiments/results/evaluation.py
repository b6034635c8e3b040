"""Compute the result of a stored run, and store it beside earlier ones: nothing is overwritten."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from backend import __version__
from backend.experiments.plans.composed_plan import ComposedPlan
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans.plan import ActuatorIdentificationPlan, IdentificationPlan, Plan
from backend.experiments.plans.sequence_plan import SequencePlan
from backend.experiments.results import actuator_identification, motor_identification, spring_identification
from backend.experiments.results.composed import composed_result
from backend.experiments.results.document import figure_documents, tracking_document
from backend.experiments.results.in_force import InForce, kept_tuning, points_in
from backend.experiments.results.metrics import NoSamplesError, tracking_metrics
from backend.identification.fitting import Method
from backend.models.run import Criterion, Metrics
from backend.recording.reader import Columns, recorded_columns
from backend.storage import banks, identifications, results, runs
from backend.storage.database import Database
from backend.storage.identifications import Identification, NewIdentification
from backend.storage.results import NewResult, Result
from backend.storage.runs import EndState, Run
from backend.tuning.gains import PointModel
from backend.tuning.preview import least_reach_time
from plant.interface import T_s
from plant.parameters import PlantParameters


@dataclass(frozen=True)
class Evaluation:
    """What a run gave; ``problem`` says why there is no result or no model."""

    result: Result | None
    identification: Identification | None
    problem: str


def evaluate(database: Database, parameters: PlantParameters, plan: Plan, run: Run) -> Evaluation:
    """Compute what the plan's kind of run gives, and store it; where that is nothing, the run says why."""
    columns, missed = recorded_columns(database, run.id)
    try:
        new, estimate = computed(columns, missed, parameters, plan, run, _points(database, run))
    except NoSamplesError as error:
        with database.session() as session:
            runs.set_evaluation_problem(session, run.id, str(error))
        return Evaluation(None, None, str(error))
    with database.session() as session:
        result = results.add(session, new)
        stored = None if estimate is None else identifications.add(session, estimate)
        runs.set_evaluation_problem(session, run.id, "")
    return Evaluation(result, stored, new.metrics.problem)


def computed(
    columns: Columns,
    missed: int,
    parameters: PlantParameters,
    plan: Plan,
    run: Run,
    points: Sequence[PointModel] = (),
) -> tuple[NewResult, NewIdentification | None]:
    """Compute what the plan's kind of run gives, from its samples, of which ``missed`` are lacking; nothing is stored.

    ``points`` are the models of the bank that the run began with.

    Raises NoSamplesError where there is nothing to compute from.
    """
    estimate: NewIdentification | None = None
    criteria: tuple[Criterion, ...] = ()
    problem = ""
    match plan:
        case ActuatorIdentificationPlan() | MotorIdentificationPlan() | SpringIdentificationPlan():
            metrics, estimate, problem = _identified(columns, parameters, plan, run)
        case ComposedPlan():
            outline = _outline(columns, plan, run)
            if columns["t"].size == 0:
                raise NoSamplesError("the run holds no samples of its program")
            in_force = InForce(parameters, plan, kept_tuning(run.set_to.loop), points)
            metrics, criteria = composed_result(columns, in_force, outline, missed)
        case SequencePlan():
            metrics = _followed(columns, parameters, plan)
    metrics = replace(metrics, missing_samples=missed, problem=problem)
    return NewResult(run.id, metrics, criteria, __version__), estimate


def _followed(columns: Columns, parameters: PlantParameters, plan: SequencePlan) -> Metrics:
    bound = partial(least_reach_time, parameters)
    metrics = tracking_metrics(columns, plan.program(), plan.phases(), bound, parameters.sensors.joint_step)
    return tracking_document(metrics, plan.phases())


def _points(database: Database, run: Run) -> tuple[PointModel, ...]:
    if run.bank_id is None:
        return ()
    with database.reading() as session:
        return points_in(banks.get(session, run.bank_id))


def _identified(
    columns: Columns, parameters: PlantParameters, plan: IdentificationPlan, run: Run
) -> tuple[Metrics, NewIdentification | None, str]:
    """Estimate a model from a whole run; one that ended early gives none, for half a record would mislead."""
    outline = _outline(columns, plan, run)
    if not outline.complete:
        return outline, None, f"no model was estimated: the run ended early ({run.end_state})"
    try:
        figures, estimate = _estimated(columns, parameters, plan, run)
    except ValueError as error:
        return outline, None, f"no model was estimated: {error}"
    return replace(outline, figures=figure_documents(figures)), estimate, ""


def _estimated(
    columns: Columns, parameters: PlantParameters, plan: IdentificationPlan, run: Run
) -> tuple[object, NewIdentification]:
    match plan:
        case MotorIdentificationPlan():
            motors = motor_identification.identify(columns, parameters)
            figures = motor_identification.figures_of(columns, motors)
            return figures, motor_identification.to_store(run, plan, motors, parameters, __version__)
        case SpringIdentificationPlan():
            springs = spring_identification.identify(columns, plan, parameters)
            stretched = spring_identification.figures_of(columns, plan, springs)
            return stretched, spring_identification.to_store(run, plan, springs, parameters, __version__)
        case ActuatorIdentificationPlan():
            excitation = plan.excitation()
            method = Method(plan.estimator)
            estimate = actuator_identification.identify(columns, excitation, parameters, method)
            moved = actuator_identification.figures_of(columns, excitation, estimate)
            return moved, actuator_identification.to_store(run, plan, columns, estimate, __version__)


def _outline(columns: Columns, plan: Plan, run: Run) -> Metrics:
    return Metrics(
        complete=run.end_state == EndState.COMPLETED,
        played_s=columns["t"].size * T_s,
        planned_s=plan.program().duration_s,
        phases=plan.phases(),
    )
