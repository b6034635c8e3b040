"""The tables of docs/how-to/experiments.md: frequency response, disturbance battery, hold at rest."""

from collections.abc import Iterator
from functools import partial

import numpy as np
from scipy.optimize import brentq

from backend.analysis.disturbance_metrics import MeasuredPush, measure_pushes
from backend.analysis.frequency_metrics import build_bode_lines
from backend.analysis.step_metrics import list_load_steps
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.docs.figures.places import Computation, Found, Place, Prose, Rows, Table, Values
from tests.docs.figures.runs import LAMBDA, MOTION_NAMES, TIME_OPTIMAL, U_PLAN_V, Experiment, in_motion

PAGE = "docs/how-to/experiments.md"
PLANTS = ("ideal", "lab", "lab-stick")
MOTIONS = (LAMBDA, TIME_OPTIMAL)

RESPONSE = Table(
    PAGE,
    "frequency response",
    (
        "plant",
        "motion",
        "bandwidth of q",
        "predicted",
        "bandwidth of S",
        "predicted",
        "largest difference up to the predicted bandwidth",
    ),
    key=2,
)
DISTURBANCE = Table(
    PAGE,
    "disturbance battery",
    (
        "plant",
        "motion",
        "step at 8.5, 11.25, 14 N·m/rad",
        "impulse of 0.1 N·s",
        "difference of steps and impulses",
        "difference of ramps",
        "time to return",
    ),
    key=2,
)
SWING = Prose(
    PAGE, "swing beyond the static deviation", "overshoots it by a factor of {ratio:.2f} with the paper's joint"
)
LOADED = Prose(
    PAGE,
    "motors under a load",
    "Under a shaft load a motor of `lab` still deviates from its reference after 5 s, by up to {off:.0f} % of its "
    "largest deviation",
)
FOLLOWED = Prose(
    PAGE,
    "sines that are followed",
    "{small:.1f} rad are followed up to {fast:.1f} Hz and {large:.1f} rad up to {slow:.1f} Hz with {limit:.1f} V",
)
REST = Table(
    PAGE,
    "hold at rest",
    (
        "plant",
        "motion",
        "deviation of q",
        "peak-to-peak q",
        "peak-to-peak u",
        "peak-to-peak S",
        "control steps with motion",
    ),
    key=2,
)


def computations() -> Iterator[Computation]:
    """Return the computations of the page, one per run."""
    yield Computation("sines that are followed", (FOLLOWED,), followed)
    for name, table, compute in (
        ("frequency response", RESPONSE, responses),
        ("disturbance battery", DISTURBANCE, disturbances),
        ("hold at rest", REST, rests),
    ):
        for motion in MOTIONS:
            for plant in PLANTS:
                places: tuple[Table | Prose, ...] = (table,)
                if table is DISTURBANCE and (plant, motion) in PROSE_OF:
                    places = (table, PROSE_OF[plant, motion])
                yield Computation(f"{name}, {plant}, {motion}", places, partial(compute, plant, motion))


PROSE_OF = {("ideal", LAMBDA): SWING, ("lab", LAMBDA): LOADED}


def followed() -> Found:
    """Return the frequencies up to which the voltage limit suffices for a sine of q of two amplitudes."""
    parameters = load_parameters("lab")
    motor, geometry = parameters.identified, parameters.geometry

    def left_V(f: float, amplitude: float) -> float:
        omega = 2.0 * np.pi * f
        turn = geometry.r_j / geometry.r_m * amplitude * omega
        return U_PLAN_V - turn * float(np.hypot(1.0, omega * motor.T_m)) / motor.K_m

    small, large = 0.1, 0.5
    fast, slow = (float(brentq(left_V, 0.01, 100.0, args=(amplitude,))) for amplitude in (small, large))
    return {FOLLOWED: {"small": small, "fast": fast, "large": large, "slow": slow, "limit": U_PLAN_V}}


