"""Comparisons of runs: alignment, metrics, differences of signals, CSV files."""

import csv
import io
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend import __version__
from backend.errors import RequestRejectedError, check_range
from backend.models import MeasuredFigure, UnreadableDocumentError
from backend.plain_text import format_csv_cell, format_csv_comment
from backend.recording import find_jump, read_samples, select_derived
from backend.reports import iterate_configuration, judge_stored_run
from backend.sample import FIELDS, UNIT_BY_SIGNAL
from backend.schemas import (
    AlignBy,
    ComparedMetric,
    ComparedRun,
    ComparedSetting,
    ComparedValue,
    ComparisonRequest,
    Differences,
    DifferencesRequest,
    MetricHistory,
    MetricName,
    MetricPoint,
    RunComparison,
    RunDifference,
)
from backend.services import record_messages
from backend.services.lineage import load_marks
from backend.storage import (
    NONE,
    All,
    Compare,
    Database,
    Op,
    Query,
    QueryError,
    Result,
    Run,
    Session,
    UnknownRecordError,
    Value,
    ValueSource,
    banks,
    parse_query,
    recordings,
    results,
    run_title,
    runs,
    search,
)
from plant import ErrorCode

# Alignment -----------------------------------------------------------------------------------------
# Runs are aligned at their starts, at a step of a reference, or at an event of the log.


@dataclass(frozen=True)
class Alignment:
    """The moment ``at_s`` [s] at which a run is aligned, and the offset of its times.

    Both are None with a ``reason`` if the run cannot be aligned.
    """

    at_s: float | None
    offset_s: float | None
    reason: str


def align_runs(session: Session, numbers: list[int], reference: int, query: ComparisonRequest) -> dict[int, Alignment]:
    """Return the alignment of each run with the reference. Raises UnknownRecordError."""
    moments = {number: _find_moment(session, number, query) for number in numbers}
    own, why = moments[reference]
    found = {}
    for number, (at_s, reason) in moments.items():
        if own is None and number != reference:
            found[number] = Alignment(at_s, None, reason or record_messages.reference_not_aligned(reason=why))
        else:
            offset_s = 0.0 if number == reference else None if at_s is None or own is None else own - at_s
            found[number] = Alignment(at_s, offset_s, reason)
    return found


def _find_moment(session: Session, run_id: int, query: ComparisonRequest) -> tuple[float | None, str]:
    """Return the moment [s from the run's first sample], or None and the reason."""
    runs.get(session, run_id)
    try:
        recordings.span(session, run_id)
    except UnknownRecordError:
        return None, record_messages.run_without_samples(run=run_id)
    match query.by:
        case AlignBy.BEGIN:
            return 0.0, ""
        case AlignBy.STEP:
            at_s, count = find_jump(session, run_id, query.step, query.number)
            too_few = record_messages.too_few_steps(run=run_id, signal=query.step, count=count, minimum=query.number)
        case AlignBy.EVENT:
            times = [mark.t for mark in load_marks(session, run_id).marks if mark.kind == query.event]
            count = len(times)
            at_s = times[query.number - 1] if count >= query.number else None
            too_few = record_messages.too_few_events(run=run_id, kind=query.event, count=count, minimum=query.number)
    return (None, too_few) if at_s is None else (at_s, "")


# Metrics -------------------------------------------------------------------------------------------


MAX_RUNS = 20
MAX_POINTS = 5000


def select_runs(query: ComparisonRequest) -> tuple[list[int], int]:
    """Return the compared runs without duplicates, and the reference.

    Raises OutOfRangeError, RequestRejectedError.
    """
    numbers = list(dict.fromkeys(query.run))
    check_range(
        "runs",
        len(numbers),
        minimum=2,
        maximum=MAX_RUNS,
        unit="1",
        remedy=record_messages.select_other_runs(),
        label="number of runs",
    )
    chosen = numbers[0] if query.reference is None else query.reference
    if chosen not in numbers:
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE,
            record_messages.reference_not_compared(run=chosen),
            legal=[str(number) for number in numbers],
        )
    return numbers, chosen


