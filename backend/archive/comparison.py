"""Runs beside each other by their metrics, and one metric over the dates of its runs."""

import json
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from backend.archive.alignment import Aligned, aligned
from backend.errors import Because, RefusalError, require_within
from backend.models.document import UnreadableDocumentError
from backend.models.run import Figure
from backend.reports.evidence import set_to
from backend.reports.provenance import verdict_of
from backend.schemas.comparison import (
    ComparedMetric,
    ComparedRun,
    ComparedSetting,
    ComparedValue,
    ComparisonAsked,
    RunComparison,
)
from backend.schemas.run import MetricHistory, MetricName, MetricPoint
from backend.storage import banks, results, runs, search
from backend.storage.database import Session
from backend.storage.results import Result
from backend.storage.runs import Run, title_of
from backend.storage.search import NONE, All, Compare, Op, Query, QueryError, Value, parse
from backend.storage.search_index import ValueSource

MOST_RUNS = 20
MOST_POINTS = 5000
_ABSENT = "the run has no such metric"


def chosen_runs(asked: ComparisonAsked) -> tuple[list[int], int]:
    """Return the runs that are compared, each once, and which of them is the reference.

    Raises OutOfRangeError, RefusalError.
    """
    numbers = list(dict.fromkeys(asked.run))
    require_within("runs", len(numbers), 2, MOST_RUNS, "1", "name other runs to compare", words="number of runs")
    chosen = numbers[0] if asked.reference is None else asked.reference
    if chosen not in numbers:
        raise RefusalError(
            Because.BAD_VALUE,
            f"reference: run {chosen} is none of those that are compared",
            legal=[str(number) for number in numbers],
        )
    return numbers, chosen


def compare(session: Session, asked: ComparisonAsked) -> RunComparison:
    """Return the metrics of runs with their differences to a reference, one of them (None: the first).

    Raises OutOfRangeError, RefusalError, UnknownRecordError.
    """
    numbers, chosen = chosen_runs(asked)
    found = [runs.get(session, number) for number in numbers]
    judged = [_judged(session, run) for run in found]
    placed = aligned(session, numbers, chosen, asked)
    return RunComparison(
        reference=chosen,
        runs=[
            _named(run, result, problem, placed[run.id]) for run, (result, problem) in zip(found, judged, strict=True)
        ],
        metrics=_metrics(
            [_figures(result) for result, _ in judged], [problem for _, problem in judged], numbers.index(chosen)
        ),
        settings=_differing(session, found),
    )


def _differing(session: Session, found: Sequence[Run]) -> list[ComparedSetting]:
    """Return what not all runs were set to alike."""
    each = []
    for run in found:
        bank = None if run.bank_id is None else banks.get(session, run.bank_id)
        each.append({(item.name, item.unit): _plain(item.value) for item in set_to(run, bank)})
    settings = []
    for name, unit in dict.fromkeys(key for one in each for key in one):
        values = [one.get((name, unit)) for one in each]
        if any(value != values[0] for value in values):
            settings.append(ComparedSetting(name=name, unit=unit or "1", values=values))
    return settings


def _plain(value: Any) -> bool | float | str:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


def _judged(session: Session, run: Run) -> tuple[Result | None, str]:
    """Return the newest result of a run, or None and why."""
    try:
        result = results.newest(session, run.id)
    except UnreadableDocumentError as error:
        return None, str(error)
    return result, "" if result is not None else run.evaluation_problem or "the run has not been evaluated"


def _figures(result: Result | None) -> dict[str, Figure]:
    return {} if result is None else {item.name: item for item in result.metrics.figures}


def _named(run: Run, result: Result | None, problem: str, placed: Aligned) -> ComparedRun:
    metrics, criteria = (None, ()) if result is None else (result.metrics, result.criteria)
    return ComparedRun(
        id=run.id,
        title=title_of(run),
        kind=run.kind,
        station=run.station,
        who=run.who,
        started=run.started_at,
        verdict=verdict_of(metrics, criteria, problem).sentence,
        aligned_at_s=placed.at_s,
        offset_s=placed.offset_s,
        not_aligned=placed.reason,
    )


