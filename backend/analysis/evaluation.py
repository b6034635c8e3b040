"""Evaluates runs: measures, criteria, and results with definitions."""

import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from typing import Any

from backend import __version__
from backend.analysis import messages
from backend.analysis.context import EvaluationContext, load_bank_points, load_initial_tuning
from backend.analysis.disturbance_metrics import (
    ComplianceColumns,
    ComplianceMetrics,
    DisturbanceMetrics,
    HoldMetrics,
    ImpactMetrics,
    PushMetrics,
    RobustnessMetrics,
    compute_compliance_metrics,
    compute_disturbance_metrics,
    compute_hold_metrics,
    compute_impact_metrics,
    compute_push_metrics,
    compute_robustness_metrics,
)
from backend.analysis.frequency_metrics import (
    BodeMetrics,
    ResponseMetrics,
    compute_bode_metrics,
    compute_response_metrics,
)
from backend.analysis.identification import (
    build_actuator_record,
    build_motor_record,
    build_spring_record,
    compute_actuator_metrics,
    compute_motor_metrics,
    compute_spring_metrics,
    identify_actuator,
    identify_motors,
    identify_springs,
)
from backend.analysis.step_metrics import (
    NoSamplesError,
    OverallMetrics,
    StepMetrics,
    TrackingMetrics,
    compute_tracking_metrics,
    evaluate_criterion,
    find_pushes,
    format_early_end,
    format_incomplete,
    list_load_steps,
)
from backend.banks import TUNING_NAMES, TUNING_SETTINGS
from backend.errors import Path
from backend.experiments import (
    PLANT_NAMES,
    ActuatorIdentificationPlan,
    Bound,
    Experiment,
    ExperimentError,
    ExperimentPlan,
    ExpressionError,
    IdentificationPlan,
    Lines,
    Measure,
    MotorIdentificationPlan,
    Plan,
    SpringIdentificationPlan,
    evaluate_number,
    find_line,
    parse_stored_plan,
    require_known,
)
from backend.identification import Method
from backend.models import (
    DeclaredValue,
    MeasuredFigure,
    Metrics,
    Phase,
    RunCriterion,
    StepFigures,
    UnreadableDocumentError,
    Value,
)
from backend.realtime import IDENTIFYING, Law
from backend.recording import Columns as ReaderColumns
from backend.recording import read_recorded_columns
from backend.storage import (
    Database,
    EndState,
    Identification,
    NewIdentification,
    NewResult,
    Result,
    Run,
    RunKind,
    banks,
    identifications,
    results,
    runs,
)
from backend.tuning import PointModel, TuningParameters, least_reach_time
from plant import ErrorCode, PlantParameters, SinewError, T_s, parse_parameters

# Document ------------------------------------------------------------------------------------------
# The stored result of a run. Each metric has its label, unit and definition, so that reports, page
# and command line show it without further knowledge.


def build_tracking_document(metrics: TrackingMetrics, phases: Sequence[Phase], missing_samples: int = 0) -> Metrics:
    """Return the document of tracking metrics: completeness, overall metrics, steps and phases."""
    return Metrics(
        complete=metrics.complete,
        played_s=metrics.played_s,
        planned_s=metrics.planned_s,
        figures=build_metric_documents(metrics.overall, metrics.reasons),
        steps=tuple(_build_step_figures(item) for item in metrics.steps),
        phases=tuple(phases),
        missing_samples=missing_samples,
    )


def build_metric_documents(figures: Any, reasons: Mapping[str, str] | None = None) -> tuple[MeasuredFigure, ...]:
    """Return the metrics of a dataclass whose fields are declared with ``declare_metric``.

    ``reasons`` states by name why a metric was not measured, or not for all steps.
    """
    why = reasons or {}
    return tuple(
        MeasuredFigure(
            name=item.name,
            **item.metadata,
            value=_to_finite(getattr(figures, item.name)),
            reason=why.get(item.name, ""),
        )
        for item in fields(figures)
        if item.metadata
    )


def _build_step_figures(metrics: StepMetrics) -> StepFigures:
    figures = asdict(metrics)
    return StepFigures(**figures.pop("step"), **figures)


def _to_finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value


