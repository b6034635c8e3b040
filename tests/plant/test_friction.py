"""Static friction (LuGre), alone and in the whole plant."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from backend.tuning.gains import TuningParameters, make_feedback_linearization_tuning
from backend.tuning.simulation import make_simulated_rig, rest_state
from plant.dynamics import (
    SUBSTEPS,
    Dynamics,
    Friction,
    LuGre,
    PlantState,
    advance_state,
    bristle_after,
    bristle_rate,
    friction_torque,
    state_derivative,
)
from plant.interface import NO_LOAD, ShaftLoad, T_s
from plant.parameters import PlantParameters, load_parameters
from tests.plant.test_dynamics import energy

# Static friction (LuGre): closed forms, independent integration, and the behaviour of a stuck motor.

STICK = load_parameters("lab-stick")
SIGMA_0, SIGMA_1, RATIO, OMEGA_S = 40.0, 0.6, 1.4, 0.05
FRICTION = Friction(0.02, 0.35, 0.02, LuGre(SIGMA_0, SIGMA_1, RATIO, OMEGA_S))
LOAD_NM = 0.2
F_C = FRICTION.c0 + FRICTION.c1 * LOAD_NM
F_S = RATIO * F_C
SLACK = PlantState(0.0, 0.0, -200.0, 0.0, LOAD_NM, -200.0, 0.0, 0.0)


def pulled(torques: np.ndarray, parameters: PlantParameters = STICK) -> np.ndarray:
    """Turn [rad] of motor A per tick under torques [N·m] in addition to the load torque; tendons slack."""
    plant, x, turned = parameters.make_dynamics(), SLACK, []
    for torque in torques:
        u = (LOAD_NM + torque) / plant.motor_A.K_t
        x = advance_state(plant, x, u, 0.0, 0.0, T_s, SUBSTEPS, ShaftLoad(LOAD_NM, 0.0))
        turned.append(x.theta_A - SLACK.theta_A)
    return np.array(turned)


def ramp(*corners: tuple[float, float]) -> np.ndarray:
    """Torques [N·m] tick by tick through corners (s, N·m), the first at 0 s."""
    at, torques = np.array(corners).T
    return np.asarray(np.interp(np.arange(round(at[-1] / T_s)) * T_s, at, torques))


def test_the_shipped_set_is_lab_with_static_friction() -> None:
    lab = load_parameters("lab")
    A, B = STICK.make_dynamics().motor_A, STICK.make_dynamics().motor_B
    assert A.friction == B.friction == FRICTION
    own = {"sigma_0", "sigma_1", "stiction_ratio", "omega_s"}
    ours, theirs = STICK.to_document(), lab.to_document()
    assert own <= set(ours["motor"])
    for section, entries in theirs.items():
        for name, number in entries.items():
            assert ours[section][name]["value"] == number["value"], f"{section}.{name}"
        assert set(ours[section]) - set(entries) == (own if section == "motor" else set())


@pytest.mark.parametrize("omega", [1e-3, 0.02, 0.05, 0.08, 0.3, -0.05, -20.0])
@pytest.mark.parametrize("load", [0.0, 0.15, 0.375])
def test_friction_at_constant_speed_is_stribecks_curve(omega: float, load: float) -> None:
    F_c, z = 0.02 + 0.35 * load, 0.0
    for _ in range(2000):
        z = bristle_after(FRICTION, z, omega * 0.1, 0.1, load, load)
    curve = math.copysign(F_c * (1.0 + 0.4 * math.exp(-((omega / OMEGA_S) ** 2))), omega)
    assert friction_torque(FRICTION, omega, load, z) == pytest.approx(curve, rel=1e-9)


@pytest.mark.parametrize("u", [1.0, -2.0, 8.0])
def test_a_motor_turns_steadily_where_its_torque_equals_stribecks_curve(u: float) -> None:
    plant, x = STICK.make_dynamics(), SLACK._replace(tau_A=0.0)
    for _ in range(6000):
        x = advance_state(plant, x, u, 0.0, 0.0, T_s, SUBSTEPS)
    B_m, torque = plant.motor_A.B_m, plant.motor_A.K_t * u
    assert abs(x.omega_A) > 1.0
    assert torque == pytest.approx(B_m * x.omega_A + math.copysign(0.02, u), rel=1e-9)


@given(
    bent=st.floats(-1.0, 1.0), omega=st.floats(0.01, 25.0), way=st.sampled_from([-1.0, 1.0]), load=st.floats(0.0, 0.4)
)
def test_bristles_follow_their_equation_at_constant_speed(bent: float, omega: float, way: float, load: float) -> None:
    """A linear equation at constant speed: one exponential, whose rate is derived independently."""
    F_c = 0.02 + 0.35 * load
    level = F_c * (1.0 + 0.4 * math.exp(-((omega / OMEGA_S) ** 2)))
    z, end, h = bent * RATIO * F_c / SIGMA_0, way * level / SIGMA_0, 2.5e-4
    expected = end + (z - end) * math.exp(-SIGMA_0 * omega * h / level)
    assert bristle_after(FRICTION, z, way * omega * h, h, load, load) == pytest.approx(expected, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("way", [-1.0, 1.0])
@pytest.mark.parametrize("change", [-0.15, 0.15])
def test_bristles_follow_a_changing_load(way: float, change: float) -> None:
    """The load changes fast compared with their own rate; a held load would give no z' at all."""
    omega, span, steps = 15.0 * way, 0.02, 160

    def load(t: float) -> float:
        return 0.35 + change * t / span

    def rate(t: float, z: np.ndarray) -> list[float]:
        level = (0.02 + 0.35 * load(t)) * (1.0 + 0.4 * math.exp(-((omega / OMEGA_S) ** 2)))
        return [omega - SIGMA_0 * abs(omega) * float(z[0]) / level]

    own = float(solve_ivp(rate, (0.0, span), np.zeros(1), method="Radau", rtol=1e-10, atol=1e-14).y[0, -1])
    z, h = 0.0, span / steps
    for k in range(steps):
        z = bristle_after(FRICTION, z, omega * h, h, load(k * h), load((k + 1) * h))
    assert z == pytest.approx(own, rel=2e-5)
    ours, owns = (bristle_rate(FRICTION, omega, load(span), at) for at in (z, own))
    assert ours == pytest.approx(owns, rel=0.05)
    assert owns * way * change > 0.0


