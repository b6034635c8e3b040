"""The library of experiments: those shipped with Sinew, recorded ones, and the plans of stored runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import STIFFNESS_RANGE, compute_bounds
from backend.errors import InvalidValueError, OutOfRangeError
from backend.experiments import messages, parser
from backend.experiments.compiler import PART_MAX_S
from backend.experiments.parser import ExperimentError, Lines, build_settings, parse_experiment
from backend.experiments.plans import (
    KIND,
    ActuatorIdentificationPlan,
    ExperimentPlan,
    IdentificationPlan,
    MotorIdentificationPlan,
    Plan,
    SpringIdentificationPlan,
    build_experiment_plan,
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
from plant import PlantParameters, T_s

# Ready-made experiments ----------------------------------------------------------------------------
# The experiments shipped with Sinew: YAML files in the format that users write.


READY_NAMES = (
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
"""Names in the order in which the page lists them."""


@cache
def load_ready_experiment(name: str) -> tuple[Experiment, Lines]:
    """Return a ready-made experiment and the lines of its file. Raises KeyError."""
    return parse_experiment(load_ready_text(name))


def load_ready_text(name: str) -> str:
    """Return the text of a ready-made experiment, as a template. Raises KeyError."""
    if name not in READY_NAMES:
        raise KeyError(name)
    return files(__package__).joinpath("ready", f"{name}.yaml").read_text(encoding="utf-8")


# Recorded references -------------------------------------------------------------------------------
# Converts recorded references, pushes and changes to parts of an experiment that approximate them.


Column = NDArray[np.float64]

TOLERANCE_Q_RAD = 1e-3
TOLERANCE_S = 0.02
TOLERANCE_F_N = 0.05
"""Largest deviation of the parts from the recorded columns at any tick [rad, N·m/rad, N]."""

_SAME_FRACTION = 2e-3
"""Fraction of a tolerance below which a deviation is only a rounding error of the recording."""
_DECIMALS = 6
"""Decimals of written numbers, in SI units: finer than the tolerances."""
PART_MIN_TICKS = 10
"""Minimum length of a part [ticks]."""
_TICKS_MAX = round(PART_MAX_S / T_s)


class ReferenceChange(NamedTuple):
    """A part without duration that is due at a tick of the references: a tuning or an obstacle."""

    tick: int
    part: dict[str, Any]


class RecordedParts(NamedTuple):
    """Parts that approximate recorded columns, and their largest deviations.

    ``delay_ticks`` is the largest delay of a push or change. ``unpushed`` are the intervals (first tick, end) in which
    a push is left out, because a push part would hold references that move.
    """

    parts: list[dict[str, Any]]
    deviation_q_rad: float
    deviation_S: float
    deviation_F_N: float
    delay_ticks: int
    unpushed: list[tuple[int, int]]


def find_commanded_range(q_ref: Column, S_ref: Column) -> tuple[int, int]:
    """Return the first tick with references and the tick after the last one.

    Raises ExperimentError for no references, and for a gap in them.
    """
    has_reference = np.isfinite(q_ref) & np.isfinite(S_ref)
    if not has_reference.any():
        raise ExperimentError(messages.no_recorded_references())
    first, end = int(np.argmax(has_reference)), len(has_reference) - int(np.argmax(has_reference[::-1]))
    if not has_reference[first:end].all():
        raise ExperimentError(messages.gap_in_references())
    return first, end


def approximate_columns(
    q: Column, S: Column, F_push: Column | None = None, changes: Sequence[ReferenceChange] = ()
) -> RecordedParts:
    """Return parts whose references and pushes approximate these columns, one value per tick.

    ``changes`` are in order of their ticks. If a step and a ramp, or two changes, follow each other within the minimum
    length of a part, the deviation exceeds the tolerances; the result contains it. Raises ExperimentError for more
    parts than an experiment can have.
    """
    return _RecordedPartBuilder(q, S, np.zeros(len(q)) if F_push is None else F_push, changes).build_parts()


class _RecordedPartBuilder:
    """Builds the parts one after the other.

    ``_tick`` is the end of the parts so far, ``_references`` their final references.
    """

    def __init__(self, q: Column, S: Column, F: Column, changes: Sequence[ReferenceChange]) -> None:
        self._q, self._S, self._F = q, S, F
        self._changes = list(changes)
        self._push_edges = np.flatnonzero(np.diff(F != 0.0)) + 1
        self._tick = 0
        self._references = (np.nan, np.nan)
        self._force = 0.0
        self._parts: list[dict[str, Any]] = []
        self._deviations = (0.0, 0.0, 0.0)
        self._delay_ticks = 0
        self._unpushed: list[tuple[int, int]] = []

    def build_parts(self) -> RecordedParts:
        """Return the parts for all columns. Raises ExperimentError for too many parts."""
        while self._tick < len(self._q):
            self._add_changes()
            bound = self._find_latest_end()
            if not (self._F[self._tick] != 0.0 and self._add_push(bound)):
                self._add_motion(bound)
            if len(self._parts) > MAX_SEGMENTS:
                raise ExperimentError(messages.too_many_recorded_parts(maximum=MAX_SEGMENTS))
        return RecordedParts(self._parts, *self._deviations, self._delay_ticks, self._unpushed)

    def _add_changes(self) -> None:
        """Add the changes that are due: the last obstacle, and one tuning that combines all changes of the tuning."""
        due = [change for change in self._changes if change.tick <= self._tick]
        self._changes = self._changes[len(due) :]
        tuning: dict[str, Any] = {}
        wall: dict[str, Any] | None = None
        for change in due:
            self._delay_ticks = max(self._delay_ticks, self._tick - change.tick)
            if change.part["do"] == "tuning":
                tuning |= change.part
            else:
                wall = change.part
        self._parts += [part for part in (tuning, wall) if part]

    def _find_latest_end(self) -> int:
        """Return the latest end of the next part: at the next change, or where a push begins or ends."""
        later = [change.tick for change in self._changes[:1]]
        edges = self._push_edges[self._push_edges > self._tick]
        return min(len(self._q), *later, *(int(edge) for edge in edges[:1]), self._tick + _TICKS_MAX)

    def _add_push(self, bound: int) -> bool:
        """Add a push that ends before the references move; return False if they move too early for one."""
        at, (q, S) = self._tick, self._references
        rest = slice(at, bound)
        moves = np.abs(self._q[rest] - q) > _SAME_FRACTION * TOLERANCE_Q_RAD
        moves |= np.abs(self._S[rest] - S) > _SAME_FRACTION * TOLERANCE_S
        if not np.isfinite(q) or moves[0]:
            return False
        bound = at + int(np.argmax(moves)) if moves.any() else bound
        if bound - at < PART_MIN_TICKS and moves.any():
            return False
        F = self._F[:bound]
        end, shape = _find_hold_end([(F, TOLERANCE_F_N)], at), "step"
        if end - at < PART_MIN_TICKS and end < bound:
            for within in (_SAME_FRACTION, 1.0):
                ramp = _find_ramp_end([(F, self._force, TOLERANCE_F_N)], at, within)
                if ramp - at >= PART_MIN_TICKS:
                    end, shape = ramp, "ramp"
                    break
        end = max(end, at + PART_MIN_TICKS)
        last = min(end, len(self._F)) - 1
        force = round(float(self._F[at if shape == "step" else last]), _DECIMALS)
        share = np.arange(1, end - at + 1) / (end - at) if shape == "ramp" else np.ones(end - at)
        off = _compute_deviation(
            column=self._F, at=at, share=share, before=self._force, after=force, most=self._deviations[2]
        )
        self._deviations = *self._deviations[:2], off
        part = {"do": "push", "F_push": force, "duration_s": round((end - at) * T_s, 3)}
        self._parts.append(part if shape == "step" else {**part, "shape": shape})
        self._tick, self._force = end, force
        return True

    def _add_motion(self, bound: int) -> None:
        """Add a hold, a step or a ramp of the references, without a push."""
        at, is_pushed = self._tick, bool(self._F[self._tick] != 0.0)
        q, S = self._q[:bound], self._S[:bound]
        columns = [(q, TOLERANCE_Q_RAD), (S, TOLERANCE_S)]
        # during a push, a step has the minimum length, so that the push continues soon
        hold_end = end = min(_find_hold_end(columns, at), at + PART_MIN_TICKS if is_pushed else bound)
        ramp = False
        for within in (_SAME_FRACTION, 1.0):  # an original ramp is found exactly; other curves become several ramps
            if end - at < PART_MIN_TICKS and at > 0:
                ramps = [
                    (column, start, bound) for (column, bound), start in zip(columns, self._references, strict=True)
                ]
                end = _find_ramp_end(ramps, at, within)
                ramp = end - at >= PART_MIN_TICKS
        end = max(end if ramp else hold_end, at + PART_MIN_TICKS)
        last = min(end, len(self._q)) - 1
        final = round(float(self._q[last]), _DECIMALS), round(float(self._S[last]), _DECIMALS)
        self._parts.append(_build_part("ramp" if ramp else "step", end - at, self._references, final))
        share = np.arange(1, end - at + 1) / (end - at) if ramp else np.ones(end - at)
        deviation_q = _compute_deviation(
            column=self._q, at=at, share=share, before=self._references[0], after=final[0], most=self._deviations[0]
        )
        deviation_S = _compute_deviation(
            column=self._S, at=at, share=share, before=self._references[1], after=final[1], most=self._deviations[1]
        )
        self._deviations = deviation_q, deviation_S, self._deviations[2]
        if is_pushed:
            self._unpushed = _append_interval(self._unpushed, at, min(end, int(self._find_next_edge(at))))
        elif (edge := self._find_next_edge(at)) < end:
            self._delay_ticks = max(self._delay_ticks, end - edge)
        self._tick, self._references, self._force = end, final, 0.0

    def _find_next_edge(self, at: int) -> int:
        """Return the next tick at which a push begins or ends."""
        edges = self._push_edges[self._push_edges > at]
        return int(edges[0]) if len(edges) else len(self._F)


def _append_interval(intervals: list[tuple[int, int]], begin: int, end: int) -> list[tuple[int, int]]:
    if intervals and intervals[-1][1] == begin:
        return [*intervals[:-1], (intervals[-1][0], end)]
    return [*intervals, (begin, end)]


def _build_part(do: str, ticks: int, before: Sequence[float], after: Sequence[float]) -> dict[str, Any]:
    named = {name: new for name, old, new in zip(("q_ref", "S_ref"), before, after, strict=True) if new != old}
    return {"do": do if named else "hold", **named, "duration_s": round(ticks * T_s, 3)}


def _compute_deviation(column: Column, at: int, share: Column, before: float, after: float, most: float) -> float:
    """Return the largest deviation of a part, at least ``most``."""
    recorded = column[at : at + len(share)]
    path = after - (1.0 - share[: len(recorded)]) * (0.0 if np.isnan(before) else after - before)
    return max(most, float(np.max(np.abs(path - recorded))))


def _find_hold_end(columns: Sequence[tuple[Column, float]], at: int) -> int:
    """Return the end of the ticks from ``at`` on in which each column is constant within its tolerance."""
    off = np.zeros(len(columns[0][0]) - at, bool)
    for column, within in columns:
        off |= np.abs(column[at:] - column[at]) > _SAME_FRACTION * within
    return at + int(np.argmax(off)) if off.any() else at + len(off)


def _find_ramp_end(ramps: Sequence[tuple[Column, float, float]], at: int, share: float) -> int:
    """Return the end of the longest ramp from the value of each column before ``at``.

    Each item of ``ramps`` is a column, its initial value and its tolerance. The slopes that pass all ticks within
    ``share`` of the tolerance form a cone, which narrows with each tick. The ramp ends at the last tick whose own slope
    lies in the cone. The inspected span is doubled while the whole span can be one ramp.
    """
    span, length = 64, len(ramps[0][0])
    while True:
        ticks = np.arange(1, min(span, length - at) + 1)
        inside = np.ones(len(ticks), bool)
        can_continue = True
        for column, start, within in ramps:
            slopes = (column[at : at + len(ticks)] - start) / ticks
            low = np.maximum.accumulate(slopes - share * within / ticks)
            high = np.minimum.accumulate(slopes + share * within / ticks)
            inside &= (slopes >= low) & (slopes <= high)
            can_continue = can_continue and bool(low[-1] <= high[-1])
        if not can_continue or at + len(ticks) == length:
            ends = np.flatnonzero(inside)
            return at + int(ends[-1]) + 1 if len(ends) else at
        span *= 2


# Stored plans --------------------------------------------------------------------------------------
# Conversion between plans of all kinds and the values that a run stores.


KINDS: dict[str, type[Any]] = {
    plan.kind: plan for plan in (ActuatorIdentificationPlan, MotorIdentificationPlan, SpringIdentificationPlan)
}
"""Plans of identifications, by the kind of their runs."""

PAPER_EXPERIMENTS = ("tracking", "compliance", "robustness")
"""Ready-made experiments whose runs have their own kind, as before experiments were documents."""


def build_ready_plan(name: str, **values: Any) -> ExperimentPlan:
    """Return the plan of a ready-made experiment.

    Raises KeyError, SettingError, OutOfRangeError, ExperimentError.
    """
    experiment, lines = load_ready_experiment(name)
    return build_experiment_plan(experiment, values, name if name in PAPER_EXPERIMENTS else KIND, lines)


def list_settings(plan: Plan) -> tuple[Setting, ...]:
    """Return the settings that a plan declares."""
    return plan.settings if isinstance(plan, ExperimentPlan) else describe_settings(type(plan))


def list_setting_values(plan: Plan) -> dict[str, Value]:
    """Return the settings of a plan by name."""
    return dict(plan.values) if isinstance(plan, ExperimentPlan) else asdict(plan)


def list_stored_values(plan: Plan) -> dict[str, Value]:
    """Return the values of a plan to store with its run."""
    return plan.to_stored_values() if isinstance(plan, ExperimentPlan) else asdict(plan)


def describe_plan_values(plan: Plan) -> tuple[DeclaredValue, ...]:
    """Return the settings of a plan with value, symbol, unit and meaning."""
    if not isinstance(plan, ExperimentPlan):
        return describe_values(plan)
    return tuple(
        DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, plan.values[setting.name])
        for setting in plan.settings
    )


def parse_stored_plan(kind: str, stored_values: Mapping[str, Value]) -> Plan:
    """Return the plan of a stored run; an old run without its experiment has settings only.

    Raises SettingError, OutOfRangeError, ExperimentError for settings that this version does not support.
    """
    if kind in KINDS:
        plan: Plan = build_plan(KINDS[kind], stored_values)
        return plan
    if "experiment" not in stored_values:
        if kind not in PAPER_EXPERIMENTS:
            raise ExperimentError(messages.program_in_unknown_form())
        return build_ready_plan(kind, **stored_values)
    experiment = parser.parse_canonical(str(stored_values["experiment"]))
    return build_experiment_plan(
        experiment, {name: value for name, value in stored_values.items() if name != "experiment"}, kind
    )


# Definitions ---------------------------------------------------------------------------------------
# The experiments and identifications that page and command line offer by name.


@dataclass(frozen=True)
class ExperimentDefinition:
    """An experiment that can be run by name: its texts, its settings, and the function that makes a plan.

    ``run_kind`` is the kind of its runs; ``experiment`` is its document, if it has one; ``replacement`` names the
    alternative to a deprecated one, which is accepted but not listed.
    """

    name: str
    title: str
    description: str
    settings: tuple[Setting, ...]
    make_plan: Callable[[Mapping[str, Any]], Plan]
    run_kind: str
    experiment: Experiment | None = None
    replacement: str = ""

    @cached_property
    def default_plan(self) -> Plan:
        """Plan with all settings at their defaults."""
        return self.make_plan({})


def build_experiment_definition(
    experiment: Experiment, lines: Lines | None = None, *, name: str = "", run_kind: str = KIND
) -> ExperimentDefinition:
    """Return the definition of an experiment. Raises ExperimentError if it does not compile."""
    source_lines = {} if lines is None else lines
    definition = ExperimentDefinition(
        name=name or experiment.name,
        title=experiment.title,
        description=experiment.description,
        settings=build_settings(experiment, source_lines),
        make_plan=lambda values: build_experiment_plan(experiment, values, run_kind, source_lines),
        run_kind=run_kind,
        experiment=experiment,
    )
    _ = definition.default_plan
    return definition


_STIFFNESS_UNIT = "N·m/rad"
_STIFFNESS_METRICS = ("deviation_S",)
_TENSION_METRICS = ("min_tension_N", "max_tension_N")


def fit_to_plant(experiment: Experiment, parameters: PlantParameters) -> Experiment:
    """Return a ready-made experiment with the stiffnesses of another mechanism.

    The ready-made experiments are written for the range of two tendons, which maps linearly to that of the mechanism:
    settings in N·m/rad with default and bounds, and bounds of criteria on stiffness. Criteria on tension are omitted.
    """
    if parameters.mechanism is None:
        return experiment
    bounds, (least, most) = compute_bounds(parameters), STIFFNESS_RANGE
    ratio = (bounds.S_max - bounds.S_min) / (most - least)

    def fit(value: Any) -> Any:
        if value is None:
            return None
        return round(bounds.S_min + ratio * (parser.evaluate_number(value, {}) - least), _DECIMALS)

    def scale(bound: float | str | None) -> str | None:
        return None if bound is None else f"{ratio:.6g} * ({bound})"

    settings = tuple(
        replace(item, default=fit(item.default), minimum=fit(item.minimum), maximum=fit(item.maximum))
        if item.unit == _STIFFNESS_UNIT
        else item
        for item in experiment.settings
    )
    criteria = tuple(
        replace(item, below=scale(item.below), above=scale(item.above)) if item.figure in _STIFFNESS_METRICS else item
        for item in experiment.criteria
        if item.figure not in _TENSION_METRICS
    )
    return replace(experiment, settings=settings, criteria=criteria)


def build_fitted_definition(name: str, parameters: PlantParameters) -> ExperimentDefinition:
    """Return the definition of a ready-made experiment, fitted to the plant.

    Raises KeyError.
    """
    if parameters.mechanism is None or name == upgrades.SEQUENCE:
        return experiments_by_name()[name]
    experiment = fit_to_plant(load_ready_experiment(name)[0], parameters)
    return build_experiment_definition(experiment, run_kind=name if name in PAPER_EXPERIMENTS else KIND)


@cache
def experiments_by_name() -> Mapping[str, ExperimentDefinition]:
    """Return the ready-made experiments by name, and the deprecated list of segments."""
    ready = {
        name: build_experiment_definition(
            *load_ready_experiment(name), run_kind=name if name in PAPER_EXPERIMENTS else KIND
        )
        for name in READY_NAMES
    }
    return {**ready, upgrades.SEQUENCE: _build_sequence_definition()}


_SEGMENTS = Setting(
    name=upgrades.SEGMENTS,
    kind="text",
    symbol="segments",
    unit="1",
    meaning='JSON list of segments: duration_s [s], q_ref [rad], S_ref [N·m/rad], F_push [N], shape "step", "ramp" or '
    '"sine" around the previous values, period_s [s] of a sine',
    default="""[
  {"duration_s": 4, "q_ref": 0, "S_ref": 10},
  {"duration_s": 4, "q_ref": 0.5, "S_ref": 10},
  {"duration_s": 4, "q_ref": -0.5, "S_ref": 12, "shape": "ramp"},
  {"duration_s": 8, "q_ref": -0.2, "S_ref": 12, "shape": "sine", "period_s": 4}
]""",
    maximum=parser.MAX_CHARACTERS,
)


def _build_sequence_definition() -> ExperimentDefinition:
    """Return the deprecated definition that converts a list of segments to an experiment."""

    def make_plan(values: Mapping[str, Any]) -> ExperimentPlan:
        segments = _SEGMENTS.parse(values.get(_SEGMENTS.name, _SEGMENTS.default))
        document = upgrades.convert_sequence(segments)
        if document is None:
            reason = messages.not_a_list_of_segments(meaning=_SEGMENTS.meaning)
            raise SettingError(_SEGMENTS.name, str(segments)[:40], reason)
        try:
            return build_experiment_plan(parser.build_experiment(document, {}), {}, upgrades.SEQUENCE)
        except ExperimentError as error:
            raise _translate_segment_error(error) from None

    return ExperimentDefinition(
        name=upgrades.SEQUENCE,
        title=messages.own_sequence_title(),
        description=messages.own_sequence_description(),
        settings=(_SEGMENTS,),
        make_plan=make_plan,
        run_kind=upgrades.SEQUENCE,
        replacement=messages.own_sequence_replacement(),
    )


def _translate_segment_error(error: ExperimentError) -> InvalidValueError:
    """Return the error with the number of the segment instead of the path of the converted part."""
    match error.path, error.why:
        case ("phases", 0, "parts", int(place), *rest), OutOfRangeError() as why:
            return OutOfRangeError(
                quantity=why.quantity,
                value=why.value,
                minimum=why.minimum,
                maximum=why.maximum,
                unit=why.unit,
                remedy=why.remedy,
                label=messages.label_in_segment(segment=place + 1, label=why.label),
                path=(_SEGMENTS.name, place, *rest),
            )
        case _:
            return error


@dataclass(frozen=True)
class IdentificationEntry:
    """A kind of identification, with its texts."""

    plan: type[IdentificationPlan]
    title: str
    description: str


IDENTIFICATIONS: dict[str, IdentificationEntry] = {
    "actuator": IdentificationEntry(
        ActuatorIdentificationPlan, "Actuator", messages.actuator_identification_description()
    ),
    "motor": IdentificationEntry(MotorIdentificationPlan, "Motors", messages.motor_identification_description()),
    "spring": IdentificationEntry(SpringIdentificationPlan, "Springs", messages.spring_identification_description()),
}


def find_experiment(name: str) -> ExperimentDefinition:
    """Return the definition with this name. Raises SettingError, which lists the known names."""
    known = experiments_by_name()
    if name not in known:
        raise SettingError("name", name, messages.unknown_experiment(known=", ".join(known)), legal=tuple(known))
    return known[name]
