"""Time-optimal trajectories: least time, targets that jump, ends of ramps."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from backend.control import decoupler, trajectory
from backend.control.decoupler import build_decoupler
from backend.control.motion_types import Setpoint
from backend.control.setpoint_player import find_ramp_end, step_setpoint_player
from backend.control.trajectory import AxisTarget, LoopReferences, has_jumped, plan_fastest_stop
from backend.realtime.commands import Accepted, RunProgram
from backend.realtime.gains import make_tuning_command
from backend.realtime.motions import make_segment_player
from backend.realtime.program import Law, Program, Segment, Shape
from backend.sample import INDEX
from backend.tuning.gains import TuningParameters, collect_plant_knowledge
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop

# The plan against integrations of its own: least time, exact model, budget, and nothing that is no number.

LAB = load_parameters("lab")
D, MODEL = build_decoupler(LAB), collect_plant_knowledge(LAB).model
K, T = MODEL.K_A, MODEL.T_A
BUDGET = 8.5
Q, S = st.floats(-1.4, 1.4), st.floats(8.0, 15.0)


def turned(state: tuple[float, float], u: float, seconds: float) -> tuple[float, float]:
    """Motor T θ'' + θ' = K u, integrated by an independent solver."""
    path = solve_ivp(
        lambda _, x: (x[1], (K * u - x[1]) / T), (0.0, seconds), state, rtol=1e-11, atol=1e-12, method="DOP853"
    )
    return float(path.y[0, -1]), float(path.y[1, -1])


def least_time(far: float, omega: float, U: float) -> float:
    """Least time to rest at ``far``, found by a search for the time at which the voltage reverses."""
    best = math.inf
    for u in (U, -U):
        low, high = 0.0, 10.0
        for _ in range(80):
            at, speed = turned((0.0, omega), u, middle := 0.5 * (low + high)) if high > 0.0 else (0.0, omega)
            V = K * U
            stop_s = T * math.log1p(abs(speed) / V)
            gone, left = turned((at, speed), math.copysign(U, -speed), stop_s)
            assert abs(left) < 1e-6
            low, high = (middle, high) if (gone - far) * math.copysign(1.0, u) < 0.0 else (low, middle)
        if abs(gone - far) < 1e-6:
            best = min(best, middle + stop_s)
    return best


@pytest.mark.parametrize(
    ("far", "omega"), [(20.94, 0.0), (4.16, 0.0), (0.5, 0.0), (10.0, 6.0), (3.0, 15.0), (-5.0, 8.0), (1.0, -12.0)]
)
def test_the_duration_is_minimal(far: float, omega: float) -> None:
    assert trajectory.compute_duration(K * BUDGET, T, far, omega) == pytest.approx(
        least_time(far, omega, BUDGET), abs=1e-6
    )


@given(st.floats(0.5, 40.0), st.floats(0.05, 1.0), st.floats(0.0, 60.0))
def test_the_braking_speed_inverts_the_distance(V: float, lag: float, omega: float) -> None:
    distance = trajectory.braking_distance(V, lag, omega)
    assert trajectory.braking_speed(V, lag, distance) == pytest.approx(omega, rel=1e-6, abs=1e-5)
    assert distance >= -1e-12


@pytest.mark.parametrize("tau_e", [1e-3, 2e-3, 0.05, 0.22])
def test_an_axis_with_electrical_lag_agrees_with_an_independent_integration(tau_e: float) -> None:
    """T θ'' + θ' = K v, τ_e v' + v = u; also where both lags are the same (T = 0.22 s)."""
    at, x = trajectory.Lagged(0.3, 2.0, -1.5), np.array([0.3, 2.0, -1.5])

    def rate(_: float, x: np.ndarray, u: float) -> list[float]:
        return [x[1], (K * x[2] - x[1]) / T, (u - x[2]) / tau_e]

    for u in (8.5, 8.5, -4.0, -8.5, 0.0):
        at = trajectory.advance_lagged_axis(K, T, tau_e, at, u)
        path = solve_ivp(rate, (0.0, T_s), x, args=(u,), rtol=1e-11, atol=1e-12, method="DOP853")
        x = path.y[:, -1]
    np.testing.assert_allclose(at, x, rtol=1e-7, atol=1e-8)