@pytest.mark.parametrize("share", [-0.8, -0.5, 0.05, 0.5])
def test_below_break_away_a_motor_sticks_and_springs_back(share: float) -> None:
    """Pulled slowly, z' = θ' (1 ∓ σ_0 z/F_s): θ = −(F_s/σ_0) ln(1 − T/F_s) out, ln(1 + T/F_s) of it back."""
    torque, F_s = share * F_S, math.copysign(F_S, share)
    turned = pulled(ramp((0.0, 0.0), (8.0, torque), (28.0, torque), (36.0, 0.0), (37.0, 0.0)))
    out, back = -F_s / SIGMA_0 * math.log(1.0 - abs(share)), -F_s / SIGMA_0 * math.log(1.0 + abs(share))
    assert turned[9000] == pytest.approx(out, rel=0.015)
    assert np.ptp(turned[12000:27999]) < 1e-9, "it must not creep"
    assert turned[-1] == pytest.approx(out + back, rel=0.02, abs=0.01 * abs(out))
    if abs(share) < 0.1:  # elastic: a spring of σ_0, all of which comes back
        assert turned[9000] == pytest.approx(torque / SIGMA_0, rel=0.04)
        assert abs(turned[-1]) < 0.06 * abs(turned[9000])


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_motor_breaks_away_at_the_static_friction(way: float) -> None:
    """The torque rises by 5 % per second; break-away is a turn of ten times the largest bristle deflection."""
    torques = ramp((0.0, 0.0), (24.0, way * 1.2 * F_S))
    away = np.abs(pulled(torques)) > 10.0 * F_S / SIGMA_0
    assert abs(torques[int(np.argmax(away))]) == pytest.approx(F_S, rel=0.03)


def test_smoothed_friction_creeps_where_static_friction_holds() -> None:
    torques = np.full(5000, 0.5 * F_C)
    creeps, stuck = pulled(torques, load_parameters("lab")), pulled(torques)
    assert creeps[-1] - creeps[1000] > 0.02
    assert abs(stuck[-1] - stuck[1000]) < 1e-6


@pytest.mark.parametrize("seed", range(8))
def test_bristles_never_return_more_energy_than_they_received(seed: int) -> None:
    """Random motion from relaxed bristles: at rest, creeping, fast and reversing, under changing loads."""
    random, h = np.random.default_rng(seed), 1e-5
    knots = np.arange(0, 60_001, 2000)
    speeds = random.choice([0.0, 0.02, 0.2, 3.0], knots.size) * random.uniform(-1.0, 1.0, knots.size)
    loads = random.uniform(0.0, 0.4, knots.size)
    omega, load = (np.interp(np.arange(60_001), knots, given) for given in (speeds, loads))
    z, work, least = 0.0, 0.0, 0.0
    for k in range(60_000):
        mean, mean_load = 0.5 * (omega[k] + omega[k + 1]), 0.5 * (load[k] + load[k + 1])
        after = bristle_after(FRICTION, z, mean * h, h, load[k], load[k + 1])
        work += h * mean * friction_torque(FRICTION, mean, mean_load, 0.5 * (z + after))
        z, least = after, min(least, work - 0.5 * SIGMA_0 * after**2)
    assert work > 1e-3, "it has to rub for this to mean anything"
    assert least > -1e-6 * work


