"""Quiet at rest: what joint, stiffness, motors and voltages do in a hold of 20 s, by the simulator's true states."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from backend.controllers import cascade, decoupler
from backend.controllers.dead_zone import beyond
from backend.controllers.goals import References
from backend.tuning.closed_loop import at_rest, rig_of
from backend.tuning.gains import cascade_tuning
from backend.tuning.models import Lambdas
from backend.tuning.plan_budget import usual_budget
from plant.interface import Measurement
from plant.parameters import PlantParameters, load_parameters
from tests.closed_loop import true_states
from tests.closed_loop.true_states import TrueStates

LAMBDAS = Lambdas(lam_q=0.355, lam_S=0.345)
COUNT, MOTOR_COUNT = 2.0 * math.pi / 4000.0, 2.0 * math.pi / 8000.0
HOLD_S = 20
WAYS = (
    ((-0.7, 12.0), (0.3, 10.0)),
    ((0.0, 10.0), (0.5, 10.0)),
    ((0.3, 8.0), (0.3, 14.0)),
    ((1.0, 14.0), (-1.0, 9.0)),
    ((0.2, 12.0), (0.2, 13.0)),
    ((-1.2, 9.0), (0.7, 13.0)),
    ((-0.6, 9.0), (-380.55 * COUNT, 14.8)),
)
"""From, to: position [rad] and stiffness [N·m/rad]; the last of them half-way between two counts."""


class Hold(NamedTuple):
    """Peak to peak of the joint and its largest error [joint counts], of voltages [V], stiffness [N·m/rad] and motors
    [motor counts]; share of its ticks in which a motor turns by more than a hundredth of a count."""

    q: float
    off: float
    u: float
    S: float
    theta: float
    moving: float


def held(states: TrueStates, since: int, q_ref: float) -> Hold:
    part = TrueStates(*(column[since : since + 1000 * HOLD_S] for column in states))
    turned = np.abs(np.diff([part.theta_A, part.theta_B])).max(axis=0)
    return Hold(
        float(np.ptp(part.q)) / COUNT,
        float(np.max(np.abs(part.q - q_ref))) / COUNT,
        float(max(np.ptp(part.u_A), np.ptp(part.u_B))),
        float(np.ptp(part.S)),
        float(max(np.ptp(part.theta_A), np.ptp(part.theta_B))) / MOTOR_COUNT,
        float(np.mean(turned > 0.01 * MOTOR_COUNT)),
    )


def after_move(
    plant: PlantParameters, way: tuple[tuple[float, float], tuple[float, float]], budget: float, settled_s: int
) -> Hold:
    (q_0, S_0), (q, S) = way
    ticks = 1000, 1000 * (settled_s + HOLD_S)
    tuning = cascade_tuning(plant, LAMBDAS, u_plan=budget)
    states = true_states.run(plant, tuning, np.repeat([q_0, q], ticks), np.repeat([S_0, S], ticks))
    return held(states, 1000 * (1 + settled_s), q)


def worst(holds: list[Hold]) -> Hold:
    return Hold(*np.max(holds, axis=0).tolist())


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
def test_a_hold_is_quiet(name: str) -> None:
    """On friction that sticks, and on smoothed friction, along which motors creep to where they stand."""
    plant = load_parameters(name)
    hold = worst([after_move(plant, way, usual_budget(plant), 5) for way in WAYS])
    assert hold.q <= 0.3
    assert hold.off <= 1.0
    assert hold.u <= 0.15
    assert hold.S <= 0.005
    assert hold.moving == 0.0
    assert hold.theta <= (0.5 if name == "lab-stick" else 2.0)


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
def test_a_hold_from_rest_is_quiet(name: str) -> None:
    plant = load_parameters(name)
    tuning = cascade_tuning(plant, LAMBDAS, u_plan=usual_budget(plant))
    for q, S in ((0.3, 10.0), (-0.7001, 14.0), (1.1, 8.5)):
        states = true_states.run(plant, tuning, np.full(30_000, q), np.full(30_000, S))
        hold = held(states, 10_000, q)
        assert hold.q <= 0.3
        assert hold.off <= 1.0
        assert hold.u <= 0.15
        assert hold.S <= 0.005
        assert hold.moving == 0.0


def test_the_paper_s_law_hunts() -> None:
    """What the plan's rest is compared with: without dead zones the motors never stand on smoothed friction."""
    lab = load_parameters("lab")
    hold = after_move(lab, WAYS[0], 0.0, 10)
    assert hold.q > 1.0
    assert hold.u > 0.4
    assert hold.moving > 0.1


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
def test_a_push_at_rest_is_pushed_back(name: str) -> None:
    """Integrators that rest begin again: joint and stiffness come back to where they rested, within a dead zone."""
    plant = load_parameters(name)
    tuning = cascade_tuning(plant, LAMBDAS, u_plan=usual_budget(plant))
    F_push = np.zeros(30_000)
    F_push[10_000:] = 5.0
    states = true_states.run(plant, tuning, np.full(F_push.size, 0.3), np.full(F_push.size, 12.0), F_push)
    assert np.max(np.abs(states.q[10_000:11_000] - 0.3)) > 5.0 * COUNT
    assert np.max(np.abs(states.q[20_000:] - 0.3)) <= 1.5 * COUNT
    assert np.max(np.abs(states.S[20_000:] - states.S[9999])) <= 0.1


@pytest.mark.parametrize(
    ("position_loop", "rate", "off", "rests"),
    [
        (True, 0.0, 0.0, True),
        (False, 0.0, 0.0, False),
        (True, 0.001, 0.0, False),
        (True, 0.0, 0.58 * COUNT, True),
        (True, 0.0, -0.62 * COUNT, False),
    ],
)
def test_motors_rest_where_position_and_stiffness_are_as_wanted(
    position_loop: bool, rate: float, off: float, rests: bool
) -> None:
    """Not where nothing else positions the joint, nor where a reference moves, however slowly."""
    lab = load_parameters("lab")
    tuning = cascade_tuning(lab, LAMBDAS, u_plan=usual_budget(lab))
    theta_A, theta_B = decoupler.motor_positions(tuning.decoupler, 0.3, 10.0)
    _, law = at_rest(rig_of(lab), tuning, 0.3, 10.0)
    m = Measurement(0.3 + off, theta_A + MOTOR_COUNT, theta_B - MOTOR_COUNT, 17.0, 17.0, 10.0, 0.0, 0.0)
    integrals = []
    for k in range(600):
        _, law = cascade.step(tuning, law, References(0.3 + rate * 1e-3 * k, 10.0), position_loop, m)
        integrals.append(law.motors.A.integral)
    assert (np.ptp(integrals[500:]) < 1e-9) == rests


@pytest.mark.parametrize(("e", "seen"), [(0.0, 0.0), (0.3, 0.0), (-0.5, 0.0), (0.7, 0.2), (-2.0, -1.5)])
def test_what_an_integrator_sees_begins_at_the_edge_of_its_dead_zone(e: float, seen: float) -> None:
    assert beyond(e, 0.5) == pytest.approx(seen, abs=1e-15)
    assert beyond(e, 0.0) == e
    assert beyond(e, math.inf) == 0.0
