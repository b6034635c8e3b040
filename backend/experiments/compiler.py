"""Compiles an experiment into segments of the loop: layout, expressions of numbers, pushes, reach."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatchmethod
from typing import Any, NamedTuple

import numpy as np

from backend.banks import TuningSettings
from backend.control import MAX_BITS, MAX_LINES, MIN_BITS, compute_bounds
from backend.errors import Path, check_range
from backend.experiments import schema
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
    MAX_SEGMENTS,
    MAX_TOUCHES,
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
from plant import K_LEAST, SUBSTEPS, Obstacle, PlantError, PlantParameters, T_s, require_possible_wall

# Hand ----------------------------------------------------------------------------------------------
#
# Pushes like a person's: a smooth rise, a hold, a smooth release and a pause, each drawn anew.
# Pure.


PIECE_S = 0.04
"""Smooth pushes are played as straight pieces of this length [s]."""

_LONGEST_S = 3.3
"""Longest push of a hand, its pause left out [s]."""


class PushPiece(NamedTuple):
    """A piece of a push: how long [s], to which force [N], and how."""

    duration_s: float
    F_push: float
    shape: Shape


def smooth(start: float, end: float, duration_s: float, *, evenly: bool = False) -> Iterator[PushPiece]:
    """Go from start to end [N] along half a cosine, in straight pieces of PIECE_S, or ``evenly`` in just this time."""
    pieces = max(round(duration_s / PIECE_S), 1)
    ends = [round(duration_s * piece / pieces, 3) for piece in range(pieces + 1)]
    for piece in range(1, pieces + 1):
        share = 0.5 - 0.5 * math.cos(math.pi * piece / pieces)
        lasts = ends[piece] - ends[piece - 1] if evenly else PIECE_S
        yield PushPiece(lasts, start + share * (end - start), Shape.RAMP)


def pushes_of_a_hand(F_push: float, pushes: int, pause_s: float, seed: int) -> Iterator[PushPiece]:
    """Push ``pushes`` times with up to ``F_push`` [N]; the same seed gives the same pushes."""
    random = np.random.default_rng(seed)
    for _ in range(pushes):
        peak = F_push * random.uniform(0.3, 1.0) * random.choice((-1.0, 1.0))
        rise_s, held_s, release_s = random.uniform(0.3, 0.9), random.uniform(0.2, 1.5), random.uniform(0.3, 0.9)
        yield from smooth(0.0, peak, rise_s)
        yield PushPiece(held_s, peak, Shape.STEP)
        yield from smooth(peak, 0.0, release_s)
        yield PushPiece(pause_s * random.uniform(0.3, 1.0), 0.0, Shape.STEP)


# Laid ----------------------------------------------------------------------------------------------
#
# What an experiment plays, laid out, and where it was written. Pure.


@dataclass(frozen=True)
class CompiledExperiment:
    """What the loop plays. ``places`` (one of each segment) say where it was written.

    ``changes`` are the tunings that segments put into use, each with all that differs from the one at the start, and
    ``change_places`` where they were written; ``walls`` and ``wall_places`` likewise what stands in the joint's way.
    ``touches`` are what contacts are given way to on the way.
    """

    segments: tuple[Segment, ...]
    places: tuple[Path, ...]
    phases: tuple[Phase, ...]
    changes: tuple[Mapping[str, Value], ...]
    change_places: tuple[Path, ...]
    walls: tuple[Obstacle | None, ...] = ()
    wall_places: tuple[Path, ...] = ()
    touches: tuple[ContactDetection, ...] = ()


# Multisine -----------------------------------------------------------------------------------------
#
# The sum of harmonics that a multisine is. Pure.


def peak_of(lines: int) -> float:
    """Return the largest value of the sum of so many cosines with Schroeder's phases, of over its period."""
    import numpy as np

    t = np.arange(0.0, 1.0, 1.0 / (64 * lines))
    k = np.arange(1, lines + 1)
    total = np.cos(2.0 * np.pi * np.outer(t, k) - np.pi * k * (k - 1) / lines).sum(axis=1)
    return float(np.abs(total).max()) * 1.01  # between the points it may be a little more


