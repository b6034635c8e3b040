"""Rehearse in a fresh process, send every command to a loop, and print the functions compiled or loaded later."""

import dataclasses
import sys
from collections.abc import Sequence

from numba.core.dispatcher import Dispatcher

from backend.realtime.commands import (
    ApplyPush,
    Command,
    Home,
    Obstruct,
    ProveDirections,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    TryModule,
    TryMotor,
)
from backend.realtime.control_loop import Loop
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.process import warm_up
from backend.realtime.program import ConfigureContactDetection, Excitation, Law, Program, Segment, Shape
from backend.realtime.ring_buffer import Ring
from backend.tuning.gains import TuningParameters
from plant.dynamics import Obstacle
from plant.parameters import load_parameters
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from tests.commissioning.rigs import WIRING

SINE = Segment(0.02, q_ref=0.1, S_ref=10.0, F_push=1.0, shape=Shape.SINE, period_s=0.01)
PUSHED = Segment(0.1, q_ref=0.0, S_ref=10.0, F_push=6.0)
WALL = Obstacle(1.0, 0.2, 2e4, 1.0)
EXCITATION = Excitation(amplitude_rad=0.1, chip_s=0.002, levels="+-", periods=2)
RESTS = (Mode.OFF, Mode.RUN, Mode.COMPLIANCE, Mode.TRIPPED)


def specialised() -> set[tuple[str, str]]:
    """All compiled functions of the project with the argument types they are ready for."""
    return {
        (f"{name}.{function}", str(signature))
        for name, module in sys.modules.items()
        if name.partition(".")[0] in ("plant", "backend")
        for function, value in vars(module).items()
        if isinstance(value, Dispatcher)
        for signature in value.signatures
    }


def ask(loop: Loop, commands: Sequence[Command]) -> None:
    """Send the commands in order, each when the loop is at rest again."""
    for command in commands:
        loop.handle(0, command)
        refused = [event.reason for event in loop.drain_events() if isinstance(event, Refused)]
        assert not refused, refused
        for _ in range(30):
            loop.tick()
        for _ in range(40_000):
            if loop.mode in RESTS or loop.is_pretension_done:
                break
            loop.tick()
    loop.close()


def main() -> None:
    lab = load_parameters("lab")
    tuning = make_tuning_command(lab, TuningParameters())
    if "--unrehearsed" not in sys.argv:
        warm_up(lab, tuning)
    loop = Loop(Simulator(lab), lab, Ring.create(16), tuning)
    rig = VirtualRig(WIRING, Simulator(lab), None, WIRING, directions_proven=True, load_cells_measured=True)
    commissioned = Loop(rig, lab, Ring.create(16), tuning)
    before = specialised()
    ask(
        loop,
        (
            SetMode(Mode.PRETENSION),
            RunProgram(Program(Law.FORCE_HOLD, tension_N=12.0, settle_s=0.01, excitation=EXCITATION)),
            RunProgram(Program(Law.CASCADE, (SINE,))),
            RunProgram(Program(Law.COMPLIANCE, (SINE,))),
            RunProgram(Program(Law.CASCADE, (dataclasses.replace(SINE, wall=1),), walls=(WALL,))),
            SetMode(Mode.RUN),
            SetReferences(0.1, 11.0),
            dataclasses.replace(tuning, entries=tuning.entries * 2, interpolate=True),
            ApplyPush(2.0, 1.0),
            Obstruct(WALL),
            SetReferences(0.3, 11.0),
            Obstruct(None),
            SetMode(Mode.COMPLIANCE),
            ConfigureContactDetection(((10.0, 0.1),), 2.0),
            ApplyPush(6.0, 0.02),
            SetMode(Mode.PRETENSION),
            RunProgram(Program(Law.COMPLIANCE, (PUSHED,))),
            SetMode(Mode.RUN),
            ConfigureContactDetection((), 0.0),
            Stop(hard=False),
            Reset(),
        ),
    )
    ask(
        commissioned,
        (TryMotor("A"), ProveDirections(proven=True), Home(0.5), SetMode(Mode.PRETENSION), TryModule()),
    )
    for name, signature in sorted(specialised() - before):
        print(name, signature)


main()
