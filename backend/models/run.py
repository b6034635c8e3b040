"""What a run stores of itself: plan, tuning, seed, plant, walls, banks and result. Pure."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from backend.models.document import ABSENT, Document, DocumentCodec, replace_non_finite
from backend.response_docs import COMPLETE_RESPONSE_CONFIG, describe_field
from plant import Obstacle

# Bank entry ----------------------------------------------------------------------------------------
#
# The models of one entry of a bank: first order, from θ_ref to q and to S, and the tension [N] they
# were found at.


ENTRY_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class EntryModel:
    """K_q [rad/rad], T_q [s], K_S [N·m/rad per rad], T_S [s]; None where an imported entry does not say."""

    K_q: float | None = field(default=None, metadata=ABSENT)
    T_q: float | None = field(default=None, metadata=ABSENT)
    K_S: float | None = field(default=None, metadata=ABSENT)
    T_S: float | None = field(default=None, metadata=ABSENT)
    tension_N: float | None = field(default=None, metadata=ABSENT)
    version: int = ENTRY_VERSION


ENTRY: DocumentCodec[EntryModel] = DocumentCodec(EntryModel, "its models", ENTRY_VERSION)


# Kept wall -----------------------------------------------------------------------------------------
#
# The walls that stood in a simulated joint's way during a run, as its settings keep them. Pure.


MOST = 1000
"""So many changes are kept of a run; after the last of them no wall is known to stand."""


@dataclass(frozen=True)
class KeptWall:
    """What stands from ``t`` [s] since the run's first sample on; ``side`` 0 is no wall, the rest as in Obstacle."""

    t: float
    side: float
    q_wall: float
    k_wall: float
    c_wall: float

    @property
    def obstacle(self) -> Obstacle | None:
        """The wall; None for no wall."""
        return Obstacle(self.side, self.q_wall, self.k_wall, self.c_wall) if self.side else None


def wall_record(t: float, wall: Obstacle | None) -> KeptWall:
    """Return what is kept of a change at ``t`` [s]."""
    return KeptWall(t, 0.0, 0.0, 0.0, 0.0) if wall is None else KeptWall(t, *map(float, wall))


def merge_changes(earlier: Sequence[KeptWall], later: Sequence[KeptWall]) -> tuple[KeptWall, ...]:
    """Return all changes in order of time, the later told of two at one moment; past MOST, that no wall is known."""
    by_time = {change.t: change for change in (*earlier, *later)}
    changes = [by_time[t] for t in sorted(by_time)]
    if len(changes) > MOST:
        changes = [*changes[: MOST - 1], wall_record(changes[MOST - 1].t, None)]
    return tuple(changes)


def find_wall_at(changes: Sequence[KeptWall], t: float) -> Obstacle | None:
    """Return what stands at ``t`` [s] since the run's first sample; None for no wall."""
    before = [change for change in changes if change.t <= t]
    return before[-1].obstacle if before else None


# Plant numbers -------------------------------------------------------------------------------------
#
# The numbers of a plant as a run keeps them (``PlantParameters.document``), by section and entry.
# Pure.


@dataclass(frozen=True)
class StoredPlantNumber:
    """A number, or a list of points, in its unit, and where it comes from."""

    value: Any
    unit: str = ""
    source: str = ""


PlantNumbers = dict[str, dict[str, StoredPlantNumber]]

PLANT_NUMBERS: DocumentCodec[PlantNumbers] = DocumentCodec(PlantNumbers, "numbers of its plant", 0)


# Applied parameters --------------------------------------------------------------------------------
#
# What the controller is told of motors and springs in place of what the parameter file says. Pure.


APPLIED_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class AppliedParameters:
    """Sections ``identified``, ``identified_A`` and ``identified_B`` as they came into force; empty: those of the file.

    ``base`` tells the numbers of the file that they are put over. ``estimate`` is the stored identification they came
    from and ``run`` its run, 0 for none; with ``undone`` the former ones were put back.
    """

    base: str
    identified: PlantNumbers
    estimate: int = 0
    run: int = 0
    undone: bool = False
    version: int = APPLIED_VERSION