# Numbers -------------------------------------------------------------------------------------------
#
# Numbers as a part of an experiment asks for them: expressions, their bounds, and where they stand.
# Pure.


LONGEST_PART_S = 600.0
Q_REF_MAX = 1.4
"""Largest joint reference of an experiment [rad]; the plant's own bound is looked at before a start."""

S_LOWEST, S_HIGHEST = 8.0, 15.0


class Numbers:
    """Reads the numbers of the part at ``_path``, of settings and counters by their names; the references so far."""

    def __init__(self, values: Names, lines: Lines) -> None:
        self._names = dict(values)
        self._lines = lines
        self._path: Path = ()
        self._q, self._S = 0.0, 10.0

    def _time(self, expression: float | str, name: str = "duration_s", words: str = "") -> float:
        return round(
            self._number(name=name, expression=expression, least=0.01, most=LONGEST_PART_S, unit="s", words=words), 3
        )

    def _whole(self, name: str, expression: float | str, least: int, most: int) -> int:
        number = self._number(name, expression, least, most, "1")
        if number != round(number):
            raise self._refused(f"{number:g} is not a whole number", (*self._path, name))
        return round(number)

    def _number(
        self, name: str, expression: float | str, least: float, most: float, unit: str, words: str = ""
    ) -> float:
        path = (*self._path, name)
        try:
            number = evaluate_number(expression, self._names)
        except ExpressionError as error:
            raise self._refused(str(error), path) from None
        slack = 1e-9 * max(abs(least), abs(most))  # a bound that was computed from the same settings is one to be met
        clipped = min(max(number, least), most) if least - slack <= number <= most + slack else number
        with error_context(path, self._lines):
            check_range(name, clipped, least, most, unit, words=words, path=path)
        return clipped

    def _aim(self, q_ref: float | str | None, S_ref: float | str | None) -> None:
        if q_ref is not None:
            self._q = self._number("q_ref", q_ref, -Q_REF_MAX, Q_REF_MAX, "rad")
        if S_ref is not None:
            self._S = self._number("S_ref", S_ref, S_LOWEST, S_HIGHEST, "N·m/rad")

    def _amplitudes(self, q: float | str, S: float | str) -> tuple[float, float]:
        """Return the amplitudes; the references stay within their bounds on both sides."""
        room_q = max(Q_REF_MAX - abs(self._q), 0.0)  # a crest may have swung further to the other side
        room_S = max(min(S_HIGHEST - self._S, self._S - S_LOWEST), 0.0)
        about = f"around {self._q:.6g} rad" if self._q else ""
        amplitude_q = self._number(
            name="q_amplitude",
            expression=q,
            least=-room_q,
            most=room_q,
            unit="rad",
            words=f"amplitude of q_ref {about}".strip(),
        )
        words = f"amplitude of S_ref around {self._S:.6g} N·m/rad"
        return amplitude_q, self._number(
            name="S_amplitude", expression=S, least=-room_S, most=room_S, unit="N·m/rad", words=words
        )

    def _refused(self, why: str, path: Path) -> ExperimentError:
        return ExperimentError(why, path, find_line(path, self._lines))


# Reach ---------------------------------------------------------------------------------------------
#
# Whether a plant's joint and stiffness may be brought where an experiment asks, told with line and
# bound. Pure.


