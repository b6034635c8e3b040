"""Plans of all kinds alike: what a run keeps of one, what it declares, and the plan of a stored run. Pure."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from backend.experiments.composing import ready_made, text
from backend.experiments.plans.composed_plan import KIND, ComposedPlan, composed
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans.plan import ActuatorIdentificationPlan, Plan
from backend.experiments.plans.sequence_plan import SequencePlan
from backend.models.run import DeclaredValue, Value
from backend.models.settings import Setting, declared_values, describe, from_values

KINDS: dict[str, type[Any]] = {
    plan.kind: plan
    for plan in (SequencePlan, ActuatorIdentificationPlan, MotorIdentificationPlan, SpringIdentificationPlan)
}
"""Plans that are written in Python, by the kind of their runs."""

OF_THE_PAPER = ("tracking", "compliance", "robustness")
"""Ready-made experiments whose runs are of a kind of their own, as they were before experiments were data."""


def ready_plan(name: str, **values: Any) -> ComposedPlan:
    """Return the plan of a ready-made experiment. Raises KeyError, SettingError, OutOfRangeError, ExperimentError."""
    experiment, lines = ready_made.ready_made(name)
    return composed(experiment, values, name if name in OF_THE_PAPER else KIND, lines)


def settings_of(plan: Plan) -> tuple[Setting, ...]:
    """Return the settings that a plan declares."""
    return plan.settings if isinstance(plan, ComposedPlan) else describe(type(plan))


def values_of(plan: Plan) -> dict[str, Value]:
    """Return the settings of a plan by name."""
    return dict(plan.values) if isinstance(plan, ComposedPlan) else asdict(plan)


def kept_values(plan: Plan) -> dict[str, Value]:
    """Return what a run keeps of its plan."""
    return plan.stored() if isinstance(plan, ComposedPlan) else asdict(plan)


def declared(plan: Plan) -> tuple[DeclaredValue, ...]:
    """Return what was chosen with symbol, unit and meaning."""
    if not isinstance(plan, ComposedPlan):
        return declared_values(plan)
    return tuple(
        DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, plan.values[setting.name])
        for setting in plan.settings
    )


def stored_plan(kind: str, kept: Mapping[str, Value]) -> Plan:
    """Return the plan of a stored run. One from before experiments were data keeps its settings alone.

    Raises SettingError, OutOfRangeError, ExperimentError for settings that have no meaning any more.
    """
    if kind in KINDS:
        plan: Plan = from_values(KINDS[kind], kept)
        return plan
    if "experiment" not in kept:
        return ready_plan(kind, **kept)
    experiment = text.of_canonical(str(kept["experiment"]))
    return composed(experiment, {name: value for name, value in kept.items() if name != "experiment"}, kind)
