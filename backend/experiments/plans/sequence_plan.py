"""Own sequences of references, written as JSON: what a person types, sends or keeps beside the data."""

import json
from dataclasses import dataclass
from typing import Any, ClassVar

from backend.control.decoupler import STIFFNESS_RANGE
from backend.errors import WORDS, Path, require_within
from backend.models.run import Phase
from backend.models.settings import SettingError, text
from backend.realtime.program import MAX_SEGMENTS, Law, Program, Segment, Shape

Q_REF_MAX = 1.4
"""Largest joint reference of a plan [rad]; the loop has the last word for its plant."""

F_PUSH_MAX = 30.0
MAX_SEQUENCE_S = 3600.0

_EXAMPLE = """[
  {"duration_s": 4, "q_ref": 0, "S_ref": 10},
  {"duration_s": 4, "q_ref": 0.5, "S_ref": 10},
  {"duration_s": 4, "q_ref": -0.5, "S_ref": 12, "shape": "ramp"},
  {"duration_s": 8, "q_ref": -0.2, "S_ref": 12, "shape": "sine", "period_s": 4}
]"""
_NEEDED = ("duration_s", "q_ref", "S_ref")
_NAMES = (*_NEEDED, "F_push", "shape", "period_s")
_SHAPES = (Shape.STEP, Shape.RAMP, Shape.SINE)


@dataclass(frozen=True)
class SequencePlan:
    """An own sequence of steps, ramps and sines of q_ref and S_ref, at most one hour long."""

    kind: ClassVar[str] = "sequence"

    segments: str = text(
        _EXAMPLE,
        100_000,
        "segments",
        'JSON list of segments: duration_s [s], q_ref [rad], S_ref [N·m/rad], F_push [N], shape "step", "ramp" or '
        '"sine" around the values before, period_s [s] of a sine',
    )

    def __post_init__(self) -> None:
        self.program()

    def program(self) -> Program:
        """Return the segments as a program. Raises SettingError, OutOfRangeError naming the segment."""
        segments = tuple(_segment(position, item) for position, item in enumerate(_listed(self.segments), start=1))
        duration = sum(segment.duration_s for segment in segments)
        words = "time of all segments together"
        require_within("segments", duration, None, MAX_SEQUENCE_S, "s", "leave some out", words=words)
        return Program(Law.CASCADE, segments)

    def phases(self) -> tuple[Phase, ...]:
        """Return one phase: the sequence."""
        return (Phase("sequence", "Own sequence", 0.0, self.program().duration_s),)


def _listed(segments: str) -> list[Any]:
    try:
        items = json.loads(segments)
    except (ValueError, RecursionError) as error:
        raise SettingError("segments", segments[:40], f"it is not JSON: {error}") from None
    if not isinstance(items, list) or not 0 < len(items) <= MAX_SEGMENTS:
        raise SettingError("segments", segments[:40], f"it needs a list of 1 to {MAX_SEGMENTS} segments")
    return items


def _segment(position: int, item: Any) -> Segment:
    place, words = ("segments", position - 1), f"segment {position}"
    if not isinstance(item, dict) or not set(_NEEDED) <= set(item) <= set(_NAMES):
        reason = f"it needs {', '.join(_NEEDED)}; it may have {', '.join(_NAMES[3:])}"
        raise SettingError("segments", item, reason, legal=_NAMES, words=words, path=place)
    shape = item.get("shape", Shape.STEP)
    if shape not in _SHAPES:
        reason = f"choose one of {', '.join(_SHAPES)}"
        where: Path = (*place, "shape")
        raise SettingError("shape", shape, reason, legal=_SHAPES, words=f"{words}, shape", path=where)
    bounds = {
        "duration_s": (0.01, 600.0, "s"),
        "q_ref": (-Q_REF_MAX, Q_REF_MAX, "rad"),
        "S_ref": (*STIFFNESS_RANGE, "N·m/rad"),
        "F_push": (-F_PUSH_MAX, F_PUSH_MAX, "N"),
        "period_s": (0.05, 600.0, "s"),
    }
    numbers = {name: item[name] for name in bounds if name in item}
    for name, value in numbers.items():
        minimum, maximum, unit = bounds[name]
        named, where = f"{words}, {WORDS[name]}", (*place, name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SettingError(name, value, "it needs a number", unit=unit, words=named, path=where)
        require_within(name, value, minimum, maximum, unit, words=named, path=where)
    values = {"F_push": 0.0, "period_s": 1.0} | {name: float(value) for name, value in numbers.items()}
    return Segment(
        round(values["duration_s"], 3),  # whole milliseconds, as the loop plays them
        values["q_ref"],
        values["S_ref"],
        values["F_push"],
        Shape(shape),
        values["period_s"],
    )