def require_reach(laid: CompiledExperiment, parameters: PlantParameters, lines: Lines) -> None:
    """Raise ExperimentError for the first reference outside the plant's bounds; what oscillates, on both sides.

    And for a wall that cannot stand in this plant's way.
    """
    bounds = compute_bounds(parameters)
    q, S, placed = 0.0, 0.0, False
    for segment, place in zip(laid.segments, laid.places, strict=True):
        asked = [(segment.q_ref, segment.S_ref)]
        if segment.shape not in OSCILLATING:
            placed = True
        elif placed:  # around which references it goes that plays first, the loop alone knows
            asked.append((2.0 * q - segment.q_ref, 2.0 * S - segment.S_ref))
        for q_ref, S_ref in asked:
            with error_context(place, lines):
                check_range("q_ref", q_ref, bounds.q_min, bounds.q_max, "rad", path=(*place, "q_ref"))
                check_range("S_ref", S_ref, bounds.S_min, bounds.S_max, "N·m/rad", path=(*place, "S_ref"))
        q, S = final_references(segment, q, S)
    g, joint = parameters.geometry, parameters.make_dynamics().joint
    for wall, place in zip(laid.walls, laid.wall_places, strict=True):
        try:
            if wall is not None:
                require_possible_wall(wall, joint, parameters.safety.F_max, g.q_max, T_s / SUBSTEPS)
        except PlantError as error:
            raise ExperimentError(str(error), place, find_line(place, lines)) from None


# Told ----------------------------------------------------------------------------------------------
#
# What each part of an experiment comes to once it is laid out: when it plays, from where to where.
# Pure.


@dataclass(frozen=True)
class PlayedPart:
    """A part as it plays.

    ``q_from`` and ``S_from`` are the references that its first piece finds, None where the experiment begins; ``q_to``,
    ``S_to`` and ``piece_s`` are that piece's own. ``end_s`` is the end of its last piece, all repetitions counted.
    """

    path: Path = field(metadata=describe_field("where it stands in the document"))
    start_s: float = field(metadata=describe_field("when it begins for the first time", "s"))
    end_s: float = field(metadata=describe_field("when it ends for the last time", "s"))
    pieces: int = field(metadata=describe_field("pieces that the loop plays of it, all repetitions counted"))
    piece_s: float = field(metadata=describe_field("length of its first piece", "s"))
    q_from: float | None = field(metadata=describe_field("joint reference before its first piece", "rad"))
    S_from: float | None = field(metadata=describe_field("stiffness reference before its first piece", "N·m/rad"))
    q_to: float = field(metadata=describe_field("joint reference of its first piece", "rad"))
    S_to: float = field(metadata=describe_field("stiffness reference of its first piece", "N·m/rad"))


def list_played_parts(laid: CompiledExperiment) -> list[PlayedPart]:
    """Return the parts that move or wait, in the order in which they first play."""
    found: dict[Path, PlayedPart] = {}
    at: tuple[float, float] | None = None
    clock_s = 0.0
    for segment, path in zip(laid.segments, laid.places, strict=True):
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


# Touches -------------------------------------------------------------------------------------------
#
# What an experiment learns and gives way to, as it is laid out, and what of it makes no sense.
# Pure.


LEARNING_S = 2.0
"""Least rest [s] that is learned from; seven times as long as its mean reaches back
(``disturbance_observer.MEAN_S``)."""


class Touches:
    """Touches in their order; each begins with the next segment, and what changes before there is one is one change."""

    def __init__(self) -> None:
        self.made: list[ContactDetection] = []
        self._begun = 0
        self._within = False
        self._learned: list[float] = []

    @property
    def unused_learning(self) -> bool:
        """Whether something was learned as the last thing of all."""
        return len(self.made) > self._begun and self.made[-1].learns

    def learn(self, S: float) -> str:
        """Learn what is felt at rest at S [N·m/rad]; why that cannot be, empty where it can."""
        if self._within:
            return "nothing is learned within what a contact ends: learn before it"
        self._learned.append(S)
        return self._put(ContactDetection(0.0, learns=True))

    def open(self, contact_N: float, S: float) -> str:
        """Let contacts above contact_N [N] end what comes, which begins at S [N·m/rad]; why not, empty where it can."""
        if self._within:
            return "a contact ends this already: what it ends has no part of its kind"
        if not self._learned:
            return "nothing was learned before it: let the joint rest in a part `do: learn` first, at this stiffness"
        if not min(self._learned) - NEIGHBOUR <= S <= max(self._learned) + NEIGHBOUR:
            known = ", ".join(f"{learned:.4g}" for learned in sorted(set(self._learned)))
            return f"at {S:.4g} N·m/rad nothing was learned, only at {known}: let the joint rest in a part `do: learn`"
        self._within = True
        return self._put(ContactDetection(contact_N))

    def close(self) -> str:
        """Let contacts end nothing more."""
        self._within = False
        return self._put(ContactDetection())

    def of_next(self) -> int:
        """Return the number of the touch that begins with the next segment, 0 for none."""
        if len(self.made) == self._begun:
            return 0
        self._begun = len(self.made)
        return self._begun

    def _put(self, touch: ContactDetection) -> str:
        if len(self.made) > self._begun:
            self.made[-1] = ContactDetection(touch.contact_N, self.made[-1].learns or touch.learns)
            return ""
        if len(self.made) == MAX_TOUCHES:
            return f"{MAX_TOUCHES} changes of what is given way to are the most: split the experiment"
        self.made.append(touch)
        return ""


