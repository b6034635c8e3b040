"""A run on the screen: what it was set to, what was measured, how it was judged."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from backend.cli.output import angles, out, print_table
from backend.units import in_words, read, reading_of

if TYPE_CHECKING:
    from backend.models.run import Criterion, Figure
    from backend.reports.model import Source

_JUDGED = {True: "passed", False: "FAILED", None: "not measured"}


def show_run(source: "Source", files: Sequence[Path] = ()) -> None:
    """Print how a run ended and what came of it, and the files that were written."""
    from backend.reports.provenance import verdict_of

    run, result = source.run, source.result
    end = ": ".join(filter(None, (run.end_state, run.end_detail)))
    _say(f"run {run.id}, {run.kind}: {end}", style="bold")
    sentence = verdict_of(result.metrics if result else None, result.criteria if result else ()).sentence
    if result is not None:
        _figures(result.metrics.figures)
        _criteria(result.criteria, sentence)
    if source.identification is not None:
        _say(source.identification.verdict)
    elif result is None or not result.metrics.figures:
        _say(sentence)
    for path in files:
        out.print(f"wrote {path}", highlight=False, markup=False)


def show_settings(source: "Source") -> None:
    """Print what a run was set to."""
    from backend.analysis.evaluation import used_settings

    used = used_settings(source.run)
    rows = [
        (
            item.meaning,
            item.symbol,
            _setting(item.value, item.unit),
            reading_of(item.unit, angles()).unit,
        )
        for item in used
    ]
    if rows:
        print_table(("setting", "symbol", "value", "unit"), rows)


def _setting(value: object, unit: str) -> object:
    return read(value, unit, angles()) if isinstance(value, float) else value


def _figures(figures: "Sequence[Figure]") -> None:
    rows = [
        (
            item.label,
            _figure(item.value, item.unit),
            reading_of(item.unit, angles()).unit,
            in_words(item.reason or "measured", angles()),
        )
        for item in figures
    ]
    if rows:
        kept = 4 if any(item.reason for item in figures) else 3
        print_table(("figure", "value", "unit", "measured")[:kept], [row[:kept] for row in rows])


def _criteria(criteria: "Sequence[Criterion]", verdict: str) -> None:
    rows = [
        (
            item.title,
            _figure(item.figure, item.unit),
            f"{item.relation} {read(item.bound, item.unit, angles()):g}",
            reading_of(item.unit, angles()).unit,
            in_words(_judged(item), angles()),
        )
        for item in criteria
    ]
    if rows:
        print_table(("criterion", "value", "bound", "unit", "verdict"), rows)
        _say(verdict)


def _judged(item: "Criterion") -> str:
    from backend.reports.provenance import SEEN

    seen = "" if item.passed is None else f"{SEEN[item.relation]}, "
    return _JUDGED[item.passed] + (f": {seen}{item.reason}" if item.reason else "")


def _figure(value: float | None, unit: str) -> float | str:
    return "not measured" if value is None else read(value, unit, angles())


def _say(text: str, style: str = "") -> None:
    out.print(in_words(text, angles()), highlight=False, markup=False, style=style)
