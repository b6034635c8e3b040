"""Holds of 20 s in the true states of the simulator."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from backend.control import cascade, decoupler
from backend.control.pid import apply_dead_zone
from backend.control.trajectory import LoopReferences
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.preview import usual_budget
from backend.tuning.simulation import at_rest, make_simulated_rig
from plant.interface import Measurement
from plant.parameters import PlantParameters, load_parameters
from tests.closed_loop import true_states
from tests.closed_loop.true_states import TrueStates

LAMBDAS = TuningParameters(lam_q=0.355, lam_S=0.345)
COUNT, MOTOR_COUNT = 2.0 * math.pi / 4000.0, 2.0 * math.pi / 8000.0
HOLD_S = 20
MOVES = (
    ((-0.7, 12.0), (0.3, 10.0)),
    ((0.0, 10.0), (0.5, 10.0)),
    ((0.3, 8.0), (0.3, 14.0)),
    ((1.0, 14.0), (-1.0, 9.0)),
    ((0.2, 12.0), (0.2, 13.0)),
    ((-1.2, 9.0), (0.7, 13.0)),
    ((-0.6, 9.0), (-380.55 * COUNT, 14.8)),
)
"""Start and end: position [rad] and stiffness [N·m/rad]; the last end is half-way between two counts."""


class Hold(NamedTuple):
    """Peak-to-peak values of a hold and the largest joint error.

    Joint in joint counts, voltages in V, stiffness in N·m/rad, motors in motor counts; ``moving`` is the share of
    ticks in which a motor turns by more than a hundredth of a count.
    """

    q: float
    off: float
    u: float
    S: float
    theta: float
    moving: float


def measure_hold(states: TrueStates, since: int, q_ref: float) -> Hold:
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
    plant: PlantParameters,
    move: tuple[tuple[float, float], tuple[float, float]],
    budget: float,
    settled_s: int,
    *,
    rests: bool = True,
) -> Hold:
    (q_0, S_0), (q, S) = move
    ticks = 1000, 1000 * (settled_s + HOLD_S)
    tuning = make_cascade_tuning(plant, LAMBDAS, u_plan=budget)
    if not rests:
        tuning = tuning._replace(
            reference_tracking=tuning.reference_tracking._replace(dead_zone_q=0.0, dead_zone_S=0.0)
        )
    states = true_states.run(plant, tuning, np.repeat([q_0, q], ticks), np.repeat([S_0, S], ticks))
    return measure_hold(states, 1000 * (1 + settled_s), q)


def worst(holds: list[Hold]) -> Hold:
    return Hold(*np.max(holds, axis=0).tolist())


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
@pytest.mark.parametrize("motion", ["time-optimal", "lambda"])
def test_the_joint_is_at_rest_in_a_hold_after_a_move(name: str, motion: str) -> None:
    """The friction is static, or smoothed so that motors creep to rest.

    In `lambda` motion the joint needs about 10 λ_q longer.
    """
    plant = load_parameters(name)
    budget, settled_s = (usual_budget(plant), 5) if motion == "time-optimal" else (0.0, 8)
    hold = worst([after_move(plant, move, budget, settled_s) for move in MOVES])
    assert hold.q <= 0.3
    assert hold.off <= 1.0
    assert hold.u <= 0.15
    assert hold.S <= 0.005
    assert hold.moving == 0.0


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
@pytest.mark.parametrize("u_plan", [0.0, 8.5])
def test_the_joint_stays_at_rest_in_a_hold_from_rest(name: str, u_plan: float) -> None:
    plant = load_parameters(name)
    tuning = make_cascade_tuning(plant, LAMBDAS, u_plan=u_plan)
    for q, S in ((0.3, 10.0), (-0.7001, 14.0), (1.1, 8.5)):
        states = true_states.run(plant, tuning, np.full(30_000, q), np.full(30_000, S))
        hold = measure_hold(states, 10_000, q)
        assert hold.q <= 0.3
        assert hold.off <= 1.0
        assert hold.u <= 0.15
        assert hold.S <= 0.005
        assert hold.moving == 0.0


@pytest.mark.parametrize("budget", [0.0, 8.5])
def test_loops_without_dead_zones_oscillate_in_a_hold(budget: float) -> None:
    """Comparison: without dead zones, motors never come to rest."""
    hold = after_move(load_parameters("lab"), MOVES[0], budget, 10, rests=False)
    assert hold.q > 1.0
    assert hold.u > 0.4
    assert hold.moving > 0.1


def test_dead_zones_do_not_change_the_step_response_in_lambda_motion() -> None:
    """Steps follow y/r = 1/(λ s + 1)², which reaches 90 % after 3.890 λ."""
    lam = 0.5
    plant = load_parameters("lab")
    without_friction = replace(plant, motor=replace(plant.motor, c0=0.0, c1=0.0))
    for degrees in (1.0, 5.0, 20.0):
        for known in (plant, without_friction):
            tuning = make_cascade_tuning(known, TuningParameters(lam_q=lam))
            without_dead_zones = tuning._replace(
                reference_tracking=tuning.reference_tracking._replace(dead_zone_q=0.0, dead_zone_S=0.0)
            )
            q_ref = np.repeat([0.0, math.radians(degrees)], (1000, 6000))
            t_90 = []
            for law in (tuning, without_dead_zones):
                q = true_states.run(known, law, q_ref, np.full(q_ref.size, 10.0)).q[1000:]
                t_90.append(np.argmax(q - q[0] >= 0.9 * (q_ref[-1] - q[0])) / 1000)
            assert t_90[0] == pytest.approx(t_90[1], rel=0.03)
            if known is without_friction and degrees >= 5.0:
                assert t_90[0] == pytest.approx(3.890 * lam, rel=0.03)


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
@pytest.mark.parametrize("u_plan", [0.0, 8.5])
def test_position_and_stiffness_recover_from_a_push_at_rest(name: str, u_plan: float) -> None:
    """Joint and stiffness return to their previous values within a dead zone."""
    plant = load_parameters(name)
    tuning = make_cascade_tuning(plant, LAMBDAS, u_plan=u_plan)
    F_push = np.zeros(30_000)
    F_push[10_000:] = 5.0
    states = true_states.run(plant, tuning, np.full(F_push.size, 0.3), np.full(F_push.size, 12.0), F_push)
    assert np.max(np.abs(states.q[10_000:11_000] - 0.3)) > 5.0 * COUNT
    assert np.max(np.abs(states.q[20_000:] - 0.3)) <= 1.5 * COUNT
    assert np.max(np.abs(states.S[20_000:] - states.S[9999])) <= 0.1


@pytest.mark.parametrize("u_plan", [0.0, 8.5])
@pytest.mark.parametrize(
    ("position_loop", "rate", "off", "turned", "rests"),
    [
        (True, 0.0, 0.0, 1, True),
        (True, 0.001, 0.0, 1, False),
        (True, 0.0, 0.58 * COUNT, 1, True),
        (True, 0.0, -0.62 * COUNT, 1, False),
        (False, 0.0, 0.0, 1, True),
        (False, 0.0, 20.0 * COUNT, 1, True),
        (False, 0.001, 0.0, 1, False),
        (False, 0.0, 0.0, 3, False),
    ],
)
def test_motor_integrators_stop_only_when_position_and_stiffness_are_reached(
    position_loop: bool, rate: float, off: float, turned: int, rests: bool, u_plan: float
) -> None:
    """With the position loop open, the equilibrium counts instead of the position."""
    lab = load_parameters("lab")
    tuning = make_cascade_tuning(lab, LAMBDAS, u_plan=u_plan)
    theta_A, theta_B = decoupler.motor_positions(tuning.decoupler, 0.3, 10.0)
    _, law = at_rest(make_simulated_rig(lab), tuning, 0.3, 10.0)
    offset = turned * MOTOR_COUNT
    m = Measurement(0.3 + off, theta_A + offset, theta_B - offset, 17.0, 17.0, 10.0, 0.0, 0.0)
    integrals = []
    for k in range(1600):
        _, law = cascade.step(tuning, law, LoopReferences(0.3 + rate * 1e-3 * k, 10.0), position_loop, m)
        integrals.append(law.motors.A.integral)
    assert (np.ptp(integrals[1500:]) < 1e-9) == rests


@pytest.mark.parametrize(("e", "expected"), [(0.0, 0.0), (0.3, 0.0), (-0.5, 0.0), (0.7, 0.2), (-2.0, -1.5)])
def test_the_dead_zone_subtracts_its_width_from_the_error(e: float, expected: float) -> None:
    assert apply_dead_zone(e, 0.5) == pytest.approx(expected, abs=1e-15)
    assert apply_dead_zone(e, 0.0) == e
    assert apply_dead_zone(e, math.inf) == 0.0
