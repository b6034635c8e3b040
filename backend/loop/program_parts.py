"""Puts a program together that came in parts."""

from dataclasses import replace

from backend.loop.channel import LongProgram, ProgramPart
from backend.loop.commands import RunProgram
from backend.loop.mode import RefusedError
from backend.loop.program import MAX_SEGMENTS, MAX_TUNINGS, Segment
from backend.loop.set_tuning import SetTuning


class ProgramParts:
    """What has come ahead of one program. Parts of another one, whose rest never came, are dropped."""

    def __init__(self) -> None:
        self._sequence = 0
        self._segments: list[Segment] = []
        self._tunings: list[SetTuning] = []

    def keep(self, sequence: int, part: ProgramPart) -> None:
        """Keep a part until the rest comes; more than a program may have are not kept."""
        if sequence != self._sequence:
            self._sequence, self._segments, self._tunings = sequence, [], []
        if len(self._segments) <= MAX_SEGMENTS:
            self._segments += part.segments
        if len(self._tunings) <= MAX_TUNINGS:
            self._tunings += part.tunings

    def whole(self, sequence: int, rest: LongProgram) -> RunProgram:
        """Return the program with all its parts. Raises RefusedError where one is missing."""
        self.keep(sequence, ProgramPart())
        segments, tunings = tuple(self._segments), tuple(self._tunings)
        self._segments, self._tunings = [], []
        for arrived, expected, what in (
            (len(segments), rest.segments, "segments"),
            (len(tunings), rest.tunings, "tunings"),
        ):
            if arrived != expected:
                raise RefusedError(f"{arrived} of the program's {expected} {what} arrived: send it again")
        return replace(rest.command, program=replace(rest.command.program, segments=segments, tunings=tunings))
