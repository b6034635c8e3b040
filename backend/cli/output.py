"""How commands speak: tables or JSON on standard output, progress and complaints on standard error."""

import io
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from backend.execution.runner import Doing
from backend.plain_text import as_json, as_line, as_lines
from backend.units import Angles, in_words


class Screen(Console):
    """A terminal that obeys nothing that stands in a text: control characters are shown as escapes."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print texts with what a terminal would obey, or nobody would see, as escapes; tables as they are."""
        super().print(*(as_lines(one) if isinstance(one, str) else one for one in objects), **options)


out = Screen()
errors = Screen(stderr=True)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of tables.")]


ANGLES = "SINEW_ANGLES"
"""Variable of the environment that says in which unit whoever types the commands reads angles."""


def angles() -> Angles:
    """Return the unit of angles in tables and refusals: degrees, unless the environment says rad."""
    return Angles.RADIANS if os.environ.get(ANGLES) == Angles.RADIANS else Angles.DEGREES


def fail(*messages: str, status: int = 1) -> NoReturn:
    """Print a line for each message, whatever line breaks it has, and end with ``status``."""
    for message in messages:
        errors.print(
            f"sinew: {in_words(' '.join(message.split()), angles())}",
            style="red",
            highlight=False,
            soft_wrap=True,
            markup=False,
        )
    sys.exit(status)


def print_what_can_be_printed() -> None:
    """Print as an escape what the terminal's encoding has no character for, such as λ in Latin-1."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def print_json(document: Any) -> None:
    """Print a document for programs."""
    print(as_json(document, indent=2))


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[object]], title: str | None = None, whole: Sequence[str] = ()
) -> None:
    """Print a table; numbers to the right. Columns of ``whole`` keep their width on a narrow terminal."""
    table = Table(title=title and escape(as_line(title)), title_justify="left", title_style="bold")
    kept = [[shown(cell) for cell in row] for row in rows]
    for index, column in enumerate(columns):
        numbers = bool(kept) and all(_is_number(row[index]) for row in kept)
        table.add_column(as_line(column), justify="right" if numbers else "left", no_wrap=column in whole)
    for row in kept:
        table.add_row(*row)
    out.print(table, highlight=False, markup=False)


def shown(value: object) -> str:
    """Return a cell: four digits of a number, a dash for what is not there; a text on one line."""
    if value is None or value == "":
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else as_line(value)


@dataclass(frozen=True)
class Meter:
    """A progress bar in seconds of the loop's time."""

    progress: Progress
    task: Any

    def __call__(self, doing: Doing, elapsed_s: float) -> None:
        """Show how far it is."""
        self.progress.update(self.task, description=doing, completed=elapsed_s if doing is Doing.PROGRAM else None)


@contextmanager
def meter(duration_s: float, *, hidden: bool) -> Iterator[Meter]:
    """Show progress on standard error while the block runs."""
    columns = (TextColumn("{task.description:>11}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=errors, disable=hidden, transient=True) as progress:
        yield Meter(progress, progress.add_task(Doing.STARTING, total=duration_s))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == "-"
    return True
