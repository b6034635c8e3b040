"""Statistics, spectra and values of recorded ranges; formulas of derived signals."""

import asyncio
import io
from collections.abc import AsyncGenerator, Callable, Iterator, Sequence
from contextlib import aclosing
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend import __version__
from backend.errors import RequestRejectedError, check_range
from backend.experiments import ExpressionError, parse_derived_signal
from backend.plain_text import format_csv_cell, format_csv_comment
from backend.recording import (
    AT_HAND_SAMPLES,
    LEAST_SAMPLES,
    ComputedSignal,
    Extreme,
    Slab,
    Spectrum,
    Statistics,
    TickInterval,
    add_slab,
    build_derived_signal,
    describe_signals,
    find_tick_range,
    read_samples,
    read_slabs,
    welch_spectrum,
)
from backend.sample import COMBINED_SIGNAL_BY_NAME, FIELDS, Field
from backend.schemas import (
    FormulaList,
    FormulaText,
    FormulaView,
    Moment,
    RecordedSpectra,
    RecordedStatistics,
    RecordedValues,
    SignalSpectrum,
    SignalStatistics,
    SpectraLine,
    StatisticsLine,
)
from backend.services import record_messages
from backend.storage import Database, Formula, formulas, recordings
from backend.workers import stream_from_process
from plant import ErrorCode

# Analysis of ranges --------------------------------------------------------------------------------
# Uses every sample of a range, not the envelope of a chart.


MAX_RANGES = 6
"""Ranges that are read at the same time."""

IN_PROCESS_VALUES = 4_000_000
"""Samples times signals up to which spectra are computed in the service: 32 MB."""

MAX_SPECTRUM_VALUES = 30_000_000
"""Largest product of samples and signals of a spectrum: 240 MB of memory."""

_SYMBOLS = {one.name: one.symbol for one in FIELDS}


@dataclass(frozen=True)
class RangeQuery:
    """Signals of a run between two times since its first sample, both included."""

    run: int
    from_s: float

    to_s: float | None
    """None: to the end of the run."""

    signals: Sequence[str]


LineStream = Callable[[Database, RangeQuery], Iterator[bytes]]