def compare_runs(session: Session, query: ComparisonRequest) -> RunComparison:
    """Return the metrics of runs with their differences from a reference.

    The reference is the first run by default. Raises OutOfRangeError, RequestRejectedError, UnknownRecordError.
    """
    numbers, chosen = select_runs(query)
    found = [runs.get(session, number) for number in numbers]
    loaded = [_load_result(session, run) for run in found]
    alignments = align_runs(session, numbers, chosen, query)
    return RunComparison(
        reference=chosen,
        runs=[
            _build_compared_run(run, result, problem, alignments[run.id])
            for run, (result, problem) in zip(found, loaded, strict=True)
        ],
        metrics=_build_metrics(
            [_list_figures(result) for result, _ in loaded], [problem for _, problem in loaded], numbers.index(chosen)
        ),
        settings=_find_differing_settings(session, found),
    )


def _find_differing_settings(session: Session, found: Sequence[Run]) -> list[ComparedSetting]:
    """Return the settings that differ between runs."""
    each = []
    for run in found:
        bank = None if run.bank_id is None else banks.get(session, run.bank_id)
        each.append({(item.name, item.unit): _to_plain_value(item.value) for item in iterate_configuration(run, bank)})
    settings = []
    for name, unit in dict.fromkeys(key for one in each for key in one):
        values = [one.get((name, unit)) for one in each]
        if any(value != values[0] for value in values):
            settings.append(ComparedSetting(name=name, unit=unit or "1", values=values))
    return settings


def _to_plain_value(value: Any) -> bool | float | str:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


def _load_result(session: Session, run: Run) -> tuple[Result | None, str]:
    """Return the newest result of a run, or None and the reason."""
    try:
        result = results.newest(session, run.id)
    except UnreadableDocumentError as error:
        return None, error.message
    return result, "" if result is not None else run.evaluation_problem or record_messages.run_not_evaluated()


def _list_figures(result: Result | None) -> dict[str, MeasuredFigure]:
    return {} if result is None else {item.name: item for item in result.metrics.figures}


def _build_compared_run(run: Run, result: Result | None, problem: str, alignments: Alignment) -> ComparedRun:
    metrics, criteria = (None, ()) if result is None else (result.metrics, result.criteria)
    return ComparedRun(
        id=run.id,
        title=run_title(run),
        kind=run.kind,
        station=run.station,
        who=run.who,
        started=run.started_at,
        verdict=judge_stored_run(metrics, criteria, problem).sentence,
        aligned_at_s=alignments.at_s,
        offset_s=alignments.offset_s,
        not_aligned=alignments.reason,
    )


def _build_metrics(
    figures: Sequence[dict[str, MeasuredFigure]], problems: Sequence[str], reference: int
) -> list[ComparedMetric]:
    """Return the metrics of all runs, those of the reference first."""
    metrics_by_name: dict[str, MeasuredFigure] = {}
    for of_run in (figures[reference], *figures):
        for name, item in of_run.items():
            metrics_by_name.setdefault(name, item)
    return [
        ComparedMetric(
            name=name,
            label=metrics_by_name[name].label,
            definition=metrics_by_name[name].definition,
            unit=metrics_by_name[name].unit,
            values=[
                _build_value(of_run.get(name), figures[reference].get(name), metrics_by_name[name].unit, problem)
                for of_run, problem in zip(figures, problems, strict=True)
            ],
        )
        for name in metrics_by_name
    ]


def _build_value(
    figure: MeasuredFigure | None, reference: MeasuredFigure | None, unit: str, problem: str
) -> ComparedValue:
    if figure is None:
        return ComparedValue(
            value=None, reason=problem or record_messages.run_without_metric(), difference=None, percent=None
        )
    if figure.unit != unit:
        return ComparedValue(
            value=None,
            reason=record_messages.metric_in_other_unit(unit=figure.unit, expected=unit),
            difference=None,
            percent=None,
        )
    difference = percent = None
    if figure.value is not None and reference is not None and reference.value is not None:
        difference = figure.value - reference.value
        percent = 100.0 * difference / abs(reference.value) if reference.value else None
    return ComparedValue(value=figure.value, reason=figure.reason, difference=difference, percent=percent)


