"""The cascade and its two baselines: the tracking experiment of the paper at the same requested speed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

from backend.analysis.step_metrics import OverallMetrics, compute_tracking_metrics
from backend.control import setpoint_player
from backend.control.motion_types import Setpoint
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import ExperimentPlan
from backend.realtime.motions import make_segment_player
from backend.tuning.gains import (
    TuningParameters,
    make_cascade_tuning,
    make_feedback_linearization_tuning,
    make_single_loop_tuning,
)
from backend.tuning.simulation import Array, Trajectory, simulate_cascade
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from tests.closed_loop.baseline_loops import run_feedback_linearization, run_single_loop

LAMBDAS = TuningParameters()
AS_QUICK = TuningParameters(lam_q=0.39, lam_S=0.39)
"""With these the cascade rises as fast as the baselines with the defaults."""

PUSH_N = 5.0

Law = Callable[[PlantParameters, PlantParameters, Array, Array, Array], Trajectory]
"""Runs a law that knows the second parameter set on the plant of the first: q_ref, S_ref, F_push (ticks,)."""

LAWS: dict[str, Law] = {
    "cascade": lambda plant, known, *inputs: simulate_cascade(plant, make_cascade_tuning(known, LAMBDAS), *inputs),
    "cascade, λ = 0.39 s": lambda plant, known, *inputs: simulate_cascade(
        plant, make_cascade_tuning(known, AS_QUICK), *inputs
    ),
    "single loop": lambda plant, known, *inputs: run_single_loop(
        plant, make_single_loop_tuning(known, LAMBDAS), *inputs
    ),
    "feedback linearization": lambda plant, known, *inputs: run_feedback_linearization(
        plant, make_feedback_linearization_tuning(known, LAMBDAS), *inputs
    ),
}

COLUMNS: dict[str, tuple[str, Callable[[OverallMetrics], float | None]]] = {
    "rise of q\n[s]": (".2f", lambda overall: overall.rise_q_s),
    "rise of S\n[s]": (".2f", lambda overall: overall.rise_S_s),
    "overshoot\nof q [%]": (".2f", lambda overall: overall.overshoot_q_percent),
    "overshoot\nof S [%]": (".2f", lambda overall: overall.overshoot_S_percent),
    "S deviation\n[N·m/rad]": (".4f", lambda overall: overall.deviation_S),
    "q deviation\n[rad]": (".4f", lambda overall: overall.deviation_q),
    "least\ntension [N]": (".2f", lambda overall: overall.min_tension_N),
    "peak\nvoltage [V]": (".2f", lambda overall: overall.peak_voltage_V),
    "voltage\nat rest [V]": (".2f", lambda overall: overall.u_rest_rms_V),
}


def bench(console: Console) -> bool:
    """Print the comparison, which has no bound."""
    title = f"Control laws, tracking experiment, λ_q = {LAMBDAS.lam_q:g} s, λ_S = {LAMBDAS.lam_S:g} s"
    note = "20 % off: springs stiffer and motors weaker by a fifth than the law knows"
    table = Table(title=title, title_justify="left", title_style="bold", caption=note, caption_justify="left")
    table.add_column("plant", no_wrap=True)
    table.add_column("law", no_wrap=True)
    for heading in (*COLUMNS, f"{PUSH_N:g} N push\nmoves q [rad]"):
        table.add_column(heading, justify="right")
    for plant, (true, known) in plants().items():
        for law, play in LAWS.items():
            table.add_row(plant, law, *tracking(play, true, known), pushed(play, true, known))
        table.add_section()
    console.print(table)
    return True


def plants() -> dict[str, tuple[PlantParameters, PlantParameters]]:
    """Return by name the plant and the plant that the law assumes."""
    ideal, lab = load_parameters("ideal"), load_parameters("lab")
    sides = lab.asymmetry
    off = replace(
        sides,
        spring_A=1.2 * sides.spring_A,
        spring_B=1.2 * sides.spring_B,
        motor_A=0.8 * sides.motor_A,
        motor_B=0.8 * sides.motor_B,
    )
    return {
        "ideal": (ideal, ideal),
        "lab": (lab, lab),
        "lab, 20 % off": (replace(lab, asymmetry=off), lab),
    }


def tracking(play: Law, true: PlantParameters, known: PlantParameters) -> list[str]:
    """Run the tracking experiment; return one cell per entry of COLUMNS."""
    plan = build_ready_plan("tracking")
    q_ref, S_ref = references(plan)
    trajectory = play(true, known, q_ref, S_ref, np.zeros(q_ref.size))
    if trajectory.tripped_at >= 0:
        return [f"tripped after {trajectory.tripped_at * T_s:.1f} s", *[""] * (len(COLUMNS) - 1)]
    columns = {name: getattr(trajectory, name) for name in ("q", "S", "F_A", "F_B", "u_A", "u_B")}
    columns |= {"t": T_s * np.arange(q_ref.size), "q_ref": q_ref, "S_ref": S_ref}
    overall = compute_tracking_metrics(columns, plan.program(), plan.phases(), q_count=true.sensors.joint_step).overall
    values = [(form, figure(overall)) for form, figure in COLUMNS.values()]
    return ["none" if value is None else format(value, form) for form, value in values]


def pushed(play: Law, true: PlantParameters, known: PlantParameters) -> str:
    """Push the joint at rest for 3 s; return the cell with its largest deviation."""
    ticks = 4000
    F_push = np.where(np.arange(ticks) < 1000, 0.0, PUSH_N)
    trajectory = play(true, known, np.zeros(ticks), np.full(ticks, 10.0), F_push)
    return "tripped" if trajectory.tripped_at >= 0 else f"{np.max(np.abs(trajectory.q)):.3f}"


def references(plan: ExperimentPlan) -> tuple[Array, Array]:
    """Return q_ref and S_ref (ticks,) of the complete program, from its first reference on."""
    segments = plan.program().segments
    target = Setpoint(segments[0].q_ref, segments[0].S_ref, 0.0)
    playing = make_segment_player(segments, target)
    targets: list[Setpoint] = []
    while True:
        ended, target, playing = setpoint_player.step_setpoint_player(playing, target)
        if ended:
            return np.array([target.q_ref for target in targets]), np.array([target.S_ref for target in targets])
        targets.append(target)
