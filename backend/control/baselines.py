"""Baseline laws: feedback linearization with a full model, and single loops.

The single loops, one per output, have no cascade.
"""

import math
from typing import NamedTuple

from backend.control import cascade, decoupler, pid
from backend.control.cascade import GovernorState, step_governor
from backend.control.decoupler import Decoupler
from plant import (
    SUBSTEPS,
    Dynamics,
    Measurement,
    Motor,
    PlantState,
    T_s,
    advance_state,
    compiled,
    elongation_A,
    elongation_B,
    friction_torque,
    joint_acceleration,
    spring_curvature,
    spring_slope,
    tendon_tension,
)

# Feedback linearization ----------------------------------------------------------------------------
# Baseline with a full model: feedback linearization that decouples joint position and stiffness.
#
# The static law follows Palli, Melchiorri, Wimböck, Grebenstein, Hirzinger, "Feedback linearization and simultaneous
# stiffness-position control of robots with antagonistic actuated joints" (ICRA 2007); De Luca, Flacco, Bicchi, Schiavi,
# "Nonlinear decoupled motion-stiffness control and collision detection/reaction for the VSA-II variable stiffness
# device" (IROS 2009). It is static because q has relative degree 4 and S has 2, together the six states of the model,
# so the law needs no states except the integrals; the dynamic extension filters S twice more
# (docs/explanation/errata.md, E9). The motors' accelerations appear in the fourth derivative of q and in the second of
# S (neglecting the torques' lag of 2 ms); the law solves for the accelerations that give q'''' = v_q, S'' = v_S, where
#
#     v_q = q_d'''' + Σ a_i (q_d − q)^(i),  v_S = S_d'' + Σ b_i (S_d − S)^(i),  i = −1 (the integral), 0, 1 ...
#
# track a smooth reference. No sensor measures speeds; they come from the model itself, simulated in parallel and
# corrected by the measured angles.


class FeedbackLinearizationGains(NamedTuple):
    """Time constants [s] of the reference filters and poles [rad/s] of the errors.

    References pass 1/(λ s + 1)^4 and 1/(λ s + 1)²; all poles of each error are at −``pole``. ``observer_pole`` is the
    pole of the model's correction, double for each angle.
    """

    lam_q: float
    lam_S: float
    pole_q: float
    pole_S: float
    observer_pole: float


class FeedbackLinearizationTuning(NamedTuple):
    """Gains, model and limits of the law.

    ``omega_max`` [rad/s] limits the governor, ``u_max`` [V] the voltages. The model's friction is smoothed
    (``plant.dynamics.smooth_friction``): the law has no bristles.
    """

    gains: FeedbackLinearizationGains
    model: Dynamics
    decoupler: Decoupler
    omega_max: float
    u_max: float


class Smooth(NamedTuple):
    """Reference and its derivatives, each in the unit of the signal per s^i."""

    r_0: float
    r_1: float
    r_2: float
    r_3: float


class FeedbackLinearizationState(NamedTuple):
    """State of the law.

    ``x`` is the model's state; the integrals are those of the errors [rad·s, N·m·s/rad].
    """

    governor: GovernorState
    q_d: Smooth
    S_d: Smooth
    x: PlantState
    integral_q: float
    integral_S: float


class _Chain(NamedTuple):
    """Derivatives of both integrator chains, and how the motors act on them.

    ``drift`` is q'''' [rad/s⁴] at constant motor speeds; slopes [N/m] and forces [N] are those of the springs.
    """

    q_2: float
    q_3: float
    S_1: float
    drift: float
    slope_A: float
    slope_B: float
    F_A: float
    F_B: float


@compiled
def _smooth_4(lam: float, s: Smooth, r: float) -> tuple[float, Smooth]:
    """Advance 1/(λ s + 1)^4 by a tick; return the fourth derivative and the new state."""
    w = 1.0 / lam
    r_4 = w**4 * (r - s.r_0) - 4.0 * w**3 * s.r_1 - 6.0 * w**2 * s.r_2 - 4.0 * w * s.r_3
    return r_4, Smooth(s.r_0 + T_s * s.r_1, s.r_1 + T_s * s.r_2, s.r_2 + T_s * s.r_3, s.r_3 + T_s * r_4)