APPLIED: DocumentCodec[AppliedParameters] = DocumentCodec(
    AppliedParameters, "what was applied to the parameters", APPLIED_VERSION
)


# Result --------------------------------------------------------------------------------------------
#
# What was computed from a run: figures, steps and criteria, each with what its reader needs to
# know. Pure.
#
# Times in s from the start of the program, all numbers in SI, None where a figure does not exist.


DEFINITIONS = 1
"""Version of the definitions that figures and criteria are computed by: one more with each change of what one means.
Results from before it was kept have 0."""


@dataclass(frozen=True)
class Phase:
    """A named stretch of a program [s from its start]; the report draws one set of panels for each."""

    name: str
    title: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class MeasuredFigure:
    """A figure of a result. ``reason`` says why it, or a part of it, was not measured; "" where nothing is missing."""

    __pydantic_config__ = COMPLETE_RESPONSE_CONFIG

    name: str
    unit: str
    label: str
    definition: str
    value: float | None
    reason: str = field(
        default="",
        metadata=describe_field("why it was not measured; with a value: why not on all steps, so at least that"),
    )


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """How one reference step of ``signal``, "q" or "S", went; ``reasons`` says by name what was not measured, and why.

    ``alone`` when the other reference stood still; the figures are those of ``StepMetrics``.
    """

    signal: str
    phase: str
    start_s: float
    end_s: float
    before: float
    after: float
    alone: bool
    rise_s: float | None
    reach_s: float | None = None
    settling_s: float | None
    overshoot_percent: float | None
    steady_error: float | None
    cross_coupling: float | None
    reasons: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class RunCriterion:
    """One criterion. ``relation`` is "<" or ">".

    ``passed`` is None when it was not measured, and ``reason`` says why; ``figure`` is then what was seen, if anything.
    With a reason one that failed was not seen whole either: its figure is at least that where it has to stay below its
    bound, at most that where above.
    """

    name: str
    title: str
    relation: str
    bound: float
    figure: float | None
    unit: str
    passed: bool | None
    reason: str = ""


METRICS_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class Metrics:
    """Figures of a run; ``complete`` is False when it ended before its program: they then cover what was played.

    ``steps`` is None for a run that is not measured step by step, ``missing_samples`` where that was not kept;
    ``problem`` says why an identification gave no model; ``definitions`` is the version of what the figures mean.
    """

    complete: bool
    played_s: float
    planned_s: float
    figures: tuple[MeasuredFigure, ...] = ()
    steps: tuple[StepFigures, ...] | None = field(default=None, metadata=ABSENT)
    phases: tuple[Phase, ...] = ()
    missing_samples: int | None = None
    problem: str = ""
    version: int = METRICS_VERSION
    definitions: int = DEFINITIONS

    def value_of(self, name: str) -> float | None:
        """Return the figure of this name, None where it was not measured or is not there."""
        return next((item.value for item in self.figures if item.name == name), None)


METRICS: DocumentCodec[Metrics] = DocumentCodec(Metrics, "its result", METRICS_VERSION)
CRITERIA: DocumentCodec[tuple[RunCriterion, ...]] = DocumentCodec(tuple[RunCriterion, ...], "its criteria", 0)


# Outcome -------------------------------------------------------------------------------------------
#
# How a run counts, from its stored metrics and criteria: for its verdict, and for whoever looks for
# it. Pure.


class Outcome(StrEnum):
    """How a run counts."""

    PASSED = "passed"
    FAILED = "failed"
    INCOMPLETE = "incomplete"
    """it ended early, or not all of it could be measured"""
    NEUTRAL = "neutral"
    """there is nothing to judge it by"""


def judge_run(metrics: Metrics | None, criteria: Sequence[RunCriterion]) -> Outcome:
    """Judge a run; one criterion that failed decides, then one that was not measured."""
    if metrics is None or not metrics.complete:
        return Outcome.INCOMPLETE
    if not criteria:
        return Outcome.NEUTRAL
    if any(item.passed is False for item in criteria):
        return Outcome.FAILED
    return Outcome.INCOMPLETE if any(item.passed is None for item in criteria) else Outcome.PASSED


