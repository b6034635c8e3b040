"""Output of commands: tables, JSON, progress bars and errors."""

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

from backend.cli import messages
from backend.execution import RunPhase
from backend.plain_text import escape_line, escape_lines, format_json
from backend.units import AngleUnit, convert_to_display, format_text, get_display_unit

if TYPE_CHECKING:
    from backend.models import MeasuredFigure, RunCriterion
    from backend.reports import RunData


# Console -------------------------------------------------------------------------------------------


class SafeConsole(Console):
    """Console that escapes control characters, so that no text controls the terminal."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print texts with quantities in display units and control characters escaped.

        Tables are printed unchanged.
        """
        texts = (escape_lines(format_text(one, angle_unit())) if isinstance(one, str) else one for one in objects)
        super().print(*texts, **options)


console = SafeConsole()
error_console = SafeConsole(stderr=True)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]

ANGLES_VARIABLE = "SINEW_ANGLES"
"""Environment variable with the unit of printed angles, ``rad`` or ``deg``."""


def angle_unit() -> AngleUnit:
    """Return the unit of printed angles, which the environment selects."""
    return AngleUnit.RADIANS if os.environ.get(ANGLES_VARIABLE) == AngleUnit.RADIANS else AngleUnit.DEGREES


def fail(*reasons: str, status: int = 1) -> NoReturn:
    """Print each reason on one line of standard error and exit with ``status``."""
    for reason in reasons:
        error_console.print(
            f"sinew: {' '.join(format_text(reason, angle_unit()).split())}",
            style="red",
            highlight=False,
            soft_wrap=True,
            markup=False,
        )
    sys.exit(status)


def escape_unprintable_output() -> None:
    """Print characters that the terminal's encoding lacks as escapes."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def print_json(document: Any) -> None:
    """Print a document as JSON."""
    print(format_json(document, indent=2))


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[object]], title: str | None = None, no_wrap: Sequence[str] = ()
) -> None:
    """Print a table, numbers aligned to the right.

    Columns in ``no_wrap`` keep their width on a narrow terminal.
    """
    table = Table(title=title and escape(escape_line(title)), title_justify="left", title_style="bold")
    cells = [[format_cell(cell) for cell in row] for row in rows]
    for index, column in enumerate(columns):
        is_numeric = bool(cells) and all(_is_number(row[index]) for row in cells)
        table.add_column(escape_line(column), justify="right" if is_numeric else "left", no_wrap=column in no_wrap)
    for row in cells:
        table.add_row(*row)
    console.print(table, highlight=False, markup=False)


def format_cell(value: object) -> str:
    """Return the text of a table cell.

    Numbers have four digits, None and an empty text become a dash.
    """
    if value is None or value == "":
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else escape_line(format_text(str(value), angle_unit()))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == "-"
    return True


# Progress ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ProgressBar:
    """Progress of a run in seconds of its program."""

    progress: Progress
    task: Any

    def __call__(self, phase: RunPhase, elapsed_s: float) -> None:
        """Show the phase and, during the program, the elapsed time [s]."""
        self.progress.update(self.task, description=phase, completed=elapsed_s if phase is RunPhase.PROGRAM else None)


@contextmanager
def show_progress(duration_s: float, *, hidden: bool) -> Iterator[ProgressBar]:
    """Show a progress bar on standard error during the block.

    ``duration_s`` is the duration of the program.
    """
    columns = (TextColumn("{task.description:>11}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=error_console, disable=hidden, transient=True) as progress:
        yield ProgressBar(progress, progress.add_task(RunPhase.STARTING, total=duration_s))


# Runs ----------------------------------------------------------------------------------------------


_VERDICTS = {True: "passed", False: "FAILED", None: messages.not_measured()}


def print_run(source: "RunData", files: Sequence[Path] = ()) -> None:
    """Print end state, metrics, criteria, verdict and files of a run."""
    from backend.reports import judge_stored_run

    run, result = source.run, source.result
    end = ": ".join(filter(None, (run.end_state, run.end_detail)))
    _print_text(messages.run_title(run_id=run.id, kind=run.kind, end=end), style="bold")
    sentence = judge_stored_run(result.metrics if result else None, result.criteria if result else ()).sentence
    if result is not None:
        _print_metrics(result.metrics.figures)
        _print_criteria(result.criteria, sentence)
    if source.identification is not None:
        _print_text(source.identification.verdict)
    elif result is None or not result.metrics.figures:
        _print_text(sentence)
    for path in files:
        console.print(messages.wrote(files=str(path)), highlight=False, markup=False)


def print_settings(source: "RunData") -> None:
    """Print the settings of a run."""
    from backend.analysis import select_used_settings

    rows = [
        (
            item.meaning,
            item.symbol,
            _convert_setting(item.value, item.unit),
            get_display_unit(item.unit, angle_unit()).unit,
        )
        for item in select_used_settings(source.run)
    ]
    if rows:
        print_table(("setting", "symbol", "value", "unit"), rows)


def _convert_setting(value: object, unit: str) -> object:
    return convert_to_display(value, unit, angle_unit()) if isinstance(value, float) else value


def _print_metrics(metrics: "Sequence[MeasuredFigure]") -> None:
    rows = [
        (
            item.label,
            _convert_metric(item.value, item.unit),
            get_display_unit(item.unit, angle_unit()).unit,
            item.reason or "measured",
        )
        for item in metrics
    ]
    if rows:
        shown = 4 if any(item.reason for item in metrics) else 3
        print_table(("metric", "value", "unit", "status")[:shown], [row[:shown] for row in rows])


def _print_criteria(criteria: "Sequence[RunCriterion]", verdict: str) -> None:
    rows = [
        (
            item.title,
            _convert_metric(item.figure, item.unit),
            f"{item.relation} {convert_to_display(item.bound, item.unit, angle_unit()):g}",
            get_display_unit(item.unit, angle_unit()).unit,
            _describe_verdict(item),
        )
        for item in criteria
    ]
    if rows:
        print_table(("criterion", "value", "bound", "unit", "verdict"), rows)
        _print_text(verdict)


def _describe_verdict(item: "RunCriterion") -> str:
    from backend.reports import SEEN

    seen = "" if item.passed is None else f"{SEEN[item.relation]}, "
    return _VERDICTS[item.passed] + (f": {seen}{item.reason}" if item.reason else "")


def _convert_metric(value: float | None, unit: str) -> float | str:
    return messages.not_measured() if value is None else convert_to_display(value, unit, angle_unit())


def _print_text(text: str, style: str = "") -> None:
    console.print(text, highlight=False, markup=False, style=style)


# Garbage collection --------------------------------------------------------------------------------
# Nearly all objects that a command creates live until its end, so collections find nothing.


_RELAXED_THRESHOLD = 100_000
_DEFAULT_THRESHOLDS = gc.get_threshold()


def relax_garbage_collection() -> None:
    """Collect garbage rarely, and not at exit.

    Both would take a third of the time of a command.
    """
    gc.set_threshold(_RELAXED_THRESHOLD)
    atexit.register(gc.freeze)


def restore_garbage_collection() -> None:
    """Collect garbage at the default rate again, for a process that runs for days."""
    gc.set_threshold(*_DEFAULT_THRESHOLDS)
