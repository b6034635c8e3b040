"""The cascade of figure 6: governor, outer I-P loops, envelope, decoupler, inner I-PD loops."""

from typing import NamedTuple

from backend.controllers import decoupler, envelope, governor, i_p, motors, scheduling
from backend.controllers.decoupler import Decoupler
from backend.controllers.envelope import Envelope
from backend.controllers.scheduling import Schedule
from plant.compiled import compiled
from plant.interface import Measurement

TRACKING_TIME_S = 0.1
"""Time constant with which the outer integrators are bled of what the envelope held back, and of clipped voltage mapped
back through the decoupler."""


class Tuning(NamedTuple):
    """All gains and bounds the tick needs, replaced as a whole.

    ``omega_max`` [rad/s] bounds the motor references, ``u_max`` [V] the voltages.
    """

    motors: motors.Gains
    schedule: Schedule
    decoupler: Decoupler
    envelope: Envelope
    omega_max: float
    u_max: float


class State(NamedTuple):
    """Everything the cascade remembers from tick to tick."""

    governor: governor.State
    position: i_p.State
    stiffness: i_p.State
    envelope: envelope.State
    motors: motors.State
    position_gains: i_p.Gains
    stiffness_gains: i_p.Gains
    motor_gains: motors.Gains
    active: float
    correction_q: float
    correction_S: float


class Output(NamedTuple):
    """What the cascade decided in a tick, as the sample shows it."""

    u_A: float
    u_B: float
    theta_A_ref: float
    theta_B_ref: float
    S: float
    q_ref_gov: float
    S_ref_gov: float
    bank_entry: float
    clipped_A: bool
    clipped_B: bool
    governed: bool
    at_floor: bool
    at_ceiling: bool
    at_range: bool


@compiled
def step(
    tuning: Tuning, state: State, q_ref: float, S_ref: float, position_loop: bool, m: Measurement
) -> tuple[Output, State]:
    """One tick: references [rad, N·m/rad] and a measurement to motor voltages (figure 6).

    Without ``position_loop`` the decoupler's geometry alone positions the joint: the compliance experiment.
    """
    d = tuning.decoupler
    S = decoupler.stiffness(d, m.theta_A, m.theta_B)
    reference, governed = governor.step(d, tuning.omega_max, state.governor, q_ref, S_ref)

    active = scheduling.select(tuning.schedule, state.active, reference.S_ref)
    gains_q, gains_S = scheduling.gains_at(tuning.schedule, active)
    position = i_p.bumpless(state.position_gains, gains_q, state.position, reference.q_ref, m.q)
    stiffness = i_p.bumpless(state.stiffness_gains, gains_S, state.stiffness, reference.S_ref, S)
    inner = motors.bumpless(state.motor_gains, tuning.motors, state.motors, m.theta_A, m.theta_B)

    q_c, position = i_p.step(gains_q, position, reference.q_ref, m.q, state.correction_q)
    S_c, stiffness = i_p.step(gains_S, stiffness, reference.S_ref, S, state.correction_S)
    if not position_loop:
        q_c = reference.q_ref
    allowed, within = envelope.step(tuning.envelope, d, state.envelope, q_c, S_c, m.F_A, m.F_B)
    theta_A_ref, theta_B_ref = decoupler.motor_positions(d, allowed.q_c, allowed.S_c)
    motor, inner = motors.step(tuning.motors, inner, theta_A_ref, theta_B_ref, m.theta_A, m.theta_B, tuning.u_max)

    # A volt too many is worth 1/k_p radians of motor reference; the decoupler's inverse turns those into q and S.
    back_A = motor.excess_A / tuning.motors.A.k_p / TRACKING_TIME_S
    back_B = motor.excess_B / tuning.motors.B.k_p / TRACKING_TIME_S
    clipped_q, clipped_S = decoupler.rates(d, theta_A_ref, theta_B_ref, -back_A, -back_B)
    correction_q = clipped_q + (allowed.q_c - q_c) / TRACKING_TIME_S
    correction_S = clipped_S + (allowed.S_c - S_c) / TRACKING_TIME_S

    output = Output(
        motor.u_A,
        motor.u_B,
        theta_A_ref,
        theta_B_ref,
        S,
        reference.q_ref,
        reference.S_ref,
        active,
        motor.excess_A != 0.0,
        motor.excess_B != 0.0,
        governed,
        allowed.at_floor,
        allowed.at_ceiling,
        allowed.at_range,
    )
    return output, State(
        reference,
        position,
        stiffness,
        within,
        inner,
        gains_q,
        gains_S,
        tuning.motors,
        active,
        correction_q,
        correction_S,
    )


@compiled
def take_over(
    tuning: Tuning,
    inner: motors.State,
    motor_gains: motors.Gains,
    theta_A_ref: float,
    theta_B_ref: float,
    m: Measurement,
) -> State:
    """State that continues motor loops already running towards theta_A_ref, theta_B_ref [rad], without a bump.

    The references begin where the joint is: q_ref = q, S_ref = S.
    """
    d = tuning.decoupler
    S = decoupler.stiffness(d, m.theta_A, m.theta_B)
    active = scheduling.select(tuning.schedule, -1.0, S)
    gains_q, gains_S = scheduling.gains_at(tuning.schedule, active)
    return State(
        governor.State(m.q, S),
        i_p.at_rest(gains_q, m.q, m.q, decoupler.equilibrium(d, theta_A_ref, theta_B_ref)),
        i_p.at_rest(gains_S, S, S, decoupler.stiffness(d, theta_A_ref, theta_B_ref)),
        envelope.State(m.F_A - m.F_B),
        inner,
        gains_q,
        gains_S,
        motor_gains,
        active,
        0.0,
        0.0,
    )