def build_metric_history(session: Session, kind: str, metric: str, where: str, *, everywhere: bool) -> MetricHistory:
    """Return a metric of the runs of a kind that match ``where``.

    An empty ``metric`` selects the first one. Raises QueryError.
    """
    of_kind = Compare(Value("kind", 0), Op.EQUAL, (Value(kind, 0),))
    query: Query = All((of_kind, parse_query(where)))
    loaded = All((query, Compare(Value("verdict", 0), Op.EQUAL, tuple(Value(v, 0) for v in _JUDGED_VERDICTS))))
    known = _find_metrics(session, loaded, metric, everywhere=everywhere)
    chosen = next((one for one in known if one.name == metric or not metric), None)
    if chosen is None:
        if metric:
            raise QueryError(
                0, record_messages.unknown_metric(kind=kind, metric=metric), [one.name for one in known], metric
            )
        return MetricHistory(kind=kind, metric=None, metrics=[], points=[], without=0, left_out=0)
    found = search.metric_points(session, query, chosen.name, everywhere=everywhere, limit=MAX_POINTS)
    return MetricHistory(
        kind=kind,
        metric=chosen,
        metrics=known,
        points=[MetricPoint(run=run_id, at=at, value=value) for run_id, at, value in found.points],
        without=found.fitting - found.measured,
        left_out=found.measured - len(found.points),
    )


_JUDGED_VERDICTS = ("passed", "failed", "neutral", "incomplete")
_MAX_SEARCHED = 20
"""Number of newest runs of a kind whose metrics are listed."""


def _find_metrics(session: Session, query: Query, required_name: str, *, everywhere: bool) -> list[MetricName]:
    """Return the metrics of the newest runs, and ``wanted`` if an older run has it."""
    newest = search.search(session, query, everywhere=everywhere, limit=_MAX_SEARCHED).run_ids
    known = _list_metrics(session, newest)
    if required_name and required_name not in known:
        measured = Compare(Value(f"{ValueSource.METRIC}.{required_name}", 0), Op.UNLIKE, (Value(NONE, 0),))
        with suppress(QueryError):  # no run at all has one of this name
            older = search.search(session, All((query, measured)), everywhere=everywhere, limit=1).run_ids
            known |= {name: item for name, item in _list_metrics(session, older).items() if name == required_name}
    return list(known.values())


def _list_metrics(session: Session, run_ids: Sequence[int]) -> dict[str, MetricName]:
    """Return the metrics of runs by name, with the label of the first run."""
    found: dict[str, MetricName] = {}
    for run in runs.of_numbers(session, run_ids):
        for item in _list_figures(_load_result(session, run)[0]).values():
            found.setdefault(item.name, MetricName(name=item.name, label=item.label, unit=item.unit))
    return found


# Differences ---------------------------------------------------------------------------------------
# Signals of runs minus the signal of a reference, at the samples of the reference.


Array = NDArray[np.float64]

_TIME_TOLERANCE = 1e-3
"""Share of a period within which a sample counts as taken at the requested time."""


@dataclass(frozen=True)
class Curve:
    """Values ``y`` [n] at times ``t`` [n, s], one per ``period_s`` except in gaps."""

    t: Array
    y: Array
    period_s: float

    def interpolate(self, times: Array) -> Array:
        """Return the values at ``times`` by linear interpolation; NaN in gaps."""
        slack = _TIME_TOLERANCE * self.period_s
        after = np.searchsorted(self.t, times - slack)
        nearest = np.minimum(after, self.t.size - 1)
        before = np.maximum(nearest - 1, 0)
        exact = np.abs(self.t[nearest] - times) <= slack
        length = self.t[nearest] - self.t[before]
        between = (after > 0) & (after < self.t.size) & (length < 1.5 * self.period_s)
        share = np.divide(times - self.t[before], length, out=np.zeros_like(times), where=length > 0.0)
        straight = self.y[before] + share * (self.y[nearest] - self.y[before])
        return np.where(exact, self.y[nearest], np.where(between, straight, np.nan))


@dataclass(frozen=True)
class AlignedRuns:
    """The signal of the reference and of all other runs on the reference's samples.

    ``reasons`` has the reason for each run that could not be aligned.
    """

    reference: int
    unit: str
    period_s: float
    t: Array
    own: Array
    others: dict[int, Array]
    offsets: dict[int, float]
    reasons: dict[int, str]