# Layout --------------------------------------------------------------------------------------------
#
# Lays the parts of an experiment out: what the loop plays, one after the other, and where it was
# written. Pure.


LONGEST_S = 3600.0
F_PUSH_MAX = 30.0
LOAD_MAX_NM = 0.5
_K_WALL_MAX, _C_WALL_MAX = 1e5, 100.0
"""Of any plant; its own bounds of a wall are looked at before a start."""
_FASTEST_HZ = 50.0
_MOST_PARTS = 4 * MAX_SEGMENTS
_FROM_REST = (schema.Measure.COMPLIANCE, schema.Measure.DISTURBANCE, schema.Measure.PUSHES)
"""Measures of pushes, which count from the rest before each."""
_TUNED = {setting.name: setting for setting in describe_settings(TuningSettings)}


def laid(experiment: schema.Experiment, values: Names, lines: Lines) -> CompiledExperiment:
    """Lay an experiment out with these values of its settings. Raises ExperimentError naming line and bound."""
    return _Layout(experiment, values, lines).laid()


class _Layout(Numbers):
    def __init__(self, experiment: schema.Experiment, values: Names, lines: Lines) -> None:
        super().__init__(values, lines)
        self._experiment = experiment
        self._segments: list[Segment] = []
        self._places: list[Path] = []
        self._changes: list[Mapping[str, Value]] = []
        self._change_places: list[Path] = []
        self._unused_change = False
        self._placed = False
        self._F = 0.0
        self._duration_s = 0.0
        self._parts = 0
        self._walls: list[Obstacle | None] = []
        self._wall_places: list[Path] = []
        self._walls_up = 0
        self._touches = Touches()

    def laid(self) -> CompiledExperiment:
        phases: list[Phase] = []
        for place, section in enumerate(self._experiment.phases):
            path: Path = ("phases", place)
            if any(phase.name == section.name for phase in phases):
                raise self._refused("another phase has this name: give each its own", (*path, "name"))
            start_s = self._duration_s
            self._play(section.parts, (*path, "parts"))
            phases.append(Phase(section.name, section.title, start_s, self._duration_s))
        if self._unused_change:
            raise self._refused("nothing is played after this change of the tuning: leave it out", self._path)
        if self._walls_up != len(self._walls):
            raise self._refused("nothing is played after this change of the wall: leave it out", self._path)
        if self._touches.unused_learning:
            raise self._refused("nothing is played after what is learned here: leave it out", self._path)
        if not self._segments:
            raise self._refused("it plays nothing: give it a motion", ("phases",))
        return CompiledExperiment(
            segments=tuple(self._segments),
            places=tuple(self._places),
            phases=tuple(phases),
            changes=tuple(self._changes),
            change_places=tuple(self._change_places),
            walls=tuple(self._walls),
            wall_places=tuple(self._wall_places),
            touches=tuple(self._touches.made),
        )

    def _play(self, parts: Sequence[Any], path: Path) -> None:
        for place, part in enumerate(parts):
            self._path = (*path, place)
            self._parts += 1
            if self._parts > _MOST_PARTS:
                raise self._refused(f"{_MOST_PARTS} parts are the most, all repetitions counted", self._path)
            self._lay(part)

    @singledispatchmethod
    def _lay(self, part: Any) -> None:
        raise TypeError(f"no layout for {type(part).__name__}")

    @_lay.register
    def _hold(self, part: schema.Hold) -> None:
        self._stay(self._time(part.duration_s))

    @_lay.register
    def _step(self, part: schema.Step) -> None:
        self._aim(part.q_ref, part.S_ref)
        self._stay(self._time(part.duration_s), self._pushed(part.F_push))

    @_lay.register
    def _ramp(self, part: schema.Ramp) -> None:
        self._aim(part.q_ref, part.S_ref)
        F = self._pushed(part.F_push)
        self._add(Segment(self._time(part.duration_s), self._q, self._S, F, Shape.RAMP))

    @_lay.register
    def _pulse(self, part: schema.Pulse) -> None:
        before = self._q, self._S
        self._aim(part.q_ref, part.S_ref)
        self._stay(self._time(part.duration_s))
        self._q, self._S = before
        self._stay(self._time(part.rest_s, "rest_s"))

    @_lay.register
    def _sine(self, part: schema.Sine) -> None:
        period_s = self._number("period_s", part.period_s, 0.02, LONGEST_PART_S, "s")
        duration_s = self._time(part.duration_s)
        F = self._pushed(part.F_push)
        q_before, S_before, F_before = self._q, self._S, self._F
        if part.q_ref is None or part.S_ref is None:
            self._require_placed()
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
        for name, amplitude, crest in (("q_amplitude", q, part.q_ref), ("S_amplitude", S, part.S_ref)):
            if amplitude and crest is not None:
                raise self._refused("its crest is said twice, by the reference as well", (*self._path, name))
        self._q, self._S = q_before + q, S_before + S
        self._aim(part.q_ref, part.S_ref)
        self._add(Segment(duration_s, self._q, self._S, F, Shape.SINE, period_s))
        q = q if part.q_ref is None else self._q - q_before
        S = S if part.S_ref is None else self._S - S_before
        end = math.sin(2.0 * math.pi * duration_s / period_s)
        self._q, self._S = q_before + end * q, S_before + end * S
        if F:
            self._F = F_before + end * (F - F_before)

    @_lay.register
    def _sweep(self, part: schema.Sweep) -> None:
        low = 1.0 / LONGEST_PART_S
        from_Hz = self._number("from_Hz", part.from_Hz, low, _FASTEST_HZ, "Hz")
        to_Hz = self._number("to_Hz", part.to_Hz, low, _FASTEST_HZ, "Hz")
        duration_s = self._time(part.duration_s)
        self._require_placed()
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
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

    @_lay.register
    def _prbs(self, part: schema.Prbs) -> None:
        chip_s = round(self._number("chip_s", part.chip_s, 0.001, 60.0, "s"), 3)
        bits = self._whole("bits", part.bits, MIN_BITS, MAX_BITS)
        periods = self._whole("periods", part.periods, 1, 1000)
        self._require_placed()
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
        duration_s = self._time(periods * (2**bits - 1) * chip_s, "chip_s", "time of all chips")
        self._add(Segment(duration_s, self._q + q, self._S + S, shape=Shape.PRBS, period_s=chip_s, count=bits))

    @_lay.register
    def _multisine(self, part: schema.Multisine) -> None:
        period_s = round(self._number("period_s", part.period_s, 0.1, LONGEST_PART_S, "s"), 3)
        lines = self._whole("lines", part.lines, 1, MAX_LINES)
        with error_context((*self._path, "lines"), self._lines):
            fastest = f"{_FASTEST_HZ:g} Hz is the fastest: take fewer lines or a longer period"
            check_range(
                "lines",
                lines / period_s,
                minimum=None,
                maximum=_FASTEST_HZ,
                unit="Hz",
                remedy=fastest,
                words="highest frequency",
            )
        periods = self._whole("periods", part.periods, 1, 1000)
        self._require_placed()
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
        duration_s = self._time(periods * period_s, "periods", "time of all periods")
        peak, shape = peak_of(lines), Shape.MULTISINE
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

    @_lay.register
    def _push(self, part: schema.Push) -> None:
        F = self._number("F_push", part.F_push, -F_PUSH_MAX, F_PUSH_MAX, "N")
        duration_s = self._time(part.duration_s)
        if part.shape == "smooth":
            self._press(smooth(self._F, F, duration_s, evenly=True))
        else:
            self._press([PushPiece(duration_s, F, Shape(part.shape))])

    @_lay.register
    def _hand(self, part: schema.Hand) -> None:
        F = self._number("F_push", part.F_push, 0.0, F_PUSH_MAX, "N")
        pushes = self._whole("pushes", part.pushes, 1, 100)
        pause_s = self._number("pause_s", part.pause_s, 0.05, 60.0, "s")
        self._press(pushes_of_a_hand(F, pushes, pause_s, self._whole("seed", part.seed, 0, 2**31 - 1)))

    @_lay.register
    def _load(self, part: schema.Load) -> None:
        load_A = self._number("load_A", part.load_A, 0.0, LOAD_MAX_NM, "N·m")
        load_B = self._number("load_B", part.load_B, 0.0, LOAD_MAX_NM, "N·m")
        self._add(Segment(self._time(part.duration_s), self._q, self._S, load_A=load_A, load_B=load_B))

    @_lay.register
    def _tuning(self, part: schema.Tuning) -> None:
        if len(self._changes) == MAX_TUNINGS:
            raise self._refused(f"{MAX_TUNINGS} changes of the tuning are the most: split the experiment", self._path)
        named: dict[str, Value] = {}
        for name, setting in _TUNED.items():
            wanted = getattr(part, name)
            if isinstance(wanted, bool) or setting.kind == "choice":
                named |= {} if wanted is None else {name: wanted}
            elif wanted is not None and setting.minimum is not None and setting.maximum is not None:
                # A limit of 0 V is how texts from before ``motion`` existed choose the paper's law.
                minimum = 0.0 if name == "u_plan" and part.motion is None else setting.minimum
                number = self._number(name, wanted, minimum, setting.maximum, setting.unit)
                named[name] = int(number) if setting.kind == "integer" else number
        before = self._changes[-1] if self._changes else {}
        self._changes.append({**before, **complete_motion(named)})
        self._change_places.append(self._path)
        self._unused_change = True

    @_lay.register
    def _wall(self, part: schema.Wall) -> None:
        side = 1.0 if part.side == "above" else -1.0
        q_wall = self._number("q_wall", part.q_wall, -Q_REF_MAX, Q_REF_MAX, "rad")
        if side * (self._q - q_wall) >= 0.0:
            why = f"the joint is asked to be at {self._q:.4g} rad, not before a wall at {q_wall:.4g} rad"
            raise self._refused(f"{why}: bring it away from there first", (*self._path, "q_wall"))
        k_wall = self._number("k_wall", part.k_wall, K_LEAST, _K_WALL_MAX, "N/m")
        self._stand(Obstacle(side, q_wall, k_wall, self._number("c_wall", part.c_wall, 0.0, _C_WALL_MAX, "s/m")))

    @_lay.register
    def _no_wall(self, part: schema.NoWall) -> None:
        self._stand(None)

    def _stand(self, wall: Obstacle | None) -> None:
        if len(self._walls) == MAX_WALLS:
            raise self._refused(f"{MAX_WALLS} changes of the wall are the most: split the experiment", self._path)
        self._walls.append(wall)
        self._wall_places.append(self._path)

    @_lay.register
    def _learn(self, part: schema.Learn) -> None:
        words = "time at rest that is learned from"
        self._stay(round(self._number("duration_s", part.duration_s, LEARNING_S, LONGEST_PART_S, "s", words), 3))
        self._touched(self._touches.learn(self._S))

    @_lay.register
    def _until_contact(self, part: schema.UntilContact) -> None:
        path = self._path
        contact_N = self._number("contact_N", part.contact_N, 0.0, CONTACT_MAX_N, "N", "force of a contact")
        if contact_N == 0.0:
            self._play(part.parts, (*path, "parts"))
            return
        self._number("contact_N", contact_N, CONTACT_MIN_N, CONTACT_MAX_N, "N", "force of a contact (0 for none)")
        self._touched(self._touches.open(contact_N, self._S))
        self._play(part.parts, (*path, "parts"))
        self._touched(self._touches.close())

    def _touched(self, problem: str) -> None:
        if problem:
            raise self._refused(problem, self._path)

    @_lay.register
    def _choose(self, part: schema.Choose) -> None:
        chosen, path = self._names.get(part.by), self._path
        declared = next((one for one in self._experiment.settings if one.name == part.by), None)
        if declared is None or declared.kind != "choice":
            raise self._refused(f"{part.by!r} is no setting with choices", (*path, "by"))
        if set(part.of) != set(declared.choices):
            raise self._refused(f"it needs parts for each of {', '.join(declared.choices)}", (*path, "of"))
        self._play(part.of[str(chosen)], (*path, "of", str(chosen)))

    @_lay.register
    def _repeat(self, part: schema.Repeat) -> None:
        path, outer = self._path, self._names.get(part.index)
        times = self._whole("times", part.times, 1, MAX_SEGMENTS)
        if part.index in (*CONSTANTS, *FUNCTIONS) or any(part.index == one.name for one in self._experiment.settings):
            raise self._refused(f"{part.index!r} is taken: give the index another name", (*path, "index"))
        for turn in range(times):
            self._names[part.index] = turn
            self._play(part.parts, (*path, "parts"))
        if outer is None:
            del self._names[part.index]
        else:
            self._names[part.index] = outer

    def _press(self, pieces: Any) -> None:
        for piece in pieces:
            self._F = float(piece.F_push)
            self._add(Segment(round(piece.duration_s, 3), self._q, self._S, self._F, piece.shape), pushed=True)

    def _pushed(self, F_push: float | str) -> float:
        """Return the push [N] beside a motion; what is measured from rest takes none."""
        F = self._number("F_push", F_push, -F_PUSH_MAX, F_PUSH_MAX, "N")
        measured = [measure for measure in _FROM_REST if measure in self._experiment.measures]
        if F and measured:
            why = f"{measured[0]} measures pushes from rest: take a part `do: push`"
            raise self._refused(why, (*self._path, "F_push"))
        return F

    def _require_placed(self) -> None:
        """Refuse to oscillate around references that nothing before has said."""
        if not self._placed:
            raise self._refused("nothing says around which references it goes: begin with a step", self._path)

    def _stay(self, duration_s: float, F_push: float = 0.0) -> None:
        self._add(Segment(duration_s, self._q, self._S, F_push))

    def _add(self, segment: Segment, *, pushed: bool = False) -> None:
        self._placed = self._placed or segment.shape not in OSCILLATING
        if not pushed:
            self._F = segment.F_push
        if len(self._segments) == MAX_SEGMENTS:
            raise self._refused(
                f"its parts are more than {MAX_SEGMENTS}, all repetitions counted: repeat less, or split it", self._path
            )
        if self._unused_change:
            segment = replace(segment, tuning=len(self._changes))
            self._unused_change = False
        if self._walls_up != len(self._walls):
            self._walls_up = len(self._walls)
            segment = replace(segment, wall=self._walls_up)
        if touch := self._touches.of_next():
            segment = replace(segment, touch=touch)
        self._duration_s += segment.duration_s
        with error_context(self._path, self._lines):
            words = "time of all parts up to here"
            check_range(
                "duration_s",
                self._duration_s,
                minimum=None,
                maximum=LONGEST_S,
                unit="s",
                remedy="leave some out",
                words=words,
            )
        self._segments.append(segment)
        self._places.append(self._path)