def standing(q: float, stiffness: float) -> trajectory.TrajectoryState:
    return trajectory.begin_trajectory(D, MODEL, q, stiffness, 0.0, 0.0)


def step(
    state: trajectory.TrajectoryState, q_ref: float, S_ref: float, budget: float = BUDGET
) -> tuple[trajectory.Driven, trajectory.TrajectoryState]:
    return trajectory.step(
        D, MODEL, budget, state, trajectory.compute_axis_state(D, state), LoopReferences(q_ref, S_ref)
    )


@pytest.mark.parametrize(("q", "stiffness"), [(1.0, 10.0), (0.0, 14.0), (-0.8, 13.0), (0.02, 10.0)])
def test_a_step_takes_little_more_than_the_least_time_and_does_not_overshoot(q: float, stiffness: float) -> None:
    state = standing(0.0, 10.0)
    target = np.array(decoupler.motor_positions(D, q, stiffness))
    start = np.array([trajectory.compute_axis_state(D, state).theta_A, trajectory.compute_axis_state(D, state).theta_B])
    far = (target - start) @ np.array([[0.5, 0.5], [-0.5, 0.5]])
    targets = trajectory.AxisTarget(state.d.theta + far[0], 0.0), trajectory.AxisTarget(state.c.theta + far[1], 0.0)
    share, allowed = trajectory.share_budget(K, T, BUDGET, BUDGET, state, *targets)
    assert allowed == BUDGET
    least = max(
        trajectory.compute_duration(K * BUDGET * part, T, way, 0.0) if abs(way) > 1e-9 else 0.0
        for part, way in ((share, far[0]), (1.0 - share, far[1]))
    )
    path = []
    for _ in range(round(least / T_s) + 120):
        _, state = step(state, q, stiffness)
        at = trajectory.compute_axis_state(D, state)
        path.append((at.theta_A, at.theta_B))
    left = np.abs(np.array(path) - target).max(axis=1)
    assert left[-1] < 1e-4
    assert left[round(least / T_s) + 60] < 0.02 * np.abs(target - start).max()
    beyond = (np.array(path) - target) * np.sign(target - start)
    assert beyond.max() < 2e-3


@given(st.lists(st.tuples(Q, S, st.integers(1, 300)), min_size=1, max_size=6), st.floats(2.0, 9.0))
def test_the_voltage_limit_holds_and_all_values_are_finite(ways: list[tuple[float, float, int]], budget: float) -> None:
    state = standing(0.3, 9.0)
    for q, stiffness, ticks in ways:
        for _ in range(ticks):
            driven, state = step(state, q, stiffness, budget)
            assert math.isfinite(driven.u_A + driven.u_B)
            assert abs(state.window_d[0]) + abs(state.window_c[0]) <= budget + 2.0 * trajectory.MIN_VOLTAGE_V
            assert math.isfinite(state.q + state.q_dot)


def test_an_axis_in_motion_stops_at_its_target_despite_later_changes() -> None:
    """A far target of q, or a smaller voltage limit, while the stiffness moves to its end."""
    for ticks, q, budget in itertools.product((60, 120, 180, 230), (0.31, 1.3), (2.0, 8.5)):
        state, highest = standing(0.3, 9.0), 0.0
        for k in range(6000):
            _, state = step(state, 0.3 if k < ticks else q, 15.0, BUDGET if k < ticks else budget)
            highest = max(highest, trajectory.compute_axis_state(D, state).S)
        assert highest < 15.02, (ticks, q, budget)
        assert state.voltage_limit == budget
        assert pytest.approx(15.0, abs=1e-3) == trajectory.compute_axis_state(D, state).S