def align_signals(session: Session, query: DifferencesRequest) -> AlignedRuns:
    """Read a signal of all runs onto the samples of the reference.

    Raises RequestRejectedError, UnknownRecordError, UnknownSignalError.
    """
    numbers, reference = select_runs(query)
    alignments = align_runs(session, numbers, reference, query)
    own = _read_curve(session, reference, query.signal)
    count = round(float(own.t[-1]) / own.period_s) + 1
    first, last = (min(count, int(np.ceil(s / own.period_s - 0.5))) for s in (query.from_s, query.to_s))
    grid = np.asarray(np.arange(first, last) * own.period_s, np.float64)
    others, reasons = {}, {}
    for number in numbers:
        if number == reference:
            continue
        offset_s = alignments[number].offset_s
        if offset_s is None:
            others[number], reasons[number] = np.full(grid.size, np.nan), alignments[number].reason
        else:
            others[number] = _read_curve(session, number, query.signal).interpolate(grid - offset_s)
            reasons[number] = ""
    offsets = {number: one.offset_s for number, one in alignments.items() if one.offset_s is not None}
    derived = select_derived(session, [query.signal])
    unit = derived[query.signal].unit if derived else UNIT_BY_SIGNAL[query.signal]
    return AlignedRuns(
        reference=reference,
        unit=unit,
        period_s=own.period_s,
        t=grid,
        own=own.interpolate(grid),
        others=others,
        offsets=offsets,
        reasons=reasons,
    )


def count_samples(database: Database, run_ids: Sequence[int]) -> int:
    """Return the total number of samples of runs."""
    with database.reading() as session:
        return sum(0 if one is None else one.count for _, one in recordings.of_runs(session, run_ids).values())


