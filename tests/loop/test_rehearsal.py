"""After the rehearsal nothing is compiled any more, whatever the loop is asked to do; what cannot work is told."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from backend.loop.commands import SetTuning
from backend.loop.rehearsal import RehearsalError, rehearse
from plant.parameters import PlantParameters

SESSION = Path(__file__).with_name("rehearsed_session.py")


def compiled_late(*arguments: str) -> list[str]:
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, str(SESSION), *arguments]
    return subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()


def test_nothing_is_compiled_after_the_rehearsal() -> None:
    assert compiled_late() == []


def test_without_rehearsal_something_would_be() -> None:
    assert any("tick" in line for line in compiled_late("--unrehearsed"))


def test_a_tuning_that_cannot_even_start_is_told(ideal: PlantParameters, tuning: SetTuning) -> None:
    dead = dataclasses.replace(tuning.motor_A, k_p=0.0, k_i=0.0, k_d=0.0)
    with pytest.raises(RehearsalError, match="pretension was not reached"):
        rehearse(ideal, dataclasses.replace(tuning, motor_A=dead))
