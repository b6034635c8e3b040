"""The experiments that can be ordered by name, from the browser and from the command line alike."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

from backend.documents.experiment import Experiment
from backend.experiments.composing.ready_made import NAMES, ready_made
from backend.experiments.composing.refused import Lines
from backend.experiments.composing.settings import settings_of
from backend.experiments.plans.composed_plan import KIND, composed
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans.plan import ActuatorIdentificationPlan, IdentificationPlan, Plan
from backend.experiments.plans.sequence_plan import SequencePlan
from backend.experiments.plans.stored_plan import OF_THE_PAPER
from backend.models.settings import Setting, SettingError, describe, from_values


@dataclass(frozen=True)
class Entry:
    """An experiment that can be ordered: the words that present it, its settings, and what makes a plan of values.

    ``run_kind`` is the kind of its runs; ``written`` the experiment where it is data.
    """

    name: str
    title: str
    description: str
    settings: tuple[Setting, ...]
    make: Callable[[Mapping[str, Any]], Plan]
    run_kind: str
    written: Experiment | None = None

    @cached_property
    def usual(self) -> Plan:
        """The plan with all settings at their defaults."""
        return self.make({})


def entry_of(experiment: Experiment, lines: Lines | None = None, *, name: str = "", run_kind: str = KIND) -> Entry:
    """Return the entry of an experiment that is data. Raises ExperimentError for one that cannot be played."""
    where = {} if lines is None else lines
    entry = Entry(
        name or experiment.name,
        experiment.title,
        experiment.description,
        settings_of(experiment, where),
        lambda values: composed(experiment, values, run_kind, where),
        run_kind,
        experiment,
    )
    _ = entry.usual
    return entry


@cache
def experiments() -> Mapping[str, Entry]:
    """Return the experiments that come with Sinew, by name."""
    ready = {name: entry_of(*ready_made(name), run_kind=name if name in OF_THE_PAPER else KIND) for name in NAMES}
    sequence = Entry(
        SequencePlan.kind,
        "Own sequence",
        "Steps, ramps and sines of both references, one after the other, as a JSON list of segments.",
        describe(SequencePlan),
        lambda values: from_values(SequencePlan, values),
        SequencePlan.kind,
    )
    return {**ready, sequence.name: sequence}


@dataclass(frozen=True)
class IdentificationEntry:
    """Something that can be identified, with the words that present it."""

    plan: type[IdentificationPlan]
    title: str
    description: str


IDENTIFICATIONS: dict[str, IdentificationEntry] = {
    "actuator": IdentificationEntry(
        ActuatorIdentificationPlan,
        "Actuator",
        "How joint position and stiffness follow motor A, in closed loop: a binary sequence around a held tension.",
    ),
    "motor": IdentificationEntry(
        MotorIdentificationPlan,
        "Motors",
        "Gain, time constant and dry friction of both motors: voltage steps up and down with slack tendons.",
    ),
    "spring": IdentificationEntry(
        SpringIdentificationPlan,
        "Springs",
        "Force over elongation of both springs: a slow sweep of both tensions up and down.",
    ),
}


def experiment(name: str) -> Entry:
    """Return the experiment of this name. Raises SettingError with those there are."""
    known = experiments()
    if name not in known:
        raise SettingError("name", name, f"there is no such experiment; known: {', '.join(known)}", legal=tuple(known))
    return known[name]
