"""What is wrong with a wiring file, each with its line and what to do."""

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
        super().__init__("\n".join(problem.sentence(file) for problem in problems))