@compiled
def _smooth_2(lam: float, s: Smooth, r: float) -> tuple[float, Smooth]:
    """Advance 1/(λ s + 1)² by a tick; return the second derivative and the new state."""
    w = 1.0 / lam
    r_2 = w**2 * (r - s.r_0) - 2.0 * w * s.r_1
    return r_2, Smooth(s.r_0 + T_s * s.r_1, s.r_1 + T_s * r_2, 0.0, 0.0)


@compiled
def _correct_model(pole: float, x: PlantState, m: Measurement) -> PlantState:
    """Return the model's state, corrected by the measured angles."""
    e_q, e_A, e_B = m.q - x.q, m.theta_A - x.theta_A, m.theta_B - x.theta_B
    angle, speed = 2.0 * pole * T_s, pole**2 * T_s
    return PlantState(
        q=x.q + angle * e_q,
        q_dot=x.q_dot + speed * e_q,
        theta_A=x.theta_A + angle * e_A,
        omega_A=x.omega_A + speed * e_A,
        tau_A=x.tau_A,
        theta_B=x.theta_B + angle * e_B,
        omega_B=x.omega_B + speed * e_B,
        tau_B=x.tau_B,
        z_A=x.z_A,
        z_B=x.z_B,
    )


@compiled
def _chain(model: Dynamics, d: Decoupler, x: PlantState) -> _Chain:
    """Differentiate q and S along the model (equations 1-5, 13, 16 differentiated)."""
    joint = model.joint
    x_A, x_B = elongation_A(joint, x.theta_A, x.q), elongation_B(joint, x.theta_B, x.q)
    rate_A, rate_B = elongation_A(joint, x.omega_A, x.q_dot), elongation_B(joint, x.omega_B, x.q_dot)
    F_A, F_B = tendon_tension(model.spring_A, x_A), tendon_tension(model.spring_B, x_B)
    slope_A, slope_B = spring_slope(model.spring_A, x_A), spring_slope(model.spring_B, x_B)
    bend_A, bend_B = spring_curvature(model.spring_A, x_A), spring_curvature(model.spring_B, x_B)
    q_2 = joint_acceleration(joint, x.q_dot, joint.r_j * (F_A - F_B), 0.0)
    q_3 = joint_acceleration(joint, q_2, joint.r_j * (slope_A * rate_A - slope_B * rate_B), 0.0)
    F_A_2 = bend_A * rate_A**2 - slope_A * joint.r_j * q_2
    F_B_2 = bend_B * rate_B**2 + slope_B * joint.r_j * q_2
    drift = joint_acceleration(joint, q_3, joint.r_j * (F_A_2 - F_B_2), 0.0)
    _, S_1 = decoupler.rates(d, x.theta_A, x.theta_B, x.omega_A, x.omega_B)
    return _Chain(q_2=q_2, q_3=q_3, S_1=S_1, drift=drift, slope_A=slope_A, slope_B=slope_B, F_A=F_A, F_B=F_B)


@compiled
def _voltage(motor: Motor, acceleration: float, omega: float, omega_d: float, load: float) -> float:
    """Return the voltage [V] for an acceleration [rad/s²], neglecting torque lag.

    Equations 6-9. Friction is compensated at the reference speed: at the estimated speed the compensation would excite
    the vibrations that it should damp.
    """
    friction = friction_torque(motor.friction, omega_d, load, 0.0)
    return (motor.J_m * acceleration + motor.B_m * omega + load + friction) / motor.K_t


