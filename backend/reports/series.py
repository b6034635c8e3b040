"""The report of a series: its runs, their differences, metrics and curves."""

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from backend import __version__
from backend.models import MeasuredFigure, Outcome
from backend.reports import messages
from backend.reports.build import format_report_angles
from backend.reports.evidence import SERIES, SeriesEvidence, build_manifest, iterate_configuration, to_element
from backend.reports.experiment_report import find_frequency_responses
from backend.reports.model import (
    Block,
    Code,
    Column,
    Fact,
    Figure,
    Paragraph,
    Report,
    ReportSection,
    Table,
    format_measured,
)
from backend.reports.plotting import INK, axis_label, cached_figure, decimate, figure, in_unit, to_svg, upper_legend
from backend.reports.provenance import definitions_facts, format_figure, format_setting, shown_unit, verdict
from backend.reports.run_data import RunData
from backend.reports.sections import identifications_section, overlay_bode
from backend.storage import run_title
from backend.units import AngleUnit, convert_to_display

# Series figures ------------------------------------------------------------------------------------
# Figures of a series: its metrics from run to run, and the curves of all runs on shared axes.


_COLUMNS = 3
_ROW_IN = 1.25
_UNITS = {"q": "rad", "S": "N·m/rad"}
_LEGEND = 8
"""Maximum number of runs with a label at their curves; if there are more, only the first and the last have one."""


def is_partial(item: MeasuredFigure | None) -> bool:
    """Return whether a figure has a value that was measured only in part."""
    return item is not None and item.value is not None and item.reason != ""


@cached_figure
def metric_panels(metrics: Sequence[Sequence[MeasuredFigure | None]], angles: AngleUnit) -> str:
    """Draw each metric over the position of the runs in their list, one panel each."""
    rows = -(-len(metrics) // _COLUMNS)
    with figure(rows, _COLUMNS, height_in=0.6 + rows * _ROW_IN, gap_in=(0.42, 0.5), squeeze=False) as (drawn, axes):
        for panel, items in zip(axes.flat, metrics, strict=False):
            of = next(item for item in items if item is not None)
            values = [
                np.nan if item is None or item.value is None else convert_to_display(item.value, of.unit, angles)
                for item in items
            ]
            places, partial = np.arange(1, len(items) + 1), [is_partial(item) for item in items]
            panel.plot(places, values, color=INK, linewidth=0.6, marker="o", markersize=2.5)
            if any(partial):
                hollow = {"linestyle": "", "marker": "o", "markersize": 2.5, "markerfacecolor": "white"}
                panel.plot(places[partial], np.array(values)[partial], color=INK, **hollow)
            unit = shown_unit(of.unit, angles)
            panel.set_title(_short(of.label) + (f" [{unit}]" if unit else ""), fontsize=6.5)
            panel.xaxis.set_major_locator(MaxNLocator(6, integer=True))
            panel.set_xlim(0.5, len(items) + 0.5)
        for panel in axes.flat[len(metrics) :]:
            panel.set_visible(False)
        for panel in axes.flat[max(len(metrics) - _COLUMNS, 0) : len(metrics)]:  # the lowest of each column
            panel.set_xlabel("position in the list of runs")
        return to_svg(drawn, "metrics")


@cached_figure
def overlay(runs: Sequence[tuple[int, Mapping[str, NDArray[np.float64]]]], angles: AngleUnit) -> str:
    """Draw q and S of all runs over the time since the first sample of each."""
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(runs)))
    with figure(2, height_in=3.6, sharex=True) as (drawn, axes):
        for panel, signal in zip(axes, ("q", "S"), strict=True):
            for place, (number, columns) in enumerate(runs):
                named = len(runs) <= _LEGEND or place in (0, len(runs) - 1)
                _curve(
                    panel=panel,
                    columns=columns,
                    signal=signal,
                    colour=colours[place],
                    label=f"run {number}" if named else "",
                    angles=angles,
                )
            panel.set_ylabel(axis_label(signal, _UNITS[signal], angles))
        upper_legend(axes[0])
        axes[1].set_xlabel("t [s]")
        axes[1].set_xlim(0.0, max(float(columns["t"][-1]) for _, columns in runs) or 1.0)
        return to_svg(drawn, "curves")


def _curve(
    panel: Axes,
    columns: Mapping[str, NDArray[np.float64]],
    signal: str,
    colour: NDArray[np.float64],
    label: str,
    angles: AngleUnit,
) -> None:
    unit, t = _UNITS[signal], columns["t"]
    panel.plot(*decimate(t, in_unit(columns[signal], unit, angles)), color=colour, linewidth=0.8, label=label or None)
    reference = in_unit(columns[f"{signal}_ref"], unit, angles)
    panel.plot(*decimate(t, reference), color=colour, linewidth=0.5, linestyle=(0, (4, 2)), alpha=0.7)


def _short(label: str) -> str:
    return label if len(label) <= 34 else label[:33] + "…"


