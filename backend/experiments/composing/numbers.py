"""Numbers as a part of an experiment asks for them: expressions, their bounds, and where they stand. Pure."""

from backend.experiments.composing.expressions import ExpressionError, Names, number_of
from backend.experiments.composing.refused import ExperimentError, Lines, at, line_of
from backend.refusal import Path, require_within

LONGEST_PART_S = 600.0


class Numbers:
    """Reads the numbers of the part at ``_path``, of settings and counters by their names."""

    def __init__(self, values: Names, lines: Lines) -> None:
        self._names = dict(values)
        self._lines = lines
        self._path: Path = ()

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

    def _refused(self, why: str, path: Path) -> ExperimentError:
        return ExperimentError(why, path, line_of(path, self._lines))
