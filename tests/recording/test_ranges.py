"""Statistics, spectra and values of ranges of a recording."""

import asyncio
import json
import multiprocessing
from collections.abc import Iterator
from contextlib import closing
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest
from numpy.typing import NDArray
from scipy import signal

from backend.errors import OutOfRangeError, RequestRejectedError
from backend.exports import writers
from backend.exports.base import export_run
from backend.recording.reader import UnknownSignalError
from backend.sample import STORED_NAMES
from backend.services import signals
from backend.services.signals import (
    RangeAnalysis,
    RangeQuery,
    read_values,
    stream_range_csv,
    stream_spectra,
    stream_statistics,
)
from backend.storage.database import Database, open_database
from backend.storage.orm import UnknownRecordError
from plant.interface import T_s
from tests.recording.stored_run import R_J, R_M, store_run

# Long ranges are read in a process of their own, with the same result, and no longer than somebody waits.

COUNT = 120_000


@pytest.fixture
def asked(database: Database) -> RangeQuery:
    run = store_run(database, {"q": np.sin(np.arange(COUNT) * 1e-3)})
    return RangeQuery(run, 0.0, None, ("q", "u_A"))


@pytest.mark.parametrize("at_hand", [COUNT, 1000])
def test_threads_and_worker_process_give_the_same_lines(
    database: Database, asked: RangeQuery, at_hand: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signals, "AT_HAND_SAMPLES", at_hand)

    async def read() -> tuple[bytes, int]:
        stream = await RangeAnalysis(database).stream_statistics(asked)
        beside = len(multiprocessing.active_children())
        return b"".join([piece async for piece in stream]), beside

    found, beside = asyncio.run(read())
    assert found == b"".join(stream_statistics(database, asked))
    assert beside == int(at_hand < COUNT)


@pytest.mark.parametrize("at_hand", [COUNT, 1000])
def test_an_abandoned_stream_frees_its_slot(
    database: Database, asked: RangeQuery, at_hand: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signals, "AT_HAND_SAMPLES", at_hand)
    monkeypatch.setattr(signals, "MAX_RANGES", 1)

    async def leave() -> None:
        recorded = RangeAnalysis(database)
        left = await recorded.stream_statistics(asked)
        with pytest.raises(RequestRejectedError) as refused:
            await recorded.stream_spectra(asked)
        assert refused.value.retry_after_s > 0
        await left.aclose()
        assert not multiprocessing.active_children()
        with pytest.raises(OutOfRangeError):  # what is refused takes no place
            await recorded.stream_csv(RangeQuery(asked.run, COUNT, None, ("q",)))
        lines = b"".join([piece async for piece in await recorded.stream_statistics(asked)])
        assert lines.count(b"\n") > 1

    asyncio.run(leave())


# Figures of a range of a recording come from every sample of it, and agree with the run's CSV.

COUNT_RANGES = 130_000
"""More than two slabs, and no whole number of them."""
MISSING = slice(61_000, 61_700)
SIGNALS = ("q", "q_ref", "S", "u_A", "q - q_ref", "x_A")


def made_up() -> dict[str, NDArray[np.floating]]:
    """Return a signal that requires every sample: noise with spikes of one sample, on a large offset."""
    chance = np.random.default_rng(5)
    t = np.arange(COUNT_RANGES) * T_s
    q = 0.4 * np.sin(2 * np.pi * 0.2 * t) + 1e-3 * chance.standard_normal(COUNT_RANGES)
    q_ref = np.where(t < 20.0, np.nan, 0.4 * np.sin(2 * np.pi * 0.2 * t))
    S = 1000.0 + chance.standard_normal(COUNT_RANGES)
    S[40_000:40_321] = np.nan
    u_A = np.sign(np.sin(2 * np.pi * 47.0 * t))
    u_A[70_007], u_A[90_009] = 9.5, -8.5
    return {"q": q, "q_ref": q_ref, "S": S, "u_A": u_A, "theta_A": 3.0 * q}


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Database, int]]:
    database = open_database(tmp_path_factory.mktemp("ranges"))
    yield database, store_run(database, made_up(), MISSING, tuple(made_up()))
    database.close()


@pytest.fixture(scope="module")
def whole(stored: tuple[Database, int], tmp_path_factory: pytest.TempPathFactory) -> dict[str, NDArray[np.float64]]:
    """The run's data.csv, read like any CSV, with the signals computed from its columns."""
    file = tmp_path_factory.mktemp("csv") / "data.csv"
    file.write_bytes(b"".join(writers.write_csv(export_run(*stored))))
    return with_computed(read_csv(file))