@given(
    st.floats(-24.0, 24.0), st.floats(-24.0, 24.0), st.floats(0.01, 40.0), st.floats(0.01, 40.0), st.floats(2.0, 9.0)
)
def test_a_stop_uses_full_reverse_voltage_or_ends_at_the_old_targets(
    w_d: float, w_c: float, far_d: float, far_c: float, U: float
) -> None:
    """Each target is ahead, no farther than the old one; if that is closer, its voltage share stops the axis."""
    d, c = trajectory.AxisMotion(1.0, w_d), trajectory.AxisMotion(8.0, w_c)
    sent = [trajectory.AxisTarget(a.theta + math.copysign(far, a.omega), 0.0) for a, far in ((d, far_d), (c, far_c))]
    target_d, target_c, share = plan_fastest_stop(K, T, U, d, c, sent[0], sent[1])
    assert 0.0 <= share <= 1.0
    for a, target, far, part in ((d, target_d, far_d, share), (c, target_c, far_c, 1.0 - share)):
        way, speed, V = math.copysign(1.0, a.omega) * (target.theta - a.theta), abs(a.omega), K * part * U
        assert target.rate == 0.0
        assert -1e-12 <= way <= far + 1e-9
        if way < far - 1e-9 and V > 0.1:
            stopped_s = T * math.log1p(speed / V)
            gone, left = turned((0.0, speed), -part * U, stopped_s)
            assert abs(left) < 1e-6
            assert gone - 1e-6 <= way <= 1.05 * gone + V / T * 1e-4


def test_an_axis_on_a_moving_target_stops_before_a_known_end_that_is_ahead() -> None:
    c, far = trajectory.AxisMotion(8.0, 10.0), trajectory.braking_distance(K * 6.0, T, 10.0)
    for end, bound in ((8.0 + far, True), (math.nan, False), (7.0, False)):
        sent = trajectory.AxisTarget(0.0, 10.0), trajectory.AxisTarget(8.0 + 0.5 * far, 10.0, end)
        _, target, share = plan_fastest_stop(K, T, 8.5, trajectory.AxisMotion(0.0, 10.0), c, *sent)
        assert (target.theta <= 8.0 + far + 1e-9) == bound
        assert share == pytest.approx(1.0 - 6.0 / (trajectory.BRAKING_SHARE * 8.5) if bound else 0.5, abs=1e-6)


@given(st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(0.1, 3.0), st.floats(0.0, 3.0))
def test_a_target_that_moves_in_each_tick_respects_the_voltage_limit(
    start: float, rate: float, period: float, S_rate: float
) -> None:
    state = standing(start, 10.0)
    for k in range(400):
        q = start + rate * period * math.sin(k * T_s / period)
        driven, state = step(state, min(max(q, -1.4), 1.4), min(10.0 + S_rate * k * T_s, 15.0))
        assert math.isfinite(driven.u_A + driven.u_B)
        assert abs(state.window_d[0]) + abs(state.window_c[0]) <= BUDGET + 2.0 * trajectory.MIN_VOLTAGE_V


