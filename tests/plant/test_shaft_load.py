"""A load at the gearbox shaft: closed form, energy, an integration of the test's own, what is refused."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant.dynamics import SUBSTEPS, PlantState, advance_state
from plant.interface import NO_LOAD, ZERO_VOLTS, PlantError, ShaftLoad, T_s
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.plant.test_dynamics import LAB, SLACK_THETA, own_rate

LOAD_NM = 0.375
SLACK = PlantState(0.0, 0.0, SLACK_THETA, 0.0, 0.0, SLACK_THETA, 0.0, 0.0)


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


def test_a_load_turns_a_free_motor_as_the_closed_form_and_its_work_is_accounted_for(ideal: PlantParameters) -> None:
    """J w' + B w = -load from rest; work of the load = kinetic energy + what the damping took."""
    motor = ideal.make_dynamics().motor_A
    x, T_m, ticks = SLACK, motor.J_m / motor.B_m, 1000
    speeds = []
    for tick in range(1, ticks + 1):
        x = advance_state(ideal.make_dynamics(), x, 0.0, 0.0, 0.0, T_s, SUBSTEPS, ShaftLoad(LOAD_NM, 0.0))
        t = tick * T_s
        assert x.omega_A == pytest.approx(-LOAD_NM / motor.B_m * -math.expm1(-t / T_m), rel=1e-9)
        assert x.theta_A - SLACK_THETA == pytest.approx(-LOAD_NM / motor.B_m * (t + T_m * math.expm1(-t / T_m)))
        speeds.append(x.omega_A)
    assert (x.theta_B, x.omega_B, x.q) == (SLACK_THETA, 0.0, 0.0)
    work = LOAD_NM * (SLACK_THETA - x.theta_A)
    lost = motor.B_m * np.trapezoid(np.square([0.0, *speeds]), dx=T_s)
    assert work == pytest.approx(0.5 * motor.J_m * x.omega_A**2 + lost, rel=1e-5)


def test_loads_with_tendons_and_friction_agree_with_an_independent_integration() -> None:
    """A load is more force on the reel, which friction feels as well."""
    p, x = LAB, PlantState(0.05, 0.0, 5.0, 0.0, 0.0, 5.0, 0.0, 0.0)
    own, B_m = np.array(x), LAB.motor.K_t / LAB.motor.K_m

    def loaded(t: float, y: np.ndarray, loads: ShaftLoad) -> np.ndarray:
        rate = np.array(own_rate(p, 3.0, 2.0, 0.0, t, y))
        for at, load in ((3, loads.load_A), (6, loads.load_B)):
            felt = load * (1.0 + p.motor.c1 * math.tanh(y[at] / p.motor.omega_smooth))
            rate[at] -= felt / (B_m * p.motor.T_m)
        return rate

    for loads in (ShaftLoad(LOAD_NM, 0.1), NO_LOAD, ShaftLoad(0.0, LOAD_NM)):
        for _ in range(300):
            x = advance_state(p.make_dynamics(), x, 3.0, 2.0, 0.0, T_s, SUBSTEPS, loads)
        end = solve_ivp(loaded, (0.0, 0.3), own, args=(loads,), method="LSODA", rtol=1e-9, atol=1e-11, max_step=2e-3)
        own = end.y[:, -1]
        assert np.array(x) == pytest.approx(own, rel=1e-4, abs=1e-4)


def test_the_simulator_loads_from_the_next_period_on_until_told_otherwise(ideal: PlantParameters) -> None:
    simulator = Simulator(ideal, x=SLACK)
    simulator.load(ShaftLoad(0.0, LOAD_NM))
    simulator.write(ZERO_VOLTS)
    assert simulator.x == advance_state(
        ideal.make_dynamics(), SLACK, 0.0, 0.0, 0.0, T_s, SUBSTEPS, ShaftLoad(0.0, LOAD_NM)
    )
    simulator.load(NO_LOAD)
    before = simulator.x
    simulator.write(ZERO_VOLTS)
    assert simulator.x == advance_state(ideal.make_dynamics(), before, 0.0, 0.0, 0.0, T_s, SUBSTEPS)


@pytest.mark.parametrize("load", [ShaftLoad(-0.1, 0.0), ShaftLoad(0.0, math.nan)])
def test_a_load_that_pushes_its_tendon_is_refused(ideal: PlantParameters, load: ShaftLoad) -> None:
    with pytest.raises(PlantError, match="loads pull"):
        Simulator(ideal).load(load)
