"""Cost of the real nidaqmx client: a read and a write on the virtual card, a complete tick, and its lateness."""

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from backend.banks.builder import build_tuning_command
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import SetMode
from backend.realtime.control_loop import Loop
from backend.realtime.modes import Mode
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from plant.factory import make_plant
from plant.interface import SIMULATOR, MotorCommand, Plant, PlantChoice, PlantKind, T_s
from plant.parameters import load_parameters
from tests.bench.table import Ratio, print_ratios
from tests.soak.live_service import Loop as LiveLoop
from tests.soak.live_service import bench_on

VIRTUAL = PlantChoice(PlantKind.VIRTUAL_CARD)
TICKS, WARM = 5000, 500
WATCHED_S = 20.0
MAX_TICK_MS, MAX_LATENESS_RATIO = 0.1, 1.5


def bench(console: Console) -> bool:
    """Print the measurements; return whether all bounds are met."""
    cycle_s, bare_s = _cycle_s(VIRTUAL), _cycle_s(SIMULATOR)
    tick_s, bare_tick_s = _tick_s(VIRTUAL), _tick_s(SIMULATOR)
    run_s, bare_run_s = _tick_s(VIRTUAL, in_run=True), _tick_s(SIMULATOR, in_run=True)
    late_s, bare_late_s = _p99_lateness_s(("rig", "--virtual-card")), _p99_lateness_s(("simulator",))
    lines = [
        Ratio("read and write: virtual card / simulator", cycle_s / bare_s, detail=_microseconds(cycle_s, bare_s)),
        Ratio("whole tick: virtual card / simulator", tick_s / bare_tick_s, detail=_microseconds(tick_s, bare_tick_s)),
        Ratio(
            "whole tick in run: virtual card / simulator", run_s / bare_run_s, detail=_microseconds(run_s, bare_run_s)
        ),
        Ratio.at_most("whole tick with client calls, median / 0.1 ms", 1e3 * tick_s / MAX_TICK_MS, 1.0),
        Ratio.at_most(
            "lateness p99: virtual card / simulator",
            late_s / bare_late_s,
            MAX_LATENESS_RATIO,
            f"{_microseconds(late_s, bare_late_s)}, {WATCHED_S:g} s each, one after the other",
        ),
    ]
    return print_ratios(console, "Rig: the client of NI-DAQmx at the virtual card", lines)


def _cycle_s(choice: PlantChoice) -> float:
    plant = make_plant(choice, load_parameters("lab"), 0)
    plant.open()

    def cycle() -> None:
        plant.read()
        plant.write(MotorCommand(1.0, 1.0))

    try:
        return _median_s(cycle)
    finally:
        plant.close()


def _tick_s(choice: PlantChoice, *, in_run: bool = False) -> float:
    """Measure a tick with the motors off, or in mode Run."""
    parameters = load_parameters("lab")
    plant: Plant = make_plant(choice, parameters, 0)
    loop = Loop(plant, parameters, Ring.create(), build_tuning_command(parameters, LoopSettings(), None))
    try:
        if in_run:
            loop.handle(0, SetMode(Mode.PRETENSION))
            while not loop.is_pretension_done:
                loop.tick()
            loop.handle(0, SetMode(Mode.RUN))
        return _median_s(lambda: loop.tick())
    finally:
        loop.close()


def _median_s(step: Callable[[], object]) -> float:
    taken = []
    for _ in range(WARM + TICKS):
        begun = time.perf_counter()
        step()
        taken.append(time.perf_counter() - begun)
    return float(np.median(taken[WARM:]))


def _p99_lateness_s(plant: Sequence[str]) -> float:
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder), plant=plant) as live:
        loop = LiveLoop(live.service.pid)
        live.run()
        begun = loop.ring.count
        time.sleep(WATCHED_S)
        _, rows, _ = loop.ring.read(begun, round(WATCHED_S / T_s))
        loop.close()
    return float(np.percentile(rows[:, INDEX["lateness_s"]], 99.0))


def _microseconds(ours_s: float, theirs_s: float) -> str:
    return f"{1e6 * ours_s:.0f} µs against {1e6 * theirs_s:.0f} µs"
