"""What a tick costs: headless beside the C twin, in whole experiments on one core and on two, and live at 5 kHz."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from rich.console import Console

from backend.experiments.banks.bank_building import tuning_command
from backend.experiments.plans.loop_settings import LoopSettings
from backend.loop.commands import SetMode, SetReferences
from backend.loop.loop import Loop
from backend.loop.mode import Mode
from backend.loop.ring import Ring
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.bench.c_twin import CompilerMissingError, CTwin
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


def loop_in_run(parameters: PlantParameters) -> Loop:
    """Return a loop on a simulator that follows references, with tendons taut."""
    loop = Loop(Simulator(parameters), parameters, Ring.create(), tuning_command(parameters, LoopSettings(), None))
    loop.handle(0, SetMode(Mode.PRETENSION))
    while not loop.pretension_done:
        loop.tick()
    loop.handle(0, SetMode(Mode.RUN))
    return loop


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
        loop.close()
    tick_us = 1e6 * median(ours for ours, _ in whole) / TICKS
    detail = f"{tick_us:.2f} µs a tick in batches of 1 s, {1e6 * sliced:.2f} µs in those of 0.1 s"
    return [
        Ratio.at_most("headless tick / 5 µs", tick_us / MAX_TICK_US, 1.0, detail),
        Ratio("headless tick / tick of the C twin without checks and modes", median(a / b for a, b in whole)),
    ]


def _experiments() -> list[Ratio]:
    """Tracking through the whole station, evaluated and stored, without report."""
    alone = _runs_a_minute([0])
    both = _runs_a_minute([0, 1])
    what = "tracking experiments a minute, stored and evaluated"
    return [
        Ratio.at_least(f"{what}, on one core / 120", alone / RUNS_A_MINUTE, 1.0, f"{alone:.0f} a minute"),
        Ratio.at_least(f"{what}, two cores / one", both / alone, 1.7, f"{both:.0f} a minute"),
    ]


def _runs_a_minute(cores: Sequence[int]) -> float:
    """Let as many processes play as there are cores named, each kept on its own, at the same time."""
    command = [sys.executable, "-m", "tests.bench.experiment_runs", str(RUNS)]
    players = [
        subprocess.Popen([*command, str(core)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for core in cores
    ]
    for player in players:
        assert player.stdout is not None
        player.stdout.readline()  # ready: everything is loaded
    said = [_told(player) for player in _begun(players)]
    return sum(60.0 * RUNS / taken_s for taken_s in said)


def _begun(players: Sequence["subprocess.Popen[str]"]) -> Sequence["subprocess.Popen[str]"]:
    for player in players:
        assert player.stdin is not None
        player.stdin.close()
    return players


def _told(player: "subprocess.Popen[str]") -> float:
    assert player.stdout is not None
    said = float(player.stdout.read())
    if player.wait() != 0:
        raise RuntimeError("a process that played experiments has failed")
    return said


def _fast() -> list[Ratio]:
    """The loop in run at five times its rate, beside a bare C loop: each whole tick has 0.2 ms."""
    periods = round(FAST_WATCHED_S / FAST_PERIOD_S)
    gcc = shutil.which("gcc")
    if gcc is None:
        raise CompilerMissingError("gcc is not installed: apt-get install gcc, then run the bench again")
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / "pacing_twin"
        source = Path(__file__).with_name("pacing_twin.c")
        subprocess.run([gcc, "-std=gnu11", "-O3", "-Wall", "-Wextra", "-Werror", "-o", bare, source], check=True)
        theirs = [str(bare), str(periods), str(FAST_PRIORITY), str(round(1e9 * FAST_PERIOD_S))]
        ours = [sys.executable, "-m", "tests.bench.fast_loop", str(periods), str(FAST_PERIOD_S)]
        with subprocess.Popen(ours, stdout=subprocess.PIPE, text=True) as loop:
            assert loop.stdout is not None
            loop.stdout.readline()  # it ticks now
            bare_ns = subprocess.run(theirs, capture_output=True, text=True, check=True).stdout
            lateness_us, missed, busy = map(float, loop.stdout.read().split())
    bare_us = 1e-3 * float(np.percentile([float(line) for line in bare_ns.split()], 99.0))
    detail = f"p99 {lateness_us:.0f} µs against {bare_us:.0f} µs, side by side for {FAST_WATCHED_S:g} s"
    return [
        Ratio.at_most("at 5 kHz: lateness, loop / bare C loop", lateness_us / bare_us, MAX_FAST_LATENESS_RATIO, detail),
        Ratio.at_most("at 5 kHz: processor time / period", busy, 0.5, f"{1e6 * busy * FAST_PERIOD_S:.0f} µs a tick"),
        Ratio("at 5 kHz: deadlines missed", missed / periods, detail=f"{missed:.0f} of {periods}"),
    ]
