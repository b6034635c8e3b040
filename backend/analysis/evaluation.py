"""Evaluates stored runs: measures, criteria, results with their definitions."""

import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from typing import Any

from backend import __version__
from backend.analysis.context import EvaluationContext, load_bank_points, load_initial_tuning
from backend.analysis.disturbance_metrics import (
    ComplianceColumns,
    ComplianceFigures,
    DisturbanceFigures,
    HoldFigures,
    ImpactFigures,
    PushFigures,
    RobustnessFigures,
    compliance_figures,
    disturbance_figures,
    hold_figures,
    impact_figures,
    push_figures,
    robustness_figures,
)
from backend.analysis.frequency_metrics import BodeFigures, ResponseFigures, bode_figures, response_figures
from backend.analysis.identification import (
    actuator_figures,
    identify_actuator,
    identify_motors,
    identify_springs,
    motor_figures,
    spring_figures,
    to_store_actuator,
    to_store_motors,
    to_store_springs,
)
from backend.analysis.step_metrics import (
    NoSamplesError,
    Overall,
    StepMetrics,
    TrackingMetrics,
    ended_early,
    find_pushes,
    judge,
    load_steps,
    tracking_metrics,
    unseen,
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
from backend.models import DeclaredValue, MeasuredFigure, Metrics, Phase, RunCriterion, StepFigures, Value
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
#
# The result of a run as it is stored: every figure with its label, unit and definition.
#
# Reports, the page and the command line show what stands here; none of them needs to know how it
# was computed.


def tracking_document(metrics: TrackingMetrics, phases: Sequence[Phase], missing_samples: int = 0) -> Metrics:
    """Return completeness, overall figures, steps and phases."""
    return Metrics(
        complete=metrics.complete,
        played_s=metrics.played_s,
        planned_s=metrics.planned_s,
        figures=figure_documents(metrics.overall, metrics.reasons),
        steps=tuple(_step(item) for item in metrics.steps),
        phases=tuple(phases),
        missing_samples=missing_samples,
    )


def figure_documents(figures: Any, reasons: Mapping[str, str] | None = None) -> tuple[MeasuredFigure, ...]:
    """Return the fields of a dataclass made of ``figure`` declarations with their declarations.

    ``reasons`` tells by name what could not be measured, or not on all steps, and why.
    """
    why = reasons or {}
    return tuple(
        MeasuredFigure(
            name=item.name,
            **item.metadata,
            value=_finite(getattr(figures, item.name)),
            reason=why.get(item.name, ""),
        )
        for item in fields(figures)
        if item.metadata
    )


def _step(metrics: StepMetrics) -> StepFigures:
    figures = asdict(metrics)
    return StepFigures(**figures.pop("step"), **figures)


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value


# Measures ------------------------------------------------------------------------------------------
#
# What can be measured of an experiment, each measure with its figures; what bounds of them may
# speak of.


FIGURES: dict[Measure, type[Any]] = {
    Measure.STEPS: Overall,
    Measure.COMPLIANCE: ComplianceFigures,
    Measure.LOADS: RobustnessFigures,
    Measure.RESPONSE: ResponseFigures,
    Measure.DISTURBANCE: DisturbanceFigures,
    Measure.BODE: BodeFigures,
    Measure.PUSHES: PushFigures,
    Measure.HOLDS: HoldFigures,
    Measure.IMPACT: ImpactFigures,
}


def names_of(measures: tuple[Measure, ...]) -> tuple[str, ...]:
    """Return the names of all figures that these measures give."""
    listed = [item.name for measure in measures for item in fields(FIGURES[measure]) if item.metadata]
    return tuple(dict.fromkeys(listed))


def known_to_bounds(
    values: dict[str, Value], parameters: PlantParameters, lambdas: TuningParameters
) -> dict[str, bool | int | float | str]:
    """Return what the bounds of an experiment's criteria may speak of, by name."""
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


_OF_PLANT_AND_TUNING = (*PLANT_NAMES, "lam_q", "lam_S", "lam_motor")


def require_measurable(experiment: Experiment, values: Mapping[str, Value], lines: Lines) -> None:
    """Raise ExperimentError for a criterion that no run could be judged by."""
    legal = names_of(experiment.measures)
    known = {**values, **dict.fromkeys(_OF_PLANT_AND_TUNING, 1.0)}
    for place, bound in enumerate(experiment.criteria):
        path: Path = ("criteria", place)
        if bound.figure not in legal:
            given = ", ".join(experiment.measures)
            why = f"{bound.figure!r} is no figure of what is measured ({given}); there are {', '.join(legal)}"
            raise ExperimentError(why, (*path, "figure"), find_line((*path, "figure"), lines))
        if (bound.below is None) is (bound.above is None):
            raise ExperimentError("it needs a bound, either below or above", path, find_line(path, lines))
        try:
            require_known(limit_of(bound), known)
        except ExpressionError as error:
            raise ExperimentError(str(error), path, find_line(path, lines)) from None


def limit_of(bound: Bound) -> float | str:
    """Return the bound itself, whichever side it is on."""
    limit = bound.below if bound.below is not None else bound.above
    assert limit is not None
    return limit


# Composed ------------------------------------------------------------------------------------------
#
# The result of an experiment that is data: what it asks to be measured, judged by what it asks for.
# Pure.


def evaluate_experiment(
    columns: ComplianceColumns, in_force: EvaluationContext, outline: Metrics, missed: int
) -> tuple[Metrics, tuple[RunCriterion, ...]]:
    """Measure and judge a run of what was ``in_force``; ``outline`` tells how long it was.

    What one of several measures could not be made of is told figure by figure. Raises NoSamplesError where none could.
    """
    plan, parameters = in_force.plan, in_force.parameters
    metrics, problems = outline, []
    for measure in plan.experiment.measures:
        try:
            measured = _measured(measure, columns, in_force, metrics)
        except NoSamplesError as error:
            problems.append(error)
            measured = replace(metrics, figures=_not_measured(measure, str(error)))
        metrics = replace(measured, figures=_joined(metrics.figures, measured.figures))
    if problems and len(problems) == len(plan.experiment.measures):
        raise problems[0]
    early = "" if metrics.complete else ended_early(metrics.played_s, metrics.planned_s)
    known = known_to_bounds(dict(plan.values), parameters, in_force.tuning.lambdas)
    return metrics, criteria_of(plan.experiment, metrics.figures, known, unseen(missed, early))


def _measured(measure: Measure, columns: ComplianceColumns, in_force: EvaluationContext, metrics: Metrics) -> Metrics:
    parameters, plan = in_force.parameters, in_force.plan
    program = plan.program()
    figures: Any
    match measure:
        case Measure.STEPS:
            bound = partial(least_reach_time, parameters)
            tracked = tracking_metrics(columns, program, plan.phases(), bound, parameters.sensors.joint_step)
            return tracking_document(tracked, plan.phases())
        case Measure.COMPLIANCE:
            pushed = find_pushes(program)
            if not pushed:
                raise NoSamplesError("nothing pushes the joint")
            figures = compliance_figures(columns, parameters.geometry.r_j, pushed[0].start * T_s)
        case Measure.LOADS:
            figures = robustness_figures(columns, load_steps(program), parameters.sensors.motor_step)
        case Measure.RESPONSE:
            figures = response_figures(columns, program)
        case Measure.DISTURBANCE:
            figures = disturbance_figures(columns, program)
        case Measure.BODE:
            figures = bode_figures(columns, program, in_force)
        case Measure.PUSHES:
            figures = push_figures(columns, program, in_force)
        case Measure.HOLDS:
            figures = hold_figures(columns, program, parameters)
        case Measure.IMPACT:
            figures = impact_figures(columns, program)
    return replace(metrics, figures=figure_documents(figures, figures.reasons))


def _not_measured(measure: Measure, reason: str) -> tuple[MeasuredFigure, ...]:
    declared = (item for item in fields(FIGURES[measure]) if item.metadata)
    return tuple(MeasuredFigure(name=item.name, **item.metadata, value=None, reason=reason) for item in declared)


def _joined(figures: Sequence[MeasuredFigure], more: Sequence[MeasuredFigure]) -> tuple[MeasuredFigure, ...]:
    """Return all of both; a figure that both have is that of the first, unless only the second could be measured."""
    by_name = {item.name: item for item in figures}
    for item in more:
        known = by_name.get(item.name)
        if known is None or (known.value is None and item.value is not None):
            by_name[item.name] = item
    return tuple(by_name.values())


def criteria_of(
    experiment: Experiment,
    figures: Sequence[MeasuredFigure],
    known: Mapping[str, bool | int | float | str],
    reason: str = "",
) -> tuple[RunCriterion, ...]:
    """Judge figures by the criteria of an experiment; ``known`` are what its bounds may speak of.

    ``reason`` says why the run was not seen whole, if it was not: nothing passes then.
    """
    by_name = {item.name: item for item in figures}
    judged = []
    for bound in experiment.criteria:
        found = by_name[bound.figure]
        relation = "<" if bound.below is not None else ">"
        value, why = found.value, found.reason or reason
        try:
            limit = evaluate_number(limit_of(bound), known)
        except ExpressionError as error:  # a bound without a value is one that nothing passes
            limit, value, why = 0.0, None, f"its bound could not be had: {error}"
        title = bound.title or found.label
        judged.append(
            judge(
                name=bound.name or bound.figure,
                title=title,
                relation=relation,
                bound=limit,
                figure=value,
                unit=found.unit,
                reason=why,
            )
        )
    return tuple(judged)


# Evaluation ----------------------------------------------------------------------------------------
#
# Compute the result of a stored run, and store it beside earlier ones: nothing is overwritten.


@dataclass(frozen=True)
class Evaluation:
    """What a run gave; ``problem`` says why there is no result or no model."""

    result: Result | None
    identification: Identification | None
    problem: str


def evaluate_finished_run(database: Database, parameters: PlantParameters, plan: Plan, run: Run) -> Evaluation:
    """Compute what the plan's kind of run gives, and store it; where that is nothing, the run says why."""
    columns, missed = read_recorded_columns(database, run.id)
    try:
        new, estimate = compute_result(
            columns=columns, missed=missed, parameters=parameters, plan=plan, run=run, points=_points(database, run)
        )
    except NoSamplesError as error:
        with database.session() as session:
            runs.set_evaluation_problem(session, run.id, str(error))
        return Evaluation(None, None, str(error))
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
    """Compute what the plan's kind of run gives, from its samples, of which ``missed`` are lacking; nothing is stored.

    ``points`` are the models of the bank that the run began with.

    Raises NoSamplesError where there is nothing to compute from.
    """
    estimate: NewIdentification | None = None
    criteria: tuple[RunCriterion, ...] = ()
    problem = ""
    match plan:
        case ActuatorIdentificationPlan() | MotorIdentificationPlan() | SpringIdentificationPlan():
            metrics, estimate, problem = _identified(columns, parameters, plan, run)
        case ExperimentPlan():
            outline = _outline(columns, plan, run)
            if columns["t"].size == 0:
                raise NoSamplesError("the run holds no samples of its program")
            in_force = EvaluationContext(parameters, plan, load_initial_tuning(run.set_to.loop), points)
            metrics, criteria = evaluate_experiment(columns, in_force, outline, missed)
    metrics = replace(metrics, missing_samples=missed, problem=problem)
    return NewResult(run.id, metrics, criteria, __version__), estimate


def _points(database: Database, run: Run) -> tuple[PointModel, ...]:
    if run.bank_id is None:
        return ()
    with database.reading() as session:
        return load_bank_points(banks.get(session, run.bank_id))


def _identified(
    columns: ReaderColumns, parameters: PlantParameters, plan: IdentificationPlan, run: Run
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
    columns: ReaderColumns, parameters: PlantParameters, plan: IdentificationPlan, run: Run
) -> tuple[object, NewIdentification]:
    match plan:
        case MotorIdentificationPlan():
            motors = identify_motors(columns, parameters)
            figures = motor_figures(columns, motors)
            return figures, to_store_motors(run, plan, motors, parameters, __version__)
        case SpringIdentificationPlan():
            springs = identify_springs(columns, plan, parameters)
            stretched = spring_figures(columns, plan, springs)
            return stretched, to_store_springs(run, plan, springs, parameters, __version__)
        case ActuatorIdentificationPlan():
            excitation = plan.excitation()
            method = Method(plan.estimator)
            estimate = identify_actuator(columns, excitation, parameters, method)
            moved = actuator_figures(columns, excitation, estimate)
            return moved, to_store_actuator(run, plan, columns, estimate, __version__)


def _outline(columns: ReaderColumns, plan: Plan, run: Run) -> Metrics:
    return Metrics(
        complete=run.end_state == EndState.COMPLETED,
        played_s=columns["t"].size * T_s,
        planned_s=plan.program().duration_s,
        phases=plan.phases(),
    )


# Again ---------------------------------------------------------------------------------------------
#
# Evaluate a stored run once more, from nothing but what is stored of it.


_LOG = logging.getLogger(__name__)


class NotEvaluableError(SinewError, ValueError):
    """A run that gives no result: it goes on, or it is of a kind that is not evaluated."""

    category = ErrorCode.NOT_NOW


def reevaluate_run(database: Database, run_id: int) -> Evaluation:
    """Compute the result as at the run's end, with its own settings and parameters, and store it beside earlier ones.

    Raises UnknownRecordError, NotEvaluableError; SettingError or OutOfRangeError for settings that have no meaning any
    more, and ParameterError for such parameters.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
    require_evaluable(run)
    plan = parse_stored_plan(run.kind, run.set_to.plan or {})
    return evaluate_finished_run(database, parse_parameters(run.parameters_name, run.parameters), plan, run)


def find_pending_runs(database: Database, run_ids: Sequence[int]) -> list[int]:
    """Return which of these runs ended with what played them, before their result could be computed.

    Raises UnknownRecordError.
    """
    with database.reading() as session:
        due = [run.id for run in (runs.get(session, number) for number in run_ids) if _is_due(run)]
        evaluated = results.present(session, due)
        return [number for number in due if number not in evaluated]


def evaluate_pending_runs(database: Database, run_ids: Sequence[int]) -> None:
    """Evaluate those of these runs that were left behind; why one has no result is kept with it.

    Raises UnknownRecordError.
    """
    for run_id in find_pending_runs(database, run_ids):
        try:
            reevaluate_run(database, run_id)
        except Exception as error:
            _LOG.info("Run %d has no result: %s", run_id, error)
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


# Used settings -------------------------------------------------------------------------------------
#
# What a stored run was set to, as far as its control law uses it: for page, report and command
# line. Pure.


_OF_KIND = {
    RunKind.COMPLIANCE: Law.COMPLIANCE,
    RunKind.ACTUATOR_IDENTIFICATION: Law.FORCE_HOLD,
    RunKind.MOTOR_IDENTIFICATION: Law.MOTOR_STEPS,
    RunKind.SPRING_IDENTIFICATION: Law.TENSION_SWEEP,
}
_WITHOUT_CASCADE = ("lam_q", "lam_S")
USED: dict[Law, tuple[str, ...]] = {
    Law.CASCADE: TUNING_NAMES,
    Law.COMPLIANCE: tuple(name for name in TUNING_NAMES if name not in ("lam_q", "k_ext")),
    Law.SINGLE_LOOP: _WITHOUT_CASCADE,
    Law.FEEDBACK_LINEARIZATION: _WITHOUT_CASCADE,
    **dict.fromkeys(IDENTIFYING, ("lam_motor",)),
}
"""Parts of the tuning that each law uses; an open position loop rejects no push and has no λ_q."""


def find_control_law(run: Run) -> Law:
    """Return the control law that a run was played under; the cascade for a session."""
    plan = run.set_to.plan or {}
    if "experiment" in plan:
        named = json.loads(str(plan["experiment"])).get("law", Law.CASCADE)
        return Law(str(plan.get(named, named)))
    return _OF_KIND.get(RunKind(run.kind)) or Law(run.set_to.law)


def select_used_settings(run: Run) -> Sequence[DeclaredValue]:
    """Return the settings of a run in order, without the parts of the tuning that its law does not use.

    Programs store them declared; a session has a tuning only.
    """
    stored = run.set_to
    if stored.declared is None:
        tuning = stored.loop.get_known_values()
        return [
            DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, tuning[setting.name])
            for setting in TUNING_SETTINGS
            if setting.name in tuning
        ]
    unused = set(TUNING_NAMES) - set(USED[find_control_law(run)])
    if stored.loop.budget == 0.0:
        unused.add("u_plan")
    return [item for item in stored.declared if item.name not in unused]
