"""A recording that was looked over is not read a second time in the same process, unless the file has changed."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plant import replay
from plant.replay import load_replay, preload_replay
from tests.exports.written import to_csv

COLUMNS = {name: np.zeros(20) for name in ("q", "theta_A", "theta_B", "F_A", "F_B", "u_A", "u_B")}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    found = tmp_path / "run.csv"
    found.write_bytes(to_csv({"t": np.arange(20.0) / 1000.0, **COLUMNS}))
    return found


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    found: list[Path] = []
    read = replay._read_table

    def counted(path: Path) -> Any:
        found.append(path)
        return read(path)

    monkeypatch.setattr(replay, "_read_table", counted)
    return found


def test_what_was_looked_over_is_handed_on_once(file: Path, reads: list[Path]) -> None:
    preload_replay(file)
    assert len(load_replay(str(file))) == 20
    assert len(reads) == 1
    load_replay(file)
    assert len(reads) == 2


def test_a_file_that_has_changed_since_is_read_anew(file: Path, reads: list[Path]) -> None:
    preload_replay(file)
    os.utime(file, ns=(1, 1))
    load_replay(file)
    assert len(reads) == 2
