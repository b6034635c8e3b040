"""Import of common files: all columns are read; the time column is detected and checked."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from backend.identification.estimation import estimate_model
from backend.identification.importer import Selection, import_record, read_mat
from backend.identification.records import DataFileError, IdentificationError, Record
from backend.identification.tables import Columns, read_csv
from tests.identification.own_motor import K_M, PERIOD_S, T_M, Array, motor, noisy, voltages
from tests.refusals import refused


def record_from(*arguments: Any, **keywords: Any) -> Record:
    """Return the record of these columns, without the description of the reading."""
    return import_record(*arguments, **keywords).record


N = 400
T = np.arange(N) * 0.01
U = np.repeat(np.random.default_rng(0).choice([-2.5, 1.25], N // 20), 20)
Y = np.round(np.cumsum(U) * 0.125, 6)
ROWS = list(zip(T.round(6).tolist(), U.tolist(), Y.tolist(), strict=True))


def table(heading: str, row: Callable[[float, float, float], str], *before: str) -> str:
    return "\n".join([*before, heading, *(row(*values) for values in ROWS)]) + "\n"


def comma(value: float) -> str:
    return f"{value}".replace(".", ",")


READ = {
    "plain": table("t,u,y", lambda t, u, y: f"{t},{u},{y}"),
    "pandas index": table(",t,u,y", lambda t, u, y: f"{round(t / 0.01)},{t},{u},{y}"),
    "text column": table("t,label,u,y", lambda t, u, y: f"{t},run A,{u},{y}"),
    "units row": table("t,u,y", lambda t, u, y: f"{t},{u},{y}").replace("t,u,y\n", "t,u,y\n[s],[V],[rad]\n"),
    "per cent comments": table("t,u,y", lambda t, u, y: f"{t},{u},{y}", "% made by hand", "# and by another"),
    "names in a comment": table("% t u y", lambda t, u, y: f"{t} {u} {y}"),
    "blanks": table("t   u    y", lambda t, u, y: f"  {t}   {u}  {y}"),
    "blanks and units": table("t [s]  u [V]  y [rad]", lambda t, u, y: f"{t} {u} {y}"),
    "decimal commas": table("t;u;y", lambda t, u, y: f"{comma(t)};{comma(u)};{comma(y)}"),
    "quoted decimal commas": table("t,u,y", lambda t, u, y: f'"{comma(t)}","{comma(u)}","{comma(y)}"'),
    "separator at the end": table("t,u,y,", lambda t, u, y: f"{t},{u},{y},"),
    "separator at the end of rows": table("t,u,y", lambda t, u, y: f"{t},{u},{y},"),
    "other column empty": table("t,u,y,z", lambda t, u, y: f"{t},{u},{y},"),
    "other column twice": table("t,u,y,z,z", lambda t, u, y: f"{t},{u},{y},1,2"),
    "tabs and BOM": "\ufeff" + table("t\tu\ty", lambda t, u, y: f"{t}\t{u}\t{y}"),
}


@pytest.mark.parametrize("kind", READ)
def test_common_table_formats_are_read(kind: str) -> None:
    record = record_from(read_csv(READ[kind]), "u", "y")
    np.testing.assert_array_equal(record.u, U)
    np.testing.assert_array_equal(record.y, Y)
    assert record.period_s == pytest.approx(0.01, rel=1e-9)


TIMES = {
    "Time": T,
    "time [s]": T,
    "TIME (ms)": 1e3 * T,
    "t_ms": 1e3 * T,
    "Time_us": 1e6 * T,
    "timestamp": 1.7e9 + T,
    "timestamps [ms]": 1e3 * T + 5e6,
    "elapsed": T,
    **{f"time [{unit}]": T for unit in ("sec", "second", "seconds")},
    **{f"time [{unit}]": 1e3 * T for unit in ("msec", "millis", "milliseconds")},
    **{f"time [{unit}]": 1e6 * T for unit in ("µs", "μs")},
    **{f"time [{unit}]": T / 60.0 for unit in ("min", "minutes")},
    "time [ns]": 1e9 * T,
    "time [h]": T / 3600.0,
}


@pytest.mark.parametrize("heading", TIMES)
def test_a_time_column_is_recognized_by_its_name_and_unit(heading: str) -> None:
    text = f"{heading},u,y\n" + "".join(
        f"{t!r},{u},{y}\n" for t, u, y in zip(TIMES[heading].tolist(), U, Y, strict=True)
    )
    assert record_from(read_csv(text), "u", "y").period_s == pytest.approx(0.01, rel=1e-6)
    with refused(IdentificationError, "sample_time_differs", sample_time_s=pytest.approx(0.01)):
        record_from(read_csv(text), "u", "y", 0.0101)


def test_a_column_of_dates_is_a_time_column() -> None:
    stamps = np.datetime64("2026-03-04T10:20:30") + np.round(1e6 * T).astype("timedelta64[us]")
    text = "timestamp,u,y\n" + "".join(f"{stamp}Z,{u},{y}\n" for stamp, u, y in zip(stamps, U, Y, strict=True))
    assert record_from(read_csv(text), "u", "y").period_s == pytest.approx(0.01, rel=1e-9)


def test_a_signal_named_t_is_not_a_time_column() -> None:
    record = record_from(read_csv("u,T\n" + "".join(f"{u},{y}\n" for u, y in zip(U, Y, strict=True))), "u", "T", 0.01)
    np.testing.assert_array_equal(record.y, Y)


@pytest.mark.parametrize(
    ("text", "column", "code", "values"),
    [
        ("u,y\n1,2\n3,four\n5,6\n", "y", "not_a_number", {"name": "y", "cell": "four", "line": 3}),
        ("u,y,y\n1,2,3\n4,5,6\n", "y", "two_columns_of_table", {"name": "y"}),
        (
            "u,y\n1,2\n3\n",
            "y",
            "row_of_other_width",
            {"line": 3, "columns": 1, "heading_line": 1, "expected": 2},
        ),
        ("# made by hand\nu,y\n1,2\n3\n", "y", "row_of_other_width", {"line": 4, "columns": 1}),
        ("1,2\n3,4\n", "y", "first_line_holds_numbers", {}),
        ("u,z\n1,2\n3,4\n", "y", "column_missing", {"name": "y", "known": ["u", "z"]}),
        ("", "y", "no_heading", {}),
    ],
)
def test_an_unreadable_cell_is_reported_with_line_and_column(
    text: str, column: str, code: str, values: dict[str, object]
) -> None:
    with refused(DataFileError, code, **values):
        read_csv(text).column(column)


def test_a_file_without_time_needs_the_sample_time() -> None:
    with refused(DataFileError, "no_time_column"):
        record_from(Columns({"u": U, "y": Y}), "u", "y")


@pytest.mark.parametrize(
    "content",
    [
        {"u": U, "y": Y.reshape(-1, 1), "t": T},
        {"data": {"u": U, "y": Y, "Time": T, "note": "by hand"}},
        {"t": T.reshape(1, -1), "u": U, "y": Y, "K": np.eye(3), "name": "x"},
    ],
    ids=["vectors", "struct", "rows"],
)
def test_vectors_and_structs_of_matlab_are_read(content: dict[str, object]) -> None:
    stream = io.BytesIO()
    savemat(stream, content)  # type: ignore[arg-type]  # the stubs forget that files may be open
    stream.seek(0)
    record = record_from(read_mat(stream), "u", "y")
    np.testing.assert_array_equal(record.u, U)
    np.testing.assert_array_equal(record.y, Y)
    assert record.period_s == pytest.approx(0.01, rel=1e-9)


def test_columns_of_a_matrix_are_numbered() -> None:
    stream = io.BytesIO()
    savemat(stream, {"data": np.column_stack((T, U, Y))})  # type: ignore[arg-type]  # as above
    stream.seek(0)
    record = record_from(read_mat(stream), "data_2", "data_3", 0.01)
    np.testing.assert_array_equal(record.u, U)
    np.testing.assert_array_equal(record.y, Y)


def test_rows_are_chosen_by_number_and_by_time() -> None:
    columns = read_csv(READ["plain"])
    np.testing.assert_array_equal(record_from(columns, "u", "y", selection=Selection(skip=30)).y, Y[30:])
    part = record_from(columns, "u", "y", selection=Selection(start_s=0.5, end_s=3.0))
    np.testing.assert_array_equal(part.y, Y[50:301])
    untimed = record_from(Columns({"u": U, "y": Y}), "u", "y", 0.01, selection=Selection(start_s=0.5, end_s=3.0))
    np.testing.assert_array_equal(untimed.y, Y[50:301])
    with refused(DataFileError, "no_row_selected", rows=N, end_s=pytest.approx(3.99)):
        record_from(columns, "u", "y", selection=Selection(start_s=99.0))


def moving() -> tuple[Array, Array, Array]:
    u = voltages("binary", 8000)
    t = np.arange(u.size, dtype=float) * PERIOD_S
    return t, u, noisy(motor(u)[0], 0.01) + 100.0  # offset: not a speed about zero


def errors_in_std(record: Record) -> float:
    found = estimate_model(record, "first").first_order
    K_std, T_std = found.deviations
    return max(abs(found.K - K_M) / K_std, abs(found.T - T_M) / T_std)


def test_a_gap_is_rejected_and_the_part_before_it_is_accepted() -> None:
    t, u, y = moving()
    kept = (t < 4.01) | (t > 4.41)
    columns = Columns({"Time": t[kept], "u": u[kept], "y": y[kept]})
    for period_s, selection, code in (
        (PERIOD_S, Selection(), "samples_missing"),
        (None, Selection(), "samples_missing"),
        (PERIOD_S, Selection(resample=True), "gap_too_long"),
    ):
        with refused(IdentificationError, code, sample=pytest.approx(4009.5, abs=0.5)):
            record_from(columns, "u", "y", period_s, selection=selection)
    assert errors_in_std(record_from(columns, "u", "y", selection=Selection(end_s=4.0))) < 4.0


def test_uneven_rows_are_rejected_and_resampled_on_request() -> None:
    t, u, y = moving()
    dropped = np.random.default_rng(3).random(t.size) < 0.02
    columns = Columns({"Time": t[~dropped], "u": u[~dropped], "y": y[~dropped]})
    with refused(IdentificationError, "samples_missing"):
        record_from(columns, "u", "y", PERIOD_S)
    record = record_from(columns, "u", "y", PERIOD_S, selection=Selection(resample=True))
    assert record.u.size == t.size
    assert np.mean(record.u != u) < 1e-3
    assert errors_in_std(record) < 4.0


def test_a_sample_time_one_percent_off_is_rejected_and_correct_when_resampled() -> None:
    t, u, y = moving()
    columns = Columns({"t": 1.009 * t, "u": u, "y": y})
    with refused(IdentificationError, "sample_time_differs", sample_time_s=pytest.approx(0.001009)):
        record_from(columns, "u", "y", PERIOD_S)
    found = estimate_model(record_from(columns, "u", "y"), "first").first_order
    assert abs(found.T - 1.009 * T_M) < 4.0 * found.deviations[1]
    resampled = estimate_model(record_from(columns, "u", "y", PERIOD_S, selection=Selection(resample=True)), "first")
    assert abs(resampled.first_order.T / (1.009 * T_M) - 1.0) < 0.004


def test_a_file_beyond_the_stated_length_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("backend.identification.tables.MAX_SAMPLES", 3)
    np.testing.assert_array_equal(read_csv("u\n1\n2\n3\n")["u"], [1.0, 2.0, 3.0])
    with refused(DataFileError, "too_many_rows", rows=4, maximum=3):
        read_csv("u\n1\n2\n3\n4\n")
