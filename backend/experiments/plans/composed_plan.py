"""The plan of an experiment that is data: the experiment, and the values of its settings. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from backend.documents.experiment import Experiment
from backend.experiments.composing import text
from backend.experiments.composing.laid import Laid
from backend.experiments.composing.layout import laid
from backend.experiments.composing.refused import ExperimentError, Lines, line_of
from backend.experiments.composing.settings import parsed, require_rules, settings_of
from backend.models.run import Phase, Value
from backend.models.settings import Setting
from backend.realtime.program import IDENTIFYING, Law, Program

LAWS = tuple(law for law in Law if law not in IDENTIFYING)
KIND = "experiment"
"""Kind of the runs of all experiments but the paper's, whose runs have the kinds that they always had."""


@dataclass(frozen=True)
class ComposedPlan:
    """``values`` are all settings by name. ``kind`` is the kind of its runs; ``lines`` tell where it was written."""

    experiment: Experiment
    values: Mapping[str, Value]
    kind: str = KIND
    lines: Lines = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def laid(self) -> Laid:
        """What is played, and where it was written. Raises ExperimentError."""
        return laid(self.experiment, self.values, self.lines)

    def program(self) -> Program:
        """Return what the loop plays; the gains of its changes of the tuning are left to who knows the models."""
        return Program(self.law, self.laid.segments, walls=self.laid.walls, touches=self.laid.touches)

    def phases(self) -> tuple[Phase, ...]:
        """Return the named stretches."""
        return self.laid.phases

    @property
    def law(self) -> Law:
        """The control law. Raises ExperimentError."""
        named = self.values.get(self.experiment.law, self.experiment.law)
        if named not in LAWS:
            why = f"{named!r} is no control law; there are {', '.join(LAWS)}"
            raise ExperimentError(why, ("law",), line_of(("law",), self.lines))
        return Law(str(named))

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The declared settings."""
        return settings_of(self.experiment, self.lines)

    def stored(self) -> dict[str, Value]:
        """Return what a run keeps of it: the experiment as it was, and its settings by name."""
        return {"experiment": text.canonical(self.experiment), **self.values}


def composed(
    experiment: Experiment, given: Mapping[str, object], kind: str = KIND, lines: Lines | None = None
) -> ComposedPlan:
    """Return the plan with these settings, the others at their defaults; it can be played, but for the plant.

    Raises ExperimentError, SettingError, OutOfRangeError.
    """
    where = {} if lines is None else lines
    settings = settings_of(experiment, where)
    values = parsed(settings, given)
    plan = ComposedPlan(experiment, values, kind, where)
    require_rules(experiment, settings, values, given, where)
    plan.program()
    return plan
