"""Tracking of the simulated loop: paper's law, time-optimal motion, limits."""

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.control import cascade
from backend.control.decoupler import Envelope
from backend.control.trajectory import WINDOW_TICKS, TrajectoryState
from backend.tuning import simulation
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.preview import usual_budget
from backend.tuning.simulation import Array, Trajectory, simulate_cascade
from plant.dynamics import PlantState
from plant.parameters import Asymmetry, PlantParameters, load_parameters
from tests.closed_loop.quality import HIGH, STEPS, assess, references
from tests.closed_loop.random_programs import random_program

# Requirements of the tracking experiment, and mirror symmetry.


@pytest.mark.parametrize(
    ("name", "overshoot", "stiffness", "tension"),
    [("ideal", 1.0, 0.1, 5.0), ("lab", 2.0, 0.3, 4.0), ("lab-stick", 2.0, 0.3, 4.0)],
)
@pytest.mark.parametrize("lambdas", [TuningParameters(lam_q=0.5, lam_S=0.5), TuningParameters()])
def test_tracking_meets_its_limits(
    name: str, lambdas: TuningParameters, overshoot: float, stiffness: float, tension: float
) -> None:
    parameters = load_parameters(name)
    q_ref, S_ref = references(STEPS)
    trajectory = simulate_cascade(parameters, make_cascade_tuning(parameters, lambdas), q_ref, S_ref)
    quality = assess(trajectory, q_ref, S_ref)
    assert trajectory.tripped_at == -1
    assert quality.overshoot_percent < overshoot
    assert quality.stiffness_deviation < stiffness
    assert quality.least_tension > tension


def test_a_cascade_without_governor_reproduces_the_values_of_the_method_page() -> None:
    """At λ = 0.5: 10 V at most, 1.9 s to 90 % of a 2π/3 step, no overshoot."""
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


# Time-optimal motion: speed, robustness, and bumpless transfer to and from the paper's law.

SETS = ("ideal", "lab", "lab-stick")
LAMBDAS = TuningParameters(lam_q=0.355, lam_S=0.345)
COUNT = 2.0 * math.pi / 4000.0
AT = 1000


class Reached(NamedTuple):
    to_90_percent_s: float
    settling_s: float
    overshoot_percent: float


def simulate_step(
    plant: PlantParameters, q: tuple[float, float], S: tuple[float, float], budget: float, known: PlantParameters
) -> Trajectory:
    tuning = make_cascade_tuning(known, LAMBDAS, u_plan=budget)
    ticks = AT, 4000
    return simulate_cascade(plant, tuning, np.repeat(q, ticks), np.repeat(S, ticks))


def reached(y: Array, start: float, end: float) -> Reached:
    progress = (y[AT:] - start) / (end - start)
    outside = np.flatnonzero(np.abs(progress - 1.0) > 0.02)
    return Reached(
        int(np.argmax(progress >= 0.9)) / 1000, (int(outside[-1]) + 1) / 1000, 100.0 * (float(progress.max()) - 1.0)
    )


def clipped(trajectory: Trajectory, u_max: float) -> int:
    return int(np.sum(np.maximum(np.abs(trajectory.u_A), np.abs(trajectory.u_B)) >= u_max))


@pytest.mark.parametrize("name", SETS)
def test_the_largest_step_of_the_paper_is_nearly_as_fast_as_the_motors_permit(name: str) -> None:
    plant = load_parameters(name)
    trajectory = simulate_step(plant, (-HIGH, HIGH), (10.0, 10.0), usual_budget(plant), plant)
    q = reached(trajectory.q, -HIGH, HIGH)
    assert q.to_90_percent_s <= 1.05
    assert q.settling_s <= 1.15
    assert q.overshoot_percent <= 0.5
    assert np.max(np.abs(trajectory.S[AT:] - 10.0)) <= 0.05
    assert min(trajectory.F_A.min(), trajectory.F_B.min()) > 15.0
    assert clipped(trajectory, plant.motor.u_max) == 0
    paper = reached(simulate_step(plant, (-HIGH, HIGH), (10.0, 10.0), 0.0, plant).q, -HIGH, HIGH)
    assert q.to_90_percent_s < 0.6 * paper.to_90_percent_s


@pytest.mark.parametrize("name", SETS)
def test_time_optimal_steps_of_stiffness_and_of_both_references_are_fast(name: str) -> None:
    plant = load_parameters(name)
    S = simulate_step(plant, (0.0, 0.0), (8.0, 14.0), usual_budget(plant), plant).S
    assert reached(S, 8.0, 14.0).to_90_percent_s <= 0.40
    both = simulate_step(plant, (-HIGH, HIGH), (8.0, 14.0), usual_budget(plant), plant)
    assert reached(both.q, -HIGH, HIGH).to_90_percent_s <= 1.30
    assert min(both.F_A.min(), both.F_B.min()) > 8.0


