"""The whole closed loop, simulated: what the tracking experiment must show, bumpless changes, mirror symmetry."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import simulate_cascade
from plant.parameters import Asymmetry, load_parameters
from tests.closed_loop.quality import HIGH, STEPS, assess, references


@pytest.mark.parametrize(
    ("name", "overshoot", "stiffness", "tension"),
    [("ideal", 1.0, 0.1, 5.0), ("lab", 2.0, 0.3, 4.0), ("lab-stick", 2.0, 0.3, 4.0)],
)
@pytest.mark.parametrize("lambdas", [TuningParameters(lam_q=0.5, lam_S=0.5), TuningParameters()])
def test_tracking(name: str, lambdas: TuningParameters, overshoot: float, stiffness: float, tension: float) -> None:
    parameters = load_parameters(name)
    q_ref, S_ref = references(STEPS)
    trajectory = simulate_cascade(parameters, make_cascade_tuning(parameters, lambdas), q_ref, S_ref)
    quality = assess(trajectory, q_ref, S_ref)
    assert trajectory.tripped_at == -1
    assert quality.overshoot_percent < overshoot
    assert quality.stiffness_deviation < stiffness
    assert quality.least_tension > tension


def test_naive_cascade_reproduces_the_figures_of_the_method_page() -> None:
    """Without governor, λ = 0.5 touches 10 V harmlessly: 1.9 s to 90 % of a 2π/3 step, no overshoot."""
    parameters = load_parameters("ideal")
    q_ref, S_ref = references(((-HIGH, 10.0, 1.0), (HIGH, 10.0, 8.0)))
    tuning = make_cascade_tuning(parameters, TuningParameters(lam_q=0.5, lam_S=0.5))._replace(omega_max=1e9)
    trajectory = simulate_cascade(parameters, tuning, q_ref, S_ref)
    reached = int(np.argmax(trajectory.q > -HIGH + 0.9 * 2.0 * HIGH)) - 1000
    assert reached == pytest.approx(1900, abs=30)
    assert np.max(np.abs(trajectory.u_A)) == 10.0
    assert assess(trajectory, q_ref, S_ref).overshoot_percent < 0.1


@settings(max_examples=15)
@given(st.lists(st.tuples(st.floats(-1.2, 1.2), st.floats(8.0, 14.0)), min_size=2, max_size=4))
def test_swapping_sides_and_negating_q_mirrors_the_run(targets: list[tuple[float, float]]) -> None:
    parameters = replace(load_parameters("lab"), sensors=load_parameters("ideal").sensors)
    parameters = replace(parameters, asymmetry=Asymmetry(1.03, 0.97, 0.98, 1.02))
    mirrored = replace(parameters, asymmetry=Asymmetry(0.97, 1.03, 1.02, 0.98))
    tuning = make_cascade_tuning(parameters, TuningParameters())
    q_ref, S_ref = references(tuple((q, S, 1.0) for q, S in targets))
    run_A, run_B = simulate_cascade(parameters, tuning, q_ref, S_ref), simulate_cascade(mirrored, tuning, -q_ref, S_ref)
    for mine, other in (("q", "q"), ("theta_A", "theta_B"), ("F_A", "F_B"), ("u_A", "u_B")):
        sign = -1.0 if mine == "q" else 1.0
        assert getattr(run_A, mine) == pytest.approx(sign * getattr(run_B, other), abs=1e-7)
    assert pytest.approx(run_B.S, abs=1e-7) == run_A.S
