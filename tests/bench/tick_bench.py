"""What a tick costs: headless beside the C twin, in whole experiments on one core and on two, and live at 5 kHz."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import IO

import numpy as np
from rich.console import Console

from backend.banks.builder import build_tuning_command
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import SetMode, SetReferences
from backend.realtime.control_loop import Loop
from backend.realtime.modes import Mode
from backend.realtime.ring_buffer import Ring
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.bench.c_twin import CTwin, PacingTwin
from tests.bench.closed_loop_bench import HIGH, TICKS, BothWays, seconds
from tests.bench.table import Ratio, print_ratios

REPEATS = 15
MAX_TICK_US = 5.0
RUNS, RUNS_A_MINUTE = 8, 120.0
FAST_PERIOD_S, FAST_WATCHED_S, FAST_PRIORITY = 2e-4, 20.0, 60
MAX_FAST_LATENESS_RATIO = 1.5


def bench(console: Console) -> bool:
    """Print what was measured; whether all bounds are met."""
    lines = [*_headless(), *_experiments(), *_fast()]
    return print_ratios(console, "Tick: checks, modes, laws and simulator", lines)


def loop_in_run(parameters: PlantParameters, ring: Ring | None = None) -> Loop:
    """Return a loop on a simulator that follows references, with tendons taut."""
    ring, tuning = ring or Ring.create(), build_tuning_command(parameters, LoopSettings(), None)
    loop = Loop(Simulator(parameters), parameters, ring, tuning)
    loop.handle(0, SetMode(Mode.PRETENSION))
    while not loop.is_pretension_done:
        loop.tick()
    loop.handle(0, SetMode(Mode.RUN))
    return loop


def require_run(loop: Loop) -> None:
    """Raise if the loop has tripped, because its ticks would do less."""
    if loop.mode != Mode.RUN:
        raise RuntimeError(f"the loop was to be in run until the end, and is in {loop.mode.name.lower()}")


def _headless() -> list[Ratio]:
    parameters = load_parameters("lab")
    with tempfile.TemporaryDirectory() as folder:
        twin = CTwin(Path(folder), ("-O3",))
        loop, twin_run = loop_in_run(parameters), BothWays(twin, parameters).in_c
        sides = iter([HIGH, -HIGH] * REPEATS)

        def batches(ticks: int) -> None:
            loop.handle(0, SetReferences(next(sides), 12.0))
            left = TICKS
            while left > 0:
                left -= loop.run(min(ticks, left))

        batches(1000)
        twin_run()
        whole = [(seconds(partial(batches, 1000)), seconds(twin_run)) for _ in range(REPEATS)]
        sliced = median(seconds(partial(batches, 100)) for _ in range(REPEATS // 2)) / TICKS
        require_run(loop)
        loop.close()
    tick_us = 1e6 * median(ours for ours, _ in whole) / TICKS
    detail = f"{tick_us:.2f} µs a tick in batches of 1 s, {1e6 * sliced:.2f} µs in those of 0.1 s"
    return [
        Ratio.at_most("headless tick / 5 µs", tick_us / MAX_TICK_US, 1.0, detail),
        Ratio("headless tick / tick of the C twin without checks and modes", median(a / b for a, b in whole)),
    ]


def _experiments() -> list[Ratio]:
    """Execute tracking on the complete station, evaluated and stored, without a report."""
    alone = _runs_a_minute([0])
    both = _runs_a_minute([0, 1])
    what = "tracking experiments a minute, stored and evaluated"
    return [
        Ratio.at_least(f"{what}, on one core / 120", alone / RUNS_A_MINUTE, 1.0, f"{alone:.0f} a minute"),
        Ratio.at_least(f"{what}, two cores / one", both / alone, 1.7, f"{both:.0f} a minute"),
    ]


def _runs_a_minute(cores: Sequence[int]) -> float:
    """Execute runs in one process per named core, pinned to it, simultaneously."""
    with ExitStack() as stack:
        players = [stack.enter_context(_ready("experiment_runs", str(RUNS), str(core))) for core in cores]
        for player in players:
            _input(player).close()
        return sum(60.0 * RUNS / _told(player)[0] for player in players)


@contextmanager
def _ready(module: str, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """Start a module of the benchmark; wait until it prints "ready"."""
    command = [sys.executable, "-m", f"tests.bench.{module}", *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            if _output(process).readline() != "ready\n":
                raise RuntimeError(f"{module} was to get ready, and has ended: exit code {process.wait()}")
            yield process
        finally:
            process.kill()


def _told(process: "subprocess.Popen[str]") -> list[float]:
    said = _output(process).read()
    if process.wait() != 0:
        raise RuntimeError(f"{process.args!r} has failed: exit code {process.returncode}")
    return [float(word) for word in said.split()]


def _input(process: "subprocess.Popen[str]") -> IO[str]:
    assert process.stdin is not None
    return process.stdin


def _output(process: "subprocess.Popen[str]") -> IO[str]:
    assert process.stdout is not None
    return process.stdout


def _fast() -> list[Ratio]:
    """Run the loop at five times its rate next to a C loop: each tick has 0.2 ms."""
    periods = round(FAST_WATCHED_S / FAST_PERIOD_S)
    with tempfile.TemporaryDirectory() as folder:
        twin = PacingTwin(Path(folder))
        with _ready("fast_loop", str(periods), str(FAST_PERIOD_S)) as loop:
            bare_us = float(np.percentile(twin.lateness_us(periods, FAST_PRIORITY, FAST_PERIOD_S), 99.0))
            lateness_us, missed, busy = _told(loop)
    detail = f"p99 {lateness_us:.0f} µs against {bare_us:.0f} µs, side by side for {FAST_WATCHED_S:g} s"
    return [
        Ratio.at_most("at 5 kHz: lateness, loop / bare C loop", lateness_us / bare_us, MAX_FAST_LATENESS_RATIO, detail),
        Ratio.at_most("at 5 kHz: processor time / period", busy, 0.5, f"{1e6 * busy * FAST_PERIOD_S:.0f} µs a tick"),
        Ratio("at 5 kHz: deadlines missed", missed / periods, detail=f"{missed:.0f} of {periods}"),
    ]
