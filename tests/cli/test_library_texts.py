"""No words of NumPy, SciPy or LAPACK on the terminal: the command line as a process, both of its streams read.

LAPACK writes past Python's streams, so only those of the process show it.
"""

import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.identification.record_generator import without_lag

Array = np.ndarray[Any, np.dtype[np.float64]]
FOREIGN = ("Warning", "warn(", "numpy", "scipy", "DLASCL", "On entry", "Traceback", "site-packages", "nan", "NaN")


def identify(file: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """``sinew identify data`` with columns u and y."""
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


def lagged() -> tuple[Array, Array]:
    """Input and output of K = 2, T = 0.05 s at 10 ms, with noise."""
    random = np.random.default_rng(0)
    u = np.repeat(random.choice([-1.0, 1.0], 40), 20)
    y, decay = np.zeros(u.size), np.exp(-0.2)
    for k in range(1, u.size):
        y[k] = decay * y[k - 1] + 2.0 * (1.0 - decay) * u[k - 1]
    return u, y + 0.01 * random.standard_normal(u.size)


@pytest.mark.parametrize("offset", ["+01:00", "-0330", "+02", "Z"])
def test_times_with_an_offset_from_utc_are_read_without_a_word(tmp_path: Path, offset: str) -> None:
    u, y = lagged()
    rows = [
        f"2026-03-04T10:{k // 6000:02d}:{k // 100 % 60:02d}.{k % 100:02d}0{offset},{u[k]},{y[k]:.6f}"
        for k in range(u.size)
    ]
    ended = identify(table(tmp_path / "stamped.csv", "time,u,y", rows), "--structure", "first", "--json")
    assert (ended.returncode, ended.stderr, foreign(ended)) == (0, "", [])
    found = json.loads(ended.stdout)
    assert abs(found["parameters"]["T"] - 0.05) < 4.0 * found["std_errors"]["T"]


def opaque(name: bytes, kind: bytes) -> bytes:
    """Element of a MATLAB file, version 5, of an object as a table is one: no name, class 17, a reference."""

    def element(code: int, content: bytes) -> bytes:
        return struct.pack("<II", code, len(content)) + content + b"\0" * (-len(content) % 8)

    reference = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 2, 1)) + element(1, b"")
    reference += element(6, struct.pack("<II", 0xDD000000, 2))
    words = b"".join(element(1, word) for word in (name, b"MCOS", kind))
    return element(14, element(6, struct.pack("<II", 17, 0)) + words + element(14, reference))


def test_a_file_of_matlab_objects_is_refused_by_their_class(tmp_path: Path) -> None:
    header = b"MATLAB 5.0 MAT-file".ljust(116) + b"\0" * 8 + struct.pack("<H", 0x0100) + b"IM"
    file = tmp_path / "objects.mat"
    file.write_bytes(header + opaque(b"T", b"table") + opaque(b"s", b"string"))
    ended = identify(file, "--structure", "first")
    assert (ended.returncode, ended.stdout, foreign(ended)) == (2, "", [])
    assert len(ended.stderr.strip().splitlines()) == 1
    assert "T (table), s (string)" in ended.stderr


@pytest.mark.parametrize(
    ("case", "structure"), [("twice", "first+delay"), ("ramp", "first"), ("rounded", "third"), ("step", "motor")]
)
def test_an_output_without_lag_ends_in_a_verdict(tmp_path: Path, case: str, structure: str) -> None:
    """Where a sensitivity is zero, no number that is not one reaches LAPACK or the page."""
    u, y = without_lag()[case]
    rows = [f"{1e-3 * k:.3f},{u[k]:.6g},{y[k]:.6g}" for k in range(u.size)]
    ended = identify(table(tmp_path / "twice.csv", "t,u,y", rows), "--structure", structure)
    assert foreign(ended) == []
    assert (ended.returncode == 0 and "Not usable" in ended.stdout) or (
        ended.returncode == 2 and len(ended.stderr.strip().splitlines()) == 1
    )