def test_bristle_deflection_drops_to_the_bound_of_a_reduced_load() -> None:
    bent = F_S / SIGMA_0
    assert bristle_after(FRICTION, bent, 0.0, T_s, LOAD_NM, LOAD_NM) == bent
    assert bristle_after(FRICTION, bent, 0.0, T_s, LOAD_NM, 0.0) == RATIO * FRICTION.c0 / SIGMA_0
    assert bristle_after(FRICTION, -bent, 0.0, T_s, LOAD_NM, 0.0) == -RATIO * FRICTION.c0 / SIGMA_0


def mirrored(x: PlantState) -> PlantState:
    sides = (x.theta_B, x.omega_B, x.tau_B, x.theta_A, x.omega_A, x.tau_A, x.z_B, x.z_A)
    return PlantState(-x.q, -x.q_dot, *sides)


@given(u_A=st.floats(-10.0, 10.0), u_B=st.floats(-10.0, 10.0), tau_ext=st.floats(-2.0, 2.0), z=st.floats(-2e-3, 2e-3))
def test_swapping_A_and_B_mirrors_the_motion_with_friction(u_A: float, u_B: float, tau_ext: float, z: float) -> None:
    plant = STICK.make_dynamics()
    swapped = Dynamics(plant.joint, plant.motor_B, plant.motor_A, plant.spring_B, plant.spring_A)
    x = PlantState(0.1, 0.5, 5.0, 0.2, 0.0, 4.0, -0.1, 0.0, z, -0.5 * z)
    straight = advance_state(plant, x, u_A, u_B, tau_ext, 0.02, 20 * SUBSTEPS)
    reverse = advance_state(swapped, mirrored(x), u_B, u_A, -tau_ext, 0.02, 20 * SUBSTEPS)
    assert mirrored(reverse) == straight


# The whole plant with static friction: independent integration, energy, and the models without it.

LAB, STICK_PLANT = load_parameters("lab"), load_parameters("lab-stick")
UNLIKE = replace(STICK_PLANT, sided={"motor_B": {"sigma_0": 0.0}})
"""Motor A sticks, the friction of motor B is smoothed."""

states = st.builds(
    PlantState,
    q=st.floats(-0.6, 0.6), q_dot=st.floats(-5.0, 5.0),
    theta_A=st.floats(0.0, 9.0), omega_A=st.floats(-5.0, 5.0), tau_A=st.just(0.0),
    theta_B=st.floats(0.0, 9.0), omega_B=st.floats(-5.0, 5.0), tau_B=st.just(0.0),
    z_A=st.just(0.0), z_B=st.just(0.0),
)  # fmt: skip


def own_rate(p: PlantParameters, u: tuple[float, float], tau_ext: float, t: float, x: np.ndarray) -> list[float]:
    """Equations 1-16 of the method page and LuGre's, implemented independently from the parameter file."""
    g, s, a = p.geometry, p.spring, p.asymmetry
    q, dq, th_A, om_A, ta_A, th_B, om_B, ta_B, z_A, z_B = x

    def F(elongated: float, factor: float) -> float:
        curve = np.polynomial.Polynomial(s.k)
        solid = max(elongated - s.x_solid, 0.0)
        return max(factor * float(curve(min(elongated, s.x_solid))), 0.0) + s.k_solid * solid

    F_A, F_B = F(g.r_m * th_A - g.r_j * q, a.spring_A), F(g.r_m * th_B + g.r_j * q, a.spring_B)
    rates = [dq, (g.r_j * (F_A - F_B) - g.B_j * dq + tau_ext) / g.J_j]
    bent = []
    sides = (
        (p.select_motor("A"), om_A, ta_A, u[0], F_A, a.motor_A, z_A),
        (p.select_motor("B"), om_B, ta_B, u[1], F_B, a.motor_B, z_B),
    )
    for m, om, ta, volts, force, factor, z in sides:
        F_c = m.c0 + m.c1 * g.r_m * force
        if m.sigma_0 > 0.0:
            g_of_omega = F_c + (m.stiction_ratio * F_c - F_c) * math.exp(-((om / m.omega_s) ** 2))
            dz = om - m.sigma_0 * abs(om) / g_of_omega * z
            friction = m.sigma_0 * z + m.sigma_1 * dz
        else:
            dz, friction = 0.0, F_c * math.tanh(om / m.omega_smooth)
        B_m = m.K_t / m.K_m
        rates += [
            om,
            (ta - B_m * om - g.r_m * force - friction) / (B_m * m.T_m),
            (factor * m.K_t * volts - ta) / m.tau_e,
        ]
        bent.append(dz)
    return [*rates, *bent]


