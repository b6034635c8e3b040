"""Documents that a run stores: settings, plant, walls, banks and result. Pure.

Numbers are in SI. None stands for a value that does not exist, or that an earlier version did not store.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from backend.models.document import ABSENT, Document, DocumentCodec, replace_non_finite
from backend.response_docs import COMPLETE_RESPONSE_CONFIG, describe_field
from plant import Obstacle

# Bank entry ----------------------------------------------------------------------------------------


ENTRY_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class EntryModel:
    """First-order models of one bank entry, from θ_ref to q and to S.

    K_q [rad/rad], T_q [s], K_S [N·m/rad per rad], T_S [s]; None for a value that an imported entry lacks.
    """

    K_q: float | None = field(default=None, metadata=ABSENT)
    T_q: float | None = field(default=None, metadata=ABSENT)
    K_S: float | None = field(default=None, metadata=ABSENT)
    T_S: float | None = field(default=None, metadata=ABSENT)
    tension_N: float | None = field(default=None, metadata=ABSENT)
    version: int = ENTRY_VERSION


ENTRY: DocumentCodec[EntryModel] = DocumentCodec(EntryModel, "its models", ENTRY_VERSION)


# Walls ---------------------------------------------------------------------------------------------
# Changes of the obstacle of a simulated joint during a run.


MAX_WALL_CHANGES = 1000
"""Number of changes stored for a run; with more, the obstacle after the last stored change is unknown."""


@dataclass(frozen=True)
class StoredWall:
    """Obstacle from ``t`` [s] after the first sample of the run on.

    ``side`` 0 is no obstacle, else as in Obstacle.
    """

    t: float
    side: float
    q_wall: float
    k_wall: float
    c_wall: float

    @property
    def obstacle(self) -> Obstacle | None:
        """The obstacle, or None."""
        return Obstacle(self.side, self.q_wall, self.k_wall, self.c_wall) if self.side else None


def build_stored_wall(t: float, wall: Obstacle | None) -> StoredWall:
    """Return the stored form of a change at ``t`` [s]."""
    return StoredWall(t, 0.0, 0.0, 0.0, 0.0) if wall is None else StoredWall(t, *map(float, wall))


def merge_wall_changes(earlier: Sequence[StoredWall], later: Sequence[StoredWall]) -> tuple[StoredWall, ...]:
    """Return all changes by time, that of ``later`` if two have the same time.

    Of more than MAX_WALL_CHANGES, the last one stored says that there is no known wall.
    """
    by_time = {change.t: change for change in (*earlier, *later)}
    changes = [by_time[t] for t in sorted(by_time)]
    if len(changes) > MAX_WALL_CHANGES:
        changes = [*changes[: MAX_WALL_CHANGES - 1], build_stored_wall(changes[MAX_WALL_CHANGES - 1].t, None)]
    return tuple(changes)


def find_wall_at(changes: Sequence[StoredWall], t: float) -> Obstacle | None:
    """Return the obstacle at ``t`` [s] after the first sample of the run, or None."""
    before = [change for change in changes if change.t <= t]
    return before[-1].obstacle if before else None


# Plant parameters ----------------------------------------------------------------------------------
# By section and entry, as in ``PlantParameters.document``.


@dataclass(frozen=True)
class StoredPlantNumber:
    """A number, or a list of points, with its unit and its source."""

    value: Any
    unit: str = ""
    source: str = ""


PlantNumbers = dict[str, dict[str, StoredPlantNumber]]

PLANT_NUMBERS: DocumentCodec[PlantNumbers] = DocumentCodec(PlantNumbers, "the parameters of its plant", 0)


# Applied parameters --------------------------------------------------------------------------------
# Identified parameters of motors and springs that replace those of the parameter file.


APPLIED_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class AppliedParameters:
    """Sections ``identified``, ``identified_A`` and ``identified_B``.

    They are empty if the parameter file applies. ``base`` is the digest of the parameter file that they change.
    ``estimate`` is the stored identification that they come from and ``run`` its run, 0 for none. ``undone`` says that
    earlier values were restored.
    """

    base: str
    identified: PlantNumbers
    estimate: int = 0
    run: int = 0
    undone: bool = False
    version: int = APPLIED_VERSION


APPLIED: DocumentCodec[AppliedParameters] = DocumentCodec(
    AppliedParameters, "the record of the applied parameters", APPLIED_VERSION
)


# Result --------------------------------------------------------------------------------------------
# Metrics, steps and criteria computed from a run. Times are in s from the start of the program.


DEFINITIONS = 1
"""Version of the definitions of metrics and criteria, incremented with each change of a definition.
Results without a stored version have 0."""


@dataclass(frozen=True)
class Phase:
    """A named time range of a program [s from its start].

    The report draws one set of panels for each.
    """

    name: str
    title: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class MeasuredFigure:
    """A metric of a result.

    ``reason`` states why it, or a part of it, was not measured; else it is empty.
    """

    __pydantic_config__ = COMPLETE_RESPONSE_CONFIG

    name: str
    unit: str
    label: str
    definition: str
    value: float | None
    reason: str = field(
        default="",
        metadata=describe_field(
            "reason if it was not measured; with a value: reason why some steps were "
            "not measured, so the value is a lower bound"
        ),
    )


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """Metrics of one reference step of ``signal``, "q" or "S", as in ``StepMetrics``.

    ``alone`` says that the other reference was constant. ``reasons`` has, by metric, why it was not measured.
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
    """One criterion: a metric with a bound. ``relation`` is "<" or ">".

    ``passed`` is None if it was not measured; ``reason`` says why, and ``figure`` is the value of the measured part, if
    any. A failed criterion with a reason was measured in part: the value of the whole run is at least ``figure`` for
    "<", at most ``figure`` for ">".
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
    """Metrics of a run.

    ``complete`` is False if the run ended before its program; the metrics then cover the executed part. ``steps`` is
    None for a run that is not measured step by step. ``problem`` says why an identification gave no model.
    ``definitions`` is the version of the definitions of the metrics.
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

    def find_value(self, name: str) -> float | None:
        """Return the value of a metric, None if it was not measured or does not exist."""
        return next((item.value for item in self.figures if item.name == name), None)


