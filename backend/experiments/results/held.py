"""How quiet the actuator is while nothing moves its references: stretches that are held, each on its own. Pure.

A stretch counts where the references stand as they stood before it, and neither push nor load acts: a ``hold`` after a
step that had its time.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.rest import NO_NUMBER
from backend.experiments.results.whole import Columns, Whole, whole
from backend.experiments.results.windows import timed
from backend.realtime.program import Program, Shape
from plant.interface import T_s
from plant.parameters import PlantParameters

LEAST_S = 1.0
"""Shorter stretches are no rest [s]."""

JOINT_STEP, MOTOR_STEP = 2.0 * math.pi / 4000.0, 2.0 * math.pi / 8000.0
"""Counts of the paper's encoders [rad]: in these it is told where readings are exact."""


@dataclass(frozen=True)
class Held:
    """One stretch of rest from ``start_s`` to ``end_s`` [s] at ``q_ref`` [rad] and ``S_ref`` [N·m/rad].

    Peak to peak of q [rad, counts], S [N·m/rad] and of the motor that swings more [V]; ``off_counts``: the joint's
    largest distance from its reference, ``off`` [rad] its mean one; ``moving_percent``: ticks in which a motor's count
    changed.
    """

    start_s: float
    end_s: float
    q_ref: float
    S_ref: float
    q_swing: float
    q_swing_counts: float
    off: float
    off_counts: float
    u_swing: float
    S_swing: float
    moving_percent: float


@dataclass(frozen=True, kw_only=True)
class HoldFigures(Whole):
    """Figures over all stretches, each the largest. ``reasons`` tells by name which were not measured and why."""

    held_q_swing_counts: float | None = figure(
        "1", "Swing of q, in counts", "max − min of q while held, in counts of the joint encoder (4000 where exact)"
    )
    held_q_swing: float | None = figure("rad", "Swing of q", "max − min of q while held")
    held_off_counts: float | None = figure(
        "1", "Off the reference, in counts", "max |q − q_ref| while held, less the half count that a reading tells to"
    )
    held_u_swing_V: float | None = figure("V", "Swing of the voltages", "max − min of u_A or u_B while held")
    held_S_swing: float | None = figure("N·m/rad", "Swing of S", "max − min of S while held")
    held_moving_percent: float | None = figure(
        "%", "Motors moving", "ticks in which the count of a motor's encoder changed while held (8000 where exact)"
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def hold_figures(columns: Columns, program: Program, parameters: PlantParameters) -> HoldFigures:
    """Measure one run; ``columns`` holds q, S, references, motor angles, tensions, voltages, a sample a millisecond.

    Raises NoSamplesError when no stretch was held to its end.
    """
    found = holds_seen(columns, program, parameters)
    if not found:
        raise NoSamplesError("nothing was held to its end")
    worst = {
        "held_q_swing_counts": max(one.q_swing_counts for one in found),
        "held_q_swing": max(one.q_swing for one in found),
        "held_off_counts": max(one.off_counts for one in found),
        "held_u_swing_V": max(one.u_swing for one in found),
        "held_S_swing": max(one.S_swing for one in found),
        "held_moving_percent": max(one.moving_percent for one in found),
    }
    lost = dict.fromkeys((name for name, value in worst.items() if not math.isfinite(value)), NO_NUMBER)
    kept: dict[str, Any] = {name: None if name in lost else value for name, value in worst.items()}
    return HoldFigures(**whole(columns), **kept, reasons=lost)


def hold_windows(program: Program) -> tuple[slice, ...]:
    """Return the stretches of rest of a program."""
    found: list[slice] = []
    before: tuple[float, float] | None = None
    for start, end, segment in timed(program):
        references = segment.q_ref, segment.S_ref
        acts = segment.F_push or segment.load_A or segment.load_B or segment.shape is not Shape.STEP
        quiet = not acts and references == before and start > 0
        if quiet and found and found[-1].stop == start:
            found[-1] = slice(found[-1].start, end)
        elif quiet:
            found.append(slice(start, end))
        before = None if acts else references
    return tuple(one for one in found if (one.stop - one.start) * T_s >= LEAST_S)


def holds_seen(columns: Columns, program: Program, parameters: PlantParameters) -> tuple[Held, ...]:
    """Measure each stretch that was held to its end."""
    size = columns["q"].size
    return tuple(_seen(columns, one, parameters) for one in hold_windows(program) if one.stop <= size)


def _seen(columns: Columns, window: slice, parameters: PlantParameters) -> Held:
    count, motor = parameters.sensors.joint_step or JOINT_STEP, parameters.sensors.motor_step or MOTOR_STEP
    of = {name: np.asarray(columns[name][window]) for name in ("q", "q_ref", "S", "u_A", "u_B", "theta_A", "theta_B")}
    granted = 0.5 if parameters.sensors.joint_step else 0.0  # a reading tells to half a count
    off = of["q"] - of["q_ref"]
    turned = [np.diff(np.rint(of[name] / motor)) != 0.0 for name in ("theta_A", "theta_B")]
    swing = float(np.ptp(of["q"]))
    return Held(
        start_s=float(columns["t"][window.start]),
        end_s=float(columns["t"][window.stop - 1]),
        q_ref=float(of["q_ref"][-1]),
        S_ref=float(columns["S_ref"][window.stop - 1]),
        q_swing=swing,
        q_swing_counts=swing / count,
        off=float(off.mean()),
        off_counts=max(float(np.abs(off).max()) / count - granted, 0.0),
        u_swing=float(max(np.ptp(of["u_A"]), np.ptp(of["u_B"]))),
        S_swing=float(np.ptp(of["S"])),
        moving_percent=100.0 * float((turned[0] | turned[1]).mean()),
    )