@compiled
def step_feedback_linearization(
    tuning: FeedbackLinearizationTuning, state: FeedbackLinearizationState, q_ref: float, S_ref: float, m: Measurement
) -> tuple[cascade.CascadeOutput, FeedbackLinearizationState]:
    """Execute one step: references [rad, N·m/rad] and a measurement to voltages [V]."""
    d, model, gains = tuning.decoupler, tuning.model, tuning.gains
    motor_A, motor_B, joint = model.motor_A, model.motor_B, model.joint
    reference, governed = step_governor(d, tuning.omega_max, state.governor, q_ref, S_ref)
    q_4, q_next = _smooth_4(gains.lam_q, state.q_d, reference.q_ref)
    S_2, S_next = _smooth_2(gains.lam_S, state.S_d, reference.S_ref)
    q_d, S_d = state.q_d, state.S_d
    x = _correct_model(gains.observer_pole, state.x, m)
    c = _chain(model, d, x)

    # All poles of the errors are at −p: (s + p)^5 and (s + p)^3, the last power for the integral.
    p, S = gains.pole_q, decoupler.stiffness(d, m.theta_A, m.theta_B)
    e_q, e_S = q_d.r_0 - m.q, S_d.r_0 - S
    v_q = q_4 + 5.0 * p * (q_d.r_3 - c.q_3) + 10.0 * p**2 * (q_d.r_2 - c.q_2) + 10.0 * p**3 * (q_d.r_1 - x.q_dot)
    v_q += 5.0 * p**4 * e_q + p**5 * state.integral_q
    p = gains.pole_S
    v_S = S_2 + 3.0 * p * (S_d.r_1 - c.S_1) + 3.0 * p**2 * e_S + p**3 * state.integral_S

    # J_j (v_q − drift) = r_j r_m (F_A' θ_A'' − F_B' θ_B'')  and  v_S = dS/dθ (θ_A'' + θ_B'')
    twist = joint.J_j * (v_q - c.drift) / (joint.r_j * joint.r_m)
    S_slope = decoupler.stiffness_slope(d, S)
    wind = v_S / S_slope
    acceleration_A = (twist + c.slope_B * wind) / (c.slope_A + c.slope_B)
    acceleration_B = wind - acceleration_A
    speed_q, speed_S = d.r_j / d.r_m * q_d.r_1, 0.5 * S_d.r_1 / S_slope
    unlimited_A = _voltage(motor_A, acceleration_A, x.omega_A, speed_S + speed_q, joint.r_m * c.F_A)
    unlimited_B = _voltage(motor_B, acceleration_B, x.omega_B, speed_S - speed_q, joint.r_m * c.F_B)
    u_A = min(max(unlimited_A, -tuning.u_max), tuning.u_max)
    u_B = min(max(unlimited_B, -tuning.u_max), tuning.u_max)

    clipped = u_A != unlimited_A or u_B != unlimited_B
    output = cascade.CascadeOutput(
        u_A=u_A,
        u_B=u_B,
        theta_A_ref=math.nan,
        theta_B_ref=math.nan,
        S=S,
        q_ref_gov=reference.q_ref,
        S_ref_gov=reference.S_ref,
        bank_entry=0.0,
        clipped_A=u_A != unlimited_A,
        clipped_B=u_B != unlimited_B,
        governed=governed,
        at_floor=False,
        at_ceiling=False,
        at_range=False,
    )
    return output, FeedbackLinearizationState(
        governor=reference,
        q_d=q_next,
        S_d=S_next,
        x=advance_state(plant=model, x=x, u_A=u_A, u_B=u_B, tau_ext=0.0, duration_s=T_s, substeps=SUBSTEPS),
        # Anti-windup: no integration while a voltage is clipped.
        integral_q=state.integral_q + (0.0 if clipped else T_s * e_q),
        integral_S=state.integral_S + (0.0 if clipped else T_s * e_S),
    )


@compiled
def initialize_feedback_linearization(
    tuning: FeedbackLinearizationTuning, u_A: float, u_B: float, m: Measurement
) -> FeedbackLinearizationState:
    """Return the state that continues from voltages u_A, u_B [V] at a joint at rest.

    The references start at the joint's position and stiffness.
    """
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    torque_A, torque_B = tuning.model.motor_A.K_t * u_A, tuning.model.motor_B.K_t * u_B
    return FeedbackLinearizationState(
        governor=GovernorState(m.q, S),
        q_d=Smooth(m.q, 0.0, 0.0, 0.0),
        S_d=Smooth(S, 0.0, 0.0, 0.0),
        x=PlantState(
            q=m.q,
            q_dot=0.0,
            theta_A=m.theta_A,
            omega_A=0.0,
            tau_A=torque_A,
            theta_B=m.theta_B,
            omega_B=0.0,
            tau_B=torque_B,
            z_A=0.0,
            z_B=0.0,
        ),
        integral_q=0.0,
        integral_S=0.0,
    )


