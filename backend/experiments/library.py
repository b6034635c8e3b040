"""The experiments that can be ordered by name: those that come with Sinew, recorded ones, stored plans."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.errors import InvalidValueError, OutOfRangeError
from backend.experiments import parser
from backend.experiments.compiler import LONGEST_PART_S
from backend.experiments.parser import ExperimentError, Lines, read
from backend.experiments.parser import settings_of as settings_of_parser
from backend.experiments.plans import (
    KIND,
    ActuatorIdentificationPlan,
    ExperimentPlan,
    IdentificationPlan,
    MotorIdentificationPlan,
    Plan,
    SpringIdentificationPlan,
    composed,
)
from backend.experiments.schema import Experiment
from backend.models import (
    DeclaredValue,
    Setting,
    SettingError,
    Value,
    build_plan,
    describe_settings,
    describe_values,
    upgrades,
)
from backend.realtime import MAX_SEGMENTS
from plant import T_s

# Ready made ----------------------------------------------------------------------------------------
#
# The experiments that come with Sinew: files of data, with nothing that an own one cannot do.


NAMES = (
    "tracking",
    "compliance",
    "robustness",
    "step_battery",
    "stiffness_sweep",
    "lambda_sweep",
    "motion_comparison",
    "bank_comparison",
    "disturbance_battery",
    "frequency_response",
    "hold_at_rest",
    "impact",
)
"""In the order in which they are offered."""


@cache
def ready_made(name: str) -> tuple[Experiment, Lines]:
    """Return one with the lines of its file. Raises KeyError."""
    return read(text_of(name))


def text_of(name: str) -> str:
    """Return the text of one, to begin an own one with. Raises KeyError."""
    if name not in NAMES:
        raise KeyError(name)
    return files(__package__).joinpath("ready", f"{name}.yaml").read_text(encoding="utf-8")


# Recorded ------------------------------------------------------------------------------------------
#
# Recorded references, pushes and changes as the parts of an experiment that follow them closely.
# Pure.


Column = NDArray[np.float64]

WITHIN_Q_RAD = 1e-3
WITHIN_S = 0.02
WITHIN_F_N = 0.05
"""How far a straight way may be off the recorded columns at any tick [rad, N·m/rad, N]."""

_SAME = 2e-3
"""Of a bound: numbers that are off by less are the same, but for how they were written."""
_DECIMALS = 6
"""Of what is written, in SI: finer than a bound, and short."""
LEAST = 10
"""Ticks of the shortest part that an experiment may have."""
_MOST = round(LONGEST_PART_S / T_s)


class ReferenceChange(NamedTuple):
    """A part without a duration that is due at a tick of the references: a tuning or a wall."""

    tick: int
    part: dict[str, Any]


class RecordedParts(NamedTuple):
    """Parts that follow recorded columns, and how far they are off them at most.

    ``late_ticks`` is how late the latest push or change comes. ``unpushed`` are the ticks, first and end, of which the
    push is left out: the references move then, and a push part holds them.
    """

    parts: list[dict[str, Any]]
    off_q_rad: float
    off_S: float
    off_F_N: float
    late_ticks: int
    unpushed: list[tuple[int, int]]


def find_commanded_range(q_ref: Column, S_ref: Column) -> tuple[int, int]:
    """Return the first tick with references and the end of them.

    Raises ExperimentError for no references, and for a gap in them.
    """
    there = np.isfinite(q_ref) & np.isfinite(S_ref)
    if not there.any():
        raise ExperimentError("it has no references: nothing was commanded that could be played again")
    first, end = int(np.argmax(there)), len(there) - int(np.argmax(there[::-1]))
    if not there[first:end].all():
        raise ExperimentError("its references have a gap: what was commanded within it is not known")
    return first, end


def follow_columns(
    q: Column, S: Column, F_push: Column | None = None, changes: Sequence[ReferenceChange] = ()
) -> RecordedParts:
    """Return parts that bring references and push, tick by tick, to where these columns are.

    ``changes`` are in order of their ticks. Where a jump and a way, or two changes, come closer together than a part
    can be short, the parts are off by more than the bounds: how far is told. Raises ExperimentError for more parts than
    an experiment can have.
    """
    return _Follower(q, S, np.zeros(len(q)) if F_push is None else F_push, changes).followed()


class _Follower:
    """Goes through the columns part by part: ``_at`` is the tick, ``_reached`` where the parts so far have led."""

    def __init__(self, q: Column, S: Column, F: Column, changes: Sequence[ReferenceChange]) -> None:
        self._q, self._S, self._F = q, S, F
        self._changes = list(changes)
        self._edges = np.flatnonzero(np.diff(F != 0.0)) + 1
        self._at = 0
        self._reached = (np.nan, np.nan)
        self._force = 0.0
        self._parts: list[dict[str, Any]] = []
        self._off = (0.0, 0.0, 0.0)
        self._late = 0
        self._unpushed: list[tuple[int, int]] = []

    def followed(self) -> RecordedParts:
        while self._at < len(self._q):
            self._change()
            bound = self._bound()
            if not (self._F[self._at] != 0.0 and self._push(bound)):
                self._move(bound)
            if len(self._parts) > MAX_SEGMENTS:
                raise ExperimentError(
                    f"its references take more than {MAX_SEGMENTS} holds and ramps, as many as an experiment can have: "
                    "compose it of parts"
                )
        return RecordedParts(self._parts, *self._off, self._late, self._unpushed)

    def _change(self) -> None:
        """Add what is due, of several changes of one kind the last one; a tuning takes over what others changed."""
        due = [change for change in self._changes if change.tick <= self._at]
        self._changes = self._changes[len(due) :]
        tuning: dict[str, Any] = {}
        wall: dict[str, Any] | None = None
        for change in due:
            self._late = max(self._late, self._at - change.tick)
            if change.part["do"] == "tuning":
                tuning |= change.part
            else:
                wall = change.part
        self._parts += [part for part in (tuning, wall) if part]

    def _bound(self) -> int:
        """Return the tick at which the next part has to end: of a change, or where a push begins or ends."""
        later = [change.tick for change in self._changes[:1]]
        edges = self._edges[self._edges > self._at]
        return min(len(self._q), *later, *(int(edge) for edge in edges[:1]), self._at + _MOST)

    def _push(self, bound: int) -> bool:
        """Add a push up to where the references move; whether they rest long enough for one."""
        at, (q, S) = self._at, self._reached
        rest = slice(at, bound)
        moves = np.abs(self._q[rest] - q) > _SAME * WITHIN_Q_RAD
        moves |= np.abs(self._S[rest] - S) > _SAME * WITHIN_S
        if not np.isfinite(q) or moves[0]:
            return False
        bound = at + int(np.argmax(moves)) if moves.any() else bound
        if bound - at < LEAST and moves.any():
            return False
        F = self._F[:bound]
        end, shape = _held([(F, WITHIN_F_N)], at), "step"
        if end - at < LEAST and end < bound:
            for within in (_SAME, 1.0):
                ramp = _ramped([(F, self._force, WITHIN_F_N)], at, within)
                if ramp - at >= LEAST:
                    end, shape = ramp, "ramp"
                    break
        end = max(end, at + LEAST)
        last = min(end, len(self._F)) - 1
        force = round(float(self._F[at if shape == "step" else last]), _DECIMALS)
        share = np.arange(1, end - at + 1) / (end - at) if shape == "ramp" else np.ones(end - at)
        off = _off(column=self._F, at=at, share=share, before=self._force, after=force, most=self._off[2])
        self._off = *self._off[:2], off
        part = {"do": "push", "F_push": force, "duration_s": round((end - at) * T_s, 3)}
        self._parts.append(part if shape == "step" else {**part, "shape": shape})
        self._at, self._force = end, force
        return True

    def _move(self, bound: int) -> None:
        """Add a hold, a step or a ramp of the references; no push is felt during it."""
        at, pushed = self._at, bool(self._F[self._at] != 0.0)
        q, S = self._q[:bound], self._S[:bound]
        columns = [(q, WITHIN_Q_RAD), (S, WITHIN_S)]
        # during a push a jump is as short as a part can be, so that the push goes on
        held = end = min(_held(columns, at), at + LEAST if pushed else bound)
        ramp = False
        for within in (_SAME, 1.0):  # what was a ramp is one again; what was none is followed by several
            if end - at < LEAST and at > 0:
                ways = [(column, start, bound) for (column, bound), start in zip(columns, self._reached, strict=True)]
                end = _ramped(ways, at, within)
                ramp = end - at >= LEAST
        end = max(end if ramp else held, at + LEAST)
        last = min(end, len(self._q)) - 1
        arrived = round(float(self._q[last]), _DECIMALS), round(float(self._S[last]), _DECIMALS)
        self._parts.append(_part("ramp" if ramp else "step", end - at, self._reached, arrived))
        share = np.arange(1, end - at + 1) / (end - at) if ramp else np.ones(end - at)
        off_q = _off(column=self._q, at=at, share=share, before=self._reached[0], after=arrived[0], most=self._off[0])
        off_S = _off(column=self._S, at=at, share=share, before=self._reached[1], after=arrived[1], most=self._off[1])
        self._off = off_q, off_S, self._off[2]
        if pushed:
            self._unpushed = _joined(self._unpushed, at, min(end, int(self._edge(at))))
        elif (begun := self._edge(at)) < end:
            self._late = max(self._late, end - begun)
        self._at, self._reached, self._force = end, arrived, 0.0

    def _edge(self, at: int) -> int:
        """Return the tick at which a push begins or ends next."""
        edges = self._edges[self._edges > at]
        return int(edges[0]) if len(edges) else len(self._F)


def _joined(stretches: list[tuple[int, int]], begin: int, end: int) -> list[tuple[int, int]]:
    if stretches and stretches[-1][1] == begin:
        return [*stretches[:-1], (stretches[-1][0], end)]
    return [*stretches, (begin, end)]


def _part(do: str, ticks: int, before: Sequence[float], after: Sequence[float]) -> dict[str, Any]:
    named = {name: new for name, old, new in zip(("q_ref", "S_ref"), before, after, strict=True) if new != old}
    return {"do": do if named else "hold", **named, "duration_s": round(ticks * T_s, 3)}


def _off(column: Column, at: int, share: Column, before: float, after: float, most: float) -> float:
    """Return how far a part is off at most, or ``most`` where that is more."""
    recorded = column[at : at + len(share)]
    way = after - (1.0 - share[: len(recorded)]) * (0.0 if np.isnan(before) else after - before)
    return max(most, float(np.max(np.abs(way - recorded))))


def _held(columns: Sequence[tuple[Column, float]], at: int) -> int:
    """Return the end of the ticks from ``at`` on in which each column stays where it is, by its bound."""
    off = np.zeros(len(columns[0][0]) - at, bool)
    for column, within in columns:
        off |= np.abs(column[at:] - column[at]) > _SAME * within
    return at + int(np.argmax(off)) if off.any() else at + len(off)


def _ramped(ways: Sequence[tuple[Column, float, float]], at: int, share: float) -> int:
    """Return the end of the longest straight way from where the tick before ``at`` left each column.

    A way is a column, where it starts and its bound. The slopes that pass every tick within ``share`` of its bound form
    a cone, which narrows; the way ends at the last tick that lies in it itself. Looked at is twice as much as long as
    all of it does.
    """
    span, length = 64, len(ways[0][0])
    while True:
        ticks = np.arange(1, min(span, length - at) + 1)
        inside = np.ones(len(ticks), bool)
        open_still = True
        for column, start, within in ways:
            slopes = (column[at : at + len(ticks)] - start) / ticks
            low = np.maximum.accumulate(slopes - share * within / ticks)
            high = np.minimum.accumulate(slopes + share * within / ticks)
            inside &= (slopes >= low) & (slopes <= high)
            open_still = open_still and bool(low[-1] <= high[-1])
        if not open_still or at + len(ticks) == length:
            ends = np.flatnonzero(inside)
            return at + int(ends[-1]) + 1 if len(ends) else at
        span *= 2


# Stored plan ---------------------------------------------------------------------------------------
#
# Plans of all kinds alike: what a run keeps of one, what it declares, and the plan of a stored run.
# Pure.


KINDS: dict[str, type[Any]] = {
    plan.kind: plan for plan in (ActuatorIdentificationPlan, MotorIdentificationPlan, SpringIdentificationPlan)
}
"""Plans that are written in Python, by the kind of their runs."""

OF_THE_PAPER = ("tracking", "compliance", "robustness")
"""Ready-made experiments whose runs are of a kind of their own, as they were before experiments were data."""


def build_ready_plan(name: str, **values: Any) -> ExperimentPlan:
    """Return the plan of a ready-made experiment. Raises KeyError, SettingError, OutOfRangeError, ExperimentError."""
    experiment, lines = ready_made(name)
    return composed(experiment, values, name if name in OF_THE_PAPER else KIND, lines)


def settings_of(plan: Plan) -> tuple[Setting, ...]:
    """Return the settings that a plan declares."""
    return plan.settings if isinstance(plan, ExperimentPlan) else describe_settings(type(plan))


def list_setting_values(plan: Plan) -> dict[str, Value]:
    """Return the settings of a plan by name."""
    return dict(plan.values) if isinstance(plan, ExperimentPlan) else asdict(plan)


def plan_values(plan: Plan) -> dict[str, Value]:
    """Return what a run keeps of its plan."""
    return plan.stored() if isinstance(plan, ExperimentPlan) else asdict(plan)


def declare_choice(plan: Plan) -> tuple[DeclaredValue, ...]:
    """Return what was chosen with symbol, unit and meaning."""
    if not isinstance(plan, ExperimentPlan):
        return describe_values(plan)
    return tuple(
        DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, plan.values[setting.name])
        for setting in plan.settings
    )


def parse_stored_plan(kind: str, kept: Mapping[str, Value]) -> Plan:
    """Return the plan of a stored run. One from before experiments were data keeps its settings alone.

    Raises SettingError, OutOfRangeError, ExperimentError for settings that have no meaning any more.
    """
    if kind in KINDS:
        plan: Plan = build_plan(KINDS[kind], kept)
        return plan
    if "experiment" not in kept:
        if kind not in OF_THE_PAPER:
            raise ExperimentError("what it played is kept in no form that is known")
        return build_ready_plan(kind, **kept)
    experiment = parser.parse_canonical(str(kept["experiment"]))
    return composed(experiment, {name: value for name, value in kept.items() if name != "experiment"}, kind)


# Catalogue -----------------------------------------------------------------------------------------
#
# The experiments that can be ordered by name, from the browser and from the command line alike.


@dataclass(frozen=True)
class ExperimentDefinition:
    """An experiment that can be ordered: the words that present it, its settings, and what makes a plan of values.

    ``run_kind`` is the kind of its runs; ``written`` the experiment where it is data; ``instead`` what to order in the
    place of one that is deprecated: it is taken, and not offered.
    """

    name: str
    title: str
    description: str
    settings: tuple[Setting, ...]
    make: Callable[[Mapping[str, Any]], Plan]
    run_kind: str
    written: Experiment | None = None
    instead: str = ""

    @cached_property
    def usual(self) -> Plan:
        """The plan with all settings at their defaults."""
        return self.make({})


def build_library_entry(
    experiment: Experiment, lines: Lines | None = None, *, name: str = "", run_kind: str = KIND
) -> ExperimentDefinition:
    """Return the entry of an experiment that is data. Raises ExperimentError for one that cannot be played."""
    where = {} if lines is None else lines
    entry = ExperimentDefinition(
        name=name or experiment.name,
        title=experiment.title,
        description=experiment.description,
        settings=settings_of_parser(experiment, where),
        make=lambda values: composed(experiment, values, run_kind, where),
        run_kind=run_kind,
        written=experiment,
    )
    _ = entry.usual
    return entry


@cache
def experiments_by_name() -> Mapping[str, ExperimentDefinition]:
    """Return the experiments that come with Sinew, by name, and what is taken in their place."""
    ready = {
        name: build_library_entry(*ready_made(name), run_kind=name if name in OF_THE_PAPER else KIND) for name in NAMES
    }
    return {**ready, upgrades.SEQUENCE: _sequence_entry()}


_SEGMENTS = Setting(
    name=upgrades.SEGMENTS,
    kind="text",
    symbol="segments",
    unit="1",
    meaning='JSON list of segments: duration_s [s], q_ref [rad], S_ref [N·m/rad], F_push [N], shape "step", "ramp" or '
    '"sine" around the values before, period_s [s] of a sine',
    default="""[
  {"duration_s": 4, "q_ref": 0, "S_ref": 10},
  {"duration_s": 4, "q_ref": 0.5, "S_ref": 10},
  {"duration_s": 4, "q_ref": -0.5, "S_ref": 12, "shape": "ramp"},
  {"duration_s": 8, "q_ref": -0.2, "S_ref": 12, "shape": "sine", "period_s": 4}
]""",
    maximum=parser.MAX_CHARACTERS,
)


def _sequence_entry() -> ExperimentDefinition:
    """Return what takes a list of segments, as own experiments were once written, and makes an experiment of it."""

    def make(values: Mapping[str, Any]) -> ExperimentPlan:
        segments = _SEGMENTS.parse(values.get(_SEGMENTS.name, _SEGMENTS.default))
        document = upgrades.convert_sequence(segments)
        if document is None:
            raise SettingError(_SEGMENTS.name, str(segments)[:40], f"it needs a {_SEGMENTS.meaning}")
        try:
            return composed(parser.of_document(document, {}), {}, upgrades.SEQUENCE)
        except ExperimentError as error:
            raise _of_segment(error) from None

    return ExperimentDefinition(
        name=upgrades.SEQUENCE,
        title="Own sequence",
        description="Steps, ramps and sines of both references, one after the other, as a JSON list of segments.",
        settings=(_SEGMENTS,),
        make=make,
        run_kind=upgrades.SEQUENCE,
        instead="write an experiment: its parts step, ramp and sine take the same numbers (docs/how-to/experiments.md)",
    )


def _of_segment(error: ExperimentError) -> InvalidValueError:
    """Return the error that names a segment in place of the part that it became."""
    match error.path, error.why:
        case ("phases", 0, "parts", int(place), *rest), OutOfRangeError() as why:
            return OutOfRangeError(
                quantity=why.quantity,
                value=why.value,
                minimum=why.minimum,
                maximum=why.maximum,
                unit=why.unit,
                remedy=why.remedy,
                words=f"segment {place + 1}, {why.words}",
                path=(_SEGMENTS.name, place, *rest),
            )
        case _:
            return error


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


def find_experiment(name: str) -> ExperimentDefinition:
    """Return the experiment of this name. Raises SettingError with those there are."""
    known = experiments_by_name()
    if name not in known:
        raise SettingError("name", name, f"there is no such experiment; known: {', '.join(known)}", legal=tuple(known))
    return known[name]
