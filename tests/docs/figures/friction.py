"""Friction in docs/explanation/fidelity.md: motors under a load, at rest, and a step, on `lab` and `lab-stick`."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from backend.analysis.disturbance_metrics import compute_robustness_metrics
from backend.analysis.step_metrics import list_load_steps
from backend.experiments.plans import LoopSettings
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.docs.figures.places import Computation, Found, Table
from tests.docs.figures.runs import Bench, experiment

PAGE = "docs/explanation/fidelity.md"
PLANTS = ("lab", "lab-stick")
S_REF = 10.0
PLACES_RAD = (-0.6, -0.3, 0.0, 0.3, 0.6)
WAITED_S, WATCHED_S = 40.0, 20.0
LOADED_S = 20.0

STANDING = Table(
    PAGE,
    "standing",
    (
        "",
        "peak-to-peak q",
        "peak-to-peak motor angle",
        "peak-to-peak u",
        "control steps in which a motor's count changes",
    ),
)
STEP = Table(PAGE, "step with friction", ("", "λ_q [s]", "90 % of 2π/3 after"))
LOADED = Table(
    PAGE,
    "motors under a long load",
    ("", "offset of motor A at rest", "offset of motor B at rest", "motion of the motors", "peak voltage"),
)


def computations() -> Iterator[Computation]:
    """Return the computations of the page that involve friction."""
    yield Computation("robustness, lab, long loads", (LOADED,), loaded)
    for plant in PLANTS:
        yield Computation(f"standing, {plant}", (STANDING,), partial(standing, plant))
        yield Computation(f"step, {plant}", (STEP,), partial(stepped, plant))


def loaded() -> Found:
    """Return the motor positions of `lab` in the second half of 20 s under a load, and of 20 s after it."""
    parameters = load_parameters("lab")
    run = experiment(parameters, "robustness", hold_s=LOADED_S)
    columns, steps = run.played.columns, list_load_steps(run.plan.program())
    figures = compute_robustness_metrics(columns, steps, parameters.sensors.motor_step)
    off: dict[tuple[bool, str], float] = {}
    moves = {True: 0.0, False: 0.0}
    for side, window, on in steps:
        half = slice((window.start + window.stop) // 2, window.stop)
        off[on, side] = float(np.abs(columns[f"theta_{side}_ref"][half] - columns[f"theta_{side}"][half]).max())
        moves[on] = max(moves[on], float(np.ptp(columns[f"theta_{side}"][half])))
    rows = [
        [
            name, f"{off[on, 'A']:.3f} rad", f"{off[on, 'B']:.3f} rad", f"{moves[on]:.3f} rad",
            f"{figures.peak_voltage_V:.1f} V",
        ]
        for name, on in (("loaded", True), ("load removed", False))
    ]  # fmt: skip
    return {LOADED: rows}


def standing(plant: str) -> Found:
    """Return the largest peak-to-peak values of joint, motors and voltages over five holds of one minute."""
    parameters = load_parameters(plant)
    bench = Bench(parameters, LoopSettings())
    worst = np.zeros(4)
    try:
        for q_ref in PLACES_RAD:
            bench.hold(q_ref, S_REF, WAITED_S)
            bench.advance(WATCHED_S)
            of = {name: bench.seconds(name, WATCHED_S) for name in ("q", "theta_A", "theta_B", "u_A", "u_B")}
            turned = [
                np.diff(np.rint(of[name] / parameters.sensors.motor_step)) != 0 for name in ("theta_A", "theta_B")
            ]
            seen = (
                np.ptp(of["q"]) / parameters.sensors.joint_step,
                1e3 * max(np.ptp(of["theta_A"]), np.ptp(of["theta_B"])),
                max(np.ptp(of["u_A"]), np.ptp(of["u_B"])),
                100.0 * float((turned[0] | turned[1]).mean()),
            )
            worst = np.maximum(worst, seen)
    finally:
        bench.close()
    counts, motors, volts, moving = worst
    row = [f"`{plant}`", f"{counts:.0f} counts", f"{motors:.1f} mrad", f"{volts:.2f} V", f"{moving:.1f} %"]
    return {STANDING: [row]}


def stepped(plant: str) -> Found:
    """Return the rise time to 90 % of the largest step with the fastest λ_q."""
    settings = LoopSettings(lam_q=0.355)
    bench = Bench(load_parameters(plant), settings)
    try:
        bench.hold(-np.pi / 3.0, S_REF, 10.0)
        begun = float(bench.seconds("q", T_s)[0])
        bench.hold(np.pi / 3.0, S_REF, 5.0)
        share = (bench.seconds("q", 5.0) - begun) / (np.pi / 3.0 - begun)
        reach_s = float(np.argmax(share >= 0.9) + 1) * T_s
    finally:
        bench.close()
    return {STEP: [[f"`{plant}`", f"{settings.lam_q:g}", f"{reach_s:.2f} s"]]}
