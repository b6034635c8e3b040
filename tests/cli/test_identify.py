"""``sinew identify data``: files as input, one answer as output, no messages of libraries."""

import json
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import lsim

from backend.cli import main
from plant import Message, SinewError
from tests.exports.written import to_csv, to_mat, to_parquet
from tests.identification.closed_loop_records import (
    FIRST,
    K_I,
    K_P,
    ONE_HERTZ,
    PERIOD_S,
    THIRD,
    Array,
    Disturbed,
    closed_loop_record,
)
from tests.identification.record_generator import without_lag

# ``sinew identify data``: files of every format as input, one JSON object as output; invalid ones exit with 2.

HDF5 = b"\x89HDF\r\n\x1a\n".ljust(512, b"\0")
MATLAB_7_3 = (b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\0\2IM").ljust(512, b"\0")
"""Start of a file of MATLAB version 7.3, an HDF5 file; Octave and others omit it."""

Identify = Callable[..., Any]
CONTROLLER = ["--controller", f"{K_P},{K_I}"]
SUMMARY = [
    "read",
    "parameters",
    "std_errors",
    "method",
    "fit_percent",
    "spread_percent",
    "friction",
    "input_offset",
    "hint",
    "grade",
    "verdict",
]
RECORDS: dict[str, tuple[float, Disturbed]] = {
    "40 dB": (40.0, {}),
    "10 dB": (10.0, {}),
    "coloured": (20.0, {"pole": ONE_HERTZ}),
    "cut, offset, drift": (20.0, {"offset": 2.0, "drift": 3.0, "cut": 777}),
}


class Complaint(NamedTuple):
    """Status of a command that failed, its line, and the refusal with that text."""

    status: int | str
    line: str
    refusal: Message

    def has(self, code: str, values: dict[str, object]) -> bool:
        """Return whether the refusal has this code and these values, and its text was printed."""
        found = {name: self.refusal.values.get(name) for name in values}
        is_printed = " ".join(self.refusal.split()) in self.line
        return (self.status, self.refusal.code, found, is_printed) == (2, code, values, True)


@pytest.fixture
def identify(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Identify:
    """Run the command in this process; return the parsed JSON, or the complaint if it fails."""

    def run(file: Path, *words: str, structure: str = "first") -> Any:
        known = ["--input", "u", "--output", "y", "--period", "0.001", "--structure", structure, "--json"]
        monkeypatch.setattr(sys, "argv", ["sinew", "identify", "data", str(file), *known, *words])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        if ended.value.code:
            assert printed.out == ""
            assert len(printed.err.strip().splitlines()) == 1
            error = ended.value.__context__
            return Complaint(
                ended.value.code, printed.err, error.message if isinstance(error, SinewError) else Message("")
            )
        return json.loads(printed.out)

    return run


def write_csv(file: Path, **columns: Array) -> Path:
    np.savetxt(file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return file


def errors_in_std(printed: dict[str, Any], truth: dict[str, float]) -> list[float]:
    return [(printed["parameters"][name] - truth[name]) / printed["std_errors"][name] for name in truth]


@pytest.mark.parametrize("kind", RECORDS)
@pytest.mark.parametrize(("structure", "truth"), [("first", FIRST), ("third", THIRD)])
def test_every_kind_of_record_yields_the_true_parameters(
    identify: Identify, tmp_path: Path, structure: str, truth: dict[str, float], kind: str
) -> None:
    snr_dB, disturbed = RECORDS[kind]
    u, y, _ = closed_loop_record(truth, snr_dB, 11, **disturbed)
    printed = identify(write_csv(tmp_path / "record.csv", u=u, y=y), *CONTROLLER, structure=structure)
    assert list(printed) == SUMMARY
    assert set(printed["parameters"]) == set(printed["std_errors"]) == set(truth)
    assert np.max(np.abs(errors_in_std(printed, truth))) < 4.0
    assert printed["method"].startswith("closed-loop")


def test_the_setpoint_is_the_instrument_without_a_controller(identify: Identify, tmp_path: Path) -> None:
    u, y, r = closed_loop_record(FIRST, 10.0, 12, pole=ONE_HERTZ)
    printed = identify(write_csv(tmp_path / "record.csv", r=r, u=u, y=y), "--setpoint", "r")
    assert printed["method"].startswith("closed-loop")
    assert np.max(np.abs(errors_in_std(printed, FIRST))) < 4.0


def test_a_constant_setpoint_with_its_controller_is_accepted(identify: Identify, tmp_path: Path) -> None:
    u, y, _ = closed_loop_record(FIRST, 20.0, 13)
    file = write_csv(tmp_path / "record.csv", t=np.arange(u.size, dtype=float) * PERIOD_S, u=u, y=y, r=np.zeros(u.size))
    printed = identify(file, "--setpoint", "r", *CONTROLLER)
    assert printed["method"] == "closed-loop SRIVC"
    assert np.max(np.abs(errors_in_std(printed, FIRST))) < 4.0


@pytest.mark.parametrize(
    ("structure", "names"), [("lags4", ["K", "tau"]), ("order:2", ["b0", "a1", "a2"]), ("order:1", ["b0", "a1"])]
)
def test_parameters_have_their_documented_names(
    identify: Identify, tmp_path: Path, structure: str, names: list[str]
) -> None:
    u = np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 100), 50)
    y = lsim(([2.0], [0.005, 0.15, 1.0]), u, np.arange(u.size) * PERIOD_S, interp=False)[1]
    y += 0.01 * np.random.default_rng(1).standard_normal(u.size)
    assert list(identify(write_csv(tmp_path / "x.csv", u=u, y=y), structure=structure)["parameters"]) == names


@pytest.mark.parametrize("method", ["srivc", "rivc", "output_error", "arx"])
def test_each_estimator_can_be_selected(identify: Identify, tmp_path: Path, method: str) -> None:
    u, y, _ = closed_loop_record(FIRST, 30.0, 14)
    printed = identify(write_csv(tmp_path / "record.csv", u=u, y=y), *CONTROLLER, "--method", method)
    assert printed["parameters"] == pytest.approx(FIRST, rel=0.02)
    assert method.split("_")[0] in printed["method"].lower()


def test_every_file_format_yields_the_same_model(identify: Identify, tmp_path: Path) -> None:
    u, y, _ = closed_loop_record(FIRST, 30.0, 15)
    expected = identify(write_csv(tmp_path / "comma.csv", u=u, y=y), *CONTROLLER)["parameters"]
    decimal_comma = "u [V];y [rad]\r\n" + "".join(
        f"{a!r};{b!r}\r\n".replace(".", ",") for a, b in zip(u.tolist(), y.tolist(), strict=True)
    )
    (tmp_path / "excel.csv").write_text("\ufeff" + decimal_comma, encoding="utf-8", newline="")
    savemat(tmp_path / "matlab.mat", {"u": u, "y": y.reshape(-1, 1), "note": "a string"})
    for name in ("excel.csv", "matlab.mat"):
        assert identify(tmp_path / name, *CONTROLLER)["parameters"] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("suffix", "export"), [("csv", to_csv), ("mat", to_mat), ("parquet", to_parquet)])