class RangeAnalysis:
    """Reads ranges in threads, long ones in a process of their own.

    A computation ends when its generator is closed.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._active_count = 0

    async def stream_statistics(self, query: RangeQuery) -> AsyncGenerator[bytes]:
        """Return lines of ``StatisticsLine``.

        Raises UnknownRecordError, UnknownSignalError, RequestRejectedError.
        """
        return await self._start_stream(stream_statistics, query)

    async def stream_spectra(self, query: RangeQuery) -> AsyncGenerator[bytes]:
        """Return lines of ``SpectraLine``. Raises as ``stream_statistics`` does."""
        return await self._start_stream(stream_spectra, query, IN_PROCESS_VALUES // max(1, len(query.signals)))

    async def stream_csv(self, query: RangeQuery) -> AsyncGenerator[bytes]:
        """Return every sample as CSV text. Raises as ``stream_statistics`` does."""
        return await self._start_stream(
            stream_range_csv, query, in_process_samples=0
        )  # in a process: its library takes long to import

    def read_values(self, run: int, times_s: Sequence[float], signals: Sequence[str]) -> RecordedValues:
        """Return the values of the last samples at or before ``times_s``.

        Waits for the disk. Raises as ``stream_statistics`` does.
        """
        return read_values(self._database, run, times_s, signals)

    async def _start_stream(
        self, lines: LineStream, query: RangeQuery, in_process_samples: int | None = None
    ) -> AsyncGenerator[bytes]:
        """Return a stream once its first chunk is there.

        All errors of the request are raised before.
        """
        if self._active_count >= MAX_RANGES:
            message = record_messages.too_many_ranges(maximum=MAX_RANGES)
            raise RequestRejectedError(ErrorCode.TOO_MANY, message, retry_after_s=2)
        most = AT_HAND_SAMPLES if in_process_samples is None else min(in_process_samples, AT_HAND_SAMPLES)
        stream = self._count_stream(lines, query, most)
        await anext(stream)
        return stream

    async def _count_stream(
        self, lines: LineStream, query: RangeQuery, in_process_samples: int
    ) -> AsyncGenerator[bytes]:
        """Yield an empty chunk once the first chunk is there, then all chunks."""
        self._active_count += 1
        try:
            interval = await asyncio.to_thread(_find_interval, self._database, query)
            long = interval.ticks > in_process_samples
            chunks = (
                stream_from_process(lines, self._database, query)
                if long
                else _iterate_in_thread(lines(self._database, query))
            )
            async with aclosing(chunks):
                first = await anext(chunks, b"")
                yield b""
                yield first
                async for chunk in chunks:
                    yield chunk
        finally:
            self._active_count -= 1


async def _iterate_in_thread(chunks: Iterator[bytes]) -> AsyncGenerator[bytes]:
    while (chunk := await asyncio.to_thread(next, chunks, None)) is not None:
        yield chunk


def stream_statistics(database: Database, query: RangeQuery) -> Iterator[bytes]:
    """Yield ``StatisticsLine`` with the progress, the last one with the result."""
    interval, described, samples = _find_interval(database, query), _describe_signals(database, query), 0
    found = {name: Statistics() for name in query.signals}
    for slab in read_slabs(database, interval, query.signals):
        add_slab(found, slab)
        samples += slab.ticks.size
        yield _encode_line(StatisticsLine(share=_compute_progress(slab, interval)))
    signals = {name: _build_statistics(described[name].unit, one, interval.period_s) for name, one in found.items()}
    result = RecordedStatistics(**_build_range_fields(interval, samples), signals=signals)
    yield _encode_line(StatisticsLine(share=1.0, result=result))


def stream_spectra(database: Database, query: RangeQuery) -> Iterator[bytes]:
    """Yield ``SpectraLine`` with the progress, the last one with the result."""
    interval, described, samples = _find_interval(database, query), _describe_signals(database, query), 0
    remedy = record_messages.choose_shorter_range()
    words = "samples times signals of a spectrum"
    check_range(
        "range",
        interval.ticks * len(query.signals),
        minimum=None,
        maximum=MAX_SPECTRUM_VALUES,
        unit="1",
        remedy=remedy,
        label=words,
    )
    values = {name: np.full(interval.ticks, np.nan) for name in query.signals}
    for slab in read_slabs(database, interval, query.signals):
        for name, column in slab.columns.items():
            values[name][slab.ticks - interval.begin] = column
        samples += slab.ticks.size
        yield _encode_line(SpectraLine(share=0.9 * _compute_progress(slab, interval)))
    signals = {
        name: _build_spectrum(described[name].unit, column, samples, interval.period_s)
        for name, column in values.items()
    }
    yield _encode_line(
        SpectraLine(share=1.0, result=RecordedSpectra(**_build_range_fields(interval, samples), signals=signals))
    )


def stream_range_csv(database: Database, query: RangeQuery) -> Iterator[bytes]:
    """Yield every sample of a range as CSV, with all digits of each value.

    Recorded columns are written as in ``data.csv`` of the run; combined signals in double precision.
    """
    import pyarrow as pa
    import pyarrow.csv

    interval, described = _find_interval(database, query), _describe_signals(database, query)
    heading = [
        record_messages.heading_of_range(
            run=interval.run_id, from_s=interval.from_s, to_s=interval.to_s, software=__version__
        ),
        *(
            f"{name} [{described[name].unit}] {_SYMBOLS.get(name, name)}: {described[name].meaning}"
            for name in query.signals
        ),
    ]
    names = ["t", *query.signals]
    head = "\n".join([*map(format_csv_comment, heading), ",".join(map(format_csv_cell, names))]) + "\n"
    plain = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
    for slab in read_slabs(database, interval, query.signals):
        columns = [
            slab.ticks * interval.period_s,
            *(_cast_to_stored(name, slab.columns[name]) for name in query.signals),
        ]
        buffer = io.BytesIO(head.encode())
        buffer.seek(0, io.SEEK_END)
        pyarrow.csv.write_csv(pa.table([pa.array(column) for column in columns], names=names), buffer, plain)
        head = ""
        yield buffer.getvalue()
    if head:
        yield head.encode()


def read_values(database: Database, run: int, times_s: Sequence[float], signals: Sequence[str]) -> RecordedValues:
    """Return the values of the last samples at or before ``times_s`` [s].

    Raises UnknownRecordError, UnknownSignalError, and OutOfRangeError for a time outside the recording.
    """
    with database.reading() as session:
        whole = find_tick_range(session, run)
        for time_s in times_s:
            if not 0 <= whole.tick_at(time_s) < whole.end:  # sums of times have rounding errors
                remedy = record_messages.choose_time_within(run=run)
                check_range("at", time_s, minimum=0.0, maximum=whole.to_s, unit="s", remedy=remedy, label="time")
        ticks = [recordings.tick_before(session, run, whole.tick_at(time_s)) for time_s in times_s]
    return RecordedValues(
        run=run,
        period_s=whole.period_s,
        moments=[
            Moment(at_s=at_s, t=tick * whole.period_s, values=_read_values_at_tick(database, whole, tick, signals))
            for at_s, tick in zip(times_s, ticks, strict=True)
        ],
    )


def _read_values_at_tick(
    database: Database, whole: TickInterval, tick: int, signals: Sequence[str]
) -> dict[str, float | None]:
    slab = next(read_slabs(database, TickInterval(whole.run_id, tick, tick + 1, whole.period_s), signals))
    return {name: _replace_nan(float(column[0])) for name, column in slab.columns.items()}


def _find_interval(database: Database, query: RangeQuery) -> TickInterval:
    with database.reading() as session:
        read_samples(
            session, query.run, [name for name in query.signals if name not in COMBINED_SIGNAL_BY_NAME], 0.0, 0.0
        )
        return find_tick_range(session, query.run, query.from_s, query.to_s)


def _describe_signals(database: Database, query: RangeQuery) -> dict[str, Field | ComputedSignal]:
    with database.reading() as session:
        return describe_signals(session, query.signals)


def _compute_progress(slab: Slab, interval: TickInterval) -> float:
    return float(slab.ticks[-1] + 1 - interval.begin) / interval.ticks


def _build_range_fields(interval: TickInterval, samples: int) -> dict[str, Any]:
    return {
        "run": interval.run_id,
        "from_s": interval.from_s,
        "to_s": interval.to_s,
        "period_s": interval.period_s,
        "samples": samples,
        "missing": interval.ticks - samples,
    }


def _encode_line(line: StatisticsLine | SpectraLine) -> bytes:
    return line.model_dump_json().encode() + b"\n"


def _build_statistics(unit: str, found: Statistics, period_s: float) -> SignalStatistics:
    def to_seconds(extreme: Extreme | None) -> float | None:
        return None if extreme is None else extreme.tick * period_s

    return SignalStatistics(
        unit=unit,
        values=found.values,
        without_value=found.without_value,
        minimum=None if found.minimum is None else found.minimum.value,
        minimum_s=to_seconds(found.minimum),
        maximum=None if found.maximum is None else found.maximum.value,
        maximum_s=to_seconds(found.maximum),
        mean=found.mean if found.values else None,
        deviation=found.deviation if found.values else None,
    )


def _build_spectrum(unit: str, values: NDArray[np.float64], samples: int, period_s: float) -> SignalSpectrum:
    found, reason = welch_spectrum(values, period_s), ""
    finite_count = int(np.count_nonzero(np.isfinite(values)))
    if found is None:
        reason = record_messages.too_few_samples_for_spectrum(minimum=LEAST_SAMPLES)
        found = Spectrum(step_Hz=0.0, noise_bandwidth_Hz=0.0, segment=0, segments=0, used=0, density=np.empty(0))
    return SignalSpectrum(
        unit=unit,
        reason=reason,
        values=finite_count,
        without_value=samples - finite_count,
        used=found.used,
        segment=found.segment,
        segments=found.segments,
        step_Hz=found.step_Hz,
        noise_bandwidth_Hz=found.noise_bandwidth_Hz,
        density=found.density.tolist(),
    )


def _replace_nan(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _cast_to_stored(name: str, column: NDArray[np.float64]) -> NDArray[np.float32] | NDArray[np.float64]:
    return column if name in COMBINED_SIGNAL_BY_NAME else column.astype(np.float32)


# Formulas of derived signals -----------------------------------------------------------------------


MAX_FORMULAS = 50
"""Largest number of formulas of a station."""


class Formulas:
    """Checks and stores the formulas of a station. All methods wait for the disk."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def list_formulas(self) -> FormulaList:
        """Return all formulas, sorted by name."""
        with self._database.reading() as session:
            return FormulaList(formulas=[_build_view(one) for one in formulas.find(session)])

    def save(self, name: str, text: FormulaText, who: str) -> FormulaView:
        """Store a new or changed formula. Raises RequestRejectedError."""
        try:
            derived = parse_derived_signal(name, text.unit, text.expression)
        except ExpressionError as error:
            raise RequestRejectedError(ErrorCode.BAD_VALUE, error.message, code="bad_formula") from None
        with self._database.session() as session:
            others = [one.name for one in formulas.find(session) if one.name != name]
            if len(others) >= MAX_FORMULAS:
                raise RequestRejectedError(
                    ErrorCode.BAD_VALUE, record_messages.too_many_derived_signals(maximum=MAX_FORMULAS)
                )
            similar_name = next((one for one in others if one.lower() == name.lower()), None)
            if similar_name is not None:
                message = record_messages.name_differs_only_in_case(name=name, other=similar_name)
                raise RequestRejectedError(ErrorCode.BAD_VALUE, message, code="bad_formula")
            steps = [asdict(step) for step in derived.steps]
            return _build_view(
                formulas.save(
                    session=session,
                    name=name,
                    expression=text.expression,
                    steps=steps,
                    unit=text.unit,
                    meaning=text.meaning,
                    who=who,
                )
            )

    def remove(self, name: str, who: str) -> None:
        """Remove a formula. Raises UnknownRecordError."""
        with self._database.session() as session:
            formulas.remove(session, name, who)


def _build_view(one: Formula) -> FormulaView:
    derived = build_derived_signal(one)
    return FormulaView(
        name=one.name,
        expression=one.expression,
        unit=one.unit,
        meaning=one.meaning,
        who=one.who,
        at=one.at,
        signals=list(derived.signals),
        steps=list(derived.steps),
    )
