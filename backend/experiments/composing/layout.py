"""Lays the parts of an experiment out: what the loop plays, one after the other, and where it was written. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import singledispatchmethod
from typing import Any

from backend.banks.tuning_settings import TuningChoice
from backend.control.setpoint_player import LEAST_BITS, MOST_BITS, MOST_LINES
from backend.documents import experiment as form
from backend.errors import Path, require_within
from backend.experiments.composing.expressions import CONSTANTS, FUNCTIONS, Names
from backend.experiments.composing.hand import PushPiece, pushes_of_a_hand, smooth
from backend.experiments.composing.laid import Laid
from backend.experiments.composing.multisine import peak_of
from backend.experiments.composing.numbers import LONGEST_PART_S, Q_REF_MAX, Numbers
from backend.experiments.composing.refused import Lines, at
from backend.experiments.composing.touches import LEARNING_S, Touches
from backend.models.run import Phase, Value, with_motion
from backend.models.settings import describe
from backend.realtime.program import CONTACT_MAX_N, CONTACT_MIN_N, MAX_SEGMENTS, MAX_TUNINGS, MAX_WALLS, Segment, Shape
from plant.dynamics import K_LEAST, Obstacle

LONGEST_S = 3600.0
F_PUSH_MAX = 30.0
LOAD_MAX_NM = 0.5
_K_WALL_MAX, _C_WALL_MAX = 1e5, 100.0
"""Of any plant; its own bounds of a wall are looked at before a start."""
_FASTEST_HZ = 50.0
_MOST_PARTS = 4 * MAX_SEGMENTS
_TUNED = {setting.name: setting for setting in describe(TuningChoice)}


def laid(experiment: form.Experiment, values: Names, lines: Lines) -> Laid:
    """Lay an experiment out with these values of its settings. Raises ExperimentError naming line and bound."""
    return _Layout(experiment, values, lines).laid()


class _Layout(Numbers):
    def __init__(self, experiment: form.Experiment, values: Names, lines: Lines) -> None:
        super().__init__(values, lines)
        self._experiment = experiment
        self._segments: list[Segment] = []
        self._places: list[Path] = []
        self._changes: list[Mapping[str, Value]] = []
        self._change_places: list[Path] = []
        self._unused_change = False
        self._F = 0.0
        self._duration_s = 0.0
        self._parts = 0
        self._walls: list[Obstacle | None] = []
        self._wall_places: list[Path] = []
        self._walls_up = 0
        self._touches = Touches()

    def laid(self) -> Laid:
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
        return Laid(
            tuple(self._segments),
            tuple(self._places),
            tuple(phases),
            tuple(self._changes),
            tuple(self._change_places),
            tuple(self._walls),
            tuple(self._wall_places),
            tuple(self._touches.made),
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
    def _hold(self, part: form.Hold) -> None:
        self._stay(self._time(part.duration_s))

    @_lay.register
    def _step(self, part: form.Step) -> None:
        self._aim(part.q_ref, part.S_ref)
        self._stay(self._time(part.duration_s))

    @_lay.register
    def _ramp(self, part: form.Ramp) -> None:
        self._aim(part.q_ref, part.S_ref)
        self._add(Segment(self._time(part.duration_s), self._q, self._S, shape=Shape.RAMP))

    @_lay.register
    def _pulse(self, part: form.Pulse) -> None:
        before = self._q, self._S
        self._aim(part.q_ref, part.S_ref)
        self._stay(self._time(part.duration_s))
        self._q, self._S = before
        self._stay(self._time(part.rest_s, "rest_s"))

    @_lay.register
    def _sine(self, part: form.Sine) -> None:
        period_s = self._number("period_s", part.period_s, 0.02, LONGEST_PART_S, "s")
        duration_s = self._time(part.duration_s)
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
        self._add(Segment(duration_s, self._q + q, self._S + S, shape=Shape.SINE, period_s=period_s))
        end = math.sin(2.0 * math.pi * duration_s / period_s)
        self._q, self._S = self._q + end * q, self._S + end * S

    @_lay.register
    def _sweep(self, part: form.Sweep) -> None:
        low = 1.0 / LONGEST_PART_S
        from_Hz = self._number("from_Hz", part.from_Hz, low, _FASTEST_HZ, "Hz")
        to_Hz = self._number("to_Hz", part.to_Hz, low, _FASTEST_HZ, "Hz")
        duration_s = self._time(part.duration_s)
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
        end_s = 1.0 / to_Hz
        swept = Segment(duration_s, self._q + q, self._S + S, 0.0, Shape.SWEEP, 1.0 / from_Hz, period_end_s=end_s)
        self._add(swept)

    @_lay.register
    def _prbs(self, part: form.Prbs) -> None:
        chip_s = round(self._number("chip_s", part.chip_s, 0.001, 60.0, "s"), 3)
        bits = self._whole("bits", part.bits, LEAST_BITS, MOST_BITS)
        periods = self._whole("periods", part.periods, 1, 1000)
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
        duration_s = self._time(periods * (2**bits - 1) * chip_s, "chip_s", "time of all chips")
        self._add(Segment(duration_s, self._q + q, self._S + S, shape=Shape.PRBS, period_s=chip_s, count=bits))

    @_lay.register
    def _multisine(self, part: form.Multisine) -> None:
        period_s = round(self._number("period_s", part.period_s, 0.1, LONGEST_PART_S, "s"), 3)
        lines = self._whole("lines", part.lines, 1, MOST_LINES)
        with at((*self._path, "lines"), self._lines):
            fastest = f"{_FASTEST_HZ:g} Hz is the fastest: take fewer lines or a longer period"
            require_within("lines", lines / period_s, None, _FASTEST_HZ, "Hz", fastest, words="highest frequency")
        periods = self._whole("periods", part.periods, 1, 1000)
        q, S = self._amplitudes(part.q_amplitude, part.S_amplitude)
        duration_s = self._time(periods * period_s, "periods", "time of all periods")
        peak, shape = peak_of(lines), Shape.MULTISINE
        self._add(Segment(duration_s, self._q + q, self._S + S, 0.0, shape, period_s, count=lines, peak=peak))

    @_lay.register
    def _push(self, part: form.Push) -> None:
        F = self._number("F_push", part.F_push, -F_PUSH_MAX, F_PUSH_MAX, "N")
        duration_s = self._time(part.duration_s)
        if part.shape == "smooth":
            self._press(smooth(self._F, F, duration_s, evenly=True))
        else:
            self._press([PushPiece(duration_s, F, Shape(part.shape))])

    @_lay.register
    def _hand(self, part: form.Hand) -> None:
        F = self._number("F_push", part.F_push, 0.0, F_PUSH_MAX, "N")
        pushes = self._whole("pushes", part.pushes, 1, 100)
        pause_s = self._number("pause_s", part.pause_s, 0.05, 60.0, "s")
        self._press(pushes_of_a_hand(F, pushes, pause_s, self._whole("seed", part.seed, 0, 2**31 - 1)))

    @_lay.register
    def _load(self, part: form.Load) -> None:
        load_A = self._number("load_A", part.load_A, 0.0, LOAD_MAX_NM, "N·m")
        load_B = self._number("load_B", part.load_B, 0.0, LOAD_MAX_NM, "N·m")
        self._add(Segment(self._time(part.duration_s), self._q, self._S, load_A=load_A, load_B=load_B))

    @_lay.register
    def _tuning(self, part: form.Tuning) -> None:
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
        self._changes.append({**before, **with_motion(named)})
        self._change_places.append(self._path)
        self._unused_change = True

    @_lay.register
    def _wall(self, part: form.Wall) -> None:
        side = 1.0 if part.side == "above" else -1.0
        q_wall = self._number("q_wall", part.q_wall, -Q_REF_MAX, Q_REF_MAX, "rad")
        if side * (self._q - q_wall) >= 0.0:
            why = f"the joint is asked to be at {self._q:.4g} rad, not before a wall at {q_wall:.4g} rad"
            raise self._refused(f"{why}: bring it away from there first", (*self._path, "q_wall"))
        k_wall = self._number("k_wall", part.k_wall, K_LEAST, _K_WALL_MAX, "N/m")
        self._stand(Obstacle(side, q_wall, k_wall, self._number("c_wall", part.c_wall, 0.0, _C_WALL_MAX, "s/m")))

    @_lay.register
    def _no_wall(self, part: form.NoWall) -> None:
        self._stand(None)

    def _stand(self, wall: Obstacle | None) -> None:
        if len(self._walls) == MAX_WALLS:
            raise self._refused(f"{MAX_WALLS} changes of the wall are the most: split the experiment", self._path)
        self._walls.append(wall)
        self._wall_places.append(self._path)

    @_lay.register
    def _learn(self, part: form.Learn) -> None:
        words = "time at rest that is learned from"
        self._stay(round(self._number("duration_s", part.duration_s, LEARNING_S, LONGEST_PART_S, "s", words), 3))
        self._touched(self._touches.learn(self._S))

    @_lay.register
    def _until_contact(self, part: form.UntilContact) -> None:
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
    def _choose(self, part: form.Choose) -> None:
        chosen, path = self._names.get(part.by), self._path
        declared = next((one for one in self._experiment.settings if one.name == part.by), None)
        if declared is None or declared.kind != "choice":
            raise self._refused(f"{part.by!r} is no setting with choices", (*path, "by"))
        if set(part.of) != set(declared.choices):
            raise self._refused(f"it needs parts for each of {', '.join(declared.choices)}", (*path, "of"))
        self._play(part.of[str(chosen)], (*path, "of", str(chosen)))

    @_lay.register
    def _repeat(self, part: form.Repeat) -> None:
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

    def _stay(self, duration_s: float) -> None:
        self._add(Segment(duration_s, self._q, self._S))

    def _add(self, segment: Segment, *, pushed: bool = False) -> None:
        if not pushed:
            self._F = 0.0
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
        with at(self._path, self._lines):
            words = "time of all parts up to here"
            require_within("duration_s", self._duration_s, None, LONGEST_S, "s", "leave some out", words=words)
        self._segments.append(segment)
        self._places.append(self._path)