# Measures ------------------------------------------------------------------------------------------
# The measures with their metrics, and the names that the bounds of criteria may contain.


METRICS_BY_MEASURE: dict[Measure, type[Any]] = {
    Measure.STEPS: OverallMetrics,
    Measure.COMPLIANCE: ComplianceMetrics,
    Measure.LOADS: RobustnessMetrics,
    Measure.RESPONSE: ResponseMetrics,
    Measure.DISTURBANCE: DisturbanceMetrics,
    Measure.BODE: BodeMetrics,
    Measure.PUSHES: PushMetrics,
    Measure.HOLDS: HoldMetrics,
    Measure.IMPACT: ImpactMetrics,
}


def list_metric_names(measures: tuple[Measure, ...]) -> tuple[str, ...]:
    """Return the names of all metrics of these measures."""
    listed = [item.name for measure in measures for item in fields(METRICS_BY_MEASURE[measure]) if item.metadata]
    return tuple(dict.fromkeys(listed))


def collect_bound_values(
    values: dict[str, Value], parameters: PlantParameters, lambdas: TuningParameters
) -> dict[str, bool | int | float | str]:
    """Return the values of all names that the bounds of criteria may contain."""
    return {
        **values,
        "u_max": parameters.motor.u_max,
        "F_max": parameters.safety.F_max,
        "r_j": parameters.geometry.r_j,
        "r_m": parameters.geometry.r_m,
        "lam_q": lambdas.lam_q,
        "lam_S": lambdas.lam_S,
        "lam_motor": lambdas.lam_motor,
        "ideal": parameters.name == "ideal",
    }


_PLANT_AND_TUNING_NAMES = (*PLANT_NAMES, "lam_q", "lam_S", "lam_motor")


def require_measurable(experiment: Experiment, values: Mapping[str, Value], lines: Lines) -> None:
    """Raise ExperimentError for a criterion without a metric, or with an invalid bound."""
    legal = list_metric_names(experiment.measures)
    known = {**values, **dict.fromkeys(_PLANT_AND_TUNING_NAMES, 1.0)}
    for index, bound in enumerate(experiment.criteria):
        path: Path = ("criteria", index)
        if bound.figure not in legal:
            given = ", ".join(experiment.measures)
            why = messages.metric_not_measured(metric=bound.figure, measures=given, known=", ".join(legal))
            raise ExperimentError(why, (*path, "figure"), find_line((*path, "figure"), lines))
        if (bound.below is None) is (bound.above is None):
            raise ExperimentError(messages.not_exactly_one_bound(), path, find_line(path, lines))
        try:
            require_known(get_limit(bound), known)
        except ExpressionError as error:
            raise ExperimentError(error.message, path, find_line(path, lines)) from None


def get_limit(bound: Bound) -> float | str:
    """Return the value of a bound, lower or upper."""
    limit = bound.below if bound.below is not None else bound.above
    assert limit is not None
    return limit


# Experiments ---------------------------------------------------------------------------------------
# Computes the measures that an experiment declares and evaluates its criteria.


def evaluate_experiment(
    columns: ComplianceColumns, context: EvaluationContext, outline: Metrics, missed: int
) -> tuple[Metrics, tuple[RunCriterion, ...]]:
    """Compute the measures of a run and evaluate its criteria; ``outline`` has its durations.

    ``missed`` is the number of missing samples. If some measures fail, their metrics have reasons. Raises
    NoSamplesError if all fail.
    """
    plan, parameters = context.plan, context.parameters
    metrics, problems = outline, []
    for measure in plan.experiment.measures:
        try:
            measured = _compute_measure(measure, columns, context, metrics)
        except NoSamplesError as error:
            problems.append(error)
            measured = replace(metrics, figures=_build_missing_metrics(measure, error.message))
        metrics = replace(measured, figures=_merge_metrics(metrics.figures, measured.figures))
    if problems and len(problems) == len(plan.experiment.measures):
        raise problems[0]
    early = "" if metrics.complete else format_early_end(metrics.played_s, metrics.planned_s)
    known = collect_bound_values(dict(plan.values), parameters, context.tuning.lambdas)
    return metrics, evaluate_criteria(plan.experiment, metrics.figures, known, format_incomplete(missed, early))


