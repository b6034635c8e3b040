"""A session on the simulator as a recording that Sinew exports, and the same session on whatever plant is given."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from backend.realtime.commands import Accepted, Inject, SetMode, SetReferences
from backend.realtime.modes import Mode
from backend.recording.reader import Columns
from backend.sample import INDEX, NAMES
from plant.interface import InjectedFault, InjectedFaultKind, Plant, Sensor
from plant.parameters import PlantParameters
from plant.simulator import Simulator
from tests.exports.written import to_csv
from tests.realtime.bench_top import BenchTop

JUMP = InjectedFault(InjectedFaultKind.JUMP, Sensor.F_B)


def session(parameters: PlantParameters, plant: Plant, breaks: Callable[[BenchTop], None] = lambda _: None) -> BenchTop:
    """From rest to a step of the joint; ``breaks`` may do what it wants 0.15 s after the step."""
    bench = BenchTop(parameters, plant=plant)
    assert isinstance(bench.send(SetMode(Mode.PRETENSION)), Accepted)
    bench.advance(10.0)
    assert isinstance(bench.send(SetMode(Mode.RUN, 1)), Accepted)
    bench.advance(0.2)
    bench.send(SetReferences(0.9, 11.0))
    bench.advance(0.15)
    breaks(bench)
    bench.advance(0.3)
    return bench


def columns_of(bench: BenchTop) -> Columns:
    rows = np.array(bench.samples.rows)
    return {name: rows[:, INDEX[name]] for name in NAMES}


def _jump(bench: BenchTop) -> None:
    bench.send(Inject(JUMP))


def trip_recorded(parameters: PlantParameters, file: Path, seed: int = 0) -> BenchTop:
    """Record the session with a load cell that jumps."""
    bench = session(parameters, Simulator(parameters, seed), _jump)
    file.write_bytes(to_csv(columns_of(bench)))
    return bench
