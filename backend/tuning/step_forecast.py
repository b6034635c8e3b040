"""What a step of a reference will do: the compiled closed loop, simulated on the expected plant."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade
from backend.tuning import closed_loop
from plant.interface import T_s
from plant.parameters import PlantParameters

Array = NDArray[np.float64]

BAND = 0.02
"""A step has settled when it stays so near to the new reference, as a part of the step (method section 7)."""

HELD_S = 1.0
"""How long the loop holds before the step or the push [s]: friction, dead zones and load cells come to rest."""

_POINTS = 160
"""Points of the curve that the page draws."""


@dataclass(frozen=True)
class StepForecast:
    """A step of q [rad] or S [N·m/rad] from ``start`` to ``end``: its times, its peaks and its curve.

    ``t90_s``: from the step to 90 % of it; ``settling_s``: from when on it stays within BAND of the step; both nan
    where that does not happen in the time simulated. ``overshoot_percent`` of the step. ``peak_voltage`` [V] and
    ``least_tension`` [N] of both sides. ``y`` (n,): progress from 0 to 1 over ``t`` (n,) [s].
    """

    start: float
    end: float
    t90_s: float
    settling_s: float
    overshoot_percent: float
    peak_voltage: float
    least_tension: float
    t: Array
    y: Array


def step_forecast(
    plant: PlantParameters,
    tuning: cascade.CascadeTuning,
    q: tuple[float, float],
    S: tuple[float, float],
    seconds: float,
    entry: float = -1.0,
    rig: closed_loop.Rig | None = None,
) -> StepForecast:
    """Simulate one step and return what it does; of ``q`` and ``S`` the pair that differs is the step.

    ``q`` [rad] and ``S`` [N·m/rad]: references before and after; ``seconds``: how long to simulate behind the step;
    ``entry``: entry of the bank in use before it, −1 for the one nearest to S; ``rig``: that of ``plant``,
    where it is at hand.
    """
    ticks = round(HELD_S / T_s), round(seconds / T_s)
    trajectory = closed_loop.run(plant, tuning, np.repeat(q, ticks), np.repeat(S, ticks), entry=entry, rig=rig)
    moves_q = q[0] != q[1]
    (start, end), signal = (q, trajectory.q) if moves_q else (S, trajectory.S)
    after = slice(ticks[0], None)
    y = (signal[after] - start) / (end - start)
    t90_s, settling_s, overshoot_percent = step_figures(y)
    voltages, tensions = (trajectory.u_A, trajectory.u_B), (trajectory.F_A, trajectory.F_B)
    if trajectory.tripped_at >= 0:
        t90_s = settling_s = np.nan
        y = y[: max(trajectory.tripped_at - ticks[0], 0) + 1]
    shown = shown_ticks(y.size, settling_s)
    return StepForecast(
        start,
        end,
        t90_s,
        settling_s,
        overshoot_percent,
        max(float(np.nanmax(np.abs(u[after]))) for u in voltages),
        min(float(np.nanmin(F[after])) for F in tensions),
        np.asarray(shown * T_s, dtype=np.float64),
        y[shown],
    )


def step_figures(y: Array) -> tuple[float, float, float]:
    """Return t90 [s], settling time [s] and overshoot [%] of the progress ``y`` (ticks,) of a step, 0 to 1.

    Times are nan where 90 % is not reached, or where the end is not within BAND.
    """
    reached, outside = y >= 0.9, np.flatnonzero(~(np.abs(y - 1.0) <= BAND + 1e-9))
    t90_s = float(np.argmax(reached)) * T_s if reached.any() else np.nan
    settled = int(outside[-1]) + 1 if outside.size else 0
    return t90_s, settled * T_s if settled < y.size else np.nan, 100.0 * max(float(np.nanmax(y)) - 1.0, 0.0)


def shown_ticks(ticks: int, settling_s: float) -> NDArray[np.int64]:
    """Return the ticks (n,) that a curve of ``ticks`` is drawn by: up to a quarter beyond where it has settled."""
    last = ticks - 1 if np.isnan(settling_s) else min(ticks - 1, round((1.25 * settling_s + 0.1) / T_s))
    return np.unique(np.linspace(0, last, _POINTS).round().astype(np.int64))