METRICS: DocumentCodec[Metrics] = DocumentCodec(Metrics, "its result", METRICS_VERSION)
CRITERIA: DocumentCodec[tuple[RunCriterion, ...]] = DocumentCodec(tuple[RunCriterion, ...], "its criteria", 0)


# Outcome -------------------------------------------------------------------------------------------


class Outcome(StrEnum):
    """Outcome of a run by its criteria."""

    PASSED = "passed"
    FAILED = "failed"
    INCOMPLETE = "incomplete"
    """It ended early, or a criterion could not be measured."""
    NEUTRAL = "neutral"
    """It has no criteria."""


def judge_run(metrics: Metrics | None, criteria: Sequence[RunCriterion]) -> Outcome:
    """Return the outcome of a run.

    A failed criterion decides, then one that was not measured.
    """
    if metrics is None or not metrics.complete:
        return Outcome.INCOMPLETE
    if not criteria:
        return Outcome.NEUTRAL
    if any(item.passed is False for item in criteria):
        return Outcome.FAILED
    return Outcome.INCOMPLETE if any(item.passed is None for item in criteria) else Outcome.PASSED


# Settings ------------------------------------------------------------------------------------------


Value = bool | int | float | str

LAMBDA, TIME_OPTIMAL = MOTIONS = ("lambda", "time-optimal")
"""How references are followed: by the law of the paper, or by a trajectory with feed-forward."""


@dataclass(frozen=True, kw_only=True)
class StoredLoopSettings:
    """Initial tuning of a run, named as in ``TuningSettings``, and simulator seed.

    A value that an earlier version did not store is None; ``bank`` 0 stands for geometric gains.
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
        """Feed-forward voltage limit [V].

        0 V for motion ``lambda``, which uses no trajectory.
        """
        return self.u_plan if self.motion == TIME_OPTIMAL and self.u_plan is not None else 0.0

    def get_known_values(self) -> dict[str, Value]:
        """Return the stored values by name, without those that are None."""
        return replace_non_finite({name: value for name, value in vars(self).items() if value is not None})


@dataclass(frozen=True)
class StoredRealTimeStatus:
    """Real-time privileges that the operating system granted to the control loop of a run.

    ``priority`` is that of SCHED_FIFO, 0 for normal scheduling. ``refusals`` are texts with what was not granted, why,
    and the remedy.
    """

    priority: int
    memory_locked: bool
    timer_slack_ns: int
    refusals: tuple[str, ...]


@dataclass(frozen=True)
class DeclaredValue:
    """A chosen setting with symbol, unit and meaning."""

    name: str
    symbol: str
    unit: str = field(metadata=describe_field("SI; 1 for a value without a unit"))
    meaning: str
    value: Value


SETTINGS_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Settings of a run: plan, tuning, seed, and both declared with unit and meaning.

    A session has ``mode`` and tuning only. ``versions`` are those of the packages that computed the run. ``granted`` is
    absent for a simulated loop without a clock, ``walls`` if there was no obstacle or an earlier version stored none.
    """

    mode: str | None = field(default=None, metadata=ABSENT)
    plan: dict[str, Value] | None = field(default=None, metadata=ABSENT)
    loop: StoredLoopSettings = field(default_factory=StoredLoopSettings)
    declared: tuple[DeclaredValue, ...] | None = field(default=None, metadata=ABSENT)
    versions: dict[str, str] | None = field(default=None, metadata=ABSENT)
    granted: StoredRealTimeStatus | None = field(default=None, metadata=ABSENT)
    walls: tuple[StoredWall, ...] | None = field(default=None, metadata=ABSENT)
    version: int = SETTINGS_VERSION

    @property
    def law(self) -> str:
        """Control law of the run, as in ``Law``; the cascade if the plan chooses none."""
        return str((self.plan or {}).get("controller", "cascade"))

    @property
    def experiment(self) -> str | None:
        """Text of the experiment, None if the plan is not an experiment."""
        text = (self.plan or {}).get("experiment")
        return None if text is None else str(text)

    def get_values(self) -> dict[str, Value]:
        """Return the values of plan and tuning by name."""
        return {**(self.plan or {}), **self.loop.get_known_values()}


