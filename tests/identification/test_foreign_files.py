"""Files of other programs are read correctly or rejected with a remedy; none is misread silently.

The kinds come from bug reports of comparable programs; :mod:`tests.identification.foreign_files` creates the files.
"""

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from backend.identification import messages
from backend.identification.estimation import estimate_model
from backend.identification.importer import (
    Imported,
    Selection,
    TimeChoice,
    decode_text,
    find_time_column,
    import_record,
    read_mat,
    read_parquet,
)
from backend.identification.records import DataFileError, FileFault, RecordError
from backend.identification.tables import DecimalMark, read_csv, read_dates
from tests.identification.foreign_files import (
    COUNT,
    PERIOD_S,
    T,
    U,
    Y,
    comma,
    decimals,
    lines,
    mat,
    objects,
    parquet,
    plain,
    scope,
    stamp,
    structure_with_time,
)
from tests.refusals import refused

LVM = (
    "LabVIEW Measurement\t",
    "Writer_Version\t2",
    "Separator\tTab",
    "Decimal_Separator\t,",
    "***End_of_Header***\t",
    "",
    "Channels\t2\t\t",
    "Samples\t400\t400\t",
    "X_Dimension\tTime\tTime\t",
    "X0\t0,0000000000000000E+0\t0,0000000000000000E+0\t",
    "Delta_X\t0,001000\t0,001000\t",
    "***End_of_Header***\t\t\t",
)
EPOCH_S = 1_772_619_630
WHOLE_MS = np.arange(COUNT)


def dated(form: str) -> str:
    """Return a table with dates as times; ``form`` formats the milliseconds of each row."""
    return lines("time;u;y", lambda k: f"{form.format(k)};{U[k]};{Y[k]}")


def summer(k: int) -> str:
    """Return the local time of a sample with its UTC offset, which changes by one hour after 200 samples."""
    return f"2026-10-25T02:59:59.{800 + k}+02:00" if k < 200 else f"2026-10-25T02:00:00.{k - 200:03d}+01:00"