# Series --------------------------------------------------------------------------------------------
# The report of a series: runs in columns, their differences, metrics and curves.


_MAX_COLUMNS = 5
"""Maximum number of runs in the columns of one table, so that it fits a page."""

_MARK = " *"
"""Marks a figure that was measured only in part."""

_WORST = (Outcome.FAILED, Outcome.INCOMPLETE, Outcome.NEUTRAL, Outcome.PASSED)


def series_report(sources: Sequence[RunData]) -> Report:
    """Build the report of two or more runs, no sessions; differences are to the first."""
    manifest = SeriesEvidence(format=SERIES, runs=tuple(one for one in map(build_manifest, sources) if one is not None))
    if len(manifest.runs) != len(sources) or len(sources) < 2:
        raise ValueError("a series consists of two or more runs, each with computed results")
    outcomes = [Outcome(verdict(source)[0]) for source in sources]
    numbers = [source.run.id for source in sources]
    angles = sources[0].angles
    report = Report(
        title=_title(sources),
        subtitle=messages.subtitle_of_series(run_ids=numbers),
        outcome=next(worst for worst in _WORST if worst in outcomes),
        verdict=_verdict(outcomes),
        facts=_facts(sources),
        sections=(
            ReportSection("Runs", (_runs_table(sources),)),
            *identifications_section(sources),
            ReportSection("Differences", tuple(_make_difference_tables(sources, angles))),
            ReportSection("Metrics", (*_metric_tables(sources, angles), _spread(sources, angles), *_partial(sources))),
            ReportSection("Figures", tuple(_figures(sources, angles))),
            ReportSection(
                "Verification",
                (_hashes(manifest), Code(messages.series_is_recomputable(), "sinew report verify series.html")),
            ),
        ),
        footer=messages.footer_of_series(software=__version__, run_ids=numbers),
        date=max(source.run.started_at for source in sources),
        evidence=to_element(manifest),
    )
    return format_report_angles(report, angles)


def _title(sources: Sequence[RunData]) -> str:
    titles = list(dict.fromkeys(run_title(source.run) for source in sources))
    return messages.title_of_series(titles=titles)


def _verdict(outcomes: Sequence[Outcome]) -> str:
    return messages.verdicts_of_series(
        runs=len(outcomes),
        passed=outcomes.count(Outcome.PASSED),
        failed=outcomes.count(Outcome.FAILED),
        incomplete=outcomes.count(Outcome.INCOMPLETE),
        neutral=outcomes.count(Outcome.NEUTRAL),
    )


def _facts(sources: Sequence[RunData]) -> tuple[Fact, ...]:
    runs = [source.run for source in sources]
    first, last = min(run.started_at for run in runs), max(run.started_at for run in runs)
    plants = [messages.plant_and_parameters(plant=run.plant, parameters=run.parameters_name) for run in runs]
    return (
        Fact("Runs", messages.period_of_series(runs=len(runs), first=first, last=last)),
        Fact("By", ", ".join(dict.fromkeys(run.who for run in runs))),
        Fact("Plant", "; ".join(dict.fromkeys(plants))),
        Fact("Software", ", ".join(dict.fromkeys(f"Sinew {run.software}" for run in runs))),
        Fact("Differences", messages.relative_to_run(run_id=runs[0].id)),
        *definitions_facts(sources),
    )


def _runs_table(sources: Sequence[RunData]) -> Table:
    columns = (
        Column("Run"),
        Column("Experiment", number=False),
        Column("Started (UTC)", number=False),
        Column("Result", number=False, wide=True),
    )
    rows = tuple(
        (str(run.id), run_title(run), f"{run.started_at:%Y-%m-%d %H:%M:%S}", verdict(source)[1])
        for source in sources
        for run in (source.run,)
    )
    return Table(messages.runs_of_series(), columns, rows)


def _make_difference_tables(sources: Sequence[RunData], angles: AngleUnit) -> Iterator[Block]:
    """Yield tables of settings and parameters that differ between the runs."""
    each = [dict(_set_to(source, angles)) for source in sources]
    rows = []
    for name in dict.fromkeys(name for one in each for name in one):
        texts = [one.get(name, messages.not_set()) for one in each]
        if len(set(texts)) > 1:
            rows.append((name, texts))
    if not rows:
        yield Paragraph(messages.runs_do_not_differ())
        return
    first = (Column("Setting or parameter", number=False, wide=True),)
    yield from _make_run_tables(
        sources, messages.settings_that_differ(), first, [((name,), texts) for name, texts in rows]
    )


def _set_to(source: RunData, angles: AngleUnit) -> Iterator[tuple[str, str]]:
    for item in iterate_configuration(source.run, source.bank):
        unit = shown_unit(item.unit, angles)
        yield item.name + (f" [{unit}]" if unit else ""), format_setting(item.value, item.unit, angles)