def _metrics(figures: Sequence[dict[str, Figure]], problems: Sequence[str], reference: int) -> list[ComparedMetric]:
    """Return all metrics that any of the runs has, those of the reference first."""
    shown: dict[str, Figure] = {}
    for of_run in (figures[reference], *figures):
        for name, item in of_run.items():
            shown.setdefault(name, item)
    return [
        ComparedMetric(
            name=name,
            label=shown[name].label,
            definition=shown[name].definition,
            unit=shown[name].unit,
            values=[
                _value(of_run.get(name), figures[reference].get(name), shown[name].unit, problem)
                for of_run, problem in zip(figures, problems, strict=True)
            ],
        )
        for name in shown
    ]


def _value(figure: Figure | None, reference: Figure | None, unit: str, problem: str) -> ComparedValue:
    if figure is None:
        return ComparedValue(value=None, reason=problem or _ABSENT, difference=None, percent=None)
    if figure.unit != unit:
        return ComparedValue(
            value=None, reason=f"it was measured in {figure.unit}, not in {unit}", difference=None, percent=None
        )
    difference = percent = None
    if figure.value is not None and reference is not None and reference.value is not None:
        difference = figure.value - reference.value
        percent = 100.0 * difference / abs(reference.value) if reference.value else None
    return ComparedValue(value=figure.value, reason=figure.reason, difference=difference, percent=percent)


def metric_history(session: Session, kind: str, metric: str, where: str, *, everywhere: bool) -> MetricHistory:
    """Return a metric ("": the first there is) of the runs of a kind that fit ``where``. Raises QueryError."""
    of_kind = Compare(Value("kind", 0), Op.EQUAL, (Value(kind, 0),))
    asked: Query = All((of_kind, parse(where)))
    judged = All((asked, Compare(Value("verdict", 0), Op.EQUAL, tuple(Value(v, 0) for v in _JUDGED))))
    known = _known_metrics(session, judged, metric, everywhere=everywhere)
    chosen = next((one for one in known if one.name == metric or not metric), None)
    if chosen is None:
        if metric:
            raise QueryError(0, f"runs of kind {kind} have no metric {metric!r}", [one.name for one in known], metric)
        return MetricHistory(kind=kind, metric=None, metrics=[], points=[], without=0, left_out=0)
    found = search.metric_points(session, asked, chosen.name, everywhere=everywhere, limit=MOST_POINTS)
    return MetricHistory(
        kind=kind,
        metric=chosen,
        metrics=known,
        points=[MetricPoint(run=run_id, at=at, value=value) for run_id, at, value in found.points],
        without=found.fitting - found.measured,
        left_out=found.measured - len(found.points),
    )


_JUDGED = ("passed", "failed", "neutral", "incomplete")
_LOOKED_AT = 20
"""Newest runs of a kind in which its metrics are looked for."""


def _known_metrics(session: Session, asked: Query, wanted: str, *, everywhere: bool) -> list[MetricName]:
    """Return the metrics of the newest runs, and the one that is wanted where an older run alone has it."""
    newest = search.search(session, asked, everywhere=everywhere, limit=_LOOKED_AT).run_ids
    known = _named_metrics(session, newest)
    if wanted and wanted not in known:
        measured = Compare(Value(f"{ValueSource.METRIC}.{wanted}", 0), Op.UNLIKE, (Value(NONE, 0),))
        with suppress(QueryError):  # no run at all has one of this name
            older = search.search(session, All((asked, measured)), everywhere=everywhere, limit=1).run_ids
            known |= {name: item for name, item in _named_metrics(session, older).items() if name == wanted}
    return list(known.values())


def _named_metrics(session: Session, run_ids: Sequence[int]) -> dict[str, MetricName]:
    """Return the metrics of runs by name, as the first of them calls each."""
    found: dict[str, MetricName] = {}
    for run in runs.of_numbers(session, run_ids):
        for item in _figures(_judged(session, run)[0]).values():
            found.setdefault(item.name, MetricName(name=item.name, label=item.label, unit=item.unit))
    return found