READ: dict[str, tuple[str | bytes, dict[str, Any]]] = {
    "excel, sep=": (lines("t;u;y", lambda k: f"{comma(T[k])};{comma(U[k])};{comma(Y[k])}", "sep=;"), {}),
    "excel, sep=, quoted": (lines("t;u;y", lambda k: f"{comma(T[k])};{comma(U[k])};{comma(Y[k])}", '"sep=;"'), {}),
    "labview": (lines("X_Value\tu\ty\tComment", lambda k: f"{comma(T[k])}\t{comma(U[k])}\t{comma(Y[k])}", *LVM), {}),
    "labview, comments": (
        lines("X_Value\tu\ty\tComment", lambda k: f"{comma(T[k])}\t{comma(U[k])}\t{comma(Y[k])}\t", *LVM),
        {},
    ),
    "oscilloscope": (
        lines("TIME,u,y", plain, "Model,X", "Firmware,1.2", f"Record Length,{COUNT}", ",", "Source,CH1"),
        {},
    ),
    "oscilloscope of two columns of words above": (lines("TIME,u,y", plain, "Model,X,", "Label,CH1,CH2"), {}),
    "oscilloscope, units": (
        lines("(ms),(V),(V)", lambda k: f"{1e3 * T[k]:.3f},{U[k]},{Y[k]}", "Time,u,y"),
        {},
    ),
    "units without brackets": (lines("s;V;rad/s", lambda k: plain(k).replace(",", ";"), "t;u;y"), {}),
    "rostopic": (
        lines("%time,seq,frame,u,y", lambda k: f"{1486559106139796569 + 1000000 * k},{k},base,{U[k]},{Y[k]}"),
        {},
    ),
    "heading in a comment, a line drawn below it": (lines("# -----", plain, "# measured by hand", "# t,u,y"), {}),
    "names of numbers": (lines("Time,1,2", plain), {"u": "1", "y": "2", "header": 1}),
    "names not in the line above": (
        lines("volts,and,so on", plain, "t,u,y"),
        {"header": 1},
    ),
    "text columns": (
        lines("t,mode,u,y,note", lambda k: f"{T[k]},run,{U[k]},{Y[k]},ok"),
        {},
    ),
    "R": (lines('"t" "u" "y"', lambda k: f"{T[k]} {U[k]} {Y[k]}"), {}),
    "vertical bars": (lines("t|u|y", lambda k: plain(k).replace(",", "|")), {}),
    "carriage returns": (lines("t,u,y", plain, end="\r"), {}),
    "utf-8 with a mark": (b"\xef\xbb\xbf" + lines("t,u,y", plain).encode(), {}),
    "utf-16 with a mark": (lines("t,u,y", plain).encode("utf-16"), {}),
    "empty rows at the end": (lines("t,u,y", plain) + ",,\n,,\n", {}),
    "thousands": (lines("t,u,y", lambda k: f'{T[k]},{U[k]},"{1e3 * Y[k]:,.1f}"'), {"scale": 1e3}),
    "thousands with points": (
        lines("t;u;y", lambda k: f"{comma(T[k])};{comma(U[k])};{comma(1e4 * Y[k], 0)}"),
        {"scale": 1e4},
    ),
    "grouped by points": (
        lines(
            "t;u;y",
            lambda k: f"{comma(T[k])};{comma(U[k])};" + f"{1e4 * Y[k]:,.1f}".translate(str.maketrans(",.", ".,")),
        ),
        {"scale": 1e4},
    ),
    "three decimals, comma said": (
        lines("t;u;y", lambda k: f"{k + 1000};{int(U[k])};{comma(Y[k] + 7.0, 3)}"),
        {"decimal": DecimalMark.COMMA, "time": TimeChoice(unit="ms"), "offset": 7.0, "close": 6e-4},
    ),
    "micros, unit said": (
        lines("timestamp,u,y", lambda k: f"{112_000_000 + 1000 * k},{U[k]},{Y[k]}"),
        {"time": TimeChoice(unit="us")},
    ),
    "micros, sample time said": (
        lines("timestamp,u,y", lambda k: f"{112_000_000 + 1000 * k},{U[k]},{Y[k]}"),
        {"period_s": PERIOD_S},
    ),
    "millis": (lines("millis,u,y", lambda k: f"{k},{U[k]},{Y[k]}"), {}),
    "epoch in ms": (lines("time,u,y", lambda k: f"{1000 * EPOCH_S + k},{U[k]},{Y[k]}"), {}),
    "epoch in us": (lines("time,u,y", lambda k: f"{1_000_000 * EPOCH_S + 1000 * k},{U[k]},{Y[k]}"), {}),
    "epoch in ns, words beside": (
        lines("time,u,y,w", lambda k: f"{1_000_000_000 * EPOCH_S + 1_000_000 * k},{U[k]},{Y[k]},x"),
        {},
    ),
    "epoch in s": (lines("time,u,y", lambda k: f"{EPOCH_S + k / 1000:.3f},{U[k]},{Y[k]}"), {}),
    "days of MATLAB": (
        lines("time,u,y", lambda k: f"{738_000.5 + k / 86_400_000:.12f},{U[k]},{Y[k]}"),
        {"time": TimeChoice(unit="d"), "even": 0.05},
    ),
    "T beside a sample time": (
        lines("u,y,T", lambda k: f"{U[k]},{Y[k]},{25.0 + 0.001 * k:.3f}"),
        {"period_s": PERIOD_S},
    ),
    "T [°C] beside a sample time": (
        lines("u,y,t [°C]", lambda k: f"{U[k]},{Y[k]},{25.0 - 0.001 * k:.3f}"),
        {"period_s": PERIOD_S},
    ),
    "Ts and tmin beside a sample time": (
        lines("u,y,Ts,tmin", lambda k: f"{U[k]},{Y[k]},0.001,{-k}"),
        {"period_s": PERIOD_S},
    ),
    "T is the time": (lines("T,u,y", plain), {"time": TimeChoice("T")}),
    "a time of another name": (lines("Zeit,u,y", plain), {"time": TimeChoice("Zeit")}),
    "a stamp too coarse": (
        lines("time,u,y", lambda k: f"10:20:30,{U[k]},{Y[k]}"),
        {"time": TimeChoice("none"), "period_s": PERIOD_S},
    ),
    "two times": (lines("time,timestamp,u,y", lambda k: f"{T[k]},{k},{U[k]},{Y[k]}"), {"time": TimeChoice("time")}),
    "dates": (dated("2026-03-04 10:20:30.{:03d}"), {}),
    "dates, comma": (dated("2026-03-04T10:20:30,{:03d}"), {}),
    "dates, zone": (dated("2026/03/04T10:20:30.{:03d}+0530"), {}),
    "dates, UTC": (dated("2026-03-04 10:20:30.{:03d} UTC"), {}),
    "dates, day first": (dated("04.03.2026 10:20:30.{:03d}"), {}),
    "dates, order does not matter": (dated("04/03/2026 10:20:30.{:03d}"), {}),
    "dates, named month": (dated("04-Mar-2026 10:20:30.{:03d}"), {}),
    "dates, compact": (dated("20260304T102030.{:03d}Z"), {}),
    "dates, half of the day": (dated("3/4/2026 10:20:30.{:03d} PM"), {}),
    "time of day": (lines("time,u,y", lambda k: f"{stamp(k)},{U[k]},{Y[k]}"), {}),
    "MATLAB, structure with time": (mat(structure_with_time()), {"u": "values_1", "y": "values_2"}),
    "MATLAB, one signal": (mat({"s": {"time": T, "signals": scope(Y, "y")}, "u": U}), {"y": "values"}),
    "MATLAB, two structs": (
        mat({"a": {"t": T, "u": U, "y": Y}, "b": {"u": 2.0 * U, "y": Y}}),
        {"u": "a.u", "y": "a.y"},
    ),
    "MATLAB, logical": (mat({"t": T, "u": U > 0.0, "y": Y}), {"u_read": (U > 0.0).astype(float)}),
    "MATLAB, tout": (mat({"tout": T, "u": U, "y": Y, "Ts": 1e-3, "name": "x", "c": np.array([1, "a"], object)}), {}),
    "Parquet, Boolean": (parquet({"t": T, "u": U > 0.0, "y": Y}), {"u_read": (U > 0.0).astype(float)}),
    "Parquet, decimal": (parquet({"t": decimals(T), "u": decimals(U), "y": decimals(Y)}), {}),
    "Parquet, dates": (
        parquet(
            {
                "time": pa.array((EPOCH_S * 1_000_000 + 1000 * WHOLE_MS).tolist(), pa.timestamp("us", "UTC")),
                "u": U,
                "y": Y,
            }
        ),
        {},
    ),
    "Parquet, time of day": (parquet({"time": pa.array(WHOLE_MS.tolist(), pa.time32("ms")), "u": U, "y": Y}), {}),
    "Parquet, durations": (
        parquet({"elapsed": pa.array((1000 * WHOLE_MS).tolist(), pa.duration("us")), "u": U, "y": Y}),
        {},
    ),
    "Parquet, words of a dictionary beside": (
        parquet({"t": T, "u": U, "y": Y, "w": pa.array(["x"] * COUNT).dictionary_encode()}),
        {},
    ),
    "lines ended twice": (lines("u,y", lambda k: f"{U[k]},{Y[k]}", end="\r\r\n"), {"period_s": PERIOD_S}),
    "a zone that changes with daylight saving": (lines("time,u,y", lambda k: f"{summer(k)},{U[k]},{Y[k]}"), {}),
    "comments in a comment's heading": (lines("#t u y", lambda k: f"{T[k]} {U[k]} {Y[k]}", "% by hand"), {"header": 2}),
    "Parquet, ns": (parquet({"time": EPOCH_S * 1_000_000_000 + 1_000_000 * WHOLE_MS, "u": U, "y": Y}), {}),
    "Parquet, texts beside": (parquet({"t": T, "u": U, "y": Y, "w": ["x"] * COUNT, "l": [[1]] * COUNT}), {}),
}


