"""Numbers as a part of an experiment asks for them: expressions, their bounds, and where they stand. Pure."""

from backend.errors import Path, require_within
from backend.experiments.composing.expressions import ExpressionError, Names, number_of
from backend.experiments.composing.refused import ExperimentError, Lines, at, line_of

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
        return round(self._number(name, expression, 0.01, LONGEST_PART_S, "s", words), 3)

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
            number = number_of(expression, self._names)
        except ExpressionError as error:
            raise self._refused(str(error), path) from None
        slack = 1e-9 * max(abs(least), abs(most))  # a bound that was computed from the same settings is one to be met
        clipped = min(max(number, least), most) if least - slack <= number <= most + slack else number
        with at(path, self._lines):
            require_within(name, clipped, least, most, unit, words=words, path=path)
        return clipped

    def _aim(self, q_ref: float | str | None, S_ref: float | str | None) -> None:
        if q_ref is not None:
            self._q = self._number("q_ref", q_ref, -Q_REF_MAX, Q_REF_MAX, "rad")
        if S_ref is not None:
            self._S = self._number("S_ref", S_ref, S_LOWEST, S_HIGHEST, "N·m/rad")

    def _amplitudes(self, q: float | str, S: float | str) -> tuple[float, float]:
        """Return the amplitudes; the references stay within their bounds on both sides."""
        room_q, room_S = Q_REF_MAX - abs(self._q), min(S_HIGHEST - self._S, self._S - S_LOWEST)
        about = f"around {self._q:.6g} rad" if self._q else ""
        amplitude_q = self._number("q_amplitude", q, -room_q, room_q, "rad", f"amplitude of q_ref {about}".strip())
        words = f"amplitude of S_ref around {self._S:.6g} N·m/rad"
        return amplitude_q, self._number("S_amplitude", S, -room_S, room_S, "N·m/rad", words)

    def _refused(self, why: str, path: Path) -> ExperimentError:
        return ExperimentError(why, path, line_of(path, self._lines))
