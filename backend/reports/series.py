"""The report of a series: runs beside each other, what differs between them, their metrics and their curves."""

import statistics
from collections.abc import Callable, Iterator, Sequence

from backend import __version__
from backend.models.run import Figure as Measured
from backend.models.run import Outcome
from backend.reports.bode import overlay_bode
from backend.reports.build import told
from backend.reports.composed import lines_of
from backend.reports.document import Block, Code, Column, Fact, Figure, Paragraph, Report, Section, Table, shown
from backend.reports.evidence import SERIES, SeriesEvidence, evidence_of, to_element
from backend.reports.identified import identifications_section
from backend.reports.judgement import definitions_facts, measured, verdict
from backend.reports.provenance import chosen, shown_unit
from backend.reports.series_figures import is_partial, metric_panels, overlay
from backend.reports.set_to import set_to
from backend.reports.source import Source
from backend.storage.runs import title_of
from backend.units import Angles, read

_BESIDE = 5
"""Runs that stand beside each other in one table: as many as fit a page."""

_MARK = " *"
"""Stands behind a figure that was not measured whole."""

_SAID = {
    Outcome.PASSED: "passed all criteria",
    Outcome.FAILED: "failed a criterion",
    Outcome.INCOMPLETE: "ended early or could not be measured whole",
    Outcome.NEUTRAL: "have no criteria",
}
_WORST = (Outcome.FAILED, Outcome.INCOMPLETE, Outcome.NEUTRAL, Outcome.PASSED)


def series_report(sources: Sequence[Source]) -> Report:
    """Build the report of two runs or more, none of them a session; differences are to the first."""
    evidence = SeriesEvidence(format=SERIES, runs=tuple(one for one in map(evidence_of, sources) if one is not None))
    if len(evidence.runs) != len(sources) or len(sources) < 2:
        raise ValueError("a series is of two runs or more, of each of which something was computed")
    outcomes = [Outcome(verdict(source)[0]) for source in sources]
    numbers = ", ".join(str(source.run.id) for source in sources)
    angles = sources[0].angles
    report = Report(
        title=_title(sources),
        subtitle=f"Runs {numbers}",
        outcome=next(worst for worst in _WORST if worst in outcomes),
        verdict=_verdict(outcomes),
        facts=_facts(sources),
        sections=(
            Section("Runs", (_runs_table(sources),)),
            *identifications_section(sources),
            Section("What differs", tuple(_differing(sources, angles))),
            Section("Metrics", (*_metric_tables(sources, angles), _spread(sources, angles), *_partial(sources))),
            Section("Figures", tuple(_figures(sources, angles))),
            Section("What it was made of", (_hashes(evidence), Code(_PROOF, "sinew report verify series.html"))),
        ),
        footer=f"Sinew {__version__} · series of runs {numbers}",
        date=max(source.run.started_at for source in sources),
        evidence=to_element(evidence),
    )
    return told(report, angles)


_PROOF = (
    "Every number of this report can be computed again from the samples of its runs, where these are stored; each run "
    "is found by the hash of its samples, whatever its number there:"
)


def _title(sources: Sequence[Source]) -> str:
    titles = list(dict.fromkeys(title_of(source.run) for source in sources))
    return f"Series: {titles[0]}" if len(titles) == 1 else "Series of different experiments"


def _verdict(outcomes: Sequence[Outcome]) -> str:
    counts = [
        (outcomes.count(one), one) for one in (Outcome.PASSED, Outcome.FAILED, Outcome.INCOMPLETE, Outcome.NEUTRAL)
    ]
    return f"Of {len(outcomes)} runs " + ", ".join(f"{count} {_SAID[one]}" for count, one in counts if count) + "."


def _facts(sources: Sequence[Source]) -> tuple[Fact, ...]:
    runs = [source.run for source in sources]
    first, last = min(run.started_at for run in runs), max(run.started_at for run in runs)
    return (
        Fact("Runs", f"{len(runs)}, from {first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} UTC"),
        Fact("By", ", ".join(dict.fromkeys(run.who for run in runs))),
        Fact("Plant", "; ".join(dict.fromkeys(f"{run.plant}, parameters “{run.parameters_name}”" for run in runs))),
        Fact("Software", ", ".join(dict.fromkeys(f"Sinew {run.software}" for run in runs))),
        Fact("Differences", f"to run {runs[0].id}"),
        *definitions_facts(sources),
    )


def _runs_table(sources: Sequence[Source]) -> Table:
    columns = (
        Column("Run"),
        Column("Experiment", number=False),
        Column("Started (UTC)", number=False),
        Column("Result", number=False, wide=True),
    )
    rows = tuple(
        (str(run.id), title_of(run), f"{run.started_at:%Y-%m-%d %H:%M:%S}", verdict(source)[1])
        for source in sources
        for run in (source.run,)
    )
    return Table("The runs of the series.", columns, rows)


def _differing(sources: Sequence[Source], angles: Angles) -> Iterator[Block]:
    """Give tables of what the runs were set to, and of their parameters, where not all have the same."""
    each = [dict(_set_to(source, angles)) for source in sources]
    rows = []
    for name in dict.fromkeys(name for one in each for name in one):
        texts = [one.get(name, "not set") for one in each]
        if len(set(texts)) > 1:
            rows.append((name, texts))
    if not rows:
        yield Paragraph("Nothing: the runs have the same settings, tuning, parameters and software.")
        return
    first = (Column("Setting or parameter", number=False, wide=True),)
    yield from _beside(sources, "What is not the same in all runs", first, [((name,), texts) for name, texts in rows])


