"""Figures 7 and 8 of the paper on the simulated rig and the robustness table, docs/explanation/fidelity.md."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from backend.analysis.disturbance_metrics import compute_compliance_metrics, compute_robustness_metrics
from backend.analysis.step_metrics import OverallMetrics, compute_tracking_metrics, list_load_steps
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from tests.docs.figures.places import Computation, Found, Prose, Table
from tests.docs.figures.runs import experiment
from tests.experiments.judging import LEAD_IN_S

PAGE = "docs/explanation/fidelity.md"
PAPER_RMSE_N = 2.239
DELAY_S = 0.012
"""Of the load cells: the paper's 10 to 15 ms."""

_SMOOTHED = 20
"""Ticks over which the expected force is averaged before its rate is taken: encoder counts are no pushes."""

FIGURE_7 = Table(PAGE, "figure 7", ("statement of the paper", "here"))
FIGURE_8 = Table(PAGE, "figure 8", ("pushes", "raw [N]", "aligned [N]", "offset at rest [N]", "rms of dF/dt [N/s]"))
ROBUSTNESS = Table(
    PAGE,
    "robustness",
    ("", "load", "deviation of motors A, B [rad]", "return time [s]", "deviation of the joint [rad]", "tensions [N]"),
)
HAND, STEPS = "hand, as shipped", "steps of ±10 and ±20 N"
SLOW = Prose(PAGE, "delay under the hand", "{delay:.0f} ms at {rate:.1f} N/s are {error:.2f} N, at")
FAST = Prose(PAGE, "delay under steps", "N, at {rate:.1f} N/s {error:.2f} N.")
ALONE = Prose(PAGE, "delay that makes the paper's figure", "Delay alone causes {rmse:.3f} N at {rate:.0f} N/s")


def computations() -> Iterator[Computation]:
    """Return the computations that repeat an experiment of the paper."""
    yield Computation("figure 7", (FIGURE_7,), figure_7)
    lab = load_parameters("lab")
    prompt = replace(lab, sensors=replace(lab.sensors, force_delay=0.0))
    alike = replace(lab, asymmetry=replace(lab.asymmetry, spring_A=1.0, spring_B=1.0))
    yield Computation("figure 8, hand", (FIGURE_8, SLOW, ALONE), by_hand)
    yield Computation(
        "figure 8, load cells without delay",
        (FIGURE_8,),
        partial(pushed, "hand, load cells without delay", prompt, "hand"),
    )
    yield Computation(
        "figure 8, springs alike", (FIGURE_8,), partial(pushed, "hand, both springs alike", alike, "hand")
    )
    yield Computation("figure 8, steps", (FIGURE_8, FAST), by_steps)
    yield Computation("robustness, ideal", (ROBUSTNESS,), partial(loaded, "ideal"))
    yield Computation("robustness, lab", (ROBUSTNESS,), partial(loaded, "lab"))


def figure_7() -> Found:
    """Return the results of tracking with the values of the paper."""
    return {FIGURE_7: list(figure_7_rows(load_parameters("lab")))}


def figure_7_rows(parameters: PlantParameters) -> Iterator[list[str]]:
    run = experiment(parameters, "tracking")
    metrics = compute_tracking_metrics(
        run.played.columns, run.plan.program(), run.plan.phases(), q_count=parameters.sensors.joint_step
    )
    all_of: OverallMetrics = metrics.overall
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


def by_hand() -> Found:
    """Return the row of the pushes by hand, and the effect of a delay."""
    row = pushed_row(HAND, load_parameters("lab"), "hand")
    rate = float(row[-1])
    return {
        FIGURE_8: [["paper", f"{PAPER_RMSE_N:.3f}", "", "", ""], row],
        SLOW: {"delay": 1e3 * DELAY_S, "rate": rate, "error": DELAY_S * rate},
        ALONE: {"rmse": PAPER_RMSE_N, "rate": PAPER_RMSE_N / DELAY_S},
    }


def by_steps() -> Found:
    """Return the row of the steps, and the effect of a delay."""
    row = pushed_row(STEPS, load_parameters("lab"), "steps")
    rate = float(row[-1])
    return {FIGURE_8: [row], FAST: {"rate": rate, "error": DELAY_S * rate}}


def pushed(name: str, parameters: PlantParameters, profile: str) -> Found:
    """Return one row of figure 8."""
    return {FIGURE_8: [pushed_row(name, parameters, profile)]}


def pushed_row(name: str, parameters: PlantParameters, profile: str) -> list[str]:
    """Return raw and aligned RMSE, the difference at rest before the first push, and the speed of the pushes."""
    columns, r_j = experiment(parameters, "compliance", profile=profile).played.columns, parameters.geometry.r_j
    figures = compute_compliance_metrics(columns, r_j, LEAD_IN_S)
    pushed = round(LEAD_IN_S / T_s)
    expected = -columns["S_ref"] * columns["q"] / r_j
    rest = (columns["F_A"] - columns["F_B"] - expected)[pushed - round(1.0 / T_s) : pushed].mean()
    smooth = np.convolve(expected[pushed:], np.full(_SMOOTHED, 1.0 / _SMOOTHED), "valid")
    rate = float(np.sqrt(np.mean(np.gradient(smooth, T_s) ** 2)))
    return [name, f"{figures.rmse_raw_N:.3f}", f"{figures.rmse_aligned_N:.3f}", f"{rest:.3f}", f"{rate:.1f}"]


def loaded(plant: str) -> Found:
    """Return one row: load, deviations of both motors, recovery time, joint deviation, tensions."""
    parameters = load_parameters(plant)
    run = experiment(parameters, "robustness")
    found = compute_robustness_metrics(
        run.played.columns, list_load_steps(run.plan.program()), parameters.sensors.motor_step
    )
    back = f"{found.back_s:.2f}" if not found.reasons else f"not within {run.plan.values['hold_s']:g}"
    row = [
        f"here, `{plant}`", f"{run.plan.values['load_Nm']} N·m",
        f"{found.deviation_A_rad:.4f}, {found.deviation_B_rad:.4f}", back, f"{found.deviation_q:.4f}",
        f"{found.min_tension_N:.1f} to {found.max_tension_N:.1f}",
    ]  # fmt: skip
    if plant == "lab":
        return {ROBUSTNESS: [row]}
    return {ROBUSTNESS: [["paper", "0.375 N·m", "", "", "", ""], row]}
