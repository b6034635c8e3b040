"""What the closed loops should answer to an excitation: of the models and gains that were in use. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade
from backend.experiments.results.in_force import InForce, NotPredictedError
from backend.experiments.results.response import Response, bandwidth
from backend.experiments.results.windows import Excited
from backend.tuning.robustness import decoupling
from backend.tuning.simulation import INPUTS, OUTPUTS, planned_response, sampled_loop
from plant.interface import T_s

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SLOWEST_HZ, FASTEST_HZ = 0.01, 100.0
"""Between these a predicted bandwidth is looked for; the faster is a tenth of the sampling."""

_GRID = 2000


@dataclass(frozen=True)
class Predicted:
    """The response to one excitation: at any frequency, until the loop's references ask for more than there is."""

    signal: str
    S: float
    tuning: cascade.CascadeTuning
    in_force: InForce

    def response(self, f: Array) -> Complex:
        """Return it at ``f`` (n,) [Hz]."""
        parameters, closed = self.in_force.parameters, self.in_force.position_loop
        if self.tuning.following.budget > 0.0:
            H = planned_response(parameters, self.tuning, self.S, f, position_loop=closed)
        else:
            H = sampled_loop(parameters, self.tuning, self.S, position_loop=closed).closed.response(f)
        output, to = (OUTPUTS.q, INPUTS.q_ref) if self.signal == "q" else (OUTPUTS.S, INPUTS.S_ref)
        return np.asarray(H[:, output, to])

    def bandwidth(self) -> float | None:
        """Where the gain falls to −3 dB of that at rest [Hz], as it is measured; None where it does not."""
        f = np.geomspace(SLOWEST_HZ, FASTEST_HZ, _GRID)
        found, _ = bandwidth(Response(self.signal, f, self.response(f)))
        return found


def predicted(in_force: InForce, excited: Excited, references: Array) -> Predicted:
    """Return what is expected of an excitation whose references (n, 2) were these. Raises NotPredictedError."""
    tuning = in_force.gains_at(excited.window.start)
    _, S = in_force.references_before(excited.window.start)
    budget = tuning.following.budget
    if budget > 0.0:
        asked = asked_voltage(tuning, S, references)
        if asked > budget:
            raise NotPredictedError(
                f"the excitation asks the plan for {asked:.1f} V of its {budget:g} V: take a smaller amplitude"
            )
    return Predicted(excited.signal, S, tuning, in_force)


def asked_voltage(tuning: cascade.CascadeTuning, S: float, references: Array) -> float:
    """Largest |u_d| + |u_c| [V] with which the axes of a plan keep up with references (n, 2): (T θ'' + θ')/K."""
    model = tuning.following.model
    theta = (references - references[0]) @ decoupling(tuning.decoupler, S).T
    axes = np.column_stack([theta[:, 0] - theta[:, 1], theta[:, 0] + theta[:, 1]]) / 2.0
    rate = np.gradient(axes, T_s, axis=0)
    turning = np.gradient(rate, T_s, axis=0)
    u = (max(model.T_A, model.T_B) * turning + rate) / min(model.K_A, model.K_B)
    return float(np.abs(u).sum(axis=1).max())