def imported(content: str | bytes, options: dict[str, Any]) -> Imported:
    """Import a file with this content; the kind is detected from its first bytes."""
    raw = content.encode() if isinstance(content, str) else content
    if raw.startswith(b"MATLAB"):
        columns = read_mat(io.BytesIO(raw))
    elif raw.startswith(b"PAR1"):
        columns = read_parquet(io.BytesIO(raw))
    else:
        text = decode_text(raw, "file.csv")
        columns = read_csv(text, header=options.get("header"), decimal=options.get("decimal"))
    return import_record(
        columns,
        options.get("u", "u"),
        options.get("y", "y"),
        options.get("period_s"),
        time=options.get("time", TimeChoice()),
        selection=options.get("selection", Selection()),
    )


@pytest.mark.parametrize("kind", READ)
def test_every_value_of_a_foreign_file_is_read(kind: str) -> None:
    content, options = READ[kind]
    record, reading = imported(content, options)
    np.testing.assert_array_equal(record.u, options.get("u_read", U))
    expected = options.get("scale", 1.0) * Y + options.get("offset", 0.0)
    np.testing.assert_allclose(record.y, expected, rtol=1e-12, atol=options.get("close", 1e-9))
    assert record.period_s == pytest.approx(PERIOD_S, rel=options.get("even", 1e-6))
    assert (reading.rows_used, reading.rows_in_file) == (COUNT, COUNT)
    if reading.largest_step_s is not None:
        assert reading.largest_step_s == pytest.approx(PERIOD_S, rel=options.get("even", 1e-3))


