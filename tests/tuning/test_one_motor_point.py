"""Gains and lags that geometry, springs and motor loops predict, against their closed forms for like quadratic springs.

The motor loops give four lags λ. The joint lags by B_j/S. A tendon that pulls more turns its motor back until the
integral has made up for it: r_m² F'/(2 K_t k_i) later on both sides, which leaves q alone and delays S twice.
"""

import pytest

from backend.tuning.gains import make_motor_loops
from backend.tuning.robustness import linearize_one_motor
from plant.parameters import load_parameters


@pytest.mark.parametrize("S", [8.24, 10.55, 14.06])
@pytest.mark.parametrize("lam_motor", [0.06, 0.0854])
def test_gains_and_lags_are_those_of_the_closed_form(S: float, lam_motor: float) -> None:
    parameters = load_parameters("ideal")
    g, known, K_t = parameters.geometry, parameters.identified, parameters.motor.K_t
    found = linearize_one_motor(parameters, make_motor_loops(parameters, lam_motor), S)
    assert found.K_q == pytest.approx(g.r_m / (2.0 * g.r_j), rel=1e-6)
    assert pytest.approx(2.0 * g.r_j**2 * known.k[2] * g.r_m, rel=1e-6) == found.K_S
    assert found.T_q == pytest.approx(4.0 * lam_motor + g.B_j / S, rel=1e-6)
    k_i = known.T_m**2 / (known.K_m * lam_motor**3 * (4.0 * known.T_m - lam_motor))
    slope = S / (2.0 * g.r_j**2)
    assert pytest.approx(4.0 * lam_motor + g.r_m**2 * slope / (K_t * k_i), rel=1e-6) == found.T_S
