"""Compiles an experiment into the segments that the control loop executes, and checks them against the plant."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatchmethod
from typing import Any, NamedTuple

import numpy as np

from backend.banks import TuningSettings
from backend.control import MAX_BITS, MAX_LINES, MIN_BITS, compute_bounds
from backend.errors import Path, check_range
from backend.experiments import messages, schema
from backend.experiments.parser import (
    CONSTANTS,
    FUNCTIONS,
    ExperimentError,
    ExpressionError,
    Lines,
    Names,
    error_context,
    evaluate_number,
    find_line,
)
from backend.models import Phase, Value, complete_motion, describe_settings
from backend.realtime import (
    CONTACT_MAX_N,
    CONTACT_MIN_N,
    MAX_CONTACT_DETECTIONS,
    MAX_SEGMENTS,
    MAX_TUNINGS,
    MAX_WALLS,
    NEIGHBOUR,
    OSCILLATING,
    ContactDetection,
    Segment,
    Shape,
    final_references,
)
from backend.response_docs import describe_field
from plant import (
    K_LEAST,
    SUBSTEPS,
    Message,
    Obstacle,
    PlantError,
    PlantParameters,
    T_s,
    require_possible_wall,
)

# Manual pushes -------------------------------------------------------------------------------------
# Random pushes that resemble those of a person: smooth rise, hold, smooth release and pause.


SMOOTH_SEGMENT_S = 0.04
"""Length of the linear segments that approximate a smooth push [s]."""


class PushSegment(NamedTuple):
    """A segment of a push: duration [s], final force [N] and shape."""

    duration_s: float
    F_push: float
    shape: Shape


def generate_smooth_push(start: float, end: float, duration_s: float, *, evenly: bool = False) -> Iterator[PushSegment]:
    """Yield the segments of a half cosine from start to end [N].

    A segment lasts SMOOTH_SEGMENT_S, or is adjusted so that all last ``duration_s`` exactly (``evenly``).
    """
    count = max(round(duration_s / SMOOTH_SEGMENT_S), 1)
    ends_s = [round(duration_s * number / count, 3) for number in range(count + 1)]
    for number in range(1, count + 1):
        share = 0.5 - 0.5 * math.cos(math.pi * number / count)
        segment_s = ends_s[number] - ends_s[number - 1] if evenly else SMOOTH_SEGMENT_S
        yield PushSegment(segment_s, start + share * (end - start), Shape.RAMP)


def generate_manual_pushes(F_push: float, pushes: int, pause_s: float, seed: int) -> Iterator[PushSegment]:
    """Yield the segments of ``pushes`` random pushes of up to ``F_push`` [N]; the seed determines them."""
    random = np.random.default_rng(seed)
    for _ in range(pushes):
        peak = F_push * random.uniform(0.3, 1.0) * random.choice((-1.0, 1.0))
        rise_s, held_s, release_s = random.uniform(0.3, 0.9), random.uniform(0.2, 1.5), random.uniform(0.3, 0.9)
        yield from generate_smooth_push(0.0, peak, rise_s)
        yield PushSegment(held_s, peak, Shape.STEP)
        yield from generate_smooth_push(peak, 0.0, release_s)
        yield PushSegment(pause_s * random.uniform(0.3, 1.0), 0.0, Shape.STEP)


# Compiled experiment -------------------------------------------------------------------------------


@dataclass(frozen=True)
class CompiledExperiment:
    """Segments of an experiment for the control loop, with the document paths that they come from.

    ``paths`` has one entry per segment. ``changes`` are the tunings that segments apply, each with all differences from
    the initial tuning, defined at ``change_paths``; ``walls`` are the obstacles that segments set, defined at
    ``wall_paths``; ``contact_detections`` are the settings of the contact detection that segments apply.
    """

    segments: tuple[Segment, ...]
    paths: tuple[Path, ...]
    phases: tuple[Phase, ...]
    changes: tuple[Mapping[str, Value], ...]
    change_paths: tuple[Path, ...]
    walls: tuple[Obstacle | None, ...] = ()
    wall_paths: tuple[Path, ...] = ()
    contact_detections: tuple[ContactDetection, ...] = ()


# Multisine -----------------------------------------------------------------------------------------


def compute_multisine_peak(lines: int) -> float:
    """Return the largest value over a period of the sum of ``lines`` cosines with Schroeder's phases."""
    import numpy as np

    t = np.arange(0.0, 1.0, 1.0 / (64 * lines))
    k = np.arange(1, lines + 1)
    total = np.cos(2.0 * np.pi * np.outer(t, k) - np.pi * k * (k - 1) / lines).sum(axis=1)
    return float(np.abs(total).max()) * 1.01  # the peak may lie between two points