def with_computed(columns: dict[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    of = columns
    return columns | {"q - q_ref": of["q"] - of["q_ref"], "x_A": R_M * of["theta_A"] - R_J * of["q"]}


def read_csv(file: Path) -> dict[str, NDArray[np.float64]]:
    """Read recorded columns in single precision, as written: the digits restore each value exactly."""
    with file.open() as lines:
        comments = sum(1 for _ in takewhile(lambda line: line.startswith("#"), lines))
    types = pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(STORED_NAMES, pa.float32()))
    columns = pyarrow.csv.read_csv(file, pyarrow.csv.ReadOptions(skip_rows=comments), convert_options=types)
    return {name: columns[name].cast(pa.float64()).to_numpy() for name in columns.column_names}


def last_of(lines: Iterator[bytes]) -> dict[str, Any]:
    """Return the result, after a check that the lines before it report progress."""
    *under_way, last = [json.loads(line) for line in lines]
    shares = [line["share"] for line in under_way]
    assert shares == sorted(shares)
    assert all(0.0 < share <= 1.0 for share in shares)
    assert all(line["result"] is None for line in under_way)
    assert last["share"] == 1.0
    return dict(last["result"])


@pytest.mark.parametrize(("from_s", "to_s"), [(0.0, None), (35.7, 66.3), (19.9995, 20.0004), (60.9, 62.0)])
def test_statistics_are_those_of_the_csv(
    stored: tuple[Database, int], whole: dict[str, NDArray[np.float64]], from_s: float, to_s: float | None
) -> None:
    database, run = stored
    result = last_of(stream_statistics(database, RangeQuery(run, from_s, to_s, SIGNALS)))
    t = whole["t"]
    within = (t >= from_s - 1e-9) & (t <= (np.inf if to_s is None else to_s) + 1e-9)
    ticks = round((t[within][-1] - t[within][0]) / T_s) + 1
    assert (result["samples"], result["missing"]) == (within.sum(), ticks - within.sum())
    assert (result["from_s"], result["to_s"]) == (t[within][0], t[within][-1])
    for name in SIGNALS:
        found, column = result["signals"][name], whole[name][within]
        there = np.isfinite(column)
        assert (found["values"], found["without_value"]) == (there.sum(), column.size - there.sum())
        if not there.any():
            assert found["mean"] is found["deviation"] is found["minimum"] is found["maximum_s"] is None
            continue
        wanted = column[there]
        assert found["mean"] == pytest.approx(wanted.mean(), rel=1e-9, abs=1e-12)
        assert found["deviation"] == pytest.approx(wanted.std(), rel=1e-9, abs=1e-12)
        assert (found["minimum"], found["maximum"]) == (wanted.min(), wanted.max())
        assert found["minimum_s"] == t[within][there][wanted.argmin()]
        assert found["maximum_s"] == t[within][there][wanted.argmax()]


def test_statistics_of_ten_minutes_are_those_of_the_csv(tmp_path: Path) -> None:
    """Read in double precision, like most CSV readers: the digits differ from the stored values by less than 1e-9."""
    t = np.arange(600_000) * T_s
    drift, chance = 30.0 + 0.01 * t, np.random.default_rng(7)
    columns = {"F_A": drift + chance.standard_normal(t.size), "u_A": 10.0 * np.sign(np.sin(9.0 * t)), "q": 1e-3 * drift}
    with closing(open_database(tmp_path)) as database:
        run = store_run(database, columns, fields=tuple(columns))
        result = last_of(stream_statistics(database, RangeQuery(run, 0.0, None, tuple(columns))))
        file = tmp_path / "data.csv"
        file.write_bytes(b"".join(writers.write_csv(export_run(database, run))))
    lines = file.read_text().splitlines()
    begin = next(place for place, line in enumerate(lines) if not line.startswith("#"))
    read = np.genfromtxt(lines[begin:], delimiter=",", names=True)
    assert result["samples"] == read.size == 600_000
    for name in columns:
        found = result["signals"][name]
        assert found["mean"] == pytest.approx(read[name].mean(), rel=1e-9, abs=1e-9)
        assert found["deviation"] == pytest.approx(read[name].std(), rel=1e-9, abs=1e-9)
        # a single value has the seven or eight digits of single precision
        assert found["minimum"] == pytest.approx(read[name].min(), rel=1e-7)
        assert found["maximum"] == pytest.approx(read[name].max(), rel=1e-7)


def test_a_file_of_a_range_has_the_rows_of_the_csv(
    stored: tuple[Database, int], whole: dict[str, NDArray[np.float64]], tmp_path: Path
) -> None:
    database, run = stored
    file = tmp_path / "range.csv"
    file.write_bytes(b"".join(stream_range_csv(database, RangeQuery(run, 35.7, 66.3, SIGNALS))))
    found = read_csv(file)
    assert list(found) == ["t", *SIGNALS]
    within = (whole["t"] >= 35.7) & (whole["t"] <= 66.3)
    for name, column in found.items():
        np.testing.assert_array_equal(column, whole[name][within])


def test_values_are_those_of_the_sample_at_or_before(
    stored: tuple[Database, int], whole: dict[str, NDArray[np.float64]]
) -> None:
    database, run = stored
    times = [-1e-16, 0.0, 35.7, 35.7009, 61.35, 129.999, 129.999 * (1.0 + 4e-16)]
    found = read_values(database, run, times, SIGNALS)
    for time_s, moment in zip(times, found.moments, strict=True):
        row = np.flatnonzero(whole["t"] <= time_s + 1e-9)[-1]
        assert (moment.at_s, moment.t) == (time_s, whole["t"][row])
        for name in SIGNALS:
            value = whole[name][row]
            assert moment.values[name] == (None if np.isnan(value) else value)


def test_spectra_are_those_of_scipy(
    stored: tuple[Database, int], whole: dict[str, NDArray[np.float64]], monkeypatch: pytest.MonkeyPatch
) -> None:
    database, run = stored
    result = last_of(stream_spectra(database, RangeQuery(run, 62.0, None, ("q", "u_A"))))
    within = whole["t"] >= 62.0
    for name in ("q", "u_A"):
        found = result["signals"][name]
        assert (found["values"], found["without_value"], result["missing"]) == (within.sum(), 0, 0)
        segment = found["segment"]
        options = {"window": "hann", "nperseg": segment, "detrend": "constant"}
        f, density = signal.welch(whole[name][within], 1.0 / T_s, **options)
        np.testing.assert_allclose(found["density"], density[1:-1], rtol=1e-7, atol=1e-14)
        np.testing.assert_allclose(found["step_Hz"] * np.arange(1, segment // 2), f[1:-1], rtol=1e-12)
        assert found["used"] == (found["segments"] - 1) * segment // 2 + segment
    monkeypatch.setattr(signals, "MAX_SPECTRUM_VALUES", 100_000)
    with pytest.raises(OutOfRangeError) as refused:
        list(stream_spectra(database, RangeQuery(run, 62.0, None, ("q", "u_A"))))
    assert (refused.value.value, refused.value.maximum) == (2 * within.sum(), 100_000)


def test_a_spectrum_excludes_segments_with_gaps_and_reports_them(stored: tuple[Database, int]) -> None:
    database, run = stored
    result = last_of(stream_spectra(database, RangeQuery(run, 39.0, 80.0, ("S", "u_A", "q_ref"))))
    assert (result["samples"], result["missing"]) == (41_001 - 700, 700)
    stiffness = result["signals"]["S"]
    assert (stiffness["without_value"], stiffness["values"]) == (321, 41_001 - 700 - 321)
    assert 0 < stiffness["used"] <= stiffness["values"]
    # white noise of deviation 1 has the same density everywhere: a gap that was bridged would add to it
    assert np.mean(stiffness["density"]) == pytest.approx(2.0 * T_s, rel=0.05)
    square = result["signals"]["u_A"]
    place = int(np.argmax(square["density"]))
    assert (place + 1) * square["step_Hz"] == pytest.approx(47.0, abs=square["step_Hz"])
    amplitude = np.sqrt(2.0 * square["density"][place] * square["noise_bandwidth_Hz"])
    assert amplitude == pytest.approx(
        4.0 / np.pi, rel=0.08
    )  # of its first harmonic; Hann loses up to 15 % aside a line
    none = last_of(stream_spectra(database, RangeQuery(run, 19.0, 20.05, ("q_ref",))))["signals"]["q_ref"]
    assert (none["segments"], none["density"], none["values"]) == (0, [], 51)
    assert none["reason"]


@pytest.mark.parametrize(
    ("from_s", "to_s", "quantity", "minimum", "maximum"),
    [
        (130.0, None, "from", 0.0, 129.999),
        (-0.5, 3.0, "from", 0.0, 129.999),
        (3.0, 2.0, "to", 3.0, 129.999),
        (3.0, 130.5, "to", 3.0, 129.999),
        (3.0002, 3.0008, "range", T_s, None),
    ],
)
def test_an_invalid_range_is_rejected_with_its_bounds(
    stored: tuple[Database, int],
    from_s: float,
    to_s: float | None,
    quantity: str,
    minimum: float,
    maximum: float | None,
) -> None:
    database, run = stored
    for lines in (stream_statistics, stream_spectra, stream_range_csv):
        with pytest.raises(OutOfRangeError) as refused:
            next(lines(database, RangeQuery(run, from_s, to_s, SIGNALS)))
        assert (refused.value.quantity, refused.value.unit) == (quantity, "s")
        assert refused.value.minimum == pytest.approx(minimum)
        assert refused.value.maximum == (None if maximum is None else pytest.approx(maximum))


def test_unknown_runs_and_signals_are_rejected(stored: tuple[Database, int]) -> None:
    database, run = stored
    for lines in (stream_statistics, stream_spectra, stream_range_csv):
        with pytest.raises(UnknownSignalError):
            next(lines(database, RangeQuery(run, 0.0, 1.0, ("q", "nonsense"))))
        with pytest.raises(UnknownRecordError):
            next(lines(database, RangeQuery(run + 1, 0.0, 1.0, ("q",))))
    with pytest.raises(OutOfRangeError):
        read_values(database, run, [0.0, 130.0], ["q"])