@pytest.mark.parametrize("tau_e", [0.001, 0.002, 0.003])
@pytest.mark.parametrize("lambdas", [LAMBDAS, TuningParameters()], ids=["fast", "default"])
@pytest.mark.parametrize("S", [(8.0, 10.0), (8.0, 14.0), (14.0, 8.0)])
def test_the_electrical_lag_causes_no_overshoot(
    tau_e: float, lambdas: TuningParameters, S: tuple[float, float]
) -> None:
    """Without the lag in the model, S overshoots by 0.6 to 2.1 % from 8 to 10 N·m/rad."""
    ideal = load_parameters("ideal")
    plant = replace(ideal, motor=replace(ideal.motor, tau_e=tau_e))
    tuning = make_cascade_tuning(plant, lambdas, u_plan=usual_budget(plant))
    ticks = AT, 3000
    found = simulate_cascade(plant, tuning, np.zeros(sum(ticks)), np.repeat(S, ticks))
    assert reached(found.S, *S).overshoot_percent <= 0.02
    assert np.max(np.abs(found.q)) <= 1e-4


def off_by(
    K_m: float = 1.0, T_m: float = 1.0, spring: float = 1.0, K_t: float = 1.0, friction: float = 1.0
) -> PlantParameters:
    lab = load_parameters("lab")
    m, a = lab.motor, lab.asymmetry
    return replace(
        lab,
        motor=replace(m, K_m=K_m * m.K_m, T_m=T_m * m.T_m, K_t=K_t * m.K_t, c0=friction * m.c0, c1=friction * m.c1),
        asymmetry=replace(a, spring_A=spring * a.spring_A, spring_B=spring * a.spring_B),
    )


ALONE = [
    *({name: factor} for name in ("K_m", "spring", "K_t") for factor in (0.9, 1.1)),
    *({name: factor} for name in ("T_m", "friction") for factor in (0.8, 1.2)),
]


@pytest.mark.parametrize("wrong", ALONE, ids=str)
def test_time_optimal_motion_tolerates_one_wrong_parameter(wrong: dict[str, float]) -> None:
    lab = load_parameters("lab")
    trajectory = simulate_step(off_by(**wrong), (-HIGH, HIGH), (10.0, 10.0), usual_budget(lab), lab)
    assert trajectory.tripped_at == -1
    assert reached(trajectory.q, -HIGH, HIGH).overshoot_percent <= 1.0


def test_time_optimal_motion_tolerates_all_parameters_being_wrong() -> None:
    lab = load_parameters("lab")
    for K_m, T_m, spring, K_t, friction in itertools.product(
        (0.9, 1.1), (0.8, 1.2), (0.9, 1.1), (0.9, 1.1), (0.8, 1.2)
    ):
        plant = off_by(K_m, T_m, spring, K_t, friction)
        trajectory = simulate_step(plant, (-HIGH, HIGH), (10.0, 10.0), usual_budget(lab), lab)
        assert trajectory.tripped_at == -1
        assert min(trajectory.F_A.min(), trajectory.F_B.min()) > 8.0
        assert reached(trajectory.q, -HIGH, HIGH).overshoot_percent <= 3.0, (K_m, T_m, spring, K_t, friction)


@pytest.mark.parametrize("name", SETS)
def test_time_optimal_motion_follows_a_sine(name: str) -> None:
    plant = load_parameters(name)
    t = np.arange(12_000) / 1000
    q_ref = 0.5 * np.sin(2.0 * np.pi * 0.3 * np.maximum(t - 1.0, 0.0))
    errors = {}
    for budget in (0.0, usual_budget(plant)):
        found = simulate_cascade(
            plant, make_cascade_tuning(plant, LAMBDAS, u_plan=budget), q_ref, np.full(t.size, 10.0)
        )
        errors[budget > 0.0] = float(np.sqrt(np.mean((found.q - q_ref)[AT:] ** 2)))
    assert errors[True] <= 0.01
    assert errors[False] > 0.3  # the paper's law lags


