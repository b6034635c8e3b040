"""How an experiment that cannot be is refused: in which line, which part of it, why."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from backend.errors import Path, RefusedValueError
from backend.units import Angles

Lines = Mapping[Path, int]
"""Line of each part of a text, from 1, by its place in what the text says."""


class ExperimentError(RefusedValueError):
    """An experiment that is not taken. ``line`` is None where nobody wrote it as a text."""

    def __init__(self, why: str | RefusedValueError, path: Path = (), line: int | None = None) -> None:
        self.why = why
        self.line = line
        super().__init__(str(path[-1]) if path else "experiment", words=in_words(path), path=path)

    def sentence(self, angles: Angles) -> str:
        """Say it to somebody who reads angles in this unit."""
        why = self.why if isinstance(self.why, str) else self.why.sentence(angles)
        place = f"line {self.line}" if self.line else ""
        return ": ".join(part for part in (place, self.words if self.path else "", why) if part)


def in_words(path: Path) -> str:
    """Write a place as a person counts: "phases 2, parts 1, q_ref"."""
    words: list[str] = []
    for part in path:
        if isinstance(part, int) and words:
            words[-1] += f" {part + 1}"
        else:
            words.append(str(part))
    return ", ".join(words) or "experiment"


def line_of(path: Path, lines: Lines) -> int | None:
    """Return the line of a place, or of the nearest that it lies in."""
    for length in range(len(path), -1, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return None


@contextmanager
def at(path: Path, lines: Lines) -> Iterator[None]:
    """Say of whatever is refused inside where it stands."""
    try:
        yield
    except ExperimentError:
        raise
    except RefusedValueError as error:
        raise ExperimentError(error, path, line_of(path, lines)) from None
