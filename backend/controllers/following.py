"""What the loops of the cascade follow: references as they are, or a model that a plan moves and what is left of it."""

import math
from typing import NamedTuple

from backend.controllers import governor, i_pd, motors, plan
from plant.compiled import compiled
from plant.interface import Measurement, T_s

PATIENCE_S = 0.1
"""Voltage clipped for so long [s] says that the budget is more than the motors have: the rest is planned with less."""

LESS = 0.9
"""What is left of the budget then."""

NEARLY = 1.2
"""Rest is granted at so many times what the position's integrator leaves alone: a reference half-way between two counts
is read half a count off wherever the joint is, and a little more by one of the two."""


LEFT_Q, LEFT_S = 4.0, 20.0
"""A joint that is off by so many times what is left alone has been pushed away, and comes back by the linear loops;
what hunts against stiction is nearer."""

OPEN = 0.2
"""With the position loop open the motors alone position the joint: rest is granted within so much of ``unseen_q``."""


class Following(NamedTuple):
    """What the references are followed by: a plan within ``budget`` [V] and the model it moves; 0 V: the governor.

    ``unseen_q`` [rad], ``unseen_S`` [N·m/rad]: errors that the outer integrators leave alone; with the governor from
    when the joint has arrived, so that it gets there by the linear loops alone. While both are nearly within, and the
    references stand, all integrators rest.
    """

    budget: float
    model: plan.Model
    unseen_q: float
    unseen_S: float


class DeadZones(NamedTuple):
    """Errors that the outer integrators leave alone in a tick, of position [rad] and stiffness [N·m/rad]."""

    q: float
    S: float


class Followed(NamedTuple):
    """What the loops of this tick work on.

    ``reference`` and the place that position, stiffness and both motors count from; what is added to the outer loops'
    sum, ``q_e`` and ``S_e``; the model's voltages [V]; whether the references are still on their way.
    """

    reference: governor.State
    q: float
    S: float
    theta_A: float
    theta_B: float
    q_e: float
    S_e: float
    u_A: float
    u_B: float
    moving: bool


@compiled
def governed(reference: governor.State, moving: bool) -> Followed:
    """Return references as the governor leaves them: the loops count from zero."""
    return Followed(reference, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, moving)


@compiled
def planned(p: plan.Now, by: plan.Driven) -> Followed:
    """Return the model of a plan: the loops count from it."""
    reference = governor.State(p.q, p.S)
    return Followed(reference, p.q, p.S, p.theta_A, p.theta_B, p.q_e, p.S, by.u_A, by.u_B, by.moving)


@compiled
def unseen(f: Following, e_q: float, e_S: float) -> bool:
    """Whether the errors of position [rad] and stiffness [N·m/rad] are both so small that they are left alone."""
    return abs(e_q) <= NEARLY * f.unseen_q and abs(e_S) <= f.unseen_S


@compiled
def near(f: Following, e_q: float, e_S: float) -> bool:
    """Whether errors of position [rad] and stiffness [N·m/rad] are those of a joint that has not been pushed away."""
    return abs(e_q) <= LEFT_Q * f.unseen_q and abs(e_S) <= LEFT_S * f.unseen_S


@compiled
def unseen_open(f: Following, e_q: float, e_S: float) -> bool:
    """As ``unseen``, for an error of the equilibrium [rad] where the position loop is open."""
    return abs(e_q) <= OPEN * f.unseen_q and abs(e_S) <= f.unseen_S


@compiled
def patient(clipped_s: float, reserve: float, clipped: bool, moving: bool) -> tuple[float, float]:
    """For how long voltage has been clipped on the way [s], and the share of the budget in use after this tick."""
    clipped_s = clipped_s + T_s if clipped and moving else 0.0
    reserve = reserve if moving else 1.0
    return (0.0, reserve * LESS) if clipped_s > PATIENCE_S else (clipped_s, reserve)


@compiled
def absolute(
    gains: motors.Gains, inner: motors.State, at: plan.Now, u_A: float, u_B: float, m: Measurement
) -> motors.State:
    """Motor loops that count from zero, in place of the model, and give its voltages [V] too."""
    return motors.State(
        i_pd.carried(gains.A, inner.A, m.theta_A - at.theta_A, at.theta_A, at.omega_A, u_A),
        i_pd.carried(gains.B, inner.B, m.theta_B - at.theta_B, at.theta_B, at.omega_B, u_B),
    )


@compiled
def dead_zones(f: Following, resting: bool, arrived: bool) -> DeadZones:
    """Dead zones of the outer integrators: everything at rest, nothing on the way."""
    if resting:
        return DeadZones(math.inf, math.inf)
    if arrived:
        return DeadZones(f.unseen_q, f.unseen_S)
    return DeadZones(0.0, 0.0)