def without_and_with(
    before: cascade.CascadeTuning, after: cascade.CascadeTuning, at: int
) -> tuple[Array, Array, cascade.CascadeState, cascade.CascadeState, cascade.CascadeState]:
    """Return voltages (2,) without and with a change in tick ``at``, and the states."""
    ideal = load_parameters("ideal")
    rig = simulation.make_simulated_rig(ideal)
    q_ref, S_ref = np.full(at + 1, HIGH), np.full(at + 1, 13.0)
    q_ref[:200], S_ref[:200] = -HIGH, 9.0
    x, law = simulation.at_rest(rig, before, -HIGH, 9.0)
    line, out = simulation.empty_arrays(at)
    x, law, _ = simulation.simulate(
        rig, before, x, law, simulation.make_closed_loop_inputs(ideal, q_ref[:at], S_ref[:at]), line, out
    )
    voltages, laws = [], []
    for tuning in (before, after):
        line, row = simulation.empty_arrays(1)
        last = simulation.make_closed_loop_inputs(ideal, q_ref[at:], S_ref[at:])
        laws.append(simulation.simulate(rig, tuning, x, law, last, line, row)[1])
        voltages.append(row[0, [simulation.COLUMNS.index(name) for name in ("u_A", "u_B")]])
    return voltages[0], voltages[1], law, laws[0], laws[1]


def mean_voltages(state: TrajectoryState) -> Array:
    """Return the mean voltages of motors A and B that drive the model."""
    d, c = np.mean(state.window_d), np.mean(state.window_c)
    return np.array([c + d, c - d])


TICKS = [150, 230, 700, 1500, 6000]
"""Before the step, just after it, at full speed, at the end of the motion and at rest again."""


@pytest.mark.parametrize("at", TICKS)
def test_the_transfer_from_lambda_to_time_optimal_motion_is_bumpless(at: int) -> None:
    ideal = load_parameters("ideal")
    without, with_plan, _, _, after = without_and_with(
        make_cascade_tuning(ideal, LAMBDAS), make_cascade_tuning(ideal, LAMBDAS, u_plan=8.5), at
    )
    d, c = after.trajectory_state.window_d, after.trajectory_state.window_c
    own = np.array([c[0] - c[1] + d[0] - d[1], c[0] - c[1] - d[0] + d[1]]) / WINDOW_TICKS
    assert np.max(np.abs(with_plan - without - own)) < 1e-3
    assert np.max(np.abs(own)) < 2.0


@pytest.mark.parametrize("at", TICKS)
def test_the_transfer_from_time_optimal_to_lambda_motion_is_bumpless(at: int) -> None:
    ideal = load_parameters("ideal")
    without, by_governor, _, planned, after = without_and_with(
        make_cascade_tuning(ideal, LAMBDAS, u_plan=8.5), make_cascade_tuning(ideal, LAMBDAS), at
    )
    own = mean_voltages(after.trajectory_state) - mean_voltages(planned.trajectory_state)
    assert np.max(np.abs(by_governor - without - own)) < 1e-3
    assert np.max(np.abs(own)) < 2.0
    assert after.follows_trajectory == (at in (230, 700, 1500))


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("S_limits", [(8.0, 15.0), (15.0, 8.0)])
def test_a_move_ends_within_its_limits_after_a_transfer_to_lambda_motion(
    name: str, S_limits: tuple[float, float]
) -> None:
    """The transfer happens at 28 times of a move between the limits of S."""
    plant = load_parameters(name)
    rig, planned = simulation.make_simulated_rig(plant), make_cascade_tuning(plant, LAMBDAS, u_plan=usual_budget(plant))
    governed = make_cascade_tuning(plant, LAMBDAS)
    x, law = simulation.at_rest(rig, planned, 0.3, S_limits[0])

    def play(tuning: cascade.CascadeTuning, x: PlantState, law: cascade.CascadeState, ticks: int) -> tuple[Any, ...]:
        line, out = simulation.empty_arrays(ticks)
        inputs = simulation.make_closed_loop_inputs(plant, np.full(ticks, 0.3), np.full(ticks, S_limits[1]))
        return *simulation.simulate(rig, tuning, x, law, inputs, line, out), out

    for _ in range(28):
        x, law, _, _ = play(planned, x, law, 15)
        _, law_after, tripped, _ = play(governed, x, law, 220)
        assert tripped == -1
        assert not law_after.follows_trajectory
        _, _, tripped, out = play(governed, x, law, 2000)
        assert tripped == -1
        S = out[:, simulation.COLUMNS.index("S")]
        assert S.min() >= 7.95
        assert S.max() <= 15.05


