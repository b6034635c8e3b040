"""A wall in the joint's way: closed forms of an impact, energy, what is refused, and nothing changed without one."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from plant.dynamics import (
    K_LEAST,
    NO_OBSTACLE,
    SUBSTEPS,
    Dynamics,
    Joint,
    Obstacle,
    PlantState,
    advance_state,
    contact_force,
    largest_wall_damping,
    largest_wall_stiffness,
    require_possible_wall,
)
from plant.interface import NO_LOAD, MotorCommand, PlantError, T_s
from plant.parameters import load_parameters
from plant.simulator import Simulator
from tests.plant.test_dynamics import energy

LAB = load_parameters("lab")
SLACK_THETA = -200.0
H = T_s / SUBSTEPS
WALL = Obstacle(1.0, 0.3, 2e4, 0.0)


def free() -> Dynamics:
    """The plant with its tendons slack and no friction at the joint: a mass m = J_j/r_j² at r_j."""
    plant = LAB.make_dynamics()
    return plant._replace(joint=plant.joint._replace(B_j=0.0))


def mass(joint: Joint) -> float:
    return joint.J_j / joint.r_j**2


def thrown(q: float, q_dot: float) -> PlantState:
    return PlantState(q, q_dot, SLACK_THETA, 0.0, 0.0, SLACK_THETA, 0.0, 0.0)


def flight(wall: Obstacle, q_dot: float, start: float = 0.0) -> tuple[np.ndarray, PlantState]:
    """Forces [N] in each integration step from just before the wall until well after it, and where it has come to."""
    plant, x = free(), thrown(wall.q_wall - wall.side * start, wall.side * q_dot)
    forces = []
    for _ in range(4000):
        x = advance_state(plant, x, 0.0, 0.0, 0.0, H, 1, NO_LOAD, wall)
        forces.append(contact_force(wall, plant.joint, x.q, x.q_dot))
        if len(forces) > 3 and forces[-1] == 0.0 and x.q_dot * wall.side < 0.0:
            break
    return np.array(forces), x


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("k", "q_dot"), [(2e3, 0.5), (2e4, 2.0), (3.3e4, 3.0)])
def test_a_free_mass_on_an_undamped_wall_hits_and_leaves_as_a_half_sine(side: float, k: float, q_dot: float) -> None:
    wall = Obstacle(side, side * 0.3, k, 0.0)
    joint = free().joint
    for start in (0.0, 0.3 * H * q_dot, 0.7 * H * q_dot):
        forces, x = flight(wall, q_dot, start)
        v = joint.r_j * q_dot
        assert np.all(side * forces <= 0.0)
        assert np.abs(forces).max() == pytest.approx(v * math.sqrt(k * mass(joint)), rel=4e-3)
        duration_s = H * np.count_nonzero(forces)
        assert duration_s == pytest.approx(math.pi * math.sqrt(mass(joint) / k), abs=1.1 * H)
        assert side * x.q_dot == pytest.approx(-q_dot, rel=3e-3)
        assert H * np.abs(forces).sum() == pytest.approx(2.0 * mass(joint) * v, rel=5e-3)


@pytest.mark.parametrize("c", [0.5, 3.0, 7.0])
@pytest.mark.parametrize("q_dot", [0.5, 2.0])
def test_damping_gives_back_the_speed_of_the_closed_form_whatever_the_stiffness(c: float, q_dot: float) -> None:
    r_j, v = LAB.geometry.r_j, LAB.geometry.r_j * q_dot

    def left(w: float) -> float:
        return (-c * w - math.log1p(-c * w)) - (c * v - math.log1p(c * v))

    back = brentq(left, 0.0, min(v, (1.0 - 1e-12) / c))
    for k in (3e3, 3e4):
        _, x = flight(Obstacle(1.0, 0.3, k, c), q_dot)
        assert -r_j * x.q_dot == pytest.approx(back, rel=5e-3)


@settings(max_examples=200, deadline=None)
@given(
    st.floats(K_LEAST, 3.3e4), st.floats(0.0, 7.0), st.floats(0.01, 20.0), st.floats(0.0, 1.0), st.sampled_from([-1, 1])
)
def test_no_wall_ever_gives_more_than_it_took(k: float, c: float, q_dot: float, part: float, side: int) -> None:
    """Within the error of one step in which the joint touches: a thousandth of the energy, at any place in the step."""
    wall = Obstacle(float(side), 0.2 * side, k, c)
    plant, x = free(), thrown(0.2 * side - side * part * H * q_dot, side * q_dot)
    before = energy(plant, x)
    for _ in range(400):
        x = advance_state(plant, x, 0.0, 0.0, 0.0, T_s, SUBSTEPS, NO_LOAD, wall)
        depth = max(plant.joint.r_j * wall.side * (x.q - wall.q_wall), 0.0)
        assert energy(plant, x) + 0.5 * k * depth**2 <= 1.003 * before


@given(st.floats(0.0, 1.5), st.floats(-30.0, 30.0), st.floats(0.0, 7.0), st.sampled_from([-1.0, 1.0]))
def test_a_wall_pushes_away_from_itself_or_not_at_all(q: float, q_dot: float, c: float, side: float) -> None:
    wall = Obstacle(side, 0.4, 2e4, c)
    force = contact_force(wall, LAB.make_dynamics().joint, q, q_dot)
    assert side * force <= 0.0
    assert (force == 0.0) or side * (q - 0.4) > 0.0
    assert contact_force(NO_OBSTACLE, LAB.make_dynamics().joint, q, q_dot) == 0.0


def test_the_steps_are_stable_at_the_bounds_and_say_where_they_come_from() -> None:
    joint, F_max = LAB.make_dynamics().joint, LAB.safety.F_max
    assert math.sqrt(largest_wall_stiffness(joint, H) / mass(joint)) * H == pytest.approx(0.15)
    assert largest_wall_damping(joint, F_max, H) * F_max * H / mass(joint) == pytest.approx(1.0)
    wall = Obstacle(1.0, 0.3, largest_wall_stiffness(joint, H), largest_wall_damping(joint, F_max, H))
    pressed, x = 50.0, thrown(0.29, 3.0)
    plant = LAB.make_dynamics()
    for _ in range(400):
        x = advance_state(plant, x, 0.0, 0.0, joint.r_j * pressed, T_s, SUBSTEPS, NO_LOAD, wall)
    assert contact_force(wall, joint, x.q, x.q_dot) == pytest.approx(-pressed, rel=1e-6)


@pytest.mark.parametrize(
    ("wall", "told"),
    [
        (WALL._replace(side=0.5), "side of the wall: 0.5 is neither 1"),
        (WALL._replace(side=math.nan), "side of the wall: nan is neither 1"),
        (WALL._replace(q_wall=1.6), "angle of the wall: 1.6\u202frad is outside -1.5708 to 1.5708\u202frad"),
        (WALL._replace(q_wall=math.nan), "angle of the wall: nan\u202frad"),
        (
            WALL._replace(k_wall=4e4),
            "stiffness of the wall: 40000 N/m is outside 100 to 33280 N/m; the simulator's step",
        ),
        (WALL._replace(k_wall=50.0), "stiffness of the wall: 50 N/m is outside 100"),
        (WALL._replace(k_wall=math.inf), "stiffness of the wall: inf N/m"),
        (WALL._replace(c_wall=-0.1), "damping of the wall: -0.1 s/m is outside 0 to 7.39556 s/m"),
        (WALL._replace(c_wall=8.0), "damping of the wall: 8 s/m is outside"),
        (
            WALL._replace(q_wall=-0.1),
            "the joint stands at 0\u202frad, in a wall at -0.1\u202frad: bring it below that first",
        ),
        (WALL._replace(q_wall=0.1, side=-1.0), "in a wall at 0.1\u202frad: bring it above that first"),
    ],
)
def test_a_wall_that_cannot_be_is_refused_and_the_one_before_stays(wall: Obstacle, told: str) -> None:
    simulator = Simulator(LAB)
    simulator.obstacle(WALL)
    with pytest.raises(PlantError) as refused:
        simulator.obstacle(wall)
    assert told in str(refused.value)
    assert simulator.simulated.field("obstacle").get() == WALL
    require_possible_wall(WALL, LAB.make_dynamics().joint, LAB.safety.F_max, LAB.geometry.q_max, H)


def test_it_comes_and_goes_in_flight_and_what_it_presses_is_measured() -> None:
    simulator = Simulator(LAB)
    simulator.open()
    assert simulator.read().F_wall == 0.0
    simulator.obstacle(WALL._replace(q_wall=0.05))
    simulator.push(20.0)
    for _ in range(400):
        simulator.write(MotorCommand(0.0, 0.0))
    m = simulator.read()
    assert m.F_wall == pytest.approx(-20.0, rel=1e-3)
    assert m.q == pytest.approx(0.05 + 20.0 / 2e4 / LAB.geometry.r_j, abs=2e-3)
    simulator.obstacle(None)
    for _ in range(100):
        simulator.write(MotorCommand(0.0, 0.0))
    assert (simulator.read().F_wall, simulator.read().q > 0.2) == (0.0, True)


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_a_wall_that_is_never_touched_changes_no_bit(name: str) -> None:
    bare, walled = Simulator(load_parameters(name), seed=3), Simulator(load_parameters(name), seed=3)
    walled.obstacle(WALL._replace(q_wall=1.57))
    random = np.random.default_rng(5)
    for tick in range(5000):
        if tick % 200 == 0:
            command = MotorCommand(*random.uniform(0.0, 2.0, 2))
            for simulator in (bare, walled):
                simulator.push(float(tick % 7))
        for simulator in (bare, walled):
            simulator.write(command)
        assert bare.x == walled.x
        assert bare.read() == walled.read()
    assert bare.x.q != 0.0
