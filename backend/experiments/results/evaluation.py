"""Compute the result of a stored run, and store it beside earlier ones: nothing is overwritten."""

from dataclasses import dataclass, replace
from functools import partial

from backend import __version__
from backend.documents.result import Criterion, Metrics
from backend.experiments.plans.compliance_plan import CompliancePlan
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans.plan import ActuatorIdentificationPlan, IdentificationPlan, Plan, TrackingPlan
from backend.experiments.plans.robustness_plan import RobustnessPlan
from backend.experiments.plans.sequence_plan import SequencePlan
from backend.experiments.results import actuator_identification, motor_identification, spring_identification
from backend.experiments.results.compliance import compliance_criteria, compliance_figures
from backend.experiments.results.criteria import bounds_for, ended_early, tracking_criteria, unseen
from backend.experiments.results.document import figure_documents, tracking_document
from backend.experiments.results.metrics import NoSamplesError, tracking_metrics
from backend.experiments.results.robustness import robustness_criteria, robustness_figures
from backend.identification.fit import Method
from backend.recording.columns import Columns, recorded_columns
from backend.storage import Database, identifications, results, runs
from backend.storage.identifications import Identification, NewIdentification
from backend.storage.results import NewResult, Result
from backend.storage.runs import EndState, Run
from backend.tuning.models import LAM_MOTOR
from backend.tuning.speed_bound import least_reach_time
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
    estimate: NewIdentification | None = None
    criteria: tuple[Criterion, ...] = ()
    problem = ""
    try:
        match plan:
            case ActuatorIdentificationPlan() | MotorIdentificationPlan() | SpringIdentificationPlan():
                metrics, estimate, problem = _identified(columns, parameters, plan, run)
            case CompliancePlan():
                metrics, criteria = _complied(columns, parameters, plan, run, missed)
            case RobustnessPlan():
                metrics, criteria = _loaded(columns, parameters, plan, run, missed)
            case TrackingPlan() | SequencePlan():
                metrics, criteria = _tracked(columns, parameters, plan, run, missed)
    except NoSamplesError as error:
        with database.session() as session:
            runs.set_evaluation_problem(session, run.id, str(error))
        return Evaluation(None, None, str(error))
    metrics = replace(metrics, missing_samples=missed, problem=problem)
    with database.session() as session:
        result = results.add(session, NewResult(run.id, metrics, criteria, __version__))
        stored = None if estimate is None else identifications.add(session, estimate)
        runs.set_evaluation_problem(session, run.id, "")
    return Evaluation(result, stored, problem)


def _tracked(
    columns: Columns, parameters: PlantParameters, plan: TrackingPlan | SequencePlan, run: Run, missed: int
) -> tuple[Metrics, tuple[Criterion, ...]]:
    bound = partial(least_reach_time, parameters)
    metrics = tracking_metrics(columns, plan.program(), plan.phases(), bound, parameters.sensors.joint_step)
    criteria: tuple[Criterion, ...] = ()
    if isinstance(plan, TrackingPlan):
        criteria = tracking_criteria(metrics, bounds_for(run.parameters_name), missed)
    return tracking_document(metrics, plan.phases()), criteria


def _complied(
    columns: Columns, parameters: PlantParameters, plan: CompliancePlan, run: Run, missed: int
) -> tuple[Metrics, tuple[Criterion, ...]]:
    outline = _outline(columns, plan, run)
    figures = compliance_figures(columns, parameters.geometry.r_j)
    early = "" if outline.complete else ended_early(outline.played_s, outline.planned_s)
    criteria = compliance_criteria(figures, unseen(missed, early))
    return replace(outline, figures=figure_documents(figures, figures.reasons)), criteria


def _loaded(
    columns: Columns, parameters: PlantParameters, plan: RobustnessPlan, run: Run, missed: int
) -> tuple[Metrics, tuple[Criterion, ...]]:
    outline = _outline(columns, plan, run)
    figures = robustness_figures(columns, plan.phases(), parameters.sensors.motor_step)
    early = "" if outline.complete else ended_early(outline.played_s, outline.planned_s)
    criteria = robustness_criteria(figures, _lam_motor(run), parameters.motor.u_max, unseen(missed, early))
    return replace(outline, figures=figure_documents(figures, figures.reasons)), criteria


def _lam_motor(run: Run) -> float:
    return LAM_MOTOR if run.set_to.loop.lam_motor is None else run.set_to.loop.lam_motor


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