def _compute_measure(
    measure: Measure, columns: ComplianceColumns, context: EvaluationContext, metrics: Metrics
) -> Metrics:
    parameters, plan = context.parameters, context.plan
    program = plan.program()
    figures: Any
    match measure:
        case Measure.STEPS:
            bound = partial(least_reach_time, parameters)
            tracked = compute_tracking_metrics(columns, program, plan.phases(), bound, parameters.sensors.joint_step)
            return build_tracking_document(tracked, plan.phases())
        case Measure.COMPLIANCE:
            pushes = find_pushes(program)
            if not pushes:
                raise NoSamplesError(messages.no_push())
            figures = compute_compliance_metrics(columns, parameters.geometry.r_j, pushes[0].start * T_s)
        case Measure.LOADS:
            figures = compute_robustness_metrics(columns, list_load_steps(program), parameters.sensors.motor_step)
        case Measure.RESPONSE:
            figures = compute_response_metrics(columns, program)
        case Measure.DISTURBANCE:
            figures = compute_disturbance_metrics(columns, program)
        case Measure.BODE:
            figures = compute_bode_metrics(columns, program, context)
        case Measure.PUSHES:
            figures = compute_push_metrics(columns, program, context)
        case Measure.HOLDS:
            figures = compute_hold_metrics(columns, program, parameters)
        case Measure.IMPACT:
            figures = compute_impact_metrics(columns, program)
    return replace(metrics, figures=build_metric_documents(figures, figures.reasons))


def _build_missing_metrics(measure: Measure, reason: str) -> tuple[MeasuredFigure, ...]:
    declared = (item for item in fields(METRICS_BY_MEASURE[measure]) if item.metadata)
    return tuple(MeasuredFigure(name=item.name, **item.metadata, value=None, reason=reason) for item in declared)


def _merge_metrics(figures: Sequence[MeasuredFigure], more: Sequence[MeasuredFigure]) -> tuple[MeasuredFigure, ...]:
    """Return both lists; of a metric in both, the first is used unless only the second has a value."""
    by_name = {item.name: item for item in figures}
    for item in more:
        known = by_name.get(item.name)
        if known is None or (known.value is None and item.value is not None):
            by_name[item.name] = item
    return tuple(by_name.values())


def evaluate_criteria(
    experiment: Experiment,
    figures: Sequence[MeasuredFigure],
    known: Mapping[str, bool | int | float | str],
    reason: str = "",
) -> tuple[RunCriterion, ...]:
    """Evaluate the criteria of an experiment; ``known`` are the values for its bounds.

    ``reason`` states why the recording of the run is incomplete, and is empty otherwise: an incomplete run passes no
    criterion.
    """
    by_name = {item.name: item for item in figures}
    criteria = []
    for bound in experiment.criteria:
        found = by_name[bound.figure]
        relation = "<" if bound.below is not None else ">"
        value, why = found.value, found.reason or reason
        try:
            limit = evaluate_number(get_limit(bound), known)
        except ExpressionError as error:  # nothing passes a bound without a value
            limit, value, why = 0.0, None, messages.bound_not_evaluated(reason=error.message)
        title = bound.title or found.label
        criteria.append(
            evaluate_criterion(
                name=bound.name or bound.figure,
                title=title,
                relation=relation,
                bound=limit,
                figure=value,
                unit=found.unit,
                reason=why,
            )
        )
    return tuple(criteria)


# Evaluation ----------------------------------------------------------------------------------------
# Computes the result of a stored run and stores it in addition to earlier ones.


@dataclass(frozen=True)
class Evaluation:
    """Result and identification of a run; ``problem`` states why one of them is missing."""

    result: Result | None
    identification: Identification | None
    problem: str


def evaluate_finished_run(database: Database, parameters: PlantParameters, plan: Plan, run: Run) -> Evaluation:
    """Compute and store the results of a run; if there are none, store the reason."""
    columns, missed = read_recorded_columns(database, run.id)
    try:
        new, estimate = compute_result(
            columns=columns,
            missed=missed,
            parameters=parameters,
            plan=plan,
            run=run,
            points=_load_points(database, run),
        )
    except NoSamplesError as error:
        with database.session() as session:
            runs.set_evaluation_problem(session, run.id, str(error))
        return Evaluation(None, None, error.message)
    with database.session() as session:
        result = results.add(session, new)
        stored = None if estimate is None else identifications.add(session, estimate)
        runs.set_evaluation_problem(session, run.id, "")
    return Evaluation(result, stored, new.metrics.problem)


