"""After the rehearsal nothing is compiled any more, whatever the loop is asked to do; what cannot work is told."""

import dataclasses

import pytest
from numba.core.event import install_recorder

from backend.loop.commands import Push, Reset, RunProgram, SetMode, SetReferences, SetTuning, Stop
from backend.loop.loop import Loop
from backend.loop.mode import Mode
from backend.loop.program import Excitation, Law, Program, Segment, Shape
from backend.loop.rehearsal import RehearsalError, rehearse
from backend.loop.ring import Ring
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator


def test_nothing_is_compiled_after_the_rehearsal(tuning: SetTuning) -> None:
    lab = load_parameters("lab")
    rehearse(lab, tuning)
    ring = Ring.create(16)
    loop = Loop(Simulator(lab), lab, ring, tuning)
    sine = Segment(0.02, q_ref=0.1, S_ref=10.0, F_push=1.0, shape=Shape.SINE, period_s=0.01)
    excitation = Excitation(amplitude_rad=0.1, chip_s=0.002, levels="+-", periods=2)
    with install_recorder("numba:compile") as compiled:
        for command in (
            SetMode(Mode.PRETENSION),
            RunProgram(Program(Law.FORCE_HOLD, tension_N=12.0, settle_s=0.01, excitation=excitation)),
            RunProgram(Program(Law.CASCADE, (sine,))),
            RunProgram(Program(Law.COMPLIANCE, (sine,))),
            SetMode(Mode.RUN),
            SetReferences(0.1, 11.0),
            dataclasses.replace(tuning, entries=tuning.entries * 2, interpolate=True),
            Push(2.0),
            SetMode(Mode.COMPLIANCE),
            Stop(hard=False),
            Reset(),
        ):
            loop.handle(0, command)
            for _ in range(30):
                loop.tick()
            for _ in range(20_000):
                if loop.mode in (Mode.OFF, Mode.RUN, Mode.COMPLIANCE, Mode.TRIPPED) or loop.pretension_done:
                    break
                loop.tick()
    loop.close()
    ring.close()
    assert compiled.buffer == []


def test_a_tuning_that_cannot_even_start_is_told(ideal: PlantParameters, tuning: SetTuning) -> None:
    dead = dataclasses.replace(tuning.motor_A, k_p=0.0, k_i=0.0, k_d=0.0)
    with pytest.raises(RehearsalError, match="pretension was not reached"):
        rehearse(ideal, dataclasses.replace(tuning, motor_A=dead))
