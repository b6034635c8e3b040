"""The closed loop as it runs, linear and sampled: what becomes of a reference or a torque on the joint, tick by tick.

The plant between two ticks is exact (voltages are held), the laws are the tick's own functions where nothing clips
them: no lag of the sampling is left out, as the continuous models of ``robustness`` do. Friction, encoder counts and
dead zones are not in it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade, pid
from backend.control.decoupler import Decoupler, gains_at, select, stiffness_slope
from backend.tuning.linear_model import decoupling, linear_plant
from plant.interface import T_s
from plant.parameters import PlantParameters

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Rule = Callable[[Array, Array], tuple[Array, Array]]

_PLANT, _LAWS = 8, 8
_Q, _THETA_A, _THETA_B = 0, 2, 5
"""Places of the angles in the plant's state."""


class Inputs(NamedTuple):
    """Places of the inputs: references [rad, N·m/rad], a torque on the joint [N·m], and what a rejection adds.

    ``q_e`` [rad] on top of the position loop's output, ``q_off`` [rad] that its measurement is expected to be off.
    """

    q_ref: int = 0
    S_ref: int = 1
    tau_ext: int = 2
    q_e: int = 3
    q_off: int = 4


class Outputs(NamedTuple):
    """Places of the outputs [rad, N·m/rad]."""

    q: int = 0
    S: int = 1


INPUTS, OUTPUTS = Inputs(), Outputs()


@dataclass(frozen=True)
class Sampled:
    """A linear system of ticks: x ← A x + B w, y = C x + D w, all counted from rest."""

    A: Array
    B: Array
    C: Array
    D: Array

    def response(self, f: Array) -> Complex:
        """Frequency response at ``f`` (n,) [Hz], shape (n, outputs, inputs)."""
        z = np.exp(2j * np.pi * np.asarray(f) * T_s)
        resolvent = z[:, None, None] * np.eye(len(self.A)) - self.A
        states = np.linalg.solve(resolvent, np.broadcast_to(self.B, (z.size, *self.B.shape)))
        return np.asarray(self.C @ states + self.D)

    def played(self, w: Array) -> Array:
        """Return the outputs (ticks, outputs) under inputs (ticks, inputs), from rest."""
        x = np.zeros(len(self.A))
        y = np.empty((len(w), len(self.C)))
        for k, now in enumerate(w):
            y[k] = self.C @ x + self.D @ now
            x = self.A @ x + self.B @ now
        return y


@dataclass(frozen=True)
class SampledLoop:
    """The loop and its parts, about rest.

    ``plant``: voltages [V] and a torque on the joint [N·m] to q, θ_A, θ_B [rad]. ``law``: q_ref, S_ref, q, θ_A, θ_B,
    and what a rejection adds, to voltages. ``closed``: inputs as in ``INPUTS``, outputs as in ``OUTPUTS``. ``split``
    (2, 2): motor references [rad] per q_c and S_c; ``slope``: stiffness per angle of either motor.
    """

    plant: Sampled
    law: Sampled
    closed: Sampled
    split: Array
    slope: float


def sampled_loop(
    parameters: PlantParameters,
    tuning: cascade.CascadeTuning,
    S: float,
    *,
    position_loop: bool = True,
    plant: Sampled | None = None,
) -> SampledLoop:
    """Return the loop of ``tuning`` about rest at S [N·m/rad] and q = 0, as the plant's identified numbers let expect.

    Without ``position_loop`` the decoupler's geometry alone positions the joint. Of a bank the entry for S is in use.
    ``plant``: ``held_plant`` at S, where it is at hand.
    """
    d = tuning.decoupler
    plant = plant or held_plant(parameters, d, S)
    split, slope = decoupling(d, S), stiffness_slope(d, S)
    gains_q, gains_S = gains_at(tuning.schedule, select(tuning.schedule, -1.0, S))
    inner = tuning.motors

    def law(x: Array, w: Array) -> tuple[Array, Array]:
        q_ref, S_ref, q, theta_A, theta_B, q_e, q_off = w
        q_c, position = pid.step_i_p(gains_q, pid.IPState(x[6]), q_ref, q - q_off, 0.0)
        S_c, stiffness = pid.step_i_p(gains_S, pid.IPState(x[7]), S_ref, slope * (theta_A + theta_B), 0.0)
        if not position_loop:
            q_c, position, q_e = q_ref, pid.IPState(0.0), 0.0
        ref_A, ref_B = split @ (q_c + q_e, S_c)
        u_A, _, A = pid.step_i_pd(inner.A, pid.IPDState(*x[:3]), ref_A, theta_A, np.inf)
        u_B, _, B = pid.step_i_pd(inner.B, pid.IPDState(*x[3:6]), ref_B, theta_B, np.inf)
        return np.array([u_A, u_B]), np.concatenate([A, B, position, stiffness])

    def tick(x: Array, w: Array) -> tuple[Array, Array]:
        at = plant.C @ x[:_PLANT]
        u, laws = law(x[_PLANT:], np.concatenate([w[:2], at, w[3:]]))
        moved = plant.A @ x[:_PLANT] + plant.B @ np.append(u, w[INPUTS.tau_ext])
        return np.array([at[0], slope * (at[1] + at[2])]), np.concatenate([moved, laws])

    return SampledLoop(plant, _linear(law, _LAWS, 5 + 2), _linear(tick, _PLANT + _LAWS, len(INPUTS)), split, slope)


def _linear(rule: Rule, states: int, inputs: int) -> Sampled:
    """Return the matrices of a linear rule from state and input to output and next state."""
    of_states = [rule(x, np.zeros(inputs)) for x in np.eye(states)]
    of_inputs = [rule(np.zeros(states), w) for w in np.eye(inputs)]
    C, A = (np.column_stack([pair[place] for pair in of_states]) for place in (0, 1))
    D, B = (np.column_stack([pair[place] for pair in of_inputs]) for place in (0, 1))
    return Sampled(A, B, C, D)


def held_plant(parameters: PlantParameters, d: Decoupler, S: float) -> Sampled:
    """Return the plant about rest at S [N·m/rad] under inputs that are held over a tick."""
    from scipy.linalg import expm

    plant = linear_plant(parameters, d, S)
    states, inputs = plant.B.shape
    both = np.zeros((states + inputs, states + inputs))
    both[:states, :states], both[:states, states:] = plant.A, plant.B
    held = expm(both * T_s)
    C = np.eye(states)[[_Q, _THETA_A, _THETA_B]]
    return Sampled(held[:states, :states], held[:states, states:], C, np.zeros((len(C), inputs)))