def test_the_model_moves_like_motors_and_joint_under_its_voltages() -> None:
    """Motors with electrical lag and joint, integrated independently under the model's voltages, reach its end."""
    state = standing(-0.6, 9.0)
    first = trajectory.compute_axis_state(D, state)
    x = np.array([first.theta_A, 0.0, first.theta_B, 0.0, first.q, 0.0, 0.0, 0.0])
    held = [D.r_m * F / K_t for F, K_t in ((state.F_held_A, MODEL.K_t_A), (state.F_held_B, MODEL.K_t_B))]

    def rate(_: float, x: np.ndarray, u_A: float, u_B: float) -> list[float]:
        theta_A, omega_A, theta_B, omega_B, q, q_dot, v_A, v_B = x
        elongation = D.r_m * theta_A - D.r_j * q, D.r_m * theta_B + D.r_j * q
        F_A, F_B = (D.k_0 + D.k_1 * e + D.k_2 * e**2 for e in elongation)
        loads = D.r_m * F_A / MODEL.K_t_A - held[0], D.r_m * F_B / MODEL.K_t_B - held[1]
        return [
            omega_A,
            (MODEL.K_A * (v_A - loads[0]) - omega_A) / MODEL.T_A,
            omega_B,
            (MODEL.K_B * (v_B - loads[1]) - omega_B) / MODEL.T_B,
            q_dot,
            (D.r_j * (F_A - F_B) - MODEL.B_j * q_dot) / MODEL.J_j,
            (u_A - v_A) / MODEL.tau_e_A,
            (u_B - v_B) / MODEL.tau_e_B,
        ]

    for _ in range(700):
        driven, state = step(state, 0.5, 13.0)
        path = solve_ivp(rate, (0.0, T_s), x, args=(driven.u_A, driven.u_B), rtol=1e-9, atol=1e-12, method="DOP853")
        x = path.y[:, -1]
    at = trajectory.compute_axis_state(D, state)
    np.testing.assert_allclose([x[0], x[2]], [at.theta_A, at.theta_B], atol=0.002)
    assert x[4] == pytest.approx(at.q, abs=2e-4)


@given(S)
def test_tension_and_stiffness_at_rest_are_inverse_functions(stiffness: float) -> None:
    F = decoupler.tension_under(D, stiffness)
    assert decoupler.stiffness_under(D, F) == pytest.approx(stiffness, rel=1e-12)
    assert 8.0 < F < 47.0


# When the target of an axis counts as one that has jumped.


@pytest.mark.parametrize(("rate_before", "rate"), list(itertools.product((0.0, -0.4, 0.7), repeat=2)))
def test_a_target_jumps_if_it_differs_and_did_not_move(rate_before: float, rate: float) -> None:
    before = AxisTarget(0.2, rate_before)
    assert has_jumped(before, AxisTarget(0.3, rate)) == (rate_before == 0.0 or rate == 0.0)
    assert not has_jumped(before, AxisTarget(0.2, rate))


# A ramp of a program ends where it was sent: the plan knows the end from the segments, and brakes before it.

COUNT = 2.0 * math.pi / 4000.0
RAMP = Segment(0.02, 0.5, 12.0, shape=Shape.RAMP)
HELD = Segment(0.02, 0.5, 12.0)


@pytest.mark.parametrize(
    ("segments", "q_end", "S_end"),
    [
        ((RAMP,), 0.5, 12.0),
        ((RAMP, HELD), 0.5, 12.0),
        ((RAMP, Segment(0.02, 0.5, 12.0, F_push=3.0, shape=Shape.RAMP)), 0.5, 12.0),
        ((RAMP, Segment(0.02, 0.8, 12.0, shape=Shape.RAMP)), math.nan, 12.0),
        ((RAMP, Segment(0.02, 0.5, 13.0)), 0.5, math.nan),
        ((RAMP, Segment(0.02, 0.6, 13.0, shape=Shape.SINE, period_s=0.01)), math.nan, math.nan),
        ((HELD, RAMP), math.nan, math.nan),
        ((Segment(0.02, 0.5, 12.0, shape=Shape.SINE, period_s=0.01),), math.nan, math.nan),
    ],
)
def test_a_ramp_end_is_announced_where_the_references_stay(
    segments: tuple[Segment, ...], q_end: float, S_end: float
) -> None:
    start = Setpoint(0.0, 10.0, 0.0)
    _, _, player = step_setpoint_player(make_segment_player(segments, start), start)
    np.testing.assert_equal(find_ramp_end(player), (q_end, S_end))


def test_nothing_is_announced_after_the_program() -> None:
    start = Setpoint(0.0, 10.0, 0.0)
    player, done = make_segment_player((RAMP,), start), False
    while not done:
        done, _, player = step_setpoint_player(player, start)
    np.testing.assert_equal(find_ramp_end(player), (math.nan, math.nan))