# Run settings --------------------------------------------------------------------------------------
#
# What a run was set to: its plan, the tuning and seed of the loop, and both declared with unit and
# meaning. Pure.
#
# A session has a tuning and a mode only.


Value = bool | int | float | str

LAMBDA, TIME_OPTIMAL = MOTIONS = ("lambda", "time-optimal")
"""The two ways to follow a reference: by the paper's law, or by a trajectory with feed-forward."""


@dataclass(frozen=True, kw_only=True)
class StoredLoopSettings:
    """The tuning that a run began with, as ``TuningSettings`` spells it, and the seed of the simulator.

    What an earlier version did not keep is None; ``bank`` 0 stands for gains from geometry.
    """

    lam_q: float | None = field(default=None, metadata=ABSENT)
    lam_S: float | None = field(default=None, metadata=ABSENT)
    lam_motor: float | None = field(default=None, metadata=ABSENT)
    b: float | None = field(default=None, metadata=ABSENT)
    bank: int | None = field(default=None, metadata=ABSENT)
    interpolate: bool | None = field(default=None, metadata=ABSENT)
    motion: str | None = field(default=None, metadata=ABSENT)
    u_plan: float | None = field(default=None, metadata=ABSENT)
    k_ext: float | None = field(default=None, metadata=ABSENT)
    seed: int | None = field(default=None, metadata=ABSENT)

    @property
    def budget(self) -> float:
        """Voltage limit [V] of the trajectory in use; 0 V in ``lambda``, which has none."""
        return self.u_plan if self.motion == TIME_OPTIMAL and self.u_plan is not None else 0.0

    def known(self) -> dict[str, Value]:
        """Return by name what was kept."""
        return replace_non_finite({name: value for name, value in vars(self).items() if value is not None})


@dataclass(frozen=True)
class KeptGrant:
    """What the machine granted to the loop of a run: ``priority`` of SCHED_FIFO, 0 under ordinary scheduling.

    ``refusals`` say what it did not grant, why, and the remedy.
    """

    priority: int
    memory_locked: bool
    timer_slack_ns: int
    refusals: tuple[str, ...]


@dataclass(frozen=True)
class DeclaredValue:
    """A setting as it was chosen, with symbol, unit and meaning, so that a stored run explains itself."""

    name: str
    symbol: str
    unit: str = field(metadata=describe_field("SI, 1 for what has none"))
    meaning: str
    value: Value


SETTINGS_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """All of it. ``mode`` is that of a session; ``versions`` are those of the packages that computed.

    ``granted`` is absent for a loop that is computed tick by tick, on no clock; ``walls``, what stood in the joint's
    way, where nothing did or where an earlier version kept nothing of it.
    """

    mode: str | None = field(default=None, metadata=ABSENT)
    plan: dict[str, Value] | None = field(default=None, metadata=ABSENT)
    loop: StoredLoopSettings = field(default_factory=StoredLoopSettings)
    declared: tuple[DeclaredValue, ...] | None = field(default=None, metadata=ABSENT)
    versions: dict[str, str] | None = field(default=None, metadata=ABSENT)
    granted: KeptGrant | None = field(default=None, metadata=ABSENT)
    walls: tuple[KeptWall, ...] | None = field(default=None, metadata=ABSENT)
    version: int = SETTINGS_VERSION

    @property
    def law(self) -> str:
        """The law that played the plan, as ``Law`` spells it: one that chose none had the cascade."""
        return str((self.plan or {}).get("controller", "cascade"))

    @property
    def experiment(self) -> str | None:
        """The text of the experiment; None where the plan is none that is data."""
        text = (self.plan or {}).get("experiment")
        return None if text is None else str(text)

    def told(self) -> dict[str, Value]:
        """Return plan and tuning by name."""
        return {**(self.plan or {}), **self.loop.known()}


