"""What is wrong with a wiring file, each with its line and what to do."""

import re
from collections.abc import Iterator
from typing import NamedTuple


class Problem(NamedTuple):
    """One thing that is wrong: ``line`` of the file from 1 (0: of the whole), the entry, what and what to do."""

    line: int
    entry: str
    text: str
    remedy: str

    def sentence(self, file: str) -> str:
        """Say it in one line."""
        where = f"{file}:{self.line}" if self.line else file
        return f"{where}: {self.entry}: {self.text}; {self.remedy}"


class WiringError(ValueError):
    """A wiring file is refused; ``problems`` are all that was found."""

    def __init__(self, file: str, problems: tuple[Problem, ...]) -> None:
        self.problems = problems
        self.sentences = [problem.sentence(file) for problem in problems]
        super().__init__("\n".join(self.sentences))


_HEADER = re.compile(r"\s*\[\s*([\w-]+)\s*\]")
_KEY = re.compile(r"\s*([\w-]+)\s*=")


def lines_of(text: str) -> dict[str, int]:
    """Return on which lines sections and their entries stand, from 1."""
    return dict(_found(text))


def _found(text: str) -> Iterator[tuple[str, int]]:
    section = ""
    for position, line in enumerate(text.splitlines(), 1):
        if (header := _HEADER.match(line)) is not None:
            section = header[1]
            yield section, position
        elif (key := _KEY.match(line)) is not None and section:
            yield f"{section}.{key[1]}", position