@pytest.mark.parametrize(("speed", "S"), [(0.5, 10.0), (1.0, 10.0), (-1.0, 10.0), (0.8, 14.0), (2.5, 10.0)])
def test_a_ramp_is_not_overshot(speed: float, S: float) -> None:
    """Also for a ramp that is too fast for the motors; they catch up before its end."""
    lab = load_parameters("lab")
    bench = BenchTop(lab, make_tuning_command(lab, TuningParameters(0.355, 0.345), u_plan=8.5))
    bench.wind_up()
    before = len(bench.samples.rows)
    way, way_s = math.copysign(0.8, speed), 0.8 / abs(speed)
    segments = (Segment(2.0, 0.0, 10.0), Segment(way_s, way, S, shape=Shape.RAMP), Segment(2.0, way, S))
    assert isinstance(bench.send(RunProgram(Program(Law.CASCADE, segments), 5)), Accepted)
    bench.advance(4.0 + way_s)
    rows = np.array(bench.samples.rows[before:])
    done = rows[2000:, INDEX["q"]] * math.copysign(1.0, speed)
    assert done.max() <= 0.8 + COUNT
    assert np.all(done[round(1000 * way_s) + 300 :] >= 0.8 - 3.0 * COUNT)
    assert rows[2000:, INDEX["S"]].max() <= S + 0.1
    if abs(speed) <= 1.0:
        last = slice(2000 + round(750 * way_s), 2000 + round(900 * way_s))
        lag = np.abs(rows[last, INDEX["q_ref"]] - rows[last, INDEX["q"]])
        assert lag.max() <= 0.012 * abs(speed) + COUNT


def test_a_continued_ramp_is_not_slowed_down_between_its_segments() -> None:
    """A ramp in two segments of equal speed is driven like one in one segment."""
    lab = load_parameters("lab")
    driven = []
    for segments in (
        (Segment(1.0, 0.5, 10.0, shape=Shape.RAMP),),
        (Segment(0.4, 0.2, 10.0, shape=Shape.RAMP), Segment(0.6, 0.5, 10.0, shape=Shape.RAMP)),
    ):
        bench = BenchTop(lab, make_tuning_command(lab, TuningParameters(0.355, 0.345), u_plan=8.5))
        bench.wind_up()
        before = len(bench.samples.rows)
        whole = (Segment(1.0, 0.0, 10.0), *segments, Segment(0.5, 0.5, 10.0))
        bench.send(RunProgram(Program(Law.CASCADE, whole), 5))
        bench.advance(2.5)
        driven.append(np.array(bench.samples.rows[before:])[:, INDEX["q"]])
    assert np.max(np.abs(driven[0] - driven[1])) <= 1.01 * COUNT


@pytest.mark.parametrize(
    "excitation",
    [
        Segment(0.02, 0.5, 12.0, shape=Shape.SINE, period_s=0.01),
        Segment(0.02, 0.5, 12.0, shape=Shape.SWEEP, period_s=0.01, period_end_s=0.005),
        Segment(0.021, 0.5, 12.0, shape=Shape.PRBS, period_s=0.001, count=3),
        Segment(0.02, 0.5, 12.0, shape=Shape.MULTISINE, period_s=0.01, count=2, peak=2.0),
    ],
)
def test_the_segment_after_an_excitation_begins_at_its_start(excitation: Segment) -> None:
    """Checked with a following ramp; a sine of whole periods ends there by itself."""
    start, ramp = Setpoint(0.1, 10.0, 0.0), Segment(0.02, 0.3, 14.0, shape=Shape.RAMP)
    player = make_segment_player((excitation, ramp), start)
    targets, (done, target, player) = [], step_setpoint_player(player, start)
    while not done:
        targets.append((target.q_ref, target.S_ref))
        done, target, player = step_setpoint_player(player, target)
    share = np.arange(1, 21) / 20.0
    line = np.column_stack((0.1 + 0.2 * share, 10.0 + 4.0 * share))
    np.testing.assert_allclose(targets[-20:], line, atol=1e-12)
    assert np.ptp([q for q, _ in targets[:-20]]) > 0.1