def test_exports_can_be_read(
    identify: Identify, tmp_path: Path, suffix: str, export: Callable[[dict[str, Array]], bytes]
) -> None:
    u, y, _ = closed_loop_record(FIRST, 40.0, 16)
    columns = {"t": np.arange(u.size) * PERIOD_S, "theta_A_ref": u, "q": y, "S_true": np.full(u.size, np.nan)}
    file = tmp_path / f"data.{suffix}"
    file.write_bytes(export(columns))
    printed = identify(file, "--input", "theta_A_ref", "--output", "q", *CONTROLLER)
    assert printed["parameters"] == pytest.approx(FIRST, rel=5e-3)


def bad_tables() -> dict[str, tuple[dict[str, Array], str, dict[str, object]]]:
    u, y, _ = closed_loop_record(FIRST, 30.0, 17, samples=2000)
    t = np.arange(u.size, dtype=float) * PERIOD_S
    holed, late = y.copy(), t.copy()
    holed[300] = np.nan
    late[700:] += 0.05
    clipped = np.clip(y, *np.quantile(y, [0.2, 0.8]))
    return {
        "constant": ({"u": np.ones(u.size), "y": y}, "signal_is_constant", {"name": "u"}),
        "not finite": ({"u": u, "y": holed}, "samples_not_finite", {"name": "y", "first": 300}),
        "saturated": ({"u": u, "y": clipped}, "output_is_saturated", {}),
        "sample time": (
            {"t": 2.0 * t, "u": u, "y": y},
            "sample_time_differs",
            {"sample_time_s": pytest.approx(0.002)},
        ),
        "gap": ({"t": late, "u": u, "y": y}, "samples_missing", {"sample": 699}),
        "short": ({"u": u[:150], "y": y[:150]}, "record_too_short", {"length": 150, "minimum": 200}),
        "missing column": ({"u": u, "z": y}, "column_missing", {"name": "y"}),
    }


