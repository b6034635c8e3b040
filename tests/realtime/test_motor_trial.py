"""A motor that is tried may turn either way: nothing closes a loop on it, however the trial ends."""

import asyncio
import math

import pytest

from backend.banks.builder import build_tuning_command
from backend.control import pid
from backend.control.motion_types import NO_REFERENCE, MotorLoopState
from backend.experiments.plans import LoopSettings
from backend.faults import Fault
from backend.realtime.commands import Accepted, Refused, SetMode, Stop, TryMotor
from backend.realtime.commissioning_motions import ModuleTrial, MotorTrial
from backend.realtime.gains import build_cascade_tuning
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.program import SetTuning
from backend.sample import INDEX
from backend.tuning.gains import collect_plant_knowledge
from plant.factory import make_plant
from plant.interface import Measurement, PlantChoice, PlantKind
from plant.parameters import load_parameters

PARAMETERS = load_parameters("ideal")


def tried(tuning: SetTuning) -> SimulatedLoop:
    """Return a loop on the virtual card in the middle of a trial of motor A."""
    loop = SimulatedLoop(make_plant(PlantChoice(PlantKind.VIRTUAL_CARD), PARAMETERS, 0), PARAMETERS, tuning)
    asyncio.run(loop.advance(0.01))
    assert isinstance(asyncio.run(loop.send(TryMotor("A"))), Accepted)
    asyncio.run(loop.advance(0.1))
    assert value(loop, "u_A") == pytest.approx(0.1, abs=0.01)
    return loop


def value(loop: SimulatedLoop, signal: str) -> float:
    newest = loop.ring.newest()
    assert newest is not None
    return float(newest[INDEX[signal]])


@pytest.mark.parametrize(
    ("command", "mode"),
    [
        (SetMode(Mode.STOPPING), Mode.OFF),
        (Stop(Fault.OPERATOR_LOST, hard=False), Mode.TRIPPED),
        (Stop(Fault.SERVICE_LOST, hard=False), Mode.TRIPPED),
        (Stop(), Mode.TRIPPED),
    ],
)
def test_a_trial_that_is_ended_goes_to_zero_volts_without_braking(
    tuning: SetTuning, command: SetMode | Stop, mode: Mode
) -> None:
    loop = tried(tuning)
    before = loop.ring.count
    asyncio.run(loop.send(command))
    asyncio.run(loop.advance(0.2))
    _, rows, _ = loop.ring.read(before, loop.ring.count - before)
    assert not rows[1:, INDEX["u_A"]].any()
    assert not rows[:, INDEX["u_B"]].any()
    assert (rows[1:, INDEX["mode"]] == MODE_CODE[mode]).all()
    loop.close()


def test_nothing_but_a_stop_is_granted_while_a_motor_is_tried(tuning: SetTuning) -> None:
    loop = tried(tuning)
    refused = asyncio.run(loop.send(SetMode(Mode.PRETENSION)))
    assert isinstance(refused, Refused)
    assert "a motor is being tried" in refused.reason
    loop.close()


def test_a_trial_that_proved_nothing_leaves_the_directions_unproven(tuning: SetTuning) -> None:
    loop = tried(tuning)
    asyncio.run(loop.send(SetMode(Mode.STOPPING)))
    asyncio.run(loop.advance(0.01))
    refused = asyncio.run(loop.send(SetMode(Mode.PRETENSION)))
    assert isinstance(refused, Refused)
    assert "directions are not proven" in refused.reason
    loop.close()


@pytest.mark.parametrize("silent", ["q", "theta_A", "theta_B", "F_A", "F_B"])
def test_a_reading_that_is_no_number_ends_the_way_out(silent: str) -> None:
    m = Measurement(0.0, 0.0, 0.0, 2.0, 2.0, math.nan, 0.0, 0.0)
    gains = build_cascade_tuning(
        build_tuning_command(PARAMETERS, LoopSettings(), None), collect_plant_knowledge(PARAMETERS)
    )
    carry = MotorLoopState(pid.at_rest_motor_pair(gains.motors, 0.0, 0.0, 0.0, 0.0), gains.motors, 0.0, 0.0)
    trial = MotorTrial(carry, NO_REFERENCE, m, "A")
    rising = [trial.step(gains, m).u_A for _ in range(50)]
    assert rising == sorted(rising)
    after = [trial.step(gains, m._replace(**{silent: math.nan})).u_A for _ in range(50)]
    assert max(after) <= rising[-1]


@pytest.mark.parametrize("silent", ["F_A", "F_B"])
def test_a_tension_that_is_no_number_ends_the_trial_of_the_safety_module(silent: str) -> None:
    m = Measurement(0.0, 0.0, 0.0, 10.0, 10.0, math.nan, 0.0, 1.0)
    gains = build_cascade_tuning(
        build_tuning_command(PARAMETERS, LoopSettings(), None), collect_plant_knowledge(PARAMETERS)
    )
    carry = MotorLoopState(pid.at_rest_motor_pair(gains.motors, 0.0, 0.0, 0.0, 0.0), gains.motors, 0.0, 0.0)
    trial = ModuleTrial(carry, NO_REFERENCE, m)
    trial.step(gains, m)
    assert not trial.done
    trial.step(gains, m._replace(**{silent: math.nan}))
    assert trial.done