def compute_result(
    columns: ReaderColumns,
    missed: int,
    parameters: PlantParameters,
    plan: Plan,
    run: Run,
    points: Sequence[PointModel] = (),
) -> tuple[NewResult, NewIdentification | None]:
    """Compute the results of a run from its samples, without storing them.

    ``missed`` is the number of missing samples, ``points`` are the models of the bank at the start of the run. Raises
    NoSamplesError if there is nothing to compute from.
    """
    estimate: NewIdentification | None = None
    criteria: tuple[RunCriterion, ...] = ()
    problem = ""
    match plan:
        case ActuatorIdentificationPlan() | MotorIdentificationPlan() | SpringIdentificationPlan():
            metrics, estimate, problem = _estimate_model(columns, parameters, plan, run)
        case ExperimentPlan():
            outline = _build_outline(columns, plan, run)
            if columns["t"].size == 0:
                raise NoSamplesError(messages.no_samples_of_program())
            context = EvaluationContext(parameters, plan, load_initial_tuning(run.set_to.loop), points)
            metrics, criteria = evaluate_experiment(columns, context, outline, missed)
    metrics = replace(metrics, missing_samples=missed, problem=problem)
    return NewResult(run.id, metrics, criteria, __version__), estimate


def _load_points(database: Database, run: Run) -> tuple[PointModel, ...]:
    if run.bank_id is None:
        return ()
    with database.reading() as session:
        return load_bank_points(banks.get(session, run.bank_id))


def _estimate_model(
    columns: ReaderColumns, parameters: PlantParameters, plan: IdentificationPlan, run: Run
) -> tuple[Metrics, NewIdentification | None, str]:
    """Estimate a model from a complete run; an incomplete record would yield a misleading one."""
    outline = _build_outline(columns, plan, run)
    if not outline.complete:
        return outline, None, messages.incomplete_run_without_model(end_state=run.end_state)
    try:
        figures, estimate = _identify(columns, parameters, plan, run)
    except ValueError as error:
        return outline, None, messages.no_model_estimated(reason=str(error))
    return replace(outline, figures=build_metric_documents(figures)), estimate, ""


def _identify(
    columns: ReaderColumns, parameters: PlantParameters, plan: IdentificationPlan, run: Run
) -> tuple[object, NewIdentification]:
    match plan:
        case MotorIdentificationPlan():
            motors = identify_motors(columns, parameters)
            figures = compute_motor_metrics(columns, motors)
            return figures, build_motor_record(run, plan, motors, parameters, __version__)
        case SpringIdentificationPlan():
            springs = identify_springs(columns, plan, parameters)
            stretched = compute_spring_metrics(columns, plan, springs)
            return stretched, build_spring_record(run, plan, springs, parameters, __version__)
        case ActuatorIdentificationPlan():
            excitation = plan.excitation()
            method = Method(plan.estimator)
            estimate = identify_actuator(columns, excitation, parameters, method)
            moved = compute_actuator_metrics(columns, excitation, estimate)
            return moved, build_actuator_record(run, plan, columns, estimate, __version__)


def _build_outline(columns: ReaderColumns, plan: Plan, run: Run) -> Metrics:
    return Metrics(
        complete=run.end_state == EndState.COMPLETED,
        played_s=columns["t"].size * T_s,
        planned_s=plan.program().duration_s,
        phases=plan.phases(),
    )


# Re-evaluation -------------------------------------------------------------------------------------
# Evaluates a run again from its stored data.


_LOG = logging.getLogger(__name__)


class NotEvaluableError(SinewError, ValueError):
    """The run cannot have a result: it has not ended, or its kind is not evaluated."""

    category = ErrorCode.NOT_NOW