MOVES = (
    (4.0, 4.0, 0.0, 500), (9.0, 5.0, 0.5, 400), (0.0, 0.0, 0.0, 300), (1.0, 1.2, 0.0, 300),
    (1.0, 1.0, -0.2, 500), (-8.0, -8.0, 0.0, 500),
)  # fmt: skip
"""Voltages, torque at the joint and ticks: winding up, into the solid spring, hanging, breaking away, stuck, slack."""


@pytest.mark.parametrize("parameters", [STICK_PLANT, UNLIKE], ids=["lab-stick", "one side sticks"])
def test_plant_with_friction_agrees_with_an_independent_integration(parameters: PlantParameters) -> None:
    """Within 2e-5 rad, 5e-4 rad/s and 1e-6 rad of the bristles, against a stiff solver at tight tolerances."""
    plant, x = parameters.make_dynamics(), PlantState(0.05, 0.0, 3.0, 0.0, 0.0, 3.0, 0.0, 0.0)
    own, slowest = np.array(x), math.inf
    bounds = np.array([2e-5, 5e-4, *2 * (2e-4, 5e-4, 1e-9), 1e-6, 1e-6])
    for u_A, u_B, tau_ext, ticks in MOVES:
        for _ in range(ticks):
            x = advance_state(plant, x, u_A, u_B, tau_ext, T_s, SUBSTEPS)
        own = solve_ivp(
            partial(own_rate, parameters, (u_A, u_B), tau_ext),
            (0.0, ticks * T_s), own, method="LSODA", rtol=1e-8, atol=1e-11, max_step=5e-3,
        ).y[:, -1]  # fmt: skip
        slowest = min(slowest, abs(x.omega_A))
        assert np.all(np.abs(np.array(x) - own) < bounds), np.abs(np.array(x) - own)
    assert slowest < 1e-4, "it has to have stuck for this to mean anything"


@settings(max_examples=40)
@given(states)
def test_an_unforced_plant_with_bristles_only_loses_energy(x: PlantState) -> None:
    plant = STICK_PLANT.make_dynamics()

    def stored(at: PlantState) -> float:
        return energy(plant, at) + 0.5 * STICK_PLANT.motor.sigma_0 * (at.z_A**2 + at.z_B**2)

    before = stored(x)
    for _ in range(20):
        x = advance_state(plant, x, 0.0, 0.0, 0.0, 5 * T_s, 5 * SUBSTEPS)
        now = stored(x)
        assert now <= before + 1e-7 * (1.0 + before)
        before = now


def test_the_state_derivative_matches_the_friction_equations() -> None:
    x = PlantState(0.1, 0.5, 5.0, 0.2, 0.3, 4.0, -0.1, 0.2, 1e-3, -5e-4)
    ours = state_derivative(STICK_PLANT.make_dynamics(), x, 1.0, 2.0, 0.1, NO_LOAD)
    assert list(ours) == pytest.approx(own_rate(STICK_PLANT, (1.0, 2.0), 0.1, 0.0, np.array(x)), rel=1e-12)


def test_the_rest_state_is_steady_with_relaxed_bristles() -> None:
    plant = STICK_PLANT.make_dynamics()
    x, u_A, u_B = rest_state(make_simulated_rig(STICK_PLANT), 5.0, 4.0)
    assert (x.z_A, x.z_B) == (0.0, 0.0)
    after = x
    for _ in range(1000):
        after = advance_state(plant, after, u_A, u_B, 0.0, T_s, SUBSTEPS)
    assert list(after) == pytest.approx(list(x), abs=1e-9)


def test_the_identified_model_has_no_static_or_bristle_friction() -> None:
    assert STICK_PLANT.make_identified_dynamics() == LAB.make_identified_dynamics()
    assert STICK_PLANT.make_identified_dynamics().motor_A.friction.lugre is None
    x = PlantState(0.1, 0.5, 5.0, 0.2, 0.3, 4.0, -0.1, 0.2, 1e-3, -5e-4)
    rates = state_derivative(STICK_PLANT.make_identified_dynamics(), x, 1.0, 2.0, 0.1, NO_LOAD)
    assert rates == state_derivative(
        LAB.make_identified_dynamics(), x._replace(z_A=0.0, z_B=0.0), 1.0, 2.0, 0.1, NO_LOAD
    )
    assert (rates.z_A, rates.z_B) == (0.0, 0.0)


def test_the_law_with_a_full_model_uses_the_smoothed_friction() -> None:
    assert make_feedback_linearization_tuning(STICK_PLANT, TuningParameters()).model == LAB.make_dynamics()