def _make_run_tables(
    sources: Sequence[RunData],
    contents: str,
    first: tuple[Column, ...],
    rows: Sequence[tuple[tuple[str, ...], Sequence[str]]],
) -> Iterator[Table]:
    """Yield tables with a column for each run, as many runs per table as fit."""
    numbers = [source.run.id for source in sources]
    for start in range(0, len(numbers), _MAX_COLUMNS):
        part = slice(start, start + _MAX_COLUMNS)
        columns = (*first, *(Column(f"Run {number}") for number in numbers[part]))
        shown = numbers[part] if len(numbers) > _MAX_COLUMNS else []
        caption = messages.table_of_runs(contents=contents, columns=shown)
        yield Table(caption, columns, tuple((*titles, *cells[part]) for titles, cells in rows))


def _metrics(sources: Sequence[RunData]) -> dict[str, list[MeasuredFigure | None]]:
    """Return the figures of all runs by name.

    The value is None for a run that has no figure of this name and unit.
    """
    each = [
        {} if source.result is None else {item.name: item for item in source.result.metrics.figures}
        for source in sources
    ]
    units: dict[str, str] = {}
    for one in each:
        for name, item in one.items():
            units.setdefault(name, item.unit)
    return {
        name: [found if (found := one.get(name)) is not None and found.unit == unit else None for one in each]
        for name, unit in units.items()
    }


def _metric_tables(sources: Sequence[RunData], angles: AngleUnit) -> Iterator[Table]:
    rows = []
    for items in _metrics(sources).values():
        of = next(item for item in items if item is not None)
        values = [
            None if item is None or item.value is None else convert_to_display(item.value, of.unit, angles)
            for item in items
        ]
        whole = [None if is_partial(item) else value for item, value in zip(items, values, strict=True)]
        cells = [
            format_figure(value) + (_MARK if is_partial(item) else _difference(value, whole[0]))
            for item, value in zip(items, values, strict=True)
        ]
        rows.append(((of.label, shown_unit(of.unit, angles)), cells))
    first = (Column("Quantity", number=False, wide=True), Column("Unit", number=False))
    yield from _make_run_tables(sources, messages.metrics_with_differences(), first, rows)


def _difference(value: float | None, reference: float | None) -> str:
    if value is None or reference is None or value == reference:
        return ""
    sign = "+" if value > reference else ""
    return f" ({sign}{format_measured(value - reference, 2)})"


def _spread(sources: Sequence[RunData], angles: AngleUnit) -> Table:
    """Return the spread of each metric over the runs that measured it completely.

    Other runs are counted separately.
    """
    columns = (
        Column("Quantity", number=False, wide=True),
        Column("Unit", number=False),
        Column("Runs"),
        Column("Mean"),
        Column("Std. dev."),
        Column("Minimum"),
        Column("Maximum"),
        Column("Partial"),
    )
    rows = []
    for items in _metrics(sources).values():
        of = next(item for item in items if item is not None)
        values = [
            convert_to_display(item.value, of.unit, angles)
            for item in items
            if item is not None and item.value is not None and not is_partial(item)
        ]
        spread: list[Callable[[Sequence[float]], float]] = [statistics.fmean, _deviation, min, max]
        partial = sum(map(is_partial, items))
        figures = [format_measured(one(values)) if values else format_figure(None) for one in spread]
        rows.append((of.label, shown_unit(of.unit, angles), str(len(values)), *figures, str(partial or "")))
    caption = messages.spread_of_metrics()
    return Table(caption, columns, tuple(rows))


def _partial(sources: Sequence[RunData]) -> Iterator[Paragraph]:
    """Explain why each marked figure was measured only in part."""
    runs: dict[str, list[int]] = {}
    for items in _metrics(sources).values():
        for source, item in zip(sources, items, strict=True):
            if item is not None and is_partial(item):
                reason = messages.metric_and_reason(label=item.label, reason=item.reason)
                runs.setdefault(reason, []).append(source.run.id)
    if runs:
        yield Paragraph(messages.partially_measured(mark=_MARK.strip(), runs=runs))


def _deviation(values: Sequence[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else float("nan")


def _figures(sources: Sequence[RunData], angles: AngleUnit) -> Iterator[Figure]:
    drawn = {
        name: items
        for name, items in _metrics(sources).items()
        if any(i is not None and i.value is not None for i in items)
    }
    if drawn:
        words = messages.metrics_figure()
        yield Figure("metrics", metric_panels(list(drawn.values()), angles), words)
    curves = [source for source in sources if source.columns["t"].size]
    if curves:
        words = messages.curves_figure()
        yield Figure("curves", overlay([(s.run.id, s.columns) for s in curves], angles), words)
    answered = [(source.run.id, lines) for source in sources if (lines := find_frequency_responses(source))]
    if answered:
        words = messages.responses_of_runs_figure()
        yield Figure("bode", overlay_bode(answered, "bode"), words)


def _hashes(manifest: SeriesEvidence) -> Table:
    columns = (Column("Run"), Column("SHA-256 of the samples", number=False, wide=True))
    rows = tuple((str(one.run.id), one.hashes["samples"]) for one in manifest.runs)
    return Table(messages.content_hashes(), columns, rows)