@pytest.mark.parametrize("what", bad_tables())
def test_invalid_records_exit_with_2_and_one_line(identify: Identify, tmp_path: Path, what: str) -> None:
    columns, code, values = bad_tables()[what]
    complaint = identify(write_csv(tmp_path / "bad.csv", **columns))
    assert complaint.has(code, values), complaint


@pytest.mark.parametrize(
    ("name", "content", "code", "values"),
    [
        ("words.csv", b"u,y\n1,2\n3,four\n", "not_a_number", {"name": "y", "cell": "four", "line": 3}),
        ("ragged.csv", b"u,y\n1,2\n3\n", "row_of_other_width", {"line": 3, "columns": 1}),
        ("naked.csv", b"1,2\n3,4\n", "first_line_holds_numbers", {}),
        ("empty.csv", b"", "no_heading", {}),
        ("latin.csv", b"u,y\n\xb5,1\n", "not_utf_8", {"file": "latin.csv"}),
        ("broken.mat", b"not a matlab file", "not_matlab", {}),
        ("matlab.mat", MATLAB_7_3 + HDF5, "matlab_of_version_7_3", {}),
        ("octave.mat", HDF5, "matlab_of_version_7_3", {}),
        ("broken.parquet", b"not a parquet file", "not_parquet", {}),
    ],
)
def test_invalid_files_exit_with_2_and_one_line(
    identify: Identify, tmp_path: Path, name: str, content: bytes, code: str, values: dict[str, object]
) -> None:
    (tmp_path / name).write_bytes(content)
    complaint = identify(tmp_path / name)
    assert complaint.has(code, values), complaint


def test_a_file_of_another_format_exits_with_2_and_one_line(identify: Identify, tmp_path: Path) -> None:
    (tmp_path / "data.xlsx").write_bytes(b"PK")
    complaint = identify(tmp_path / "data.xlsx")
    assert complaint.status == 2
    assert ".csv, .mat" in complaint.line


@pytest.mark.parametrize(
    ("words", "code", "values"),
    [
        (["--structure", "second"], "unknown_structure", {"name": "second"}),
        (["--period", "-1"], "sample_time_out_of_bounds", {"period_s": -1.0}),
        (["--setpoint", "r"], "column_missing", {"name": "r"}),
        (["--time", "y"], "time_is_a_signal", {"name": "y"}),
        (["--time-unit", "ms"], "time_unit_without_time", {}),
        (["--period", "nan"], "sample_time_out_of_bounds", {"period_s": pytest.approx(np.nan, nan_ok=True)}),
        (["--period", "inf"], "sample_time_out_of_bounds", {"period_s": np.inf}),
    ],
)
def test_invalid_arguments_exit_with_2_and_one_line(
    identify: Identify, tmp_path: Path, words: list[str], code: str, values: dict[str, object]
) -> None:
    u, y, _ = closed_loop_record(FIRST, 30.0, 18, samples=2000)
    complaint = identify(write_csv(tmp_path / "record.csv", u=u, y=y), *words)
    assert complaint.has(code, values), complaint


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--controller", "200"], "kp,ki"),
        (["--method", "guess"], "output_error"),
        (["--range", "5:2"], "--range"),
        (["--range", "nan:"], "--range"),
        (["--decimal", "dot"], "--decimal"),
    ],
)
def test_options_that_cannot_be_parsed_exit_with_2_and_one_line(
    identify: Identify, tmp_path: Path, words: list[str], expected: str
) -> None:
    u, y, _ = closed_loop_record(FIRST, 30.0, 18, samples=2000)
    complaint = identify(write_csv(tmp_path / "record.csv", u=u, y=y), *words)
    assert complaint.status == 2
    assert expected in complaint.line


