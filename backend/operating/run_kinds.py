"""What there is to be run, with the settings of each: what a form offers is what the service takes."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cache
from typing import Any

from backend.experiments.plans.catalogue import EXPERIMENTS, IDENTIFICATIONS
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.sequence_plan import SequencePlan
from backend.experiments.settings import Setting, describe
from backend.loop.mode import RefusedError
from backend.loop.program import require_able
from backend.messages.experiment import ExperimentKind, SettingView
from backend.messages.identification import IdentificationKind
from backend.messages.tuning import TuningView
from plant.choice import PlantKind

_MOVED_BY_MOTORS_ALONE = (PlantKind.RIG, PlantKind.REPLAY)


def experiment_kinds(in_force: LoopSettings, tuning: TuningView, plant: PlantKind) -> list[ExperimentKind]:
    """Return the experiments there are, with their settings and those of the loop as ``in_force``.

    λ is offered as far as it is safe with the models of ``tuning``, and the seed is the service's own.
    """
    offered = {
        "lam_q": (tuning.lam_q_min, tuning.lam_q_max),
        "lam_S": (tuning.lam_S_min, tuning.lam_S_max),
        "lam_motor": (tuning.lam_motor_min, tuning.lam_motor_max),
        "seed": (in_force.seed, in_force.seed),
    }
    values = asdict(in_force)
    of_the_loop = [_view(_within(setting, offered), values[setting.name]) for setting in describe(LoopSettings)]
    return [
        ExperimentKind(
            name=name,
            title=entry.title,
            description=entry.description,
            duration_s=_usual_duration_s(name),
            settings=[*_DECLARED[entry.plan], *of_the_loop],
            why_not=_beyond(name) if plant in _MOVED_BY_MOTORS_ALONE else "",
        )
        for name, entry in EXPERIMENTS.items()
    ]


def identification_kinds() -> list[IdentificationKind]:
    """Return what can be identified, with the settings of each."""
    return [
        IdentificationKind(
            kind=kind,
            title=entry.title,
            description=entry.description,
            settings=_DECLARED[entry.plan],
        )
        for kind, entry in IDENTIFICATIONS.items()
    ]


@cache
def _beyond(name: str) -> str:
    """Return why nothing but its motors moving a plant is not enough for an experiment; empty where it is."""
    if name == SequencePlan.kind:  # whether it pushes is a person's choice, and the loop tells
        return ""
    try:
        for segment in EXPERIMENTS[name].plan().program().segments:
            require_able(segment, pushes=False, loads_shafts=False)
    except RefusedError as refused:
        return str(refused)
    return ""


@cache
def _usual_duration_s(name: str) -> float:
    return EXPERIMENTS[name].plan().program().duration_s


def _within(setting: Setting, offered: Mapping[str, tuple[float, float]]) -> Setting:
    low, high = offered.get(setting.name, (setting.minimum, setting.maximum))
    return replace(setting, minimum=low, maximum=high)


def _view(setting: Setting, default: float | int | str) -> SettingView:
    return SettingView(
        name=setting.name,
        meaning=setting.meaning,
        unit=setting.unit,
        default=default,
        minimum=setting.minimum,
        maximum=setting.maximum,
        choices=list(setting.choices) or None,
    )


_PLANS: list[type[Any]] = [
    *(entry.plan for entry in EXPERIMENTS.values()),
    *(entry.plan for entry in IDENTIFICATIONS.values()),
]
_DECLARED = {plan: [_view(setting, setting.default) for setting in describe(plan)] for plan in _PLANS}