def test_the_reading_reports_columns_units_and_rows() -> None:
    text = lines("t [ms],mode,u [V],y [rad],z,z", lambda k: f"{1e3 * T[k]:.1f},on,{U[k]},{Y[k]},1,2", "# by hand", "x")
    reading = imported(text, {"selection": Selection(skip=10, take=300)}).reading
    assert reading.columns == {"input": "u", "output": "y"}
    assert reading.units == {"u": "V", "y": "rad"}
    assert (reading.time_column, reading.time_unit, reading.time_unit_from) == ("t", "ms", "heading")
    assert (reading.rows_in_file, reading.first_row, reading.last_row, reading.rows_used) == (COUNT, 11, 310, 300)
    assert set(reading.not_read) == {"mode", "z"}
    assert reading.layout == {
        "format": messages.table_of_text(),
        "heading_line": 3,
        "separator": "comma",
        "decimal_mark": "point",
        "rows": COUNT,
        "lines_above_heading": 1,
        "lines_of_units": 0,
        "comment_lines": 1,
    }
    assert reading.sample_time_s == pytest.approx(PERIOD_S)


def test_the_reading_reports_commented_out_rows() -> None:
    text = lines("t,u,y", lambda k: plain(k) if k % 10 else f"# {plain(k)}")
    reading = imported(text, {"selection": Selection(resample=True)}).reading
    assert reading.rows_in_file == 360
    assert reading.layout["comment_lines"] == 40
    assert (
        messages.comment_lines_with_numbers(count=39) in reading.notes[0]
    )  # the first comment line is above the first row


def test_rows_in_reverse_order_are_rejected() -> None:
    text = lines("t,u,y", lambda k: plain(COUNT - 1 - k))
    with refused(RecordError, "rows_in_reverse_order", largest_step_s=pytest.approx(-PERIOD_S)):
        imported(text, {})


def test_columns_that_are_not_read_have_a_reason() -> None:
    file = mat({"t": T, "u": U, "y": Y, "name": "x", "z": Y + 1j, "K": 3.0, "w": U})
    assert set(imported(file, {}).reading.not_read) == {"name", "z", "K", "w"}
    table = parquet({"t": T, "u": U, "y": Y, "w": ["x"] * COUNT, "l": [[1]] * COUNT})
    assert set(imported(table, {}).reading.not_read) == {"w", "l"}