def test_a_missing_file_is_named(identify: Identify, tmp_path: Path) -> None:
    complaint = identify(tmp_path / "nowhere.csv")
    assert complaint.status == 2
    assert "nowhere.csv" in complaint.line


def test_options_resolve_ambiguous_files(identify: Identify, tmp_path: Path) -> None:
    u, y, _ = closed_loop_record(FIRST, 40.0, 19, samples=4000)
    rows = "".join(f"{1000 * at};{a!r};{b!r}\n" for at, (a, b) in enumerate(zip(u.tolist(), y.tolist(), strict=True)))
    file = tmp_path / "log.csv"
    file.write_text("bench;4;a\nstamp;u;y\nof;the;card\n" + rows.replace(".", ","), encoding="utf-8")
    assert identify(file, *CONTROLLER).has("ambiguous_heading", {"lines": [2, 3]})
    printed = identify(
        file,
        *CONTROLLER,
        "--header",
        "2",
        "--decimal",
        "comma",
        "--time",
        "stamp",
        "--time-unit",
        "us",
        "--take",
        "3000",
    )
    read = printed["read"]
    assert (read["file"], read["time_column"], read["time_unit"]) == ("log.csv", "stamp", "us")
    assert (read["rows_in_file"], read["first_row"], read["last_row"], read["rows_used"]) == (4000, 1, 3000, 3000)
    assert read["columns"] == {"input": "u", "output": "y"}
    assert (read["sample_time_s"], read["sample_time_from"]) == (PERIOD_S, "--period")
    assert printed["parameters"] == pytest.approx(FIRST, rel=2e-2)