def responses(plant: str, motion: str) -> Found:
    """Return measured and predicted bandwidths, and the largest difference of the responses."""
    run = in_motion(plant, "frequency_response", motion)
    figures = {figure.name: figure.value for figure in run.played.metrics.figures}
    highest = {
        lines.signal: lines.f[-1] for lines in build_bode_lines(run.played.columns, run.plan.program(), run.in_force)
    }

    def width(signal: str) -> str:
        value = figures[f"bandwidth_{signal}_Hz"]
        return f"above {highest[signal]:.3g} Hz" if value is None else f"{value:.3f} Hz"

    def predicted(signal: str) -> str:
        value = figures[f"bandwidth_{signal}_predicted_Hz"]
        return "none" if value is None else f"{value:.3f} Hz" if value < 1.0 else f"{value:.0f} Hz"

    gain, phase = (
        max(run.value(f"{name}_off_{signal}_{unit}") for signal in ("q", "S"))
        for name, unit in (("gain", "dB"), ("phase", "deg"))
    )
    row = [
        f"`{plant}`", MOTION_NAMES[motion], width("q"), predicted("q"), width("S"), predicted("S"),
        f"{gain:.2f} dB, {phase:.1f}°",
    ]  # fmt: skip
    return {RESPONSE: [row]}


def disturbances(plant: str, motion: str) -> Found:
    """Return the largest deviation at each stiffness under steps and impulses, and its prediction error."""
    run = in_motion(plant, "disturbance_battery", motion)
    pushes = measure_pushes(run.played.columns, run.plan.program(), run.in_force)
    steps, impulses, ramps = (
        [push for push in pushes if push.window.shape == shape] for shape in ("step", "impulse", "ramp")
    )
    rows = [
        [
            f"`{plant}`", MOTION_NAMES[motion], _peaks(steps), _peaks(impulses), _off([*steps, *impulses]), _off(ramps),
            f"{run.value('pushed_back_s'):.2f} s",
        ]
    ]  # fmt: skip
    if (plant, motion) == ("ideal", LAMBDA):
        expected = [_peaks(kind, expected=True) for kind in (steps, impulses)]
        rows.insert(0, ["expected", "either", *expected, "", "", ""])
    found: dict[Place, Rows | Values] = {DISTURBANCE: rows}
    if (plant, motion) == ("ideal", LAMBDA):
        found[SWING] = {"ratio": run.value("pushed_static_ratio")}
    if (plant, motion) == ("lab", LAMBDA):
        found[LOADED] = {"off": 100.0 * still_off(run)}
    return found


def _peaks(pushes: list[MeasuredPush], *, expected: bool = False) -> str:
    peaks: dict[float, float] = {}
    for push in pushes:
        peak = push.expected_peak if expected else push.peak_q
        assert peak is not None, push.unpredicted
        peaks[push.S] = max(peaks.get(push.S, 0.0), peak)
    return ", ".join(f"{np.degrees(peak):.2f}°" for _, peak in sorted(peaks.items()))


def _off(pushes: list[MeasuredPush]) -> str:
    off = [push.off_percent for push in pushes]
    assert None not in off
    return f"{max(abs(one) for one in off if one is not None):.1f} %"


def still_off(run: Experiment) -> float:
    """Return the deviation of a motor at the end of a load, relative to its largest deviation under the load."""
    shares = []
    for side, window, _ in list_load_steps(run.plan.program()):
        error = np.abs(run.played.columns[f"theta_{side}_ref"] - run.played.columns[f"theta_{side}"])[window]
        shares.append(error[-round(0.1 / T_s) :].mean() / error.max())
    return float(max(shares))


def rests(plant: str, motion: str) -> Found:
    """Return the worst values of all holds."""
    run = in_motion(plant, "hold_at_rest", motion)
    row = [
        f"`{plant}`", MOTION_NAMES[motion], f"{run.value('held_off_counts'):.2f} counts",
        f"{run.value('held_q_swing_counts'):.2f} counts", f"{run.value('held_u_swing_V'):.2f} V",
        f"{run.value('held_S_swing'):.4f} N·m/rad", f"{run.value('held_moving_percent'):.1f} %",
    ]  # fmt: skip
    return {REST: [row]}