def back(step: int, at: int = 250) -> str:
    """Return a table whose time in ms decreases by ``step`` after row ``at``."""
    return lines("t_ms,u,y", lambda k: f"{k - (step if k >= at else 0) + 10_000_000},{U[k]},{Y[k]}")


BACK = {
    "overflow of 32 bits": (
        lines("t_us,u,y", lambda k: f"{(2**32 - 250_000 + 1000 * k) % 2**32},{U[k]},{Y[k]}"),
        -(2.0**32) * 1e-6 + 1e-3,
        messages.counter_overflows(bits=32),
    ),
    "overflow of 16 bits": (
        lines("t_ms,u,y", lambda k: f"{(2**16 - 250 + k) % 2**16},{U[k]},{Y[k]}"),
        -(2.0**16) * 1e-3 + 1e-3,
        messages.counter_overflows(bits=16),
    ),
    "end of daylight saving": (back(3_600_000), -3600.0 + 1e-3, messages.daylight_saving_ends()),
    "midnight": (
        lines("time,u,y", lambda k: f"{'23:59:59' if k < 250 else '00:00:00'}.{(k + 750) % 1000:03d},{U[k]},{Y[k]}"),
        -86400.0 + 1e-3,
        messages.day_begins(),
    ),
    "a clock that is set by 5 ms": (back(5), -5e-3 + 1e-3, ""),
}


@pytest.mark.parametrize("kind", BACK)
def test_decreasing_times_are_rejected_and_each_part_can_be_selected(kind: str) -> None:
    text, step_s, cause = BACK[kind]
    for resample in (False, True):
        with refused(
            RecordError,
            "time_decreases_after_row",
            row=250,
            step_s=pytest.approx(step_s, abs=1e-6),
            cause=cause,
            skipped=0,
            rows=250,
        ):
            imported(text, {"selection": Selection(resample=resample)})
    before = imported(text, {"selection": Selection(take=250)})
    np.testing.assert_array_equal(before.record.y, Y[:250])
    assert (before.reading.rows_used, before.reading.rows_in_file) == (250, COUNT)
    with refused(RecordError, "record_too_short", length=150, minimum=200):
        imported(text, {"selection": Selection(skip=250)})


def test_a_time_range_that_occurs_twice_is_rejected() -> None:
    text = lines("t,u,y", lambda k: f"{(k % 300) * PERIOD_S:.3f},{U[k]},{Y[k]}")
    with pytest.raises(DataFileError) as refusal:
        imported(text, {"selection": Selection(start_s=0.0, end_s=0.05)})
    assert (refusal.value.fault, refusal.value.option) == (FileFault.ROWS, "--take")
    assert refusal.value.message.code == "rows_not_contiguous"


def twice_in_parquet() -> bytes:
    """Return a Parquet file with two columns named u."""
    import pyarrow.parquet

    stream = io.BytesIO()
    table = pa.table([pa.array(T), pa.array(U), pa.array(Y), pa.array(-U)], names=["t", "u", "y", "u"])
    pyarrow.parquet.write_table(table, stream)
    return stream.getvalue()


