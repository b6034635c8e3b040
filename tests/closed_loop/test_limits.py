"""The limits of the cascade on the simulated plant: what they prevent, and that the loop comes back from them."""

from dataclasses import dataclass

import numpy as np
import pytest

from backend.control.decoupler import Envelope
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import Trajectory, simulate_cascade
from plant.parameters import PlantParameters, load_parameters

WITHOUT = Envelope(F_floor=-1e3, F_ceiling=1e3, q_max=1e3)
TICKS = 14_000


@dataclass(frozen=True)
class Push:
    """A push at (q, S): it grows over ``ramp_s``, is held until 8 s and goes as it came."""

    q: float
    S: float
    force_N: float
    ramp_s: float

    def play(self, parameters: PlantParameters, envelope: Envelope | None = None) -> Trajectory:
        tuning = make_cascade_tuning(parameters, TuningParameters())
        tuning = tuning if envelope is None else tuning._replace(envelope=envelope)
        t = 1e-3 * np.arange(TICKS)
        F_push = np.interp(t, [1.0, 1.0 + self.ramp_s, 8.0, 8.0 + self.ramp_s], [0.0, self.force_N, self.force_N, 0.0])
        return simulate_cascade(parameters, tuning, np.full(TICKS, self.q), np.full(TICKS, self.S), F_push)


def least_tension(trajectory: Trajectory) -> float:
    return float(min(trajectory.F_A.min(), trajectory.F_B.min()))


@pytest.mark.parametrize("force_N", [24.0, -24.0])
@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_a_push_that_would_slacken_a_tendon_winds_both_up(name: str, force_N: float) -> None:
    parameters = load_parameters(name)
    push = Push(q=0.0, S=8.0, force_N=force_N, ramp_s=2.0)
    assert least_tension(push.play(parameters, WITHOUT)) <= 0.0, "the push has to matter"
    held = push.play(parameters)
    assert least_tension(held) > 2.0
    assert float(max(held.F_A.max(), held.F_B.max())) < 50.0
    # At the end of the push both references hold again: nothing has wound up.
    assert held.q[-1] == pytest.approx(0.0, abs=2.0 * 2.0 * np.pi / 4000)
    assert held.S[-1] == pytest.approx(8.0, abs=0.01)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_a_push_that_would_make_a_spring_solid_unwinds_both(name: str) -> None:
    parameters = load_parameters(name)
    push = Push(q=0.0, S=15.0, force_N=12.0, ramp_s=5.0)
    assert push.play(parameters, WITHOUT).tripped_at >= 0, "the push has to matter"
    held = push.play(parameters)
    assert held.tripped_at == -1
    assert held.S[7900] < 14.9
    assert held.S[-1] == pytest.approx(15.0, abs=0.02)


def test_the_equilibrium_stays_inside_the_joints_range() -> None:
    """Held against a push at the end of its range, the joint must not be aimed at what lies beyond its stop."""
    parameters = load_parameters("ideal")
    q_max = parameters.geometry.q_max
    push = Push(q=1.4, S=10.0, force_N=-30.0, ramp_s=3.0)

    def furthest_aim(trajectory: Trajectory) -> float:
        r_m, r_j = parameters.geometry.r_m, parameters.geometry.r_j
        return float(np.max(r_m * (trajectory.theta_A_ref - trajectory.theta_B_ref) / (2.0 * r_j)))

    assert furthest_aim(push.play(parameters, WITHOUT)) > q_max, "the push has to matter"
    held = push.play(parameters)
    assert furthest_aim(held) < q_max
    assert held.tripped_at == -1
    assert held.q[-1] == pytest.approx(1.4, abs=1e-3)
