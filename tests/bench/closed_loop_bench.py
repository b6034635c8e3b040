"""Speed of the offline closed loop: relative to a C twin, to python-control, and over the cores."""

import math
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import TypeVar

import numpy as np
from rich.console import Console

from backend.tuning import simulation
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from plant.parameters import PlantParameters, load_parameters
from tests.bench import python_control
from tests.bench.batch import run_batch
from tests.bench.c_twin import CompilerMissingError, CTwin
from tests.bench.table import Ratio, print_ratios

_Result = TypeVar("_Result")

HIGH = np.pi / 3.0
REPEATS = 31
TICKS = 20_000
AGREEMENT = 1e-9
"""Largest difference to the C twin, in each column's SI unit: rounding, nothing else."""

PYTHON_CONTROL_TICKS = 1_000
PYTHON_CONTROL_AGREEMENT = 5e-3
"""Largest difference of q to python-control [rad]: the tolerance of its default solver, and continuous time."""

RUNS = 1000
RUN_TICKS = 8_000
BLOCKS = 10


class DisagreementError(AssertionError):
    """Two computations of the same closed loop differ, so that their times are not comparable."""


def bench(console: Console) -> bool:
    """Print the ratios of this part; return whether all bounds are met."""
    return print_ratios(console, "Offline closed loop", [*_against_c(), _against_python_control(), _over_cores()])


def timed(function: Callable[[], _Result]) -> tuple[float, _Result]:
    """Return the wall-clock time of one call [s] and its result."""
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


def seconds(function: Callable[[], object]) -> float:
    """Return the wall-clock time of one call [s]."""
    return timed(function)[0]


def steps(ticks: int) -> tuple[simulation.Array, simulation.Array]:
    """Return references (ticks,) of a position step and a stiffness step, at an eighth and at half of the time."""
    q_ref, S_ref = np.full(ticks, -HIGH), np.full(ticks, 10.0)
    q_ref[ticks // 8 :] = HIGH
    S_ref[ticks // 2 :] = 14.0
    return q_ref, S_ref


def _against_c() -> list[Ratio]:
    lines = []
    for flags in (("-O3",), ("-O3", "-march=native")):
        for name in ("ideal", "lab"):
            what = f"{name}: compiled Python / C twin, gcc {' '.join(flags)}"
            with tempfile.TemporaryDirectory() as folder:
                try:
                    twin = CTwin(Path(folder), flags)
                except CompilerMissingError as missing:
                    return [Ratio(what, math.nan, "at most 1.5", None, str(missing))]
                ratio, detail = _against_twin(twin, load_parameters(name))
            lines.append(Ratio.at_most(what, ratio, 1.5, detail))
    return lines


class BothWays:
    """The same run of TICKS by the compiled closed loop, into ``mine``, and by its C twin, into ``other``."""

    def __init__(self, twin: CTwin, parameters: PlantParameters) -> None:
        q_ref, S_ref = steps(TICKS)
        tuning = make_cascade_tuning(parameters, TuningParameters())
        rig = simulation.make_simulated_rig(parameters)
        x, controller = simulation.at_rest(rig, tuning, q_ref[0], S_ref[0])
        inputs = simulation.make_closed_loop_inputs(parameters, q_ref, S_ref)
        line, self.mine = simulation.empty_arrays(TICKS)
        self.other = np.empty_like(self.mine)
        self.in_python = partial(simulation.simulate, rig, tuning, x, controller, inputs, line, self.mine)
        self.in_c = partial(twin.simulate, rig, tuning, x, controller, inputs, self.other)


def _against_twin(twin: CTwin, parameters: PlantParameters) -> tuple[float, str]:
    run = BothWays(twin, parameters)
    in_python, in_c = run.in_python, run.in_c
    in_python()
    in_c()
    difference = float(np.max(np.abs(run.mine - run.other)))
    if not difference <= AGREEMENT:
        raise DisagreementError(f"C twin and compiled Python differ by {difference:g} on {parameters.name}")
    pairs = [(seconds(in_python), seconds(in_c)) for _ in range(REPEATS)]
    per_tick_us = 1e6 * median(python for python, _ in pairs) / TICKS
    detail = f"{per_tick_us:.2f} µs a tick; largest difference {difference:.1g}"
    return median(python / c for python, c in pairs), detail


def _against_python_control() -> Ratio:
    parameters = load_parameters("ideal")
    q_ref, S_ref = steps(PYTHON_CONTROL_TICKS)
    tuning = make_cascade_tuning(parameters, TuningParameters())
    rig = simulation.make_simulated_rig(parameters)
    run = partial(simulation.simulate_cascade, parameters, tuning, q_ref, S_ref)
    trajectory = run()
    system = python_control.closed_loop(rig, tuning)
    start = python_control.initial_state(*simulation.at_rest(rig, tuning, q_ref[0], S_ref[0]))
    t = 1e-3 * np.arange(PYTHON_CONTROL_TICKS, dtype=float)
    governed = np.array([trajectory.q_ref_gov, trajectory.S_ref_gov])
    q, _ = python_control.response(system, t, governed, start)
    difference = float(np.max(np.abs(q - trajectory.q)))
    if not difference <= PYTHON_CONTROL_AGREEMENT:
        raise DisagreementError(f"python-control and compiled Python differ by {difference:g} rad in q")
    theirs = median(seconds(partial(python_control.response, system, t, governed, start)) for _ in range(3))
    mine = median(seconds(run) for _ in range(REPEATS))
    detail = f"1 s simulated, set-up of the run included; largest difference in q {difference:.1g} rad"
    what = "ideal: python-control, input_output_response / compiled Python"
    return Ratio.at_least(what, theirs / mine, 20.0, detail)


def _over_cores() -> Ratio:
    parameters = load_parameters("lab")
    tuning = make_cascade_tuning(parameters, TuningParameters())
    q_ref, S_ref = steps(RUN_TICKS)

    def least_tension(seed: int) -> float:
        trajectory = simulation.simulate_cascade(parameters, tuning, q_ref, S_ref, seed=seed)
        return float(min(trajectory.F_A.min(), trajectory.F_B.min()))

    quotients = []
    for block in np.split(np.arange(RUNS), BLOCKS):
        runs = [partial(least_tension, int(seed)) for seed in block]
        one, on_one = timed(partial(run_batch, runs, workers=1))
        two, on_two = timed(partial(run_batch, runs, workers=2))
        if on_one != on_two:
            raise DisagreementError("the batch gives other results on two cores than on one")
        quotients.append(one / two)
    detail = f"{RUNS} runs of {RUN_TICKS / 1000:g} s, median over {BLOCKS} blocks; same results in the same order"
    return Ratio.at_least("lab: batch of runs, 1 core / 2 cores", median(quotients), 1.7, detail)
