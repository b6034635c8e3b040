"""Derived signals and figures over every sample of a recorded range."""

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
    Extreme,
    Following,
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
from backend.storage import Database, Formula, formulas, recordings
from backend.workers import stream_from_process
from plant import ErrorCode

# Figures -------------------------------------------------------------------------------------------
#
# Computes statistics, values, spectra and files of every sample of a range of a recorded run.


MAX_RANGES = 6
"""Ranges that are read at a time."""

IN_PROCESS_VALUES = 4_000_000
"""Samples times signals of which spectra are computed in the service itself: they take 32 MB."""

MAX_SPECTRUM_VALUES = 30_000_000
"""Samples times signals of which spectra are computed at once: they are held in memory, 240 MB."""

_SYMBOLS = {one.name: one.symbol for one in FIELDS}


@dataclass(frozen=True)
class RangeQuery:
    """``signals`` of a run from ``from_s`` to ``to_s`` (both included) since its first sample; None: to its end."""

    run: int
    from_s: float
    to_s: float | None
    signals: Sequence[str]


LineStream = Callable[[Database, RangeQuery], Iterator[bytes]]


class RangeAnalysis:
    """Computes beside the event loop: in threads, and in a process of its own where a range is long.

    What is under way ends when its generator is closed.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._active_count = 0

    async def stream_statistics(self, asked: RangeQuery) -> AsyncGenerator[bytes]:
        """Return lines of ``StatisticsLine``. Raises UnknownRecordError, UnknownSignalError, refusals."""
        return await self._start_stream(stream_statistics, asked)

    async def stream_spectra(self, asked: RangeQuery) -> AsyncGenerator[bytes]:
        """Return lines of ``SpectraLine``. Raises UnknownRecordError, UnknownSignalError, refusals."""
        return await self._start_stream(stream_spectra, asked, IN_PROCESS_VALUES // max(1, len(asked.signals)))

    async def stream_csv(self, asked: RangeQuery) -> AsyncGenerator[bytes]:
        """Return every sample as comma-separated text, in pieces. Raises like ``statistics``."""
        return await self._start_stream(stream_range_csv, asked, at_hand=0)  # its library takes long to load

    def read_values(self, run: int, times_s: Sequence[float], signals: Sequence[str]) -> RecordedValues:
        """Return the values at the samples at or before ``times_s``; waits for the disk. Raises like ``statistics``."""
        return read_values(self._database, run, times_s, signals)

    async def _start_stream(
        self, lines: LineStream, asked: RangeQuery, at_hand: int | None = None
    ) -> AsyncGenerator[bytes]:
        """Return a stream whose first piece is there: whatever is refused has been refused by then."""
        if self._active_count >= MAX_RANGES:
            raise RequestRejectedError(
                ErrorCode.TOO_MANY, f"{MAX_RANGES} ranges are being read: wait for one of them", retry_after_s=2
            )
        most = AT_HAND_SAMPLES if at_hand is None else min(at_hand, AT_HAND_SAMPLES)
        stream = self._count_stream(lines, asked, most)
        await anext(stream)
        return stream

    async def _count_stream(self, lines: LineStream, asked: RangeQuery, at_hand: int) -> AsyncGenerator[bytes]:
        """Yield nothing when the first piece is there, then the pieces."""
        self._active_count += 1
        try:
            stretch = await asyncio.to_thread(_find_interval, self._database, asked)
            long = stretch.ticks > at_hand
            pieces = (
                stream_from_process(lines, self._database, asked)
                if long
                else _iterate_in_thread(lines(self._database, asked))
            )
            async with aclosing(pieces):
                first = await anext(pieces, b"")
                yield b""
                yield first
                async for piece in pieces:
                    yield piece
        finally:
            self._active_count -= 1


async def _iterate_in_thread(pieces: Iterator[bytes]) -> AsyncGenerator[bytes]:
    while (piece := await asyncio.to_thread(next, pieces, None)) is not None:
        yield piece


def stream_statistics(database: Database, asked: RangeQuery) -> Iterator[bytes]:
    """Yield lines of ``StatisticsLine`` while the range is read, the result in the last one."""
    stretch, told, samples = _find_interval(database, asked), _describe_signals(database, asked), 0
    found = {name: Statistics() for name in asked.signals}
    for slab in read_slabs(database, stretch, asked.signals):
        add_slab(found, slab)
        samples += slab.ticks.size
        yield _encode_line(StatisticsLine(share=_compute_progress(slab, stretch)))
    signals = {name: _build_statistics(told[name].unit, one, stretch.period_s) for name, one in found.items()}
    result = RecordedStatistics(**_build_range_fields(stretch, samples), signals=signals)
    yield _encode_line(StatisticsLine(share=1.0, result=result))


def stream_spectra(database: Database, asked: RangeQuery) -> Iterator[bytes]:
    """Yield lines of ``SpectraLine`` while the range is read, the result in the last one."""
    stretch, told, samples = _find_interval(database, asked), _describe_signals(database, asked), 0
    remedy = "choose a shorter range or fewer signals"
    words = "samples times signals of a spectrum"
    check_range(
        "range",
        stretch.ticks * len(asked.signals),
        minimum=None,
        maximum=MAX_SPECTRUM_VALUES,
        unit="1",
        remedy=remedy,
        words=words,
    )
    values = {name: np.full(stretch.ticks, np.nan) for name in asked.signals}
    for slab in read_slabs(database, stretch, asked.signals):
        for name, column in slab.columns.items():
            values[name][slab.ticks - stretch.begin] = column
        samples += slab.ticks.size
        yield _encode_line(SpectraLine(share=0.9 * _compute_progress(slab, stretch)))
    signals = {
        name: _build_spectrum(told[name].unit, column, samples, stretch.period_s) for name, column in values.items()
    }
    yield _encode_line(
        SpectraLine(share=1.0, result=RecordedSpectra(**_build_range_fields(stretch, samples), signals=signals))
    )


def stream_range_csv(database: Database, asked: RangeQuery) -> Iterator[bytes]:
    """Yield every sample of a range as comma-separated text, with the digits that give each value back exactly.

    Columns of the recording are written as ``data.csv`` of the run has them; combined signals in double precision.
    """
    import pyarrow as pa
    import pyarrow.csv

    stretch, told = _find_interval(database, asked), _describe_signals(database, asked)
    heading = [
        f"run {stretch.run_id} from {stretch.from_s:.3f} s to {stretch.to_s:.3f} s, Sinew {__version__}; every sample; "
        "SI units, angles in rad; t counts from the first sample of the run",
        *(f"{name} [{told[name].unit}] {_SYMBOLS.get(name, name)}: {told[name].meaning}" for name in asked.signals),
    ]
    names = ["t", *asked.signals]
    head = "\n".join([*map(format_csv_comment, heading), ",".join(map(format_csv_cell, names))]) + "\n"
    plain = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
    for slab in read_slabs(database, stretch, asked.signals):
        columns = [
            slab.ticks * stretch.period_s,
            *(_cast_to_stored(name, slab.columns[name]) for name in asked.signals),
        ]
        buffer = io.BytesIO(head.encode())
        buffer.seek(0, io.SEEK_END)
        pyarrow.csv.write_csv(pa.table([pa.array(column) for column in columns], names=names), buffer, plain)
        head = ""
        yield buffer.getvalue()
    if head:
        yield head.encode()


def read_values(database: Database, run: int, times_s: Sequence[float], signals: Sequence[str]) -> RecordedValues:
    """Return the values of signals at the samples at or before ``times_s``.

    Raises UnknownRecordError, UnknownSignalError, OutOfRangeError for a time outside the recording.
    """
    with database.reading() as session:
        whole = find_tick_range(session, run)
        for time_s in times_s:
            if not 0 <= whole.tick_at(time_s) < whole.end:  # a sum of times may miss the last sample by a rounding
                remedy = f"choose a time within the recording of run {run}"
                check_range("at", time_s, minimum=0.0, maximum=whole.to_s, unit="s", remedy=remedy, words="time")
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


def _find_interval(database: Database, asked: RangeQuery) -> TickInterval:
    with database.reading() as session:
        read_samples(
            session, asked.run, [name for name in asked.signals if name not in COMBINED_SIGNAL_BY_NAME], 0.0, 0.0
        )
        return find_tick_range(session, asked.run, asked.from_s, asked.to_s)


def _describe_signals(database: Database, asked: RangeQuery) -> dict[str, Field | Following]:
    with database.reading() as session:
        return describe_signals(session, asked.signals)


def _compute_progress(slab: Slab, stretch: TickInterval) -> float:
    return float(slab.ticks[-1] + 1 - stretch.begin) / stretch.ticks


def _build_range_fields(stretch: TickInterval, samples: int) -> dict[str, Any]:
    return {
        "run": stretch.run_id,
        "from_s": stretch.from_s,
        "to_s": stretch.to_s,
        "period_s": stretch.period_s,
        "samples": samples,
        "missing": stretch.ticks - samples,
    }


def _encode_line(line: StatisticsLine | SpectraLine) -> bytes:
    return line.model_dump_json().encode() + b"\n"


def _build_statistics(unit: str, found: Statistics, period_s: float) -> SignalStatistics:
    def when(extreme: Extreme | None) -> float | None:
        return None if extreme is None else extreme.tick * period_s

    return SignalStatistics(
        unit=unit,
        values=found.values,
        without_value=found.without_value,
        minimum=None if found.minimum is None else found.minimum.value,
        minimum_s=when(found.minimum),
        maximum=None if found.maximum is None else found.maximum.value,
        maximum_s=when(found.maximum),
        mean=found.mean if found.values else None,
        deviation=found.deviation if found.values else None,
    )


def _build_spectrum(unit: str, values: NDArray[np.float64], samples: int, period_s: float) -> SignalSpectrum:
    found, reason = welch_spectrum(values, period_s), ""
    there = int(np.count_nonzero(np.isfinite(values)))
    if found is None:
        reason = f"fewer than {LEAST_SAMPLES} consecutive samples have a value"
        found = Spectrum(step_Hz=0.0, noise_bandwidth_Hz=0.0, segment=0, segments=0, used=0, density=np.empty(0))
    return SignalSpectrum(
        unit=unit,
        reason=reason,
        values=there,
        without_value=samples - there,
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


# Formulas ------------------------------------------------------------------------------------------
#
# Derived signals of the station as the page writes them: checked and stored.


MAX_FORMULAS = 50
"""So many formulas a station may have."""


class Formulas:
    """Reads and writes the formulas of a station. All methods wait for the disk."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def list_formulas(self) -> FormulaList:
        """Return the formulas, by name."""
        with self._database.reading() as session:
            return FormulaList(formulas=[_build_view(one) for one in formulas.find(session)])

    def save(self, name: str, text: FormulaText, who: str) -> FormulaView:
        """Write a formula, or change the one of this name. Raises RequestRejectedError."""
        try:
            derived = parse_derived_signal(name, text.unit, text.expression)
        except ExpressionError as error:
            raise RequestRejectedError(ErrorCode.BAD_VALUE, str(error), code="bad_formula") from None
        with self._database.session() as session:
            others = [one.name for one in formulas.find(session) if one.name != name]
            if len(others) >= MAX_FORMULAS:
                raise RequestRejectedError(
                    ErrorCode.BAD_VALUE, f"a station has {MAX_FORMULAS} formulas at most: remove one first"
                )
            alike = next((one for one in others if one.lower() == name.lower()), None)
            if alike is not None:
                raise RequestRejectedError(
                    ErrorCode.BAD_VALUE, f"{name!r} differs from {alike!r} by case only", code="bad_formula"
                )
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