def complete_motion(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Return tuning parts, completed with the motion that a voltage limit implies.

    A limit without a motion selects ``time-optimal``; a limit of 0 V selects ``lambda``.
    """
    if parts.get("motion") is not None or parts.get("u_plan") is None:
        return dict(parts)
    try:
        is_lambda = float(parts["u_plan"]) == 0.0
    except (TypeError, ValueError, OverflowError):
        return dict(parts)  # parsing the value reports the error
    if is_lambda:
        return {**{name: value for name, value in parts.items() if name != "u_plan"}, "motion": LAMBDA}
    return {**parts, "motion": TIME_OPTIMAL}


SETTINGS: DocumentCodec[RunSettings] = DocumentCodec(RunSettings, "its settings", SETTINGS_VERSION)


# Active and saved tuning ---------------------------------------------------------------------------


TUNING_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class StoredTuning:
    """Last active tuning, with all its parts.

    ``parameters`` is the digest of the plant's parameters.
    """

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
class SavedLoopSettings(StoredLoopSettings):
    """Saved tuning of a bank."""

    version: int = TUNING_VERSION


ACTIVE_TUNING: DocumentCodec[StoredTuning] = DocumentCodec(StoredTuning, "the active tuning", TUNING_VERSION)
SAVED_TUNING: DocumentCodec[SavedLoopSettings] = DocumentCodec(SavedLoopSettings, "the saved tuning", TUNING_VERSION)


# Bank numbers in settings --------------------------------------------------------------------------
# A run names its initial bank by number, and so does a part of its experiment that changes the
# bank, directly or by a setting. A number that an expression computes cannot be replaced.


BANK = "bank"
MAX_RECORD_NUMBER = 2**31 - 1
"""Largest number of a record in any database."""


@dataclass(frozen=True)
class BankChanges:
    """Banks that a plan changes to: numbers, and expressions that compute a number."""

    numbers: frozenset[int]
    computed: tuple[str, ...]


def find_bank_changes(settings: Mapping[str, Any]) -> BankChanges:
    """Return the banks that a run changes to, without 0 for geometric gains."""
    numbers: set[int] = set()

    def collect(number: int) -> int:
        numbers.add(number)
        return number

    renumbering = _BankRenumbering(collect, settings.get("plan"))
    return BankChanges(frozenset(numbers), tuple(renumbering.computed))


def renumber_banks(settings: Mapping[str, Any], number: Callable[[int], int]) -> Document:
    """Return the settings with each bank number replaced by ``number`` of it."""
    document = dict(settings)
    renumbering = _BankRenumbering(number, document.get("plan"))
    if isinstance(document.get("plan"), Mapping):
        document["plan"] = renumbering.plan
    loop, declared = document.get("loop"), document.get("declared")
    if isinstance(loop, Mapping) and BANK in loop:
        document["loop"] = {**loop, BANK: renumbering.renumber(loop[BANK])}
    if isinstance(declared, list):
        document["declared"] = [renumbering.renumber_declared(one) for one in declared]
    return document


def remove_initial_bank(settings: Mapping[str, Any]) -> Document:
    """Return the settings without the initial bank."""
    document = dict(settings)
    loop, declared = document.get("loop"), document.get("declared")
    if isinstance(loop, Mapping):
        document["loop"] = {name: value for name, value in loop.items() if name != BANK}
    if isinstance(declared, list):
        document["declared"] = [one for one in declared if not isinstance(one, Mapping) or one.get("name") != BANK]
    return document


class _BankRenumbering:
    """Replaces the bank numbers of a plan.

    ``plan`` is the result, ``computed`` has the expressions whose numbers could not be replaced.
    """

    def __init__(self, number: Callable[[int], int], plan: Any) -> None:
        self._number = number
        self._values: Mapping[str, Any] = plan if isinstance(plan, Mapping) else {}
        self._bank_settings: set[str] = set()  # settings whose value is a bank number
        self.computed: list[str] = []
        experiment = _parse_experiment(self._values)
        phases = self._renumber_part(experiment.get("phases"))
        self.plan = {
            name: self.renumber(value) if name in self._bank_settings else value for name, value in self._values.items()
        }
        if self._bank_settings or phases != experiment.get("phases"):
            renumbered = {**experiment, "phases": phases}
            if isinstance(experiment.get("settings"), list):
                renumbered["settings"] = [self._widen_bounds(one) for one in experiment["settings"]]
            self.plan["experiment"] = json.dumps(renumbered, ensure_ascii=False, separators=(",", ":"))

    def renumber(self, value: Any) -> Any:
        """Return the new number of a bank.

        0 and values that are not a number are returned unchanged.
        """
        number = _parse_bank_number(value)
        return self._number(number) if number else value

    def renumber_declared(self, declared: Any) -> Any:
        """Return a declared setting, with the new number if it is a bank."""
        is_bank = isinstance(declared, Mapping) and declared.get("name") in {BANK, *self._bank_settings}
        return {**declared, "value": self.renumber(declared.get("value"))} if is_bank else declared

    def _renumber_part(self, part: Any) -> Any:
        """Return a part of an experiment, or a list of parts.

        Parts that are not executed are unchanged.
        """
        if isinstance(part, list):
            return [self._renumber_part(one) for one in part]
        if not isinstance(part, Mapping):
            return part
        match part.get("do"):
            case "tuning" if part.get(BANK) is not None:
                return {**part, BANK: self._renumber_reference(part[BANK])}
            case "choose" if isinstance(part.get("of"), Mapping):
                chosen = str(self._values.get(str(part.get("by"))))
                options = {
                    name: self._renumber_part(one) if name == chosen else one for name, one in part["of"].items()
                }
                return {**part, "of": options}
            case _:
                return {**part, "parts": self._renumber_part(part["parts"])} if "parts" in part else part

    def _renumber_reference(self, bank: Any) -> Any:
        """Return a bank reference: a new number, or the name of a setting with the number."""
        if isinstance(bank, str) and _parse_bank_number(self._values.get(bank)) is not None:
            self._bank_settings.add(bank)
            self.renumber(self._values[bank])
            return bank
        if _parse_bank_number(bank) is None:
            self.computed.append(str(bank))
        return self.renumber(bank)

    def _widen_bounds(self, setting: Any) -> Any:
        """Return a setting; one that is a bank number gets bounds that allow any number."""
        if not isinstance(setting, Mapping) or setting.get("name") not in self._bank_settings:
            return setting
        return {**setting, "minimum": 0, "maximum": MAX_RECORD_NUMBER}


def _parse_experiment(plan: Mapping[str, Any]) -> Mapping[str, Any]:
    try:
        experiment = json.loads(plan["experiment"])
    except (KeyError, TypeError, ValueError, RecursionError):
        return {}
    return experiment if isinstance(experiment, Mapping) else {}


def _parse_bank_number(value: Any) -> int | None:
    """Return a bank number, None for a value that is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return int(float(value))
    except (ValueError, OverflowError):
        return None


# Headline metric -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RunHeadline:
    """Metric that a list of runs shows.

    ``relation`` and ``bound`` of its criterion are "" and None without one.
    """

    __pydantic_config__ = COMPLETE_RESPONSE_CONFIG

    name: str
    label: str
    value: float
    unit: str = field(metadata=describe_field("SI; 1 for a value without a unit"))
    relation: str = field(
        default="", metadata=describe_field("relation of its criterion, < or >; empty without a criterion")
    )
    bound: float | None = field(
        default=None, metadata=describe_field("bound of its criterion; null without a criterion")
    )


def find_headline(
    metrics: Metrics | None, criteria: Sequence[RunCriterion], fits: Mapping[str, float] | None = None
) -> RunHeadline | None:
    """Return the first failed criterion, else the first measured one, else a metric.

    The metric is the first measured one. For an identification, ``fits`` are the fits of its channels [%]; the lowest
    one precedes the metrics. None if nothing was measured.
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