def compute_differences(database: Database, query: DifferencesRequest) -> Differences:
    """Return the differences of a signal to the reference.

    Raises as ``align_signals`` does.
    """
    with database.reading() as session:
        found = align_signals(session, query)
    first = round(float(found.t[0]) / found.period_s) if found.t.size else 0
    width = max(1, -(-found.t.size // query.points))
    buckets = (first + np.arange(found.t.size)) // width
    starts = np.flatnonzero(np.diff(buckets, prepend=-1))
    return Differences(
        reference=found.reference,
        signal=query.signal,
        unit=found.unit,
        raw=width == 1,
        width_s=width * found.period_s,
        t=(buckets[starts] * width * found.period_s).tolist(),
        runs=[
            _build_difference(number, values - found.own, found, starts, query.band)
            for number, values in found.others.items()
        ],
    )


def _read_curve(session: Session, run_id: int, signal: str) -> Curve:
    samples = read_samples(session, run_id, [signal])
    if samples.t.size == 0:
        raise UnknownRecordError(record_messages.run_without_samples(run=run_id))
    period_s = recordings.get(session, run_id).period_s
    return Curve(samples.t, samples.columns[signal].astype(np.float64), period_s)


def _build_difference(
    run: int, difference: Array, found: AlignedRuns, starts: NDArray[np.int64], band: float
) -> RunDifference:
    compared = np.isfinite(difference)
    count = int(np.count_nonzero(compared))
    outside = np.abs(difference) > band  # False for NaN
    left = np.flatnonzero(outside)
    largest = None if count == 0 else int(np.nanargmax(np.abs(difference)))
    default_reason = "" if count else record_messages.no_common_times()
    return RunDifference(
        run=run,
        reason=found.reasons[run] or default_reason,
        minimum=_replace_nan(np.fmin.reduceat(difference, starts) if starts.size else difference),
        maximum=_replace_nan(np.fmax.reduceat(difference, starts) if starts.size else difference),
        compared_s=count * found.period_s,
        missing_s=(difference.size - count) * found.period_s,
        left_at_s=float(found.t[left[0]]) if left.size else None,
        outside_s=left.size * found.period_s,
        longest_s=max((end - begin for begin, end in _iterate_intervals(outside)), default=0) * found.period_s,
        largest=None if largest is None else float(difference[largest]),
        largest_at_s=None if largest is None else float(found.t[largest]),
    )


def _iterate_intervals(outside: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(outside.astype(np.int8), prepend=0, append=0))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _replace_nan(values: Array) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]


# CSV files -----------------------------------------------------------------------------------------


_ROWS = 20_000
"""Lines per chunk."""

_TABLE = ("what", "name", "label", "unit", "run", "value", "difference", "percent", "remark")


def stream_curves_file(database: Database, query: DifferencesRequest) -> Iterator[bytes]:
    """Yield a signal of all runs on the reference's samples, with its differences.

    Samples that a run lacks are NaN. Raises RequestRejectedError, UnknownRecordError, UnknownSignalError before the
    first chunk.
    """
    import pyarrow as pa
    import pyarrow.csv

    with database.reading() as session:
        compared, found = compare_runs(session, query), align_signals(session, query)
    # signals have the precision of the recording, times and differences full precision
    own = found.own.astype(np.float32)
    meaning = next((f"{field.symbol}: {field.meaning}" for field in FIELDS if field.name == query.signal), "")
    columns: dict[str, tuple[NDArray[Any], str, str]] = {}
    columns["t"] = (found.t, "s", record_messages.time_of_reference(run=found.reference))
    name, unit = query.signal, found.unit
    columns[f"{name}_run_{found.reference}"] = (
        own,
        unit,
        record_messages.signal_of_reference(meaning=meaning, run=found.reference),
    )
    for run, values in found.others.items():
        shift = (
            record_messages.time_shifted(offset_s=found.offsets[run]) if run in found.offsets else found.reasons[run]
        )
        words = record_messages.signal_of_run(meaning=meaning, run=run, shift=shift)
        columns[f"{name}_run_{run}"] = values.astype(np.float32), unit, words
    for run, values in found.others.items():
        words = record_messages.difference_of_runs(run=run, reference=found.reference)
        columns[f"d_{name}_run_{run}"] = values - found.own, unit, words
    lines = [
        *_build_header(compared, query),
        *(format_csv_comment(f"{name} [{unit}] {words}") for name, (_, unit, words) in columns.items()),
    ]
    yield ("\n".join([*lines, ",".join(columns)]) + "\n").encode()
    plain = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
    for begin in range(0, found.t.size, _ROWS):
        part = {name: column[begin : begin + _ROWS] for name, (column, _, _) in columns.items()}
        buffer = io.BytesIO()
        pyarrow.csv.write_csv(pa.table(part), buffer, plain)
        yield buffer.getvalue()


def stream_table_file(database: Database, query: ComparisonRequest) -> Iterator[bytes]:
    """Yield a line for each metric and differing setting of each run.

    Raises RequestRejectedError, UnknownRecordError.
    """
    with database.reading() as session:
        found = compare_runs(session, query)
    text = io.StringIO()
    text.write(
        "\n".join(
            [
                *_build_header(found, query),
                format_csv_comment(record_messages.explanation_of_differences()),
            ]
        )
        + "\n"
    )
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(_TABLE)
    for metric in found.metrics:
        for run, one in zip(found.runs, metric.values, strict=True):
            row = (one.value, one.difference, one.percent, one.reason)
            lines.writerow(map(format_csv_cell, ("metric", metric.name, metric.label, metric.unit, run.id, *row)))
    for setting in found.settings:
        for run, value in zip(found.runs, setting.values, strict=True):
            remark = record_messages.value_not_set() if value is None else ""
            of_setting = ("setting", setting.name, "", setting.unit, run.id, value, "", "", remark)
            lines.writerow(map(format_csv_cell, of_setting))
    yield text.getvalue().encode()


def _build_header(found: RunComparison, query: ComparisonRequest) -> Iterator[str]:
    heading = record_messages.heading_of_comparison(
        reference=found.reference, software=__version__, alignment=_describe_alignment(query)
    )
    yield format_csv_comment(heading)
    for run in found.runs:
        where = run.not_aligned or record_messages.time_of_run(offset_s=run.offset_s or 0.0)
        line = record_messages.compared_run(
            run=run.id, title=run.title, started=run.started.isoformat(), who=run.who, alignment=where
        )
        yield format_csv_comment(line)


def _describe_alignment(query: ComparisonRequest) -> str:
    match query.by:
        case AlignBy.BEGIN:
            return record_messages.aligned_by_start()
        case AlignBy.STEP:
            return record_messages.aligned_by_step(number=query.number, signal=query.step)
        case AlignBy.EVENT:
            return record_messages.aligned_by_event(number=query.number, kind=query.event)