# Numbers -------------------------------------------------------------------------------------------
# Evaluates the expressions in the parts of an experiment and checks their bounds.


PART_MAX_S = 600.0
Q_REF_MAX = 1.4
"""Largest joint reference of an experiment [rad]; the bound of the plant is checked before a start."""

S_REF_MIN, S_REF_MAX = 1e-4, 1e5
"""Stiffness references that an experiment may have for any actuator [N·m/rad]; ``require_reach`` checks the plant's."""


class NumberReader:
    """Evaluates numbers of the part at ``_path`` from settings and counters; tracks the current references."""

    def __init__(self, values: Names, lines: Lines) -> None:
        self._names = dict(values)
        self._lines = lines
        self._path: Path = ()
        self._q, self._S = 0.0, 10.0

    def _read_time(self, expression: float | str, name: str = "duration_s", words: str = "") -> float:
        return round(
            self._read_number(name=name, expression=expression, least=0.01, most=PART_MAX_S, unit="s", words=words), 3
        )

    def _read_integer(self, name: str, expression: float | str, least: int, most: int) -> int:
        number = self._read_number(name, expression, least, most, "1")
        if number != round(number):
            raise self._build_error(messages.not_a_whole_number(value=number), (*self._path, name))
        return round(number)

    def _read_number(
        self, name: str, expression: float | str, least: float, most: float, unit: str, words: str = ""
    ) -> float:
        path = (*self._path, name)
        try:
            number = evaluate_number(expression, self._names)
        except ExpressionError as error:
            raise self._build_error(error.message, path) from None
        slack = 1e-9 * max(abs(least), abs(most))  # a value equal to a computed bound is allowed
        clipped = min(max(number, least), most) if least - slack <= number <= most + slack else number
        with error_context(path, self._lines):
            check_range(name, clipped, least, most, unit, label=words, path=path)
        return clipped

    def _set_references(self, q_ref: float | str | None, S_ref: float | str | None) -> None:
        if q_ref is not None:
            self._q = self._read_number("q_ref", q_ref, -Q_REF_MAX, Q_REF_MAX, "rad")
        if S_ref is not None:
            self._S = self._read_number("S_ref", S_ref, S_REF_MIN, S_REF_MAX, "N·m/rad")

    def _read_amplitudes(self, q: float | str, S: float | str) -> tuple[float, float]:
        """Return the amplitudes, after checking that the references stay within their bounds in both directions."""
        margin_q = max(Q_REF_MAX - abs(self._q), 0.0)  # a previous crest may lie beyond the bound
        margin_S = max(min(S_REF_MAX - self._S, self._S - S_REF_MIN), 0.0)
        amplitude_q = self._read_number(
            name="q_amplitude",
            expression=q,
            least=-margin_q,
            most=margin_q,
            unit="rad",
            words=messages.amplitude_of_q_ref(centre=self._q),
        )
        words = messages.amplitude_of_S_ref(centre=self._S)
        return amplitude_q, self._read_number(
            name="S_amplitude", expression=S, least=-margin_S, most=margin_S, unit="N·m/rad", words=words
        )

    def _build_error(self, reason: Message, path: Path) -> ExperimentError:
        return ExperimentError(reason, path, find_line(path, self._lines))