MIXED = lines("t;u;y", lambda k: f"{T[k]:.3f};{int(U[k])};{comma(Y[k])}")
REFUSED: dict[str, tuple[str | bytes, dict[str, Any], FileFault, str | None]] = {
    "thousands or decimals": (
        lines("t;u;y", lambda k: f"{k};{int(U[k])};{comma(Y[k] + 7.0, 3)}"),
        {"time": TimeChoice(unit="ms")},
        FileFault.AMBIGUOUS_DECIMALS,
        "--decimal",
    ),
    "thousands or decimals, quoted": (
        lines("t,u,y", lambda k: f'{T[k]:.3f},{U[k]},"{1000 * int(Y[k] + 9.0) + k:,}"'),
        {},
        FileFault.AMBIGUOUS_DECIMALS,
        "--decimal",
    ),
    "points of thousands or decimals": (
        lines("t;u;y", lambda k: f"{k};{int(U[k])};{Y[k] + 7.0:.3f}"),
        {"time": TimeChoice(unit="ms")},
        FileFault.AMBIGUOUS_DECIMALS,
        "--decimal",
    ),
    "one column with points, one with commas": (MIXED, {}, FileFault.MIXED_DECIMALS, "--decimal"),
    "the other one asked for": (MIXED, {"decimal": DecimalMark.POINT}, FileFault.MIXED_DECIMALS, None),
    "points and commas in one column": (
        lines("t;u;y", lambda k: f"{k};{int(U[k])};{comma(Y[k]) if k % 2 else Y[k]}"),
        {"time": TimeChoice(unit="ms")},
        FileFault.MIXED_DECIMALS,
        None,
    ),
    "micros without a unit": (
        lines("timestamp,u,y", lambda k: f"{112_000_000 + 1000 * k},{U[k]},{Y[k]}"),
        {},
        FileFault.TIME_UNIT,
        "--time-unit",
    ),
    "micros without a unit, with decimals": (
        lines("t,u,y", lambda k: f"{1000.25 * k},{U[k]},{Y[k]}"),
        {},
        FileFault.TIME_UNIT,
        "--time-unit",
    ),
    "days without a unit": (
        lines("time,u,y", lambda k: f"{45_000.5 + k / 8_640_000:.12f},{U[k]},{Y[k]}"),
        {},
        FileFault.TIME_UNIT,
        "--time-unit",
    ),
    "a unit nobody knows": (
        lines("time [samples],u,y", lambda k: f"{k},{U[k]},{Y[k]}"),
        {},
        FileFault.TIME_UNIT,
        "--time-unit",
    ),
    "T may be the time": (lines("T,u,y", plain), {}, FileFault.AMBIGUOUS_TIME, "--time"),
    "two times": (
        lines("time,timestamp,u,y", lambda k: f"{T[k]},{k},{U[k]},{Y[k]}"),
        {},
        FileFault.AMBIGUOUS_TIME,
        "--time",
    ),
    "no time": (lines("Zeit,u,y", plain), {}, FileFault.NO_TIME, "--time"),
    "time twice": (lines("t,u,y,t", lambda k: f"{plain(k)},{k}"), {}, FileFault.AMBIGUOUS_COLUMN, None),
    "the input is no time": (lines("t,u,y", plain), {"time": TimeChoice("u")}, FileFault.OPTION, "--time"),
    "a unit of nothing": (lines("t,u,y", plain), {"time": TimeChoice(unit="weeks")}, FileFault.OPTION, "--time-unit"),
    "a unit of dates": (
        dated("2026-03-04 10:20:30.{:03d}"),
        {"time": TimeChoice(unit="ms")},
        FileFault.OPTION,
        "--time-unit",
    ),
    "a day or a month": (
        lines("time,u,y", lambda k: f"{1 + k // 60:02d}/{1 + k // 300:02d}/2026 10:20:30,{U[k]},{Y[k]}"),
        {},
        FileFault.DATES,
        "--time-unit",
    ),
    "a zone here and there": (
        lines("time,u,y", lambda k: f"2026-03-04 {stamp(k)}{'Z' if k else ''},{U[k]},{Y[k]}"),
        {},
        FileFault.DATES,
        None,
    ),
    "a day that does not exist": (dated("2026-02-30 10:20:30.{:03d}"), {}, FileFault.DATES, None),
    "words for a time": (lines("time,u,y", lambda k: f"soon,{U[k]},{Y[k]}"), {}, FileFault.DATES, None),
    "lines that may be the heading": (
        lines("volts,and,so on", plain, "a,u,y"),
        {},
        FileFault.AMBIGUOUS_HEADING,
        "--header",
    ),
    "a first row with a word": (
        lines("t,u,y", plain).replace("0.000", "start", 1),
        {},
        FileFault.AMBIGUOUS_HEADING,
        "--header",
    ),
    "a footer": (lines("t,u,y", plain) + "end of data\n", {}, FileFault.ROW_WIDTH, "--header"),
    "the heading again": (lines("t,u,y", plain) * 2, {}, FileFault.NOT_A_NUMBER, None),
    "no heading": (lines("0.0,3.0,0.0", plain), {}, FileFault.NO_HEADING, None),
    "a heading alone": ("time;ms\n", {}, FileFault.NO_HEADING, None),
    "a heading alone, by its line": ("t,u,y\n1,2,3\nt,u,y\n", {"header": 3}, FileFault.NO_HEADING, None),
    "one word": ("t", {}, FileFault.NO_HEADING, None),
    "a separator alone": ("sep=;\n", {}, FileFault.NO_HEADING, None),
    "empty cells alone": ("t,u,y\n,,\n,,\n", {}, FileFault.NO_HEADING, None),
    "MATLAB without vectors": (mat({"K": 3.0}), {}, FileFault.NO_COLUMN, None),
    "Parquet without rows": (parquet({"t": T[:0], "u": U[:0], "y": Y[:0]}), {}, FileFault.ROWS, None),
    "a line beyond the end": (lines("t,u,y", plain), {"header": 9999}, FileFault.NO_HEADING, "--header"),
    "the same columns twice in Parquet": (
        twice_in_parquet(),
        {},
        FileFault.AMBIGUOUS_COLUMN,
        None,
    ),
    "empty lines between rows, no time": (
        lines("u,y", lambda k: f"{U[k]},{Y[k]}" if k % 10 else ""),
        {"period_s": PERIOD_S},
        FileFault.ROWS,
        "--time",
    ),
    "rows that are commented out, no time": (
        lines("u,y", lambda k: f"{'' if k % 10 else '# '}{U[k]},{Y[k]}"),
        {"period_s": PERIOD_S},
        FileFault.ROWS,
        "--time",
    ),
    "a count of samples beside another sample time": (
        lines("t,u,y", lambda k: f"{k},{U[k]},{Y[k]}"),
        {"period_s": 4.0 * PERIOD_S},
        FileFault.TIME_UNIT,
        "--time-unit",
    ),
    "apostrophes": (lines("t,u,y", lambda k: f"{T[k]},{U[k]},8'019"), {}, FileFault.NOT_A_NUMBER, None),
    "underscores": (lines("t,u,y", lambda k: f"{T[k]},{U[k]},8_019"), {}, FileFault.NOT_A_NUMBER, None),
    "latin-1": (lines("t,u,y [°]", plain).encode("latin-1"), {}, FileFault.ENCODING, None),
    "control characters": (lines("t,u,y\x1b[31m", plain), {}, FileFault.ENCODING, None),
    "MATLAB table": (objects(T="table"), {}, FileFault.OBJECTS, None),
    "MATLAB timetable": (objects(TT="timetable"), {}, FileFault.OBJECTS, None),
    "MATLAB timeseries": (objects(ts="timeseries"), {}, FileFault.OBJECTS, None),
    "MATLAB, a field of two structs": (
        mat({"a": {"t": T, "u": U, "y": Y}, "b": {"u": U}}),
        {},
        FileFault.AMBIGUOUS_COLUMN,
        None,
    ),
    "MATLAB, damaged": (mat({"u": U, "y": Y})[:300], {}, FileFault.UNREADABLE, None),
    "Parquet, damaged": (parquet({"u": U, "y": Y})[:300], {}, FileFault.UNREADABLE, None),
    "Parquet, words": (parquet({"t": T, "u": ["x"] * COUNT, "y": Y}), {}, FileFault.NOT_A_NUMBER, None),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_an_ambiguous_file_is_rejected_with_the_option_that_resolves_it(kind: str) -> None:
    content, options, fault, option = REFUSED[kind]
    with pytest.raises(DataFileError) as refusal:
        imported(content, options)
    assert (refusal.value.fault, refusal.value.option) == (fault, option)
    assert option is None or option in refusal.value.message


@pytest.mark.parametrize(("kind", "command"), [("table", "y = T.y"), ("timetable", "T.Properties.RowTimes")])
def test_the_rejection_of_a_matlab_object_states_the_command_that_saves_it(kind: str, command: str) -> None:
    assert command in messages.save_command(name="T", kind=kind)
    with pytest.raises(DataFileError) as refusal:
        imported(objects(T=kind, s="string"), {})
    assert refusal.value.column == "T"
    assert refusal.value.message.code == "only_matlab_objects"
    assert refusal.value.message.values == {
        "objects": {"T": kind, "s": "string"},
        "command": messages.save_command(name="T", kind=kind),
    }
    beside = mat({"t": T, "u": U})
    note = messages.matlab_object_with_columns(name="T", kind=kind, command=messages.save_command(name="T", kind=kind))
    with refused(DataFileError, "column_missing", name="y", notes=[note]):
        imported(beside + objects(T=kind)[128:], {})


@pytest.mark.parametrize(("unit", "days"), [("dmy", 1), ("mdy", 31)])
def test_an_option_selects_the_order_of_days_and_months(unit: str, days: int) -> None:
    columns = read_csv(lines("time,u,y", lambda k: f"{1 + k // 200:02d}/01/2026 00:00:00.{k % 200:03d},{U[k]},{Y[k]}"))
    time = find_time_column(columns, ("u", "y"), unit=unit)
    assert time is not None
    assert time.seconds[200] == pytest.approx(86400.0 * days)


@pytest.mark.parametrize("short", ["t", "y"])
def test_columns_of_different_length_are_refused(short: str) -> None:
    values = {"t": T, "u": U, "y": Y}
    values[short] = values[short][:300]
    with refused(RecordError, "columns_of_file_of_unequal_length", name=short, length=300, other="u", expected=400):
        imported(mat(values), {})


def test_rows_without_time_are_rejected() -> None:
    text = lines("t,u,y", lambda k: f"{T[k] if k < 390 else ''},{U[k]},{Y[k]}")
    with refused(RecordError, "rows_without_time", name="t", count=10, first_row=391):
        imported(text, {})


def test_resampling_does_not_hide_missing_samples() -> None:
    text = lines("t,u,y", lambda k: f"{T[k]},{U[k]},{Y[k] if k != 200 else 'nan'}")
    with pytest.raises(DataFileError) as refusal:
        imported(text, {"selection": Selection(resample=True)})
    assert refusal.value.column == "y"
    assert refusal.value.message.code == "resampled_not_finite"
    assert refusal.value.message.values == {"name": "y", "count": 1, "first": 200}


def test_timestamps_in_nanoseconds_are_read_without_loss() -> None:
    """Floating point has a resolution of 256 ns at 1.7e18, which is 0.5 % of the sample time at 20 kHz."""
    stamps = EPOCH_S * 1_000_000_000 + 50_000 * np.arange(COUNT)
    for content in (
        lines("time,u,y", lambda k: f"{stamps[k]},{U[k]},{Y[k]}"),
        parquet({"time": stamps, "u": U, "y": Y}),
        mat({"time": stamps, "u": U, "y": Y}),
    ):
        reading = imported(content, {}).reading
        assert reading.largest_step_s == pytest.approx(5e-5, rel=1e-9)
        assert reading.least_step_s == pytest.approx(5e-5, rel=1e-9)


def test_a_file_with_thousands_separators_gives_the_same_model_as_a_plain_file() -> None:
    found = estimate_model(imported(READ["thousands"][0], {}).record, "first").first_order
    assert pytest.approx(2000.0, rel=5e-3) == found.K
    assert pytest.approx(0.02, rel=2e-2) == found.T


def test_time_zones_are_read_with_hours_and_minutes() -> None:
    """Each cell is one second later than the previous one, starting at 04:50:30 UTC."""
    cells = [
        "2026-03-04T10:20:30+0530",
        "2026-03-04T10:20:31+05:30",
        "2026-03-03T19:05:32-0945",
        "2026-03-04T04:50:33Z",
    ]
    np.testing.assert_allclose(read_dates("time", cells).seconds, [0.0, 1.0, 2.0, 3.0])
