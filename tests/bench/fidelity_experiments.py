"""The paper's two experiments, figures 7 and 8, on the simulated rig: the last tables of docs/fidelity.md."""

import asyncio
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from backend.experiments.plans.composed_plan import ComposedPlan
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.stored_plan import ready_plan
from backend.experiments.playing.headless_station import headless_station
from backend.experiments.playing.runner import Order, run_experiment
from backend.experiments.results.compliance import compliance_figures
from backend.experiments.results.metrics import Overall, tracking_metrics
from backend.experiments.results.robustness import robustness_figures
from backend.experiments.results.windows import load_steps
from backend.recording.columns import Columns, recorded_columns
from backend.storage import open_database
from plant.interface import T_s
from plant.parameters import PlantParameters
from tests.experiments.judging import LEAD_IN_S

PAPER_RMSE_N = 2.239
_SMOOTHED = 20
"""Ticks over which the expected force is averaged before its rate is taken: encoder counts are no pushes."""


def played(parameters: PlantParameters, plan: ComposedPlan) -> Columns:
    """Play an experiment headless with the default tuning and seed 0; its recorded columns."""
    with tempfile.TemporaryDirectory() as folder:
        database = open_database(Path(folder))
        with headless_station(database, parameters, LoopSettings()) as station:
            outcome = asyncio.run(run_experiment(station, Order(plan, LoopSettings(), "bench")))
            columns, _ = recorded_columns(database, outcome.run.id)
        database.close()
    return columns


def figure_7_rows(parameters: PlantParameters) -> Iterator[list[str]]:
    plan = ready_plan("tracking")
    metrics = tracking_metrics(
        played(parameters, plan), plan.program(), plan.phases(), q_count=parameters.sensors.joint_step
    )
    all_of: Overall = metrics.overall
    settled = max(item.settling_s or np.inf for item in metrics.steps if item.step.signal == "S" and item.step.alone)
    yield [
        "position follows steps between ±π/3 without overshoot",
        f"largest overshoot {all_of.overshoot_q_percent:.2f} %, 90 % of 2π/3 after {all_of.reach_q_s:.2f} s",
    ]
    yield [
        "stiffness follows pulses between 8 and 14 without overshoot",
        f"largest overshoot {all_of.overshoot_S_percent:.2f} %, settled after {settled:.2f} s",
    ]
    yield [
        "no coupling between the two",
        f"S deviates by {all_of.deviation_S:.3f} N·m/rad under q steps, "
        f"q by {all_of.deviation_q:.4f} rad under S steps",
    ]
    yield ["tendons stay under tension", f"{all_of.min_tension_N:.1f} to {all_of.max_tension_N:.1f} N"]


def figure_8_rows(parameters: PlantParameters) -> Iterator[list[str]]:
    prompt = replace(parameters, sensors=replace(parameters.sensors, force_delay=0.0))
    alike = replace(parameters, asymmetry=replace(parameters.asymmetry, spring_A=1.0, spring_B=1.0))
    yield ["paper", f"{PAPER_RMSE_N:.3f}", "", "", ""]
    yield pushed_row("hand, as shipped", parameters, ready_plan("compliance"))
    yield pushed_row("hand, load cells without delay", prompt, ready_plan("compliance"))
    yield pushed_row("hand, both springs alike", alike, ready_plan("compliance"))
    yield pushed_row("steps of ±10 and ±20 N", parameters, ready_plan("compliance", profile="steps"))


def pushed_row(name: str, parameters: PlantParameters, plan: ComposedPlan) -> list[str]:
    """One row: RMSE raw and aligned, the difference at rest before the first push, and how fast the pushes are."""
    columns, r_j = played(parameters, plan), parameters.geometry.r_j
    figures = compliance_figures(columns, r_j, LEAD_IN_S)
    pushed = round(LEAD_IN_S / T_s)
    expected = -columns["S_ref"] * columns["q"] / r_j
    rest = (columns["F_A"] - columns["F_B"] - expected)[pushed - round(1.0 / T_s) : pushed].mean()
    smooth = np.convolve(expected[pushed:], np.full(_SMOOTHED, 1.0 / _SMOOTHED), "valid")
    rate = float(np.sqrt(np.mean(np.gradient(smooth, T_s) ** 2)))
    return [name, f"{figures.rmse_raw_N:.3f}", f"{figures.rmse_aligned_N:.3f}", f"{rest:.3f}", f"{rate:.1f}"]


def robustness_rows(parameters: PlantParameters, ideal: PlantParameters) -> Iterator[list[str]]:
    yield ["paper", "0.375 N·m", "", "", "", ""]
    yield loaded_row("here, `ideal`", ideal, ready_plan("robustness"))
    yield loaded_row("here, `lab`", parameters, ready_plan("robustness"))


def loaded_row(name: str, parameters: PlantParameters, plan: ComposedPlan) -> list[str]:
    """One row: load, deviations of both motors, time until they are back, joint deviation, tensions."""
    found = robustness_figures(played(parameters, plan), load_steps(plan.program()), parameters.sensors.motor_step)
    back = f"{found.back_s:.2f}" if not found.reasons else f"not within {plan.values['hold_s']:g}"
    return [
        name, f"{plan.values['load_Nm']} N·m", f"{found.deviation_A_rad:.4f}, {found.deviation_B_rad:.4f}", back,
        f"{found.deviation_q:.4f}", f"{found.min_tension_N:.1f} to {found.max_tension_N:.1f}",
    ]  # fmt: skip