# Reach ---------------------------------------------------------------------------------------------
# Checks that a plant can follow the references of an experiment.


def require_reach(compiled: CompiledExperiment, parameters: PlantParameters, lines: Lines) -> None:
    """Raise ExperimentError for the first reference outside the plant's bounds, or an impossible obstacle.

    Oscillations are checked in both directions.
    """
    bounds = compute_bounds(parameters)
    q, S, has_references = 0.0, 0.0, False
    for segment, path in zip(compiled.segments, compiled.paths, strict=True):
        to_check = [(segment.q_ref, segment.S_ref)]
        if segment.shape not in OSCILLATING:
            has_references = True
        elif has_references:  # only the loop has the centre of an initial oscillation
            to_check.append((2.0 * q - segment.q_ref, 2.0 * S - segment.S_ref))
        for q_ref, S_ref in to_check:
            with error_context(path, lines):
                check_range("q_ref", q_ref, bounds.q_min, bounds.q_max, "rad", path=(*path, "q_ref"))
                check_range("S_ref", S_ref, bounds.S_min, bounds.S_max, "N·m/rad", path=(*path, "S_ref"))
        q, S = final_references(segment, q, S)
    g, joint = parameters.geometry, parameters.make_dynamics().joint
    if parameters.mechanism is not None and any(compiled.walls):
        path = next(path for wall, path in zip(compiled.walls, compiled.wall_paths, strict=True) if wall is not None)
        raise ExperimentError(messages.obstacles_require_tendons(), path, find_line(path, lines))
    for wall, path in zip(compiled.walls, compiled.wall_paths, strict=True):
        try:
            if wall is not None:
                require_possible_wall(wall, joint, parameters.safety.F_max, g.q_max, T_s / SUBSTEPS)
        except PlantError as error:
            raise ExperimentError(error.message, path, find_line(path, lines)) from None


# Played parts --------------------------------------------------------------------------------------
# Times and references of each part of an experiment, for the page.


@dataclass(frozen=True)
class PlayedPart:
    """Times and references of a part.

    ``q_from`` and ``S_from`` are the references before its first segment, None at the start of the experiment;
    ``q_to``, ``S_to`` and ``piece_s`` are those of the first segment. ``end_s`` is the end of the last one, including
    repetitions.
    """

    path: Path = field(metadata=describe_field("path in the document"))
    start_s: float = field(metadata=describe_field("first start of the part", "s"))
    end_s: float = field(metadata=describe_field("last end of the part", "s"))
    pieces: int = field(metadata=describe_field("program segments of the part, including repetitions"))
    piece_s: float = field(metadata=describe_field("duration of its first segment", "s"))
    q_from: float | None = field(metadata=describe_field("joint reference before its first segment", "rad"))
    S_from: float | None = field(metadata=describe_field("stiffness reference before its first segment", "N·m/rad"))
    q_to: float = field(metadata=describe_field("joint reference of its first segment", "rad"))
    S_to: float = field(metadata=describe_field("stiffness reference of its first segment", "N·m/rad"))


def list_played_parts(compiled: CompiledExperiment) -> list[PlayedPart]:
    """Return the parts that become segments, in the order of their first execution."""
    found: dict[Path, PlayedPart] = {}
    at: tuple[float, float] | None = None
    clock_s = 0.0
    for segment, path in zip(compiled.segments, compiled.paths, strict=True):
        end_s = clock_s + segment.duration_s
        q_from, S_from = at or (None, None)
        first = found.get(path) or PlayedPart(
            path=path,
            start_s=clock_s,
            end_s=end_s,
            pieces=0,
            piece_s=segment.duration_s,
            q_from=q_from,
            S_from=S_from,
            q_to=segment.q_ref,
            S_to=segment.S_ref,
        )
        found[path] = replace(first, end_s=end_s, pieces=first.pieces + 1)
        clock_s = end_s
        at = final_references(segment, *(at or (segment.q_ref, segment.S_ref)))
    return list(found.values())


