"""Statements of README, ARCHITECTURE, documents and docstrings about the code, compared with the code."""

import inspect
import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from backend import main
from backend.auth import control_lease
from backend.control import compute_bounds, fault_detection, motion_primitives, motion_types
from backend.control.step import STEP_FUNCTIONS, Resting
from backend.experiments.plans import ActuatorIdentificationPlan
from backend.realtime import commands, control_loop, heartbeat, process, supervisor, timing  # noqa: F401  # with what it plays
from backend.realtime.motions import PythonMotion
from backend.recording import flight
from backend.schemas.state import TimingView
from plant import safety_card
from plant.interface import PlantKind, T_s
from plant.parameters import load_parameters
from plant.simulator import Simulator
from tests.docs.faults_page import PAGE as FAULTS

ROOT = Path(__file__).parents[2]
README, ARCHITECTURE = (
    " ".join((ROOT / name).read_text(encoding="utf-8").split()) for name in ("README.md", "ARCHITECTURE.md")
)
PARAMETERS = load_parameters("lab")
ENVELOPE = compute_bounds(PARAMETERS).envelope


def decision_page(number: str) -> str:
    (page,) = (ROOT / "docs" / "decisions").glob(f"{number}-*.md")
    return " ".join(page.read_text(encoding="utf-8").split())


def docstring_of(documented: object) -> str:
    return " ".join((inspect.getdoc(documented) or "").split())


@pytest.mark.parametrize(
    "statement",
    [
        f"brakes the joint under tension for {motion_primitives.SOFT_STOP_S:g} s",
        f"received no message from the service for {process.SILENCE_S:g} s",
        f"F_max ({PARAMETERS.safety.F_max:g} N)",
        f"stayed below 1 N for more than {fault_detection.SLACK_MAX_S:g} s",
        f"For {fault_detection.CONTRADICTION_S:g} s a load cell",
        f"differed by more than {fault_detection.CONTRADICTION_N:g} N",
        f"by even one count for {fault_detection.UNMOVED_S:g} s",
        f"longest time allowed: {Simulator.unattended_max_s:g} s on the simulator",
        f"sent no heartbeat for {control_lease.LOST_S:g} s",
        f"held for {control_lease.HOLD_S:g} s more",
        f"not written for {safety_card.WATCHDOG_S:g} s",
        f"would have fallen below {ENVELOPE.F_floor:g} N",
        f"would have exceeded {ENVELOPE.F_ceiling:g} N",
        f"would have exceeded {math.degrees(ENVELOPE.q_max):.1f}° to either side",
    ],
)
def test_times_and_bounds_of_the_faults_equal_those_of_the_code(statement: str) -> None:
    assert statement in " ".join(FAULTS.split())


def test_all_texts_state_the_same_heartbeat_timeouts() -> None:
    told = f"{process.SILENCE_S:g} s"
    assert f"receives no heartbeat for {told}" in decision_page("0001")
    assert f"{told} without a heartbeat" in supervisor._HEARTBEAT_PART.consequence
    longest_s = heartbeat.STALE_S + heartbeat.HEARTBEAT_S + process.SILENCE_S + motion_primitives.SOFT_STOP_S
    assert f"within {longest_s:.0f} s" in supervisor._LIVENESS_PART.consequence
    # Comments and docstrings name the constant, because no test would check a number there.
    for module in (main, heartbeat):
        assert not re.search(r"nothing for 0\.\d+ s|heartbeat every 0\.\d+ s", inspect.getsource(module)), module


def test_docstrings_agree_with_the_code() -> None:
    assert "returns to PRETENSION when it has ended" in docstring_of(commands.RunProgram)
    assert set(re.findall(r"``(\w+)``", docstring_of(motion_types.ControlOutput))) <= set(
        motion_types.ControlOutput._fields
    )
    window = f"the last {timing.WINDOW_TICKS * T_s:g} s"
    for name in ("rate_Hz", "lateness_p50_ms", "lateness_p99_ms"):
        assert window in (TimingView.model_fields[name].description or ""), name


def test_readme_names_the_kinds_of_plants_before_the_first_picture() -> None:
    first = README.split("![", 1)[0]
    assert {kind for kind in PlantKind if kind.replace("_", " ") in first} >= {
        PlantKind.SIMULATOR,
        PlantKind.RIG,
        PlantKind.VIRTUAL_CARD,
    }


def test_figures_in_the_readme_equal_those_of_the_code() -> None:
    assert f"until the tendon forces are {motion_primitives.PRETENSION_N:g} N" in README
    excitation_s = ActuatorIdentificationPlan().program().duration_s
    assert 25.0 < excitation_s < 35.0
    assert "for half a minute" in README


def test_signals_are_defined_in_the_file_that_the_architecture_names() -> None:
    assert "`FIELDS` of `backend/sample.py`" in ARCHITECTURE
    assert "`write_row` of `backend/control/step.py`" in ARCHITECTURE


def test_motions_are_in_the_files_that_the_architecture_names() -> None:
    compiled = {step.__module__ for kind, step in STEP_FUNCTIONS.items() if kind is not Resting}
    sentence = re.search(r"Each mode has a motion: a state and a pure step \((.*?)\)", ARCHITECTURE)
    assert sentence is not None
    assert set(re.findall(r"`(\w+)\.py`", sentence[1])) == {name.rpartition(".")[2] for name in compiled}
    interpreted = {found.__module__ for found in _interpreted(PythonMotion)} - {PythonMotion.__module__}
    sentence = re.search(r"The interpreter executes the motions of commissioning \((.*?)\)", ARCHITECTURE)
    assert sentence is not None
    assert set(re.findall(r"`(\w+)\.py`", sentence[1])) == {name.rpartition(".")[2] for name in interpreted}


def _interpreted(kind: type[PythonMotion]) -> Iterator[type[PythonMotion]]:
    for found in kind.__subclasses__():
        yield found
        yield from _interpreted(found)


def test_layers_in_the_architecture_equal_the_import_contract() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = [line for line in contracts[0]["layers"] if line != "__main__"] + ["plant"]
    drawn = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").split("do not import each other.\n\n", 1)[1]
    assert [line.strip() for line in drawn.split("\n\n", 1)[0].splitlines()] == layers


def test_files_that_the_architecture_names_exist() -> None:
    places = ("", "backend", "backend/realtime", "backend/control", "backend/experiments", "tests")
    for name in re.findall(r"`((?:\w+/)*\w+\.(?:py|toml))`", ARCHITECTURE):
        assert any((ROOT / place / name).is_file() for place in places), name


@pytest.mark.parametrize(
    "statement",
    [
        f"{flight.BEFORE_S:g} s before and {flight.AFTER_S:g} s after at 1 kHz",
        f"without a heartbeat for {control_lease.LOST_S:g} s the page is lost; after {control_lease.HOLD_S:g} s more",
    ],
)
def test_times_in_the_architecture_equal_those_of_the_code(statement: str) -> None:
    assert statement in ARCHITECTURE
