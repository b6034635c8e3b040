"""When an identification does what, and what it plays, from its first tick to its last one. Pure.

It is read from the way of the motor references through the program that the loop is sent (``way``), which the
forecast of the joint's range follows too: parts, times and pictures come from one place.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control.motion_primitives import PRETENSION_N, ZERO_VOLTS_S
from backend.experiments.forecasts.stretches import Stage, Stretch, titled
from backend.experiments.forecasts.way import Angles, Start, Way
from backend.experiments.plans.plan import IdentificationPlan
from backend.realtime.program import Law, Mode, Program
from plant.dynamics import tension
from plant.interface import T_s
from plant.parameters import PlantParameters

Array = NDArray[np.float64]

POINTS = 400
"""So many over the whole, besides the corners of what is asked for."""

CORNERS = 4000
"""Most corners that are drawn; with more the line is a solid band at any width."""


@dataclass(frozen=True)
class Timetable:
    """The stretches of an identification, and signals (n,) over ``t`` (n,) [s] since its first tick.

    ``signals`` are by the names of the sample's columns and in their units; NaN where the plan does not say: motor
    references from the zero volts before a step to the end of braking after it. ``theta_A_ref`` is without the trim of
    the force loop, ``u_A`` the voltage of steps for both motors, 0 where motor loops decide. ``F_A`` is the tension
    that the references give at q = 0.
    """

    law: Law
    stretches: tuple[Stretch, ...]
    t: Array
    signals: dict[str, Array]

    @property
    def duration_s(self) -> float:
        """Length from the first tick to the last one [s]."""
        return self.stretches[-1].end * T_s

    def title(self, stretch: Stretch) -> str:
        """Name the set point of a stretch."""
        return titled(self.law, stretch.set_point)


def timetable(plan: IdentificationPlan, parameters: PlantParameters, references: Angles | None = None) -> Timetable:
    """Go through an identification that begins with motor references [rad]; without any, in pretension."""
    way = Way(parameters, Start(Mode.PRETENSION, 0.0, (0.0, 0.0), (0.0, 0.0)))
    way.at = way.wound(PRETENSION_N) if references is None else references
    program = plan.program()
    way.play(program)
    return of_way(way, program, parameters)


def of_way(way: Way, program: Program, parameters: PlantParameters) -> Timetable:
    """Return the timetable of the program that a way was played by last."""
    every = _every_tick(way, program)
    kept = _kept(every)
    signals = {name: values[kept] for name, values in every.items()}
    if program.law is Law.TENSION_SWEEP:
        spring, r_m = parameters.identified_spring("A"), parameters.geometry.r_m
        signals["F_A"] = np.array([tension(spring, r_m * angle) for angle in signals["theta_A_ref"]], dtype=np.float64)
    return Timetable(program.law, tuple(way.stretches), (kept + 1) * np.float64(T_s), signals)


def _every_tick(way: Way, program: Program) -> dict[str, Array]:
    """Return what is asked for in every tick of a program."""
    theta_A, theta_B, _ = way.references()
    last = way.stretches[-1].end
    theta_A, theta_B = theta_A[-last:].copy(), theta_B[-last:].copy()
    if program.law is not Law.MOTOR_STEPS:
        return {"theta_A_ref": theta_A, "theta_B_ref": theta_B}
    u = np.zeros(last)
    for stretch in way.stretches:
        if stretch.stage is Stage.EXCITING:
            u[stretch.begin : stretch.end] = stretch.set_point
            theta_A[stretch.begin - round(ZERO_VOLTS_S / T_s) : stretch.end] = np.nan
        elif stretch.stage is Stage.BRAKING:
            theta_A[stretch.begin : stretch.end] = np.nan
    return {"u_A": u, "theta_A_ref": theta_A}


def _kept(signals: dict[str, Array]) -> NDArray[np.int64]:
    """Return the ticks to draw: an even grid, and each that begins or ends a straight piece of what is asked for."""
    ticks = next(iter(signals.values())).size
    corner = np.zeros(ticks, dtype=bool)
    corner[[0, -1]] = True
    for values in signals.values():
        bent = np.abs(np.diff(values, 2)) > 1e-9
        gone = np.isnan(values)
        bent |= (gone[2:] != gone[1:-1]) | (gone[:-2] != gone[1:-1])
        corner[1:-1] |= bent
    if np.count_nonzero(corner) > CORNERS:
        corner[:] = False
        corner[:: max(1, ticks // CORNERS)] = True
        corner[-1] = True
    corner[:: max(1, ticks // POINTS)] = True
    return np.flatnonzero(corner)
