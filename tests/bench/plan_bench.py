"""Trajectory feed-forward versus the governor of the paper: step time versus motor limits, cost of a tick."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from statistics import median

import numpy as np
from rich.console import Console
from scipy.optimize import brentq

from backend.banks.builder import build_tuning_command
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import SetReferences
from backend.realtime.control_loop import Loop
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.preview import usual_budget
from backend.tuning.simulation import simulate_cascade
from plant.parameters import PlantParameters, load_parameters
from tests.bench.closed_loop_bench import HIGH, seconds
from tests.bench.table import Ratio, print_ratios
from tests.bench.tick_bench import loop_in_run, require_run

LAMBDAS = TuningParameters(lam_q=0.355, lam_S=0.345)
GOAL = 1.15
COMPILED_US, LIVE_US = 1.0, 5.0
TICKS, LIVE_TICKS, REPEATS = 20_000, 4_000, 25


def bench(console: Console) -> bool:
    """Print the measurements; return whether all bounds are met."""
    steps = [_step(name) for name in ("ideal", "lab", "lab-stick")]
    return print_ratios(console, "Plan: largest step and what a tick of it costs", [*steps, *_cost()])


def motors_bound_s(parameters: PlantParameters) -> float:
    """Return the least time [s] for 90 % of the largest step: full voltage, T θ'' + θ' = K u, no load."""
    known, g = parameters.identified, parameters.geometry
    V, T = known.K_m * parameters.motor.u_max, known.T_m
    way = 0.9 * 2.0 * HIGH * g.r_j / g.r_m
    return float(brentq(lambda t: V * (t + T * np.expm1(-t / T)) - way, 1e-3, 10.0))


def _step(name: str) -> Ratio:
    parameters = load_parameters(name)
    budget, bound_s = usual_budget(parameters), motors_bound_s(parameters)
    took = {u_plan: _to_90_percent_s(parameters, u_plan) for u_plan in (budget, 0.0)}
    detail = (
        f"{took[budget]:.3f} s with {budget:g} V, {took[0.0]:.3f} s as in the paper, the motors alone {bound_s:.3f} s"
    )
    return Ratio.at_most(f"{name}: step of 2π/3 to 90 % / bound of the motors", took[budget] / bound_s, GOAL, detail)


def _to_90_percent_s(parameters: PlantParameters, u_plan: float) -> float:
    tuning = make_cascade_tuning(parameters, LAMBDAS, u_plan=u_plan)
    trajectory = simulate_cascade(parameters, tuning, np.repeat([-HIGH, HIGH], (1000, 4000)), np.full(5000, 10.0))
    return float(np.argmax(trajectory.q[1000:] >= 0.8 * HIGH)) / 1000.0


def _cost() -> list[Ratio]:
    """Run two loops that differ only by the trajectory in turns, under the same conditions."""
    parameters = load_parameters("lab")
    with closing(loop_in_run(parameters)) as planned, closing(loop_in_run(parameters)) as governed:
        tuning = build_tuning_command(parameters, LoopSettings(), None)
        planned.handle(0, replace(tuning, u_plan=usual_budget(parameters)))
        compiled = more_us(planned, governed, drive_batches, TICKS, REPEATS)
        live = more_us(planned, governed, drive_ticks, LIVE_TICKS, REPEATS)
        require_run(planned)
        require_run(governed)
    return [
        Ratio.at_most("compiled tick: what the plan adds / 1 µs", compiled / COMPILED_US, 1.0, f"{compiled:.2f} µs"),
        Ratio.at_most("live tick: what the plan adds / 5 µs", live / LIVE_US, 1.0, f"{live:.2f} µs"),
    ]


def more_us(loop: Loop, without: Loop, drive: Callable[[Loop, int], None], ticks: int, repeats: int) -> float:
    """Return the median of the additional time per tick of ``loop`` relative to ``without`` [µs]."""
    more = []
    for k in range(repeats):
        for each in (loop, without):
            each.handle(0, SetReferences(HIGH if k % 2 else -HIGH, 14.0 if k % 4 < 2 else 9.0))
        more.append(seconds(partial(drive, loop, ticks)) - seconds(partial(drive, without, ticks)))
    return 1e6 * median(more[1:]) / ticks


def drive_batches(loop: Loop, ticks: int) -> None:
    """Execute ticks in batches, as a headless loop does."""
    while ticks > 0:
        ticks -= loop.run(min(1000, ticks))


def drive_ticks(loop: Loop, ticks: int) -> None:
    """Execute single ticks, as a loop with a clock does."""
    for _ in range(ticks):
        loop.tick()