# Single loop ---------------------------------------------------------------------------------------
# Baseline without cascade: one I-PD loop on joint position and one on stiffness, directly to the motor voltages.
#
# The paper compares its cascade with this law. The motors are antagonistic, so voltages of opposite sign turn the joint
# and voltages of equal sign stiffen it: u_A = u_S + u_q, u_B = u_S − u_q, the directions of the decoupler (equations
# 18, 19). Governor, voltage limit and references are those of the cascade.


NOT_USED = math.nan
"""Value of the motor references in samples; this law has none."""


class SingleLoopGains(NamedTuple):
    """Gains of both loops: ``position`` [V per rad], ``stiffness`` [V per N·m/rad]."""

    position: pid.IPDGains
    stiffness: pid.IPDGains


class SingleLoopTuning(NamedTuple):
    """Gains and limits: ``omega_max`` [rad/s] of the governor, ``u_max`` [V]."""

    gains: SingleLoopGains
    decoupler: Decoupler
    omega_max: float
    u_max: float


class SingleLoopState(NamedTuple):
    """State of the law."""

    governor: GovernorState
    position: pid.IPDState
    stiffness: pid.IPDState


@compiled
def step_single_loop(
    tuning: SingleLoopTuning, state: SingleLoopState, q_ref: float, S_ref: float, m: Measurement
) -> tuple[cascade.CascadeOutput, SingleLoopState]:
    """Execute one step: references [rad, N·m/rad] and a measurement to voltages [V]."""
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    reference, governed = step_governor(tuning.decoupler, tuning.omega_max, state.governor, q_ref, S_ref)
    u_q, _, position = pid.step_i_pd(tuning.gains.position, state.position, reference.q_ref, m.q, math.inf)
    u_S, _, stiffness = pid.step_i_pd(tuning.gains.stiffness, state.stiffness, reference.S_ref, S, math.inf)
    u_A = min(max(u_S + u_q, -tuning.u_max), tuning.u_max)
    u_B = min(max(u_S - u_q, -tuning.u_max), tuning.u_max)
    clipped_A, clipped_B = u_S + u_q - u_A, u_S - u_q - u_B
    output = cascade.CascadeOutput(
        u_A=u_A,
        u_B=u_B,
        theta_A_ref=NOT_USED,
        theta_B_ref=NOT_USED,
        S=S,
        q_ref_gov=reference.q_ref,
        S_ref_gov=reference.S_ref,
        bank_entry=0.0,
        clipped_A=clipped_A != 0.0,
        clipped_B=clipped_B != 0.0,
        governed=governed,
        at_floor=False,
        at_ceiling=False,
        at_range=False,
    )
    return output, SingleLoopState(
        reference,
        _bleed_integrator(position, 0.5 * (clipped_A - clipped_B)),
        _bleed_integrator(stiffness, 0.5 * (clipped_A + clipped_B)),
    )


@compiled
def _bleed_integrator(state: pid.IPDState, excess: float) -> pid.IPDState:
    """Return the state with clipped voltage bled from the integrator (anti-windup).

    The inner loops of the cascade do the same.
    """
    return pid.IPDState(state.integral - T_s * excess / pid.TRACKING_TIME_S, state.integral_f, state.y_f)


@compiled
def initialize_single_loop(tuning: SingleLoopTuning, u_A: float, u_B: float, m: Measurement) -> SingleLoopState:
    """Return the state that continues from voltages u_A, u_B [V] at a joint at rest.

    The references start at the joint's position and stiffness.
    """
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    return SingleLoopState(
        GovernorState(m.q, S),
        pid.at_rest_i_pd(tuning.gains.position, m.q, 0.5 * (u_A - u_B)),
        pid.at_rest_i_pd(tuning.gains.stiffness, S, 0.5 * (u_A + u_B)),
    )
