"""Output of commands: tables or JSON on standard output, progress and complaints on standard error."""

import atexit
import gc
import io
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from backend.execution import RunPhase
from backend.plain_text import as_json, as_line, as_lines
from backend.units import AngleUnit, format_angles, read, reading_of

if TYPE_CHECKING:
    from backend.models import MeasuredFigure, RunCriterion
    from backend.reports import RunData

    pass


# Output --------------------------------------------------------------------------------------------
#
# How commands speak: tables or JSON on standard output, progress and complaints on standard error.


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


def angle_unit() -> AngleUnit:
    """Return the unit of angles in tables and refusals: degrees, unless the environment says rad."""
    return AngleUnit.RADIANS if os.environ.get(ANGLES) == AngleUnit.RADIANS else AngleUnit.DEGREES


def fail(*messages: str, status: int = 1) -> NoReturn:
    """Print a line for each message, whatever line breaks it has, and end with ``status``."""
    for message in messages:
        errors.print(
            f"sinew: {format_angles(' '.join(message.split()), angle_unit())}",
            style="red",
            highlight=False,
            soft_wrap=True,
            markup=False,
        )
    sys.exit(status)


def escape_unprintable_output() -> None:
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

    def __call__(self, doing: RunPhase, elapsed_s: float) -> None:
        """Show how far it is."""
        self.progress.update(self.task, description=doing, completed=elapsed_s if doing is RunPhase.PROGRAM else None)


@contextmanager
def meter(duration_s: float, *, hidden: bool) -> Iterator[Meter]:
    """Show progress on standard error while the block runs."""
    columns = (TextColumn("{task.description:>11}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=errors, disable=hidden, transient=True) as progress:
        yield Meter(progress, progress.add_task(RunPhase.STARTING, total=duration_s))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == "-"
    return True


# Run tables ----------------------------------------------------------------------------------------
#
# A run on the screen: what it was set to, what was measured, how it was judged.


_JUDGED = {True: "passed", False: "FAILED", None: "not measured"}


def show_run(source: "RunData", files: Sequence[Path] = ()) -> None:
    """Print how a run ended and what came of it, and the files that were written."""
    from backend.reports import judge_stored_run

    run, result = source.run, source.result
    end = ": ".join(filter(None, (run.end_state, run.end_detail)))
    _say(f"run {run.id}, {run.kind}: {end}", style="bold")
    sentence = judge_stored_run(result.metrics if result else None, result.criteria if result else ()).sentence
    if result is not None:
        _figures(result.metrics.figures)
        _criteria(result.criteria, sentence)
    if source.identification is not None:
        _say(source.identification.verdict)
    elif result is None or not result.metrics.figures:
        _say(sentence)
    for path in files:
        out.print(f"wrote {path}", highlight=False, markup=False)


def show_settings(source: "RunData") -> None:
    """Print what a run was set to."""
    from backend.analysis import select_used_settings

    used = select_used_settings(source.run)
    rows = [
        (
            item.meaning,
            item.symbol,
            _setting(item.value, item.unit),
            reading_of(item.unit, angle_unit()).unit,
        )
        for item in used
    ]
    if rows:
        print_table(("setting", "symbol", "value", "unit"), rows)


def _setting(value: object, unit: str) -> object:
    return read(value, unit, angle_unit()) if isinstance(value, float) else value


def _figures(figures: "Sequence[MeasuredFigure]") -> None:
    rows = [
        (
            item.label,
            _figure(item.value, item.unit),
            reading_of(item.unit, angle_unit()).unit,
            format_angles(item.reason or "measured", angle_unit()),
        )
        for item in figures
    ]
    if rows:
        kept = 4 if any(item.reason for item in figures) else 3
        print_table(("figure", "value", "unit", "measured")[:kept], [row[:kept] for row in rows])


def _criteria(criteria: "Sequence[RunCriterion]", verdict: str) -> None:
    rows = [
        (
            item.title,
            _figure(item.figure, item.unit),
            f"{item.relation} {read(item.bound, item.unit, angle_unit()):g}",
            reading_of(item.unit, angle_unit()).unit,
            format_angles(_judged(item), angle_unit()),
        )
        for item in criteria
    ]
    if rows:
        print_table(("criterion", "value", "bound", "unit", "verdict"), rows)
        _say(verdict)


def _judged(item: "RunCriterion") -> str:
    from backend.reports import SEEN

    seen = "" if item.passed is None else f"{SEEN[item.relation]}, "
    return _JUDGED[item.passed] + (f": {seen}{item.reason}" if item.reason else "")


def _figure(value: float | None, unit: str) -> float | str:
    return "not measured" if value is None else read(value, unit, angle_unit())


def _say(text: str, style: str = "") -> None:
    out.print(format_angles(text, angle_unit()), highlight=False, markup=False, style=style)


# Garbage -------------------------------------------------------------------------------------------
#
# How often the command line looks for garbage: nearly all that a command loads stays until its end.


_SELDOM = 100_000
_USUAL = gc.get_threshold()


def relax_garbage_collection() -> None:
    """Look for garbage seldom, and not at all at the end of this process: the two would take a third of a command."""
    gc.set_threshold(_SELDOM)
    atexit.register(gc.freeze)


def restore_garbage_collection() -> None:
    """Look for it as usual from here on: for what runs for days."""
    gc.set_threshold(*_USUAL)