def complete_motion(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Return parts of a tuning, with the motion that a voltage limit implies where they name none.

    A limit alone chooses ``time-optimal``; a limit of 0 V chooses ``lambda``.
    """
    if parts.get("motion") is not None or parts.get("u_plan") is None:
        return dict(parts)
    try:
        is_lambda = float(parts["u_plan"]) == 0.0
    except (TypeError, ValueError, OverflowError):
        return dict(parts)  # who reads the value refuses it
    if is_lambda:
        return {**{name: value for name, value in parts.items() if name != "u_plan"}, "motion": LAMBDA}
    return {**parts, "motion": TIME_OPTIMAL}


SETTINGS: DocumentCodec[RunSettings] = DocumentCodec(RunSettings, "what it was set to", SETTINGS_VERSION)


# Kept tuning ---------------------------------------------------------------------------------------
#
# A tuning that outlives the service: the one in force with the plant it was for, the one saved for
# a bank. Pure.


TUNING_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class StoredTuning:
    """The tuning in force, with all its parts; ``parameters`` tells the plant's numbers from others."""

    lam_q: float
    lam_S: float
    lam_motor: float
    b: float
    bank: int
    interpolate: bool
    motion: str
    u_plan: float
    k_ext: float
    parameters: str
    version: int = TUNING_VERSION


@dataclass(frozen=True, kw_only=True)
class SavedParts(StoredLoopSettings):
    """What a bank is meant to run with."""

    version: int = TUNING_VERSION


KEPT_TUNING: DocumentCodec[StoredTuning] = DocumentCodec(StoredTuning, "the tuning in force", TUNING_VERSION)
SAVED_TUNING: DocumentCodec[SavedParts] = DocumentCodec(SavedParts, "the tuning that was saved", TUNING_VERSION)


# Run banks -----------------------------------------------------------------------------------------
#
# The banks that the settings of a run name by their numbers: the one it began with, and those on
# its way. Pure.
#
# A change of the tuning names a bank by a number, or by a setting that is one. What computes the
# number otherwise can be given no other one, and is told.


BANK = "bank"
LARGEST = 2**31 - 1
"""Number of a record that no database exceeds."""


@dataclass(frozen=True)
class OnTheWay:
    """The banks that a plan puts into use, and the expressions that compute the number of one."""

    numbers: frozenset[int]
    computed: tuple[str, ...]


def list_changed_banks(settings: Mapping[str, Any]) -> OnTheWay:
    """Return the banks that a run changes to on its way; 0, gains from geometry, is none."""
    numbers: set[int] = set()

    def noted(number: int) -> int:
        numbers.add(number)
        return number

    renumbering = _Renumbering(noted, settings.get("plan"))
    return OnTheWay(frozenset(numbers), tuple(renumbering.computed))


def renumber_banks(settings: Mapping[str, Any], number: Callable[[int], int]) -> Document:
    """Return settings that name each bank by another number."""
    document = dict(settings)
    renumbering = _Renumbering(number, document.get("plan"))
    if isinstance(document.get("plan"), Mapping):
        document["plan"] = renumbering.plan
    loop, declared = document.get("loop"), document.get("declared")
    if isinstance(loop, Mapping) and BANK in loop:
        document["loop"] = {**loop, BANK: renumbering.value(loop[BANK])}
    if isinstance(declared, list):
        document["declared"] = [renumbering.declared(one) for one in declared]
    return document


def drop_first_bank(settings: Mapping[str, Any]) -> Document:
    """Return settings that say nothing of the bank that the run began with."""
    document = dict(settings)
    loop, declared = document.get("loop"), document.get("declared")
    if isinstance(loop, Mapping):
        document["loop"] = {name: value for name, value in loop.items() if name != BANK}
    if isinstance(declared, list):
        document["declared"] = [one for one in declared if not isinstance(one, Mapping) or one.get("name") != BANK]
    return document


class _Renumbering:
    """A plan with other numbers of banks; ``settings`` of it are numbers of banks too."""

    def __init__(self, number: Callable[[int], int], plan: Any) -> None:
        self._number = number
        self._values: Mapping[str, Any] = plan if isinstance(plan, Mapping) else {}
        self._settings: set[str] = set()
        self.computed: list[str] = []
        experiment = _experiment(self._values)
        phases = self._part(experiment.get("phases"))
        self.plan = {
            name: self.value(value) if name in self._settings else value for name, value in self._values.items()
        }
        if self._settings or phases != experiment.get("phases"):
            renumbered = {**experiment, "phases": phases}
            if isinstance(experiment.get("settings"), list):
                renumbered["settings"] = [self._unbounded(one) for one in experiment["settings"]]
            self.plan["experiment"] = json.dumps(renumbered, ensure_ascii=False, separators=(",", ":"))

    def value(self, value: Any) -> Any:
        """Return what stands in the place of the number of a bank."""
        number = _whole(value)
        return self._number(number) if number else value

    def declared(self, one: Any) -> Any:
        """Return a declared value, of a bank with the other number."""
        named = isinstance(one, Mapping) and one.get("name") in {BANK, *self._settings}
        return {**one, "value": self.value(one.get("value"))} if named else one

    def _part(self, part: Any) -> Any:
        """Return a part of an experiment, as far as it is played."""
        if isinstance(part, list):
            return [self._part(one) for one in part]
        if not isinstance(part, Mapping):
            return part
        match part.get("do"):
            case "tuning" if part.get(BANK) is not None:
                return {**part, BANK: self._named(part[BANK])}
            case "choose" if isinstance(part.get("of"), Mapping):
                chosen = str(self._values.get(str(part.get("by"))))
                played = {name: self._part(one) if name == chosen else one for name, one in part["of"].items()}
                return {**part, "of": played}
            case _:
                return {**part, "parts": self._part(part["parts"])} if "parts" in part else part

    def _named(self, bank: Any) -> Any:
        if isinstance(bank, str) and _whole(self._values.get(bank)) is not None:
            self._settings.add(bank)
            self.value(self._values[bank])
            return bank
        if _whole(bank) is None:
            self.computed.append(str(bank))
        return self.value(bank)

    def _unbounded(self, setting: Any) -> Any:
        """Return a setting that is the number of a bank with the bounds of such numbers: elsewhere it is another."""
        if not isinstance(setting, Mapping) or setting.get("name") not in self._settings:
            return setting
        return {**setting, "minimum": 0, "maximum": LARGEST}


def _experiment(plan: Mapping[str, Any]) -> Mapping[str, Any]:
    try:
        found = json.loads(plan["experiment"])
    except (KeyError, TypeError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, Mapping) else {}


def _whole(value: Any) -> int | None:
    """Return a number of a bank; None for what is none as it stands."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return int(float(value))
    except (ValueError, OverflowError):
        return None


# Headline ------------------------------------------------------------------------------------------
#
# The figure of a result that a list of runs shows beside the verdict. Pure.


@dataclass(frozen=True)
class RunHeadline:
    """A figure in SI. ``relation`` and ``bound`` are those of its criterion; "" and None for a figure without one."""

    __pydantic_config__ = COMPLETE_RESPONSE_CONFIG

    name: str
    label: str
    value: float
    unit: str = field(metadata=describe_field("SI, 1 for what has none"))
    relation: str = field(
        default="", metadata=describe_field("of the criterion it was judged by, < or >; empty without a criterion")
    )
    bound: float | None = field(default=None, metadata=describe_field("bound of that criterion, null without one"))


def find_headline(
    metrics: Metrics | None, criteria: Sequence[RunCriterion], fits: Mapping[str, float] | None = None
) -> RunHeadline | None:
    """Return the first criterion that failed, else the first measured one, else the first measured figure.

    Of an identification ``fits`` are those of its channels [%]: the lower one comes before any figure of the motion.
    None where nothing was measured.
    """
    for item in sorted(criteria, key=lambda item: item.passed is not False):
        if item.figure is not None:
            return RunHeadline(
                name=item.name,
                label=item.title,
                value=item.figure,
                unit=item.unit,
                relation=item.relation,
                bound=item.bound,
            )
    if fits:
        channel = min(fits, key=lambda name: fits[name])
        return RunHeadline("fit_percent", f"Fit of {channel}", fits[channel], "%")
    for figure in metrics.figures if metrics is not None else ():
        if figure.value is not None:
            return RunHeadline(figure.name, figure.label, figure.value, figure.unit)
    return None
