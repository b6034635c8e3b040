"""Metrics of the robustness test: how far a load turns a motor away from its reference, and for how long. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.windows import LoadStep
from plant.interface import T_s
from plant.parameters import SIDES, Side

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

BACK_SHARE = 0.05
"""A motor is back where it stays within this share of the largest deviation."""

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


def robustness_figures(columns: Columns, steps: Sequence[LoadStep], motor_step_rad: float) -> RobustnessFigures:
    """Measure one run. ``columns`` holds angles, references, q, S, tensions and voltages, one sample a millisecond.

    ``motor_step_rad`` is one count of the motor encoders, 0 where they are exact. Raises NoSamplesError when the run
    ended before every load had stepped.
    """
    if not steps or columns["q"].size < max(step.window.stop for step in steps):
        raise NoSamplesError("the run ended before both motors had been loaded and let go")
    errors: dict[str, Array] = {side: columns[f"theta_{side}_ref"] - columns[f"theta_{side}"] for side in SIDES}
    deviations, times, reasons, away_still = {"A": 0.0, "B": 0.0}, [0.0], {}, []
    for side, window, _ in steps:
        error = errors[side][window]
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
            away_still.append((off, side, bool(since.min() < -BACK_SHARE and since.max() > BACK_SHARE), size.size))
        times.append(float(away[-1] + 1) * T_s)
    if away_still:
        reasons["back_s"] = _still_away(*max(away_still))
    loaded = slice(min(step.window.start for step in steps), None)
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    return RobustnessFigures(
        deviation_A_rad=deviations["A"],
        deviation_B_rad=deviations["B"],
        back_s=max(times) or None,
        error_integral_A=_integral(errors["A"], "A", steps),
        error_integral_B=_integral(errors["B"], "B", steps),
        deviation_q=float(np.abs(columns["q"] - columns["q_ref"])[loaded].max()),
        deviation_S=float(np.abs(columns["S"] - columns["S_ref"])[loaded].max()),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
        reasons=reasons,
    )


def _integral(error: Array, side: Side, steps: Sequence[LoadStep]) -> float:
    return float(sum(np.sum(error[step.window]) for step in steps if step.side == side and step.on) * T_s)


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
