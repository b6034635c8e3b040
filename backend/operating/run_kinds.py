"""What there is to be run, with the settings of each: what a form offers is what the service takes."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace

from backend.experiments.library import IDENTIFICATIONS, Entry
from backend.experiments.plans import LoopSettings, SequencePlan
from backend.models.settings import Setting, describe
from backend.realtime.program import NO_WALL, RefusedError, require_able
from backend.schemas.experiment import ExperimentKind, SettingView
from backend.schemas.identification import IdentificationKind
from backend.schemas.tuning import TuningView
from plant.interface import PlantKind

_MOVED_BY_MOTORS_ALONE = (PlantKind.RIG, PlantKind.REPLAY)


def experiment_kinds(
    entries: Iterable[Entry], in_force: LoopSettings, tuning: TuningView, plant: PlantKind
) -> list[ExperimentKind]:
    """Return experiments with their settings and those of the loop as ``in_force``.

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
    moved_by_motors_alone = plant in _MOVED_BY_MOTORS_ALONE
    return [
        ExperimentKind(
            name=entry.name,
            title=entry.title,
            description=entry.description,
            run_kind=entry.run_kind,
            duration_s=entry.usual.program().duration_s,
            settings=[*views_of(entry.settings), *of_the_loop],
            why_not=_beyond(entry) if moved_by_motors_alone else "",
        )
        for entry in entries
    ]


def identification_kinds() -> list[IdentificationKind]:
    """Return what can be identified, with the settings of each."""
    return [
        IdentificationKind(
            kind=kind,
            title=entry.title,
            description=entry.description,
            settings=views_of(describe(entry.plan)),
        )
        for kind, entry in IDENTIFICATIONS.items()
    ]


def _beyond(entry: Entry) -> str:
    """Return why nothing but its motors moving a plant is not enough for an experiment; empty where it is."""
    if entry.name == SequencePlan.kind:  # whether it pushes is a person's choice, and the loop tells
        return ""
    try:
        program = entry.usual.program()
        if program.walls:
            return NO_WALL
        for segment in program.segments:
            require_able(segment, pushes=False, loads_shafts=False)
    except RefusedError as refused:
        return str(refused)
    return ""


def _within(setting: Setting, offered: Mapping[str, tuple[float, float]]) -> Setting:
    low, high = offered.get(setting.name, (setting.minimum, setting.maximum))
    return replace(setting, minimum=low, maximum=high)


def _view(setting: Setting, default: float | int | str) -> SettingView:
    return SettingView(
        name=setting.name,
        symbol=setting.symbol,
        meaning=setting.meaning,
        unit=setting.unit,
        default=default,
        minimum=setting.minimum,
        maximum=setting.maximum,
        choices=list(setting.choices) or None,
    )


def views_of(settings: Iterable[Setting]) -> list[SettingView]:
    """Return declared settings as a form shows them."""
    return [_view(setting, setting.default) for setting in settings]
