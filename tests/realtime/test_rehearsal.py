"""No function is compiled after the rehearsal, whatever the commands; failures of the rehearsal are reported."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.process import WarmUpError, warm_up
from backend.realtime.program import SetTuning
from backend.tuning.gains import LAM_MAX, TuningError, TuningParameters, make_single_loop_tuning
from plant.parameters import PlantParameters
from tests.refusals import refused

SESSION = Path(__file__).with_name("rehearsed_session.py")


def compiled_late(*arguments: str) -> list[str]:
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, str(SESSION), *arguments]
    return subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()


def test_nothing_is_compiled_after_the_rehearsal() -> None:
    assert compiled_late() == []


def test_without_rehearsal_functions_are_compiled_later() -> None:
    assert any("backend.control." in line for line in compiled_late("--unrehearsed"))


def test_a_tuning_that_fails_in_the_rehearsal_is_reported(ideal: PlantParameters, tuning: SetTuning) -> None:
    dead = dataclasses.replace(tuning.motor_A, k_p=0.0, k_i=0.0, k_d=0.0)
    with refused(WarmUpError, "rehearsal_without_pretension", mode=Mode.PRETENSION):
        warm_up(ideal, dataclasses.replace(tuning, motor_A=dead))


@pytest.mark.parametrize(("lam_q", "lam_S"), [(LAM_MAX, 0.5), (0.5, LAM_MAX), (LAM_MAX, LAM_MAX)])
def test_the_loop_starts_with_each_selectable_lambda(ideal: PlantParameters, lam_q: float, lam_S: float) -> None:
    """Also with values from 8 T_m on, which the single loop, also rehearsed, does not accept."""
    tuning = make_tuning_command(ideal, TuningParameters(lam_q=lam_q, lam_S=lam_S))
    warm_up(ideal, tuning)
    with pytest.raises(TuningError):
        make_single_loop_tuning(ideal, TuningParameters(lam_q=lam_q, lam_S=lam_S))