def _set_to(source: Source, angles: Angles) -> Iterator[tuple[str, str]]:
    for item in set_to(source.run, source.bank):
        unit = shown_unit(item.unit, angles)
        yield item.name + (f" [{unit}]" if unit else ""), chosen(item.value, item.unit, angles)


def _beside(
    sources: Sequence[Source],
    caption: str,
    first: tuple[Column, ...],
    rows: Sequence[tuple[tuple[str, ...], Sequence[str]]],
) -> Iterator[Table]:
    """Give tables with a column for each run, as many runs in each as fit."""
    numbers = [source.run.id for source in sources]
    for start in range(0, len(numbers), _BESIDE):
        part = slice(start, start + _BESIDE)
        columns = (*first, *(Column(f"Run {number}") for number in numbers[part]))
        told_of = "" if len(numbers) <= _BESIDE else f", runs {numbers[part][0]} to {numbers[part][-1]} of the list"
        yield Table(f"{caption}{told_of}.", columns, tuple((*titles, *cells[part]) for titles, cells in rows))


def _metrics(sources: Sequence[Source]) -> dict[str, list[Measured | None]]:
    """Return by name the figures of all runs; None where a run has none of this name in this unit."""
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


def _metric_tables(sources: Sequence[Source], angles: Angles) -> Iterator[Table]:
    rows = []
    for items in _metrics(sources).values():
        of = next(item for item in items if item is not None)
        values = [None if item is None or item.value is None else read(item.value, of.unit, angles) for item in items]
        whole = [None if is_partial(item) else value for item, value in zip(items, values, strict=True)]
        cells = [
            measured(value) + (_MARK if is_partial(item) else _difference(value, whole[0]))
            for item, value in zip(items, values, strict=True)
        ]
        rows.append(((of.label, shown_unit(of.unit, angles)), cells))
    first = (Column("Quantity", number=False, wide=True), Column("Unit", number=False))
    yield from _beside(sources, "Metrics; in brackets the difference to the first run", first, rows)


def _difference(value: float | None, reference: float | None) -> str:
    if value is None or reference is None or value == reference:
        return ""
    sign = "+" if value > reference else ""
    return f" ({sign}{shown(value - reference, 2)})"


def _spread(sources: Sequence[Source], angles: Angles) -> Table:
    """Return how far each metric spreads over the runs that measured it whole; the others are counted apart."""
    columns = (
        Column("Quantity", number=False, wide=True),
        Column("Unit", number=False),
        Column("Runs"),
        Column("Mean"),
        Column("Deviation"),
        Column("Smallest"),
        Column("Largest"),
        Column("In part"),
    )
    rows = []
    for items in _metrics(sources).values():
        of = next(item for item in items if item is not None)
        values = [
            read(item.value, of.unit, angles)
            for item in items
            if item is not None and item.value is not None and not is_partial(item)
        ]
        spread: list[Callable[[Sequence[float]], float]] = [statistics.fmean, _deviation, min, max]
        partial = sum(map(is_partial, items))
        figures = [shown(one(values)) if values else measured(None) for one in spread]
        rows.append((of.label, shown_unit(of.unit, angles), str(len(values)), *figures, str(partial or "")))
    caption = (
        "Spread over the runs that measured it whole; deviation is the standard deviation of one run (N − 1). In part: "
        "runs that did not measure it whole, which are left out."
    )
    return Table(caption, columns, tuple(rows))


def _partial(sources: Sequence[Source]) -> Iterator[Paragraph]:
    """Say why each marked figure was not measured whole."""
    said: dict[str, list[str]] = {}
    for items in _metrics(sources).values():
        for source, item in zip(sources, items, strict=True):
            if item is not None and is_partial(item):
                said.setdefault(f"{item.label}: {item.reason}", []).append(str(source.run.id))
    if said:
        reasons = "; ".join(f"{words} (run {', '.join(runs)})" for words, runs in said.items())
        yield Paragraph(f"{_MARK.strip()} Not measured whole, so that no difference is told. {reasons}.")


def _deviation(values: Sequence[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else float("nan")


def _figures(sources: Sequence[Source], angles: Angles) -> Iterator[Figure]:
    drawn = {
        name: items
        for name, items in _metrics(sources).items()
        if any(i is not None and i.value is not None for i in items)
    }
    if drawn:
        words = (
            "Metrics of the runs, in the order of the list; hollow where a run has not measured it whole, a gap where "
            "it has not measured it at all."
        )
        yield Figure("metrics", metric_panels(list(drawn.values()), angles), words)
    curves = [source for source in sources if source.columns["t"].size]
    if curves:
        words = "Joint position and stiffness of all runs, each from its first sample; references dashed."
        yield Figure("curves", overlay([(s.run.id, s.columns) for s in curves], angles), words)
    answered = [(source.run.id, lines) for source in sources if (lines := lines_of(source))]
    if answered:
        words = "Frequency responses of the runs that measured them: points are measured lines, curves are predicted."
        yield Figure("bode", overlay_bode(answered, "bode"), words)


def _hashes(evidence: SeriesEvidence) -> Table:
    columns = (Column("Run"), Column("SHA-256 of its samples", number=False, wide=True))
    rows = tuple((str(one.run.id), one.hashes["samples"]) for one in evidence.runs)
    return Table("Content hashes.", columns, rows)
