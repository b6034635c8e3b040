"""Equation 17 from any record of voltage and angle: right within its errors, or it says what is wrong."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from backend.cli import main
from backend.identification.errors import RecordError
from backend.identification.motor_record import MotorRecord, identify_motor_record
from backend.identification.record import Record
from backend.identification.result import Grade
from tests.identification.own_motor import K_M, PERIOD_S, T_M, motor, voltages

COUNT_RAD = 2.0 * np.pi / 8000


def worst_error(found: MotorRecord, u_c: float) -> float:
    """Largest error of K_m, T_m and u_c in standard errors; of a u_c that was left out, none."""
    values = zip((found.K_m, found.T_m, found.u_c), (K_M, T_M, u_c), found.std_errors, strict=True)
    return max(abs(value - truth) / std for value, truth, std in values if std > 0.0)


def angles(u: np.ndarray, u_c: float, delay_s: float = 0.0) -> np.ndarray:
    noise = 0.5 * COUNT_RAD * np.random.default_rng(4).standard_normal(u.size)
    return COUNT_RAD * np.round((motor(u, u_c, delay_s)[1] + noise) / COUNT_RAD)


@pytest.mark.parametrize("u_c", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("kind", ["binary", "levels", "sines"])
def test_gain_lag_and_friction_come_back_from_voltage_and_angle(kind: str, u_c: float) -> None:
    u = voltages(kind)
    found = identify_motor_record(Record(PERIOD_S, u, angles(u, u_c)), COUNT_RAD)
    assert worst_error(found, u_c) < 4.0
    assert (found.u_c > 0.0) is (u_c > 0.0)
    assert found.verdict.grade is Grade.USABLE
    assert ("dry friction takes" in found.verdict.sentence) is (u_c > 0.0)


def test_a_dead_time_is_not_usable_without_a_word() -> None:
    u = voltages("binary")
    found = identify_motor_record(Record(PERIOD_S, u, angles(u, 0.0, delay_s=0.05)), COUNT_RAD)
    assert found.verdict.grade is not Grade.USABLE
    assert "not white" in found.verdict.sentence


def test_an_angle_that_hardly_moves_is_refused() -> None:
    u = 0.0002 * voltages("binary")
    with pytest.raises(RecordError, match=r"motion is .* counts"):
        identify_motor_record(Record(PERIOD_S, u, angles(u, 0.0)), COUNT_RAD)


def test_the_command_line_identifies_a_motor_from_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    u = voltages("levels")
    table = np.column_stack((1e3 * PERIOD_S * np.arange(u.size), u, angles(u, 0.3)))
    np.savetxt(tmp_path / "motor.csv", table, delimiter=",", header="t_ms,u,theta", comments="", fmt="%.9g")
    words = ["--input", "u", "--output", "theta", "--structure", "motor", "--resolution", repr(COUNT_RAD)]
    monkeypatch.setattr(sys, "argv", ["sinew", "identify", "data", str(tmp_path / "motor.csv"), *words, "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    for name, truth in (("K_m", K_M), ("T_m", T_M), ("u_c", 0.3)):
        assert abs(printed["parameters"][name] - truth) < 4.0 * printed["std_errors"][name]
    assert printed["grade"] == "usable"