# Contact detection ---------------------------------------------------------------------------------
# Changes of the contact detection during an experiment: calibrations of the bias of the external
# force, and the parts that a contact ends.


CALIBRATION_MIN_S = 2.0
"""Least duration [s] of a calibration at rest: seven times the time constant of its mean
(``disturbance_observer.MEAN_S``)."""


class ContactDetectionSequence:
    """Settings of the contact detection in their order; each applies from the next segment on.

    Changes between two segments are combined into one. Methods return a problem, None for none.
    """

    def __init__(self) -> None:
        self.items: list[ContactDetection] = []
        self._taken_count = 0
        self._ends_parts = False
        self._calibrated_S: list[float] = []

    @property
    def has_unused_calibration(self) -> bool:
        """Whether a calibration is the last change, without a segment after it."""
        return len(self.items) > self._taken_count and self.items[-1].calibrates_bias

    def add_calibration(self, S: float) -> Message | None:
        """Calibrate the bias of the external force at rest at the stiffness S [N·m/rad]."""
        if self._ends_parts:
            return messages.calibration_within_contact()
        self._calibrated_S.append(S)
        return self._append(ContactDetection(0.0, calibrates_bias=True))

    def begin_contact_end(self, contact_N: float, S: float) -> Message | None:
        """Let contacts above ``contact_N`` [N] end the following parts, which begin at S [N·m/rad]."""
        if self._ends_parts:
            return messages.contact_within_contact()
        if not self._calibrated_S:
            return messages.bias_not_calibrated()
        if not min(self._calibrated_S) - NEIGHBOUR <= S <= max(self._calibrated_S) + NEIGHBOUR:
            return messages.bias_not_calibrated_at(S=S, calibrated_S=tuple(sorted(set(self._calibrated_S))))
        self._ends_parts = True
        return self._append(ContactDetection(contact_N))

    def finish_contact_end(self) -> Message | None:
        """End the range of parts that a contact ends."""
        self._ends_parts = False
        return self._append(ContactDetection())

    def take_next_number(self) -> int:
        """Return the number of the change that the next segment applies; 0 for none."""
        if len(self.items) == self._taken_count:
            return 0
        self._taken_count = len(self.items)
        return self._taken_count

    def _append(self, detection: ContactDetection) -> Message | None:
        if len(self.items) > self._taken_count:
            self.items[-1] = ContactDetection(
                detection.contact_N, self.items[-1].calibrates_bias or detection.calibrates_bias
            )
            return None
        if len(self.items) == MAX_CONTACT_DETECTIONS:
            return messages.too_many_contact_changes(maximum=MAX_CONTACT_DETECTIONS)
        self.items.append(detection)
        return None


# Compiler ------------------------------------------------------------------------------------------


DURATION_MAX_S = 3600.0
F_PUSH_MAX = 30.0
LOAD_MAX_NM = 0.5
_K_WALL_MAX, _C_WALL_MAX = 1e5, 100.0
"""Bounds for all plants; those of the actual plant are checked before a start."""
_FREQUENCY_MAX_HZ = 50.0
_PARTS_MAX = 4 * MAX_SEGMENTS
_MEASURES_FROM_REST = (schema.Measure.COMPLIANCE, schema.Measure.DISTURBANCE, schema.Measure.PUSHES)
"""Measures of pushes; each push must start from rest."""
_TUNING_SETTINGS = {setting.name: setting for setting in describe_settings(TuningSettings)}


def compile_experiment(experiment: schema.Experiment, values: Names, lines: Lines) -> CompiledExperiment:
    """Compile an experiment with values of its settings. Raises ExperimentError with line and bound."""
    return _Compiler(experiment, values, lines).compile()