@pytest.mark.parametrize(("structure", "denominator"), [("first", [0.02, 1.0]), ("motor", [0.02, 1.0, 0.0])])
def test_the_printed_table_has_the_interpretation_of_the_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    structure: str,
    denominator: list[float],
) -> None:
    random = np.random.default_rng(0)
    u = np.repeat(random.choice([-3.0, -1.5, 1.5, 3.0], 60), 25)
    t = np.asarray(np.arange(u.size) * PERIOD_S, dtype=np.float64)
    y = lsim(([2.0], denominator), u, t, interp=False)[1] + 1e-4 * random.standard_normal(u.size)
    file = write_csv(tmp_path / "bench.csv", t=t, u=u, y=y, z=u)
    words = ["--input", "u", "--output", "y", "--structure", structure, "--skip", "100"]
    monkeypatch.setattr(sys, "argv", ["sinew", "identify", "data", str(file), *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    printed = " ".join(capsys.readouterr().out.split())
    for expected in ("bench.csv", "1400 of 1500, 101 to 1500", "t, unit s", "0.001 s", "z: not selected"):
        assert expected in printed


@pytest.mark.parametrize("name", ["data.mat", "data.parquet"])
def test_options_of_text_files_are_rejected_for_other_files(identify: Identify, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"")
    complaint = identify(tmp_path / name, "--header", "2")
    assert complaint.status == 2
    assert "--header" in complaint.line


# No messages of NumPy, SciPy or LAPACK on the terminal: the command line as a process, with both streams read.
#
# LAPACK writes directly to the streams of the process, so only these show it.

ArrayQuietly = np.ndarray[Any, np.dtype[np.float64]]
FOREIGN = ("Warning", "warn(", "numpy", "scipy", "DLASCL", "On entry", "Traceback", "site-packages", "nan", "NaN")


def identify_quietly(file: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run ``sinew identify data`` with columns u and y."""
    command = [
        str(Path(sys.executable).with_name("sinew")),
        "identify",
        "data",
        str(file),
        "--input",
        "u",
        "--output",
        "y",
    ]
    return subprocess.run([*command, *words], capture_output=True, text=True, timeout=300, check=False)


def foreign(ended: subprocess.CompletedProcess[str]) -> list[str]:
    return [word for word in FOREIGN if word in ended.stdout + ended.stderr]


def table(file: Path, heading: str, rows: list[str]) -> Path:
    file.write_text("\n".join([heading, *rows]) + "\n", encoding="utf-8")
    return file


def lagged() -> tuple[ArrayQuietly, ArrayQuietly]:
    """Return input and output of K = 2, T = 0.05 s at 10 ms, with noise."""
    random = np.random.default_rng(0)
    u = np.repeat(random.choice([-1.0, 1.0], 40), 20)
    y, decay = np.zeros(u.size), np.exp(-0.2)
    for k in range(1, u.size):
        y[k] = decay * y[k - 1] + 2.0 * (1.0 - decay) * u[k - 1]
    return u, y + 0.01 * random.standard_normal(u.size)


@pytest.mark.parametrize("offset", ["+01:00", "-0330", "+02", "Z"])
def test_times_with_an_offset_from_utc_are_read_without_a_warning(tmp_path: Path, offset: str) -> None:
    u, y = lagged()
    rows = [
        f"2026-03-04T10:{k // 6000:02d}:{k // 100 % 60:02d}.{k % 100:02d}0{offset},{u[k]},{y[k]:.6f}"
        for k in range(u.size)
    ]
    ended = identify_quietly(table(tmp_path / "stamped.csv", "time,u,y", rows), "--structure", "first", "--json")
    assert (ended.returncode, ended.stderr, foreign(ended)) == (0, "", [])
    found = json.loads(ended.stdout)
    assert abs(found["parameters"]["T"] - 0.05) < 4.0 * found["std_errors"]["T"]


def opaque(name: bytes, kind: bytes) -> bytes:
    """Return an element of a MATLAB file, version 5, of an object such as a table: no name, class 17, a reference."""

    def element(code: int, content: bytes) -> bytes:
        return struct.pack("<II", code, len(content)) + content + b"\0" * (-len(content) % 8)

    reference = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 2, 1)) + element(1, b"")
    reference += element(6, struct.pack("<II", 0xDD000000, 2))
    words = b"".join(element(1, word) for word in (name, b"MCOS", kind))
    return element(14, element(6, struct.pack("<II", 17, 0)) + words + element(14, reference))


def test_matlab_objects_are_rejected_with_their_class(tmp_path: Path) -> None:
    header = b"MATLAB 5.0 MAT-file".ljust(116) + b"\0" * 8 + struct.pack("<H", 0x0100) + b"IM"
    file = tmp_path / "objects.mat"
    file.write_bytes(header + opaque(b"T", b"table") + opaque(b"s", b"string"))
    ended = identify_quietly(file, "--structure", "first")
    assert (ended.returncode, ended.stdout, foreign(ended)) == (2, "", [])
    assert len(ended.stderr.strip().splitlines()) == 1
    assert "T (table), s (string)" in ended.stderr


@pytest.mark.parametrize(
    ("case", "structure"), [("twice", "first+delay"), ("ramp", "first"), ("rounded", "third"), ("step", "motor")]
)
def test_an_output_without_lag_yields_a_verdict_or_one_message(tmp_path: Path, case: str, structure: str) -> None:
    """If a sensitivity is zero, no NaN reaches LAPACK or the page."""
    u, y = without_lag()[case]
    rows = [f"{1e-3 * k:.3f},{u[k]:.6g},{y[k]:.6g}" for k in range(u.size)]
    ended = identify_quietly(table(tmp_path / "twice.csv", "t,u,y", rows), "--structure", structure)
    assert foreign(ended) == []
    assert (ended.returncode == 0 and "Not usable" in ended.stdout) or (
        ended.returncode == 2 and len(ended.stderr.strip().splitlines()) == 1
    )