@pytest.mark.parametrize("at", TICKS)
@pytest.mark.parametrize(
    "changed", [{"lam_q": 1.2}, {"lam_S": 0.9}, {"lam_motor": 0.1}, {"b": 1.0}], ids=lambda changed: next(iter(changed))
)
def test_changes_of_gains_are_bumpless_in_time_optimal_motion(changed: dict[str, float], at: int) -> None:
    ideal = load_parameters("ideal")
    without, with_change, *_ = without_and_with(
        make_cascade_tuning(ideal, TuningParameters(), u_plan=8.5),
        make_cascade_tuning(ideal, TuningParameters(**changed), u_plan=8.5),
        at,
    )
    assert np.max(np.abs(with_change - without)) < 1e-3


@pytest.mark.parametrize("name", SETS)
def test_random_programs_keep_tendons_taut_and_do_not_trip(name: str) -> None:
    plant = load_parameters(name)
    for seed in range(60):
        played = random_program(plant, seed)
        assert not played.tripped, seed
        assert played.least > 1.0, seed
        assert played.most < 50.0, seed


def test_a_transfer_during_a_move_with_a_push_keeps_the_tension_limits() -> None:
    """The transfer is at 14.6 N·m/rad; this program of a thousand once tripped."""
    played = random_program(load_parameters("lab-stick"), 2203)
    assert not played.tripped
    assert played.most < 48.0


# Limits of the cascade on the simulated plant: their effect, and the recovery from them.

WITHOUT = Envelope(F_floor=-1e3, F_ceiling=1e3, q_max=1e3)
TICKS_LIMITS = 14_000


@dataclass(frozen=True)
class Push:
    """A push at (q, S) with ramps of ``ramp_s`` that start at 1 s and at 8 s."""

    q: float
    S: float
    force_N: float
    ramp_s: float

    def play(self, parameters: PlantParameters, envelope: Envelope | None = None) -> Trajectory:
        tuning = make_cascade_tuning(parameters, TuningParameters())
        tuning = tuning if envelope is None else tuning._replace(envelope=envelope)
        t = 1e-3 * np.arange(TICKS_LIMITS)
        F_push = np.interp(t, [1.0, 1.0 + self.ramp_s, 8.0, 8.0 + self.ramp_s], [0.0, self.force_N, self.force_N, 0.0])
        return simulate_cascade(
            parameters, tuning, np.full(TICKS_LIMITS, self.q), np.full(TICKS_LIMITS, self.S), F_push
        )


def least_tension(trajectory: Trajectory) -> float:
    return float(min(trajectory.F_A.min(), trajectory.F_B.min()))


@pytest.mark.parametrize("force_N", [24.0, -24.0])
@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_the_envelope_raises_both_tensions_under_a_push_that_would_slacken_a_tendon(name: str, force_N: float) -> None:
    parameters = load_parameters(name)
    push = Push(q=0.0, S=8.0, force_N=force_N, ramp_s=2.0)
    assert least_tension(push.play(parameters, WITHOUT)) <= 0.0, "the push has to matter"
    trajectory = push.play(parameters)
    assert least_tension(trajectory) > 2.0
    assert float(max(trajectory.F_A.max(), trajectory.F_B.max())) < 50.0
    # After the push both references are reached again: there was no windup.
    assert trajectory.q[-1] == pytest.approx(0.0, abs=2.0 * 2.0 * np.pi / 4000)
    assert trajectory.S[-1] == pytest.approx(8.0, abs=0.01)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_the_envelope_lowers_both_tensions_under_a_push_that_would_exceed_the_limit(name: str) -> None:
    parameters = load_parameters(name)
    push = Push(q=0.0, S=15.0, force_N=12.0, ramp_s=5.0)
    assert push.play(parameters, WITHOUT).tripped_at >= 0, "the push has to matter"
    trajectory = push.play(parameters)
    assert trajectory.tripped_at == -1
    assert trajectory.S[7900] < 14.9
    assert trajectory.S[-1] == pytest.approx(15.0, abs=0.02)


def test_the_equilibrium_stays_within_the_range_of_the_joint() -> None:
    """A push at the end of the range does not move it beyond the end stop."""
    parameters = load_parameters("ideal")
    q_max = parameters.geometry.q_max
    push = Push(q=1.4, S=10.0, force_N=-30.0, ramp_s=3.0)

    def largest_equilibrium(trajectory: Trajectory) -> float:
        r_m, r_j = parameters.geometry.r_m, parameters.geometry.r_j
        return float(np.max(r_m * (trajectory.theta_A_ref - trajectory.theta_B_ref) / (2.0 * r_j)))

    assert largest_equilibrium(push.play(parameters, WITHOUT)) > q_max, "the push has to matter"
    trajectory = push.play(parameters)
    assert largest_equilibrium(trajectory) < q_max
    assert trajectory.tripped_at == -1
    assert trajectory.q[-1] == pytest.approx(1.4, abs=1e-3)
