"""The result of an experiment that is data: what it asks to be measured, judged by what it asks for. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

from backend.documents.experiment import Experiment, Measure
from backend.experiments.composing.expressions import ExpressionError, number_of
from backend.experiments.results.bode import bode_figures
from backend.experiments.results.compliance import Columns, compliance_figures
from backend.experiments.results.criteria import ended_early, judge, unseen
from backend.experiments.results.disturbance import disturbance_figures
from backend.experiments.results.document import figure_documents, tracking_document
from backend.experiments.results.held import hold_figures
from backend.experiments.results.impact import impact_figures
from backend.experiments.results.in_force import InForce
from backend.experiments.results.measures import FIGURES, known_to_bounds, limit_of
from backend.experiments.results.metrics import NoSamplesError, tracking_metrics
from backend.experiments.results.pushed import push_figures
from backend.experiments.results.response import response_figures
from backend.experiments.results.robustness import robustness_figures
from backend.experiments.results.windows import load_steps, pushes
from backend.models.run import Criterion, Figure, Metrics
from backend.tuning.preview import least_reach_time
from plant.interface import T_s


def composed_result(
    columns: Columns, in_force: InForce, outline: Metrics, missed: int
) -> tuple[Metrics, tuple[Criterion, ...]]:
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


def _measured(measure: Measure, columns: Columns, in_force: InForce, metrics: Metrics) -> Metrics:
    parameters, plan = in_force.parameters, in_force.plan
    program = plan.program()
    figures: Any
    match measure:
        case Measure.STEPS:
            bound = partial(least_reach_time, parameters)
            tracked = tracking_metrics(columns, program, plan.phases(), bound, parameters.sensors.joint_step)
            return tracking_document(tracked, plan.phases())
        case Measure.COMPLIANCE:
            pushed = pushes(program)
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


def _not_measured(measure: Measure, reason: str) -> tuple[Figure, ...]:
    declared = (item for item in fields(FIGURES[measure]) if item.metadata)
    return tuple(Figure(name=item.name, **item.metadata, value=None, reason=reason) for item in declared)


def _joined(figures: Sequence[Figure], more: Sequence[Figure]) -> tuple[Figure, ...]:
    """Return all of both; a figure that both have is that of the first, unless only the second could be measured."""
    by_name = {item.name: item for item in figures}
    for item in more:
        known = by_name.get(item.name)
        if known is None or (known.value is None and item.value is not None):
            by_name[item.name] = item
    return tuple(by_name.values())


def criteria_of(
    experiment: Experiment,
    figures: Sequence[Figure],
    known: Mapping[str, bool | int | float | str],
    reason: str = "",
) -> tuple[Criterion, ...]:
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
            limit = number_of(limit_of(bound), known)
        except ExpressionError as error:  # a bound without a value is one that nothing passes
            limit, value, why = 0.0, None, f"its bound could not be had: {error}"
        title = bound.title or found.label
        judged.append(judge(bound.name or bound.figure, title, relation, limit, value, found.unit, why))
    return tuple(judged)