class _Compiler(NumberReader):
    """Compiles the parts of one experiment in order; ``_path`` is that of the current part.

    Changes of tuning, obstacle and contact detection apply from the next segment on, so the compiler assigns them to
    it.
    """

    def __init__(self, experiment: schema.Experiment, values: Names, lines: Lines) -> None:
        super().__init__(values, lines)
        self._experiment = experiment
        self._segments: list[Segment] = []
        self._paths: list[Path] = []
        self._changes: list[Mapping[str, Value]] = []
        self._change_paths: list[Path] = []
        self._has_unused_change = False
        self._has_references = False
        self._F = 0.0
        self._duration_s = 0.0
        self._parts = 0
        self._walls: list[Obstacle | None] = []
        self._wall_paths: list[Path] = []
        self._assigned_walls = 0
        self._detections = ContactDetectionSequence()

    def compile(self) -> CompiledExperiment:
        """Return the compiled experiment. Raises ExperimentError."""
        phases: list[Phase] = []
        for index, section in enumerate(self._experiment.phases):
            path: Path = ("phases", index)
            if any(phase.name == section.name for phase in phases):
                raise self._build_error(messages.phase_name_taken(), (*path, "name"))
            start_s = self._duration_s
            self._compile_parts(section.parts, (*path, "parts"))
            phases.append(Phase(section.name, section.title, start_s, self._duration_s))
        if self._has_unused_change:
            raise self._build_error(messages.no_motion_after_tuning(), self._path)
        if self._assigned_walls != len(self._walls):
            raise self._build_error(messages.no_motion_after_obstacle(), self._path)
        if self._detections.has_unused_calibration:
            raise self._build_error(messages.no_motion_after_calibration(), self._path)
        if not self._segments:
            raise self._build_error(messages.no_motion(), ("phases",))
        return CompiledExperiment(
            segments=tuple(self._segments),
            paths=tuple(self._paths),
            phases=tuple(phases),
            changes=tuple(self._changes),
            change_paths=tuple(self._change_paths),
            walls=tuple(self._walls),
            wall_paths=tuple(self._wall_paths),
            contact_detections=tuple(self._detections.items),
        )

    def _compile_parts(self, parts: Sequence[Any], path: Path) -> None:
        for index, part in enumerate(parts):
            self._path = (*path, index)
            self._parts += 1
            if self._parts > _PARTS_MAX:
                raise self._build_error(messages.too_many_parts(maximum=_PARTS_MAX), self._path)
            self._compile_part(part)

    @singledispatchmethod
    def _compile_part(self, part: Any) -> None:
        """Append the segments of a part, or record its change. Each kind of part has its own method."""
        raise TypeError(f"no layout for {type(part).__name__}")

    @_compile_part.register
    def _compile_hold(self, part: schema.Hold) -> None:
        self._add_hold(self._read_time(part.duration_s))

    @_compile_part.register
    def _compile_step(self, part: schema.Step) -> None:
        self._set_references(part.q_ref, part.S_ref)
        self._add_hold(self._read_time(part.duration_s), self._read_push(part.F_push))

    @_compile_part.register
    def _compile_ramp(self, part: schema.Ramp) -> None:
        self._set_references(part.q_ref, part.S_ref)
        F = self._read_push(part.F_push)
        self._add(Segment(self._read_time(part.duration_s), self._q, self._S, F, Shape.RAMP))

    @_compile_part.register
    def _compile_pulse(self, part: schema.Pulse) -> None:
        before = self._q, self._S
        self._set_references(part.q_ref, part.S_ref)
        self._add_hold(self._read_time(part.duration_s))
        self._q, self._S = before
        self._add_hold(self._read_time(part.rest_s, "rest_s"))

    @_compile_part.register
    def _compile_sine(self, part: schema.Sine) -> None:
        period_s = self._read_number("period_s", part.period_s, 0.02, PART_MAX_S, "s")
        duration_s = self._read_time(part.duration_s)
        F = self._read_push(part.F_push)
        q_before, S_before, F_before = self._q, self._S, self._F
        if part.q_ref is None or part.S_ref is None:
            self._require_references()
        q, S = self._read_amplitudes(part.q_amplitude, part.S_amplitude)
        for name, amplitude, crest in (("q_amplitude", q, part.q_ref), ("S_amplitude", S, part.S_ref)):
            if amplitude and crest is not None:
                raise self._build_error(messages.crest_defined_twice(), (*self._path, name))
        self._q, self._S = q_before + q, S_before + S
        self._set_references(part.q_ref, part.S_ref)
        self._add(Segment(duration_s, self._q, self._S, F, Shape.SINE, period_s))
        q = q if part.q_ref is None else self._q - q_before
        S = S if part.S_ref is None else self._S - S_before
        end = math.sin(2.0 * math.pi * duration_s / period_s)
        self._q, self._S = q_before + end * q, S_before + end * S
        if F:
            self._F = F_before + end * (F - F_before)

    @_compile_part.register
    def _compile_sweep(self, part: schema.Sweep) -> None:
        low = 1.0 / PART_MAX_S
        from_Hz = self._read_number("from_Hz", part.from_Hz, low, _FREQUENCY_MAX_HZ, "Hz")
        to_Hz = self._read_number("to_Hz", part.to_Hz, low, _FREQUENCY_MAX_HZ, "Hz")
        duration_s = self._read_time(part.duration_s)
        self._require_references()
        q, S = self._read_amplitudes(part.q_amplitude, part.S_amplitude)
        end_s = 1.0 / to_Hz
        swept = Segment(
            duration_s=duration_s,
            q_ref=self._q + q,
            S_ref=self._S + S,
            F_push=0.0,
            shape=Shape.SWEEP,
            period_s=1.0 / from_Hz,
            period_end_s=end_s,
        )
        self._add(swept)

    @_compile_part.register
    def _compile_prbs(self, part: schema.Prbs) -> None:
        chip_s = round(self._read_number("chip_s", part.chip_s, 0.001, 60.0, "s"), 3)
        bits = self._read_integer("bits", part.bits, MIN_BITS, MAX_BITS)
        periods = self._read_integer("periods", part.periods, 1, 1000)
        self._require_references()
        q, S = self._read_amplitudes(part.q_amplitude, part.S_amplitude)
        duration_s = self._read_time(periods * (2**bits - 1) * chip_s, "chip_s", messages.duration_of_chips())
        self._add(Segment(duration_s, self._q + q, self._S + S, shape=Shape.PRBS, period_s=chip_s, count=bits))

    @_compile_part.register
    def _compile_multisine(self, part: schema.Multisine) -> None:
        period_s = round(self._read_number("period_s", part.period_s, 0.1, PART_MAX_S, "s"), 3)
        lines = self._read_integer("lines", part.lines, 1, MAX_LINES)
        with error_context((*self._path, "lines"), self._lines):
            check_range(
                "lines",
                lines / period_s,
                minimum=None,
                maximum=_FREQUENCY_MAX_HZ,
                unit="Hz",
                remedy=messages.fewer_lines_or_longer_period(maximum_Hz=_FREQUENCY_MAX_HZ),
                label=messages.highest_frequency(),
            )
        periods = self._read_integer("periods", part.periods, 1, 1000)
        self._require_references()
        q, S = self._read_amplitudes(part.q_amplitude, part.S_amplitude)
        duration_s = self._read_time(periods * period_s, "periods", messages.duration_of_periods())
        peak, shape = compute_multisine_peak(lines), Shape.MULTISINE
        self._add(
            Segment(
                duration_s=duration_s,
                q_ref=self._q + q,
                S_ref=self._S + S,
                F_push=0.0,
                shape=shape,
                period_s=period_s,
                count=lines,
                peak=peak,
            )
        )

    @_compile_part.register
    def _compile_push(self, part: schema.Push) -> None:
        F = self._read_number("F_push", part.F_push, -F_PUSH_MAX, F_PUSH_MAX, "N")
        duration_s = self._read_time(part.duration_s)
        if part.shape == "smooth":
            self._add_push(generate_smooth_push(self._F, F, duration_s, evenly=True))
        else:
            self._add_push([PushSegment(duration_s, F, Shape(part.shape))])

    @_compile_part.register
    def _compile_hand(self, part: schema.Hand) -> None:
        F = self._read_number("F_push", part.F_push, 0.0, F_PUSH_MAX, "N")
        pushes = self._read_integer("pushes", part.pushes, 1, 100)
        pause_s = self._read_number("pause_s", part.pause_s, 0.05, 60.0, "s")
        self._add_push(generate_manual_pushes(F, pushes, pause_s, self._read_integer("seed", part.seed, 0, 2**31 - 1)))

    @_compile_part.register
    def _compile_load(self, part: schema.Load) -> None:
        load_A = self._read_number("load_A", part.load_A, 0.0, LOAD_MAX_NM, "N·m")
        load_B = self._read_number("load_B", part.load_B, 0.0, LOAD_MAX_NM, "N·m")
        self._add(Segment(self._read_time(part.duration_s), self._q, self._S, load_A=load_A, load_B=load_B))

    @_compile_part.register
    def _compile_tuning(self, part: schema.Tuning) -> None:
        if len(self._changes) == MAX_TUNINGS:
            raise self._build_error(messages.too_many_tunings(maximum=MAX_TUNINGS), self._path)
        named: dict[str, Value] = {}
        for name, setting in _TUNING_SETTINGS.items():
            value = getattr(part, name)
            if isinstance(value, bool) or setting.kind == "choice":
                named |= {} if value is None else {name: value}
            elif value is not None and setting.minimum is not None and setting.maximum is not None:
                # In documents older than ``motion``, a limit of 0 V selects the paper's law.
                minimum = 0.0 if name == "u_plan" and part.motion is None else setting.minimum
                number = self._read_number(name, value, minimum, setting.maximum, setting.unit)
                named[name] = int(number) if setting.kind == "integer" else number
        before = self._changes[-1] if self._changes else {}
        self._changes.append({**before, **complete_motion(named)})
        self._change_paths.append(self._path)
        self._has_unused_change = True

    @_compile_part.register
    def _compile_wall(self, part: schema.Wall) -> None:
        side = 1.0 if part.side == "above" else -1.0
        q_wall = self._read_number("q_wall", part.q_wall, -Q_REF_MAX, Q_REF_MAX, "rad")
        if side * (self._q - q_wall) >= 0.0:
            beyond = messages.reference_beyond_obstacle(q_ref=self._q, q_wall=q_wall)
            raise self._build_error(beyond, (*self._path, "q_wall"))
        k_wall = self._read_number("k_wall", part.k_wall, K_LEAST, _K_WALL_MAX, "N/m")
        self._add_wall_change(
            Obstacle(side, q_wall, k_wall, self._read_number("c_wall", part.c_wall, 0.0, _C_WALL_MAX, "s/m"))
        )

    @_compile_part.register
    def _compile_no_wall(self, part: schema.NoWall) -> None:
        self._add_wall_change(None)

    def _add_wall_change(self, wall: Obstacle | None) -> None:
        if len(self._walls) == MAX_WALLS:
            raise self._build_error(messages.too_many_obstacles(maximum=MAX_WALLS), self._path)
        self._walls.append(wall)
        self._wall_paths.append(self._path)

    @_compile_part.register
    def _compile_learn(self, part: schema.Learn) -> None:
        words = messages.duration_of_calibration()
        self._add_hold(
            round(self._read_number("duration_s", part.duration_s, CALIBRATION_MIN_S, PART_MAX_S, "s", words), 3)
        )
        self._raise_problem(self._detections.add_calibration(self._S))

    @_compile_part.register
    def _compile_until_contact(self, part: schema.UntilContact) -> None:
        path = self._path
        words = messages.contact_threshold()
        contact_N = self._read_number("contact_N", part.contact_N, 0.0, CONTACT_MAX_N, "N", words)
        if contact_N == 0.0:
            self._compile_parts(part.parts, (*path, "parts"))
            return
        words = messages.contact_threshold_or_none()
        self._read_number("contact_N", contact_N, CONTACT_MIN_N, CONTACT_MAX_N, "N", words)
        self._raise_problem(self._detections.begin_contact_end(contact_N, self._S))
        self._compile_parts(part.parts, (*path, "parts"))
        self._raise_problem(self._detections.finish_contact_end())

    def _raise_problem(self, problem: Message | None) -> None:
        if problem is not None:
            raise self._build_error(problem, self._path)

    @_compile_part.register
    def _compile_choose(self, part: schema.Choose) -> None:
        chosen, path = self._names.get(part.by), self._path
        declared = next((item for item in self._experiment.settings if item.name == part.by), None)
        if declared is None or declared.kind != "choice":
            raise self._build_error(messages.setting_without_choices(name=part.by), (*path, "by"))
        if set(part.of) != set(declared.choices):
            required = messages.choices_without_parts(choices=", ".join(declared.choices))
            raise self._build_error(required, (*path, "of"))
        self._compile_parts(part.of[str(chosen)], (*path, "of", str(chosen)))

    @_compile_part.register
    def _compile_repeat(self, part: schema.Repeat) -> None:
        path, outer = self._path, self._names.get(part.index)
        times = self._read_integer("times", part.times, 1, MAX_SEGMENTS)
        if part.index in (*CONSTANTS, *FUNCTIONS) or any(part.index == item.name for item in self._experiment.settings):
            raise self._build_error(messages.index_name_taken(name=part.index), (*path, "index"))
        for iteration in range(times):
            self._names[part.index] = iteration
            self._compile_parts(part.parts, (*path, "parts"))
        if outer is None:
            del self._names[part.index]
        else:
            self._names[part.index] = outer

    def _add_push(self, segments: Iterator[PushSegment] | Sequence[PushSegment]) -> None:
        for segment in segments:
            self._F = float(segment.F_push)
            self._add(Segment(round(segment.duration_s, 3), self._q, self._S, self._F, segment.shape), pushed=True)

    def _read_push(self, F_push: float | str) -> float:
        """Return the push [N] during a motion; 0 is required if a measure needs pushes from rest."""
        F = self._read_number("F_push", F_push, -F_PUSH_MAX, F_PUSH_MAX, "N")
        measured = [measure for measure in _MEASURES_FROM_REST if measure in self._experiment.measures]
        if F and measured:
            raise self._build_error(messages.push_during_motion(measure=measured[0]), (*self._path, "F_push"))
        return F

    def _require_references(self) -> None:
        """Raise ExperimentError for an oscillation before any references are set."""
        if not self._has_references:
            raise self._build_error(messages.no_centre(), self._path)

    def _add_hold(self, duration_s: float, F_push: float = 0.0) -> None:
        self._add(Segment(duration_s, self._q, self._S, F_push))

    def _add(self, segment: Segment, *, pushed: bool = False) -> None:
        self._has_references = self._has_references or segment.shape not in OSCILLATING
        if not pushed:
            self._F = segment.F_push
        if len(self._segments) == MAX_SEGMENTS:
            raise self._build_error(messages.too_many_segments(maximum=MAX_SEGMENTS), self._path)
        if self._has_unused_change:
            segment = replace(segment, tuning=len(self._changes))
            self._has_unused_change = False
        if self._assigned_walls != len(self._walls):
            self._assigned_walls = len(self._walls)
            segment = replace(segment, wall=self._assigned_walls)
        if contact_detection := self._detections.take_next_number():
            segment = replace(segment, contact_detection=contact_detection)
        self._duration_s += segment.duration_s
        with error_context(self._path, self._lines):
            check_range(
                "duration_s",
                self._duration_s,
                minimum=None,
                maximum=DURATION_MAX_S,
                unit="s",
                remedy=messages.remove_some_parts(),
                label=messages.duration_up_to_part(),
            )
        self._segments.append(segment)
        self._paths.append(self._path)