def reevaluate_run(database: Database, run_id: int) -> Evaluation:
    """Evaluate a run again with its own settings and parameters, and store the result in addition.

    Raises UnknownRecordError, NotEvaluableError; SettingError, OutOfRangeError or ParameterError for settings or
    parameters that this version does not support.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
    require_evaluable(run)
    plan = parse_stored_plan(run.kind, run.set_to.plan or {})
    return evaluate_finished_run(database, parse_parameters(run.parameters_name, run.parameters), plan, run)


def find_pending_runs(database: Database, run_ids: Sequence[int]) -> list[int]:
    """Return the runs whose process ended before the result was computed. Raises UnknownRecordError."""
    with database.reading() as session:
        due = [run.id for run in (runs.get(session, number) for number in run_ids) if _is_pending(run)]
        evaluated = results.present(session, due)
        return [number for number in due if number not in evaluated]


def evaluate_pending_runs(database: Database, run_ids: Sequence[int]) -> None:
    """Evaluate the pending runs among these, and store why one has no result. Raises UnknownRecordError."""
    for run_id in find_pending_runs(database, run_ids):
        try:
            reevaluate_run(database, run_id)
        except Exception as error:
            _LOG.info("Run %d has no result: %s", run_id, error)
            with database.session() as session:
                problem = messages.evaluation_failed(error=type(error).__name__, reason=str(error))
                runs.set_evaluation_problem(session, run_id, problem)


def _is_pending(run: Run) -> bool:
    return run.kind != RunKind.SESSION and run.end_state == EndState.SERVICE_DIED and run.evaluation_problem == ""


def require_evaluable(run: Run) -> None:
    """Raise NotEvaluableError for a run without a result."""
    if run.kind == RunKind.SESSION:
        raise NotEvaluableError(messages.session_without_result(run=run.id))
    if run.end_state == EndState.RUNNING:
        raise NotEvaluableError(messages.run_not_ended(run=run.id))


# Used settings -------------------------------------------------------------------------------------
# The settings of a stored run that its control law uses, for page, report and command line.


_LAW_BY_KIND = {
    RunKind.COMPLIANCE: Law.COMPLIANCE,
    RunKind.ACTUATOR_IDENTIFICATION: Law.FORCE_HOLD,
    RunKind.MOTOR_IDENTIFICATION: Law.MOTOR_STEPS,
    RunKind.SPRING_IDENTIFICATION: Law.TENSION_SWEEP,
}
_TUNING_WITHOUT_CASCADE = ("lam_q", "lam_S")
USED_SETTINGS: dict[Law, tuple[str, ...]] = {
    Law.CASCADE: TUNING_NAMES,
    Law.COMPLIANCE: tuple(name for name in TUNING_NAMES if name not in ("lam_q", "k_ext")),
    Law.SINGLE_LOOP: _TUNING_WITHOUT_CASCADE,
    Law.FEEDBACK_LINEARIZATION: _TUNING_WITHOUT_CASCADE,
    **dict.fromkeys(IDENTIFYING, ("lam_motor",)),
}
"""Settings of the tuning that each law uses; without a position loop there are no λ_q and no disturbance rejection."""


def find_control_law(run: Run) -> Law:
    """Return the control law of a run; the cascade for a session.

    Raises UnreadableDocumentError if the experiment stored with an imported run is invalid.
    """
    plan = run.set_to.plan or {}
    if "experiment" in plan:
        try:
            named = json.loads(str(plan["experiment"])).get("law", Law.CASCADE)
            return Law(str(plan.get(named, named)))
        except (ValueError, AttributeError, TypeError, RecursionError):
            raise UnreadableDocumentError(messages.stored_experiment_invalid(run_id=run.id)) from None
    return _LAW_BY_KIND.get(RunKind(run.kind)) or Law(run.set_to.law)


def select_used_settings(run: Run) -> Sequence[DeclaredValue]:
    """Return the settings of a run in order, without those that its control law does not use.

    Programs store their settings with declarations; a session stores a tuning only.
    """
    stored = run.set_to
    if stored.declared is None:
        tuning = stored.loop.get_known_values()
        return [
            DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, tuning[setting.name])
            for setting in TUNING_SETTINGS
            if setting.name in tuning
        ]
    unused = set(TUNING_NAMES) - set(USED_SETTINGS[find_control_law(run)])
    if stored.loop.budget == 0.0:
        unused.add("u_plan")
    return [item for item in stored.declared if item.name not in unused]
