"""Metrics of the robustness test: how far a load turns a motor away from its reference, and for how long. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from backend.documents.result import Criterion, Phase
from backend.experiments.results.criteria import judge
from backend.experiments.results.metrics import NoSamplesError, figure
from plant.interface import T_s
from plant.parameter_sections import SIDES

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

BACK_SHARE = 0.05
"""A motor is back where it stays within this share of the largest deviation."""

BACK_LAMBDAS = 18.0
"""Time to be back, in λ_motor: twice the 9 λ that the loop with its four poles at −1/λ takes without friction while its
reference stands. The paper names a load and prints no response; a motor with friction may well fail this."""

MIN_TENSION_N = 1.0
_LEAST_COUNTS = 20.0


@dataclass(frozen=True)
class RobustnessFigures:
    """Figures of one run, over all loads on and off. ``reasons`` tells by name which could not be measured and why."""

    deviation_A_rad: float = figure("rad", "Deviation of motor A", "max |θ_A − θ_A,ref| after its load steps on or off")
    deviation_B_rad: float = figure("rad", "Deviation of motor B", "max |θ_B − θ_B,ref| after its load steps on or off")
    back_s: float | None = figure(
        "s",
        "Back on the reference",
        "longest time from a step of the load until |θ_ref − θ| stays within 5 % of its largest",
    )
    error_integral_A: float = figure("rad·s", "Integral of the error of A", "of θ_A,ref − θ_A while its load is on")
    error_integral_B: float = figure("rad·s", "Integral of the error of B", "of θ_B,ref − θ_B while its load is on")
    deviation_q: float = figure("rad", "Joint deviation", "max |q − q_ref| from the first load on")
    deviation_S: float = figure("N·m/rad", "Stiffness deviation", "max |S − S_ref| from the first load on")
    min_tension_N: float = figure("N", "Smallest tension", "of both load cells from the start of the program")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells from the start of the program")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest |u_A|, |u_B| after limits")
    reasons: Mapping[str, str] = field(default_factory=dict)


def robustness_figures(columns: Columns, phases: tuple[Phase, ...], motor_step_rad: float) -> RobustnessFigures:
    """Measure one run. ``columns`` holds angles, references, q, S, tensions and voltages, one sample a millisecond.

    ``motor_step_rad`` is one count of the motor encoders, 0 where they are exact. Raises NoSamplesError when the run
    ended before every load had stepped.
    """
    steps = {phase.name: slice(round(phase.start_s / T_s), round(phase.end_s / T_s)) for phase in phases}
    loads = {name: window for name, window in steps.items() if name != "lead_in"}
    if columns["q"].size < max(window.stop for window in loads.values()):
        raise NoSamplesError("the run ended before both motors had been loaded and let go")
    errors: dict[str, Array] = {side: columns[f"theta_{side}_ref"] - columns[f"theta_{side}"] for side in SIDES}
    deviations, times, reasons, away_still = {"A": 0.0, "B": 0.0}, [0.0], {}, []
    for name, window in loads.items():
        side, error = name[0], errors[name[0]][window]
        size = np.abs(error)
        deviations[side] = float(np.maximum(deviations[side], size.max()))
        if math.isnan(deviations[side]):
            reasons["back_s"] = reasons[f"deviation_{side}_rad"] = f"the angles of motor {side} hold no number"
            continue
        if not size.max() > _LEAST_COUNTS * motor_step_rad:  # neither is a motor that stood still
            reasons["back_s"] = f"motor {side} moved by less than {_LEAST_COUNTS:g} encoder counts: load it more"
            continue
        away = np.flatnonzero(size > BACK_SHARE * size.max())
        if away[-1] == size.size - 1:
            off = float(size[size.size // 2 :].max() / size.max())
            since = error[size.argmax() :] / size.max()
            away_still.append((off, side, bool(since.min() < -BACK_SHARE and since.max() > BACK_SHARE)))
        times.append(float(away[-1] + 1) * T_s)
    if away_still:
        reasons["back_s"] = _still_away(*max(away_still), loads["A_on"].stop - loads["A_on"].start)
    loaded = slice(loads["A_on"].start, None)
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    return RobustnessFigures(
        deviation_A_rad=deviations["A"],
        deviation_B_rad=deviations["B"],
        back_s=max(times) or None,
        error_integral_A=float(np.sum(errors["A"][loads["A_on"]]) * T_s),
        error_integral_B=float(np.sum(errors["B"][loads["B_on"]]) * T_s),
        deviation_q=float(np.abs(columns["q"] - columns["q_ref"])[loaded].max()),
        deviation_S=float(np.abs(columns["S"] - columns["S_ref"])[loaded].max()),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
        reasons=reasons,
    )


def _still_away(off: float, side: str, to_both_sides: bool, ticks: int) -> str:
    why = (
        ", to both sides: it hunts, as dry friction makes it do under integral action"
        if to_both_sides
        else ", to one side: hold the load longer, or look what keeps it there"
    )
    return (
        f"motor {side} was not back on its reference when the load changed again after {ticks * T_s:g} s: in the "
        f"second half of it the motor was off by up to {100.0 * off:.0f} % of its largest deviation{why}"
    )


def robustness_criteria(
    figures: RobustnessFigures, lam_motor: float, u_max: float, reason: str = ""
) -> tuple[Criterion, ...]:
    """Judge that both motors come back, that neither tendon goes slack and that the voltage is never clipped.

    ``reason`` says why the run was not seen whole, if it was not: nothing passes then.
    """
    back = figures.reasons.get("back_s", "") or reason
    return (
        judge(
            "back",
            f"Motors back within {100 * BACK_SHARE:g} % of their largest deviation",
            "<",
            BACK_LAMBDAS * lam_motor,
            figures.back_s,
            "s",
            back,
        ),
        judge("min_tension", "Smallest tendon tension", ">", MIN_TENSION_N, figures.min_tension_N, "N", reason),
        judge("peak_voltage", "Peak voltage", "<", u_max, figures.peak_voltage_V, "V", reason),
    )
