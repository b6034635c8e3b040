"""The cascade of figure 6: outer I-P loops, envelope, decoupler, inner I-PD loops, and what they are to follow.

As in the paper the loops are given the references, slowed down by the governor. With a plan they are given what is left
between actuator and model, and the model's voltages go to the motors directly: the loops are the same, so are λ, M_s
and margins, but their lags are no longer on the way (docs/decisions/0046).
"""

import math
from typing import NamedTuple

from backend.controllers import decoupler, envelope, following, governor, i_p, i_pd, motors, plan, rejection, scheduling
from backend.controllers.decoupler import Decoupler
from backend.controllers.envelope import Envelope
from backend.controllers.goals import References
from backend.controllers.scheduling import Schedule
from plant.compiled import compiled
from plant.interface import Measurement

TRACKING_TIME_S = 0.1
"""Time constant with which the outer integrators are bled of what the envelope held back, and of clipped voltage mapped
back through the decoupler."""


class Tuning(NamedTuple):
    """All gains and bounds the tick needs, replaced as a whole.

    ``omega_max`` [rad/s] bounds the governor's motor references, ``u_max`` [V] the voltages.
    """

    motors: motors.Gains
    schedule: Schedule
    decoupler: Decoupler
    envelope: Envelope
    omega_max: float
    u_max: float
    following: following.Following
    rejection: rejection.Rejection


class State(NamedTuple):
    """Everything the cascade remembers from tick to tick.

    With a plan (``follows``) the loops count from the model: ``position`` and ``stiffness`` give what is added to its
    equilibrium. ``clipped_s`` [s]: for how long voltage has been clipped; ``reserve``: share of the budget in use.
    ``alone``: the motor loops as they are for who takes them over, without a model. ``resting``: all integrators rest;
    ``arrived``: they have, once, since the references have stood and the joint was not pushed away.
    """

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
    plan: plan.State
    follows: bool
    clipped_s: float
    reserve: float
    alone: motors.State
    rejection: rejection.State
    resting: bool
    arrived: bool


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
    tuning: Tuning, state: State, r: References, position_loop: bool, m: Measurement, tau_ext: float = math.nan
) -> tuple[Output, State]:
    """One tick: references and a measurement to motor voltages (figure 6).

    Without ``position_loop`` the decoupler's geometry alone positions the joint: the compliance experiment.
    ``tau_ext`` [N·m]: outside torque for the rejection, nan where it is not known.
    """
    d = tuning.decoupler
    S = decoupler.stiffness(d, m.theta_A, m.theta_B)
    # What a plan has set in motion it brings to a stand first: the loops alone let S run on by up to 0.5 N·m/rad.
    follows = tuning.following.budget > 0.0 or (state.follows and not plan.stands(tuning.following.model, state.plan))
    tau_ext = tau_ext if position_loop and S > 0.0 else math.nan
    if follows != state.follows:
        state = _changed(tuning, state, S, position_loop, m)
    is_at = plan.now(d, state.plan)
    if follows:
        budget = tuning.following.budget * state.reserve
        by, way = plan.step(d, tuning.following.model, budget, state.plan, is_at, r)
        at = following.planned(is_at, by)
        stands = not by.moving
    else:
        reference, governed = governor.step(d, tuning.omega_max, state.governor, r.q, r.S)
        way = state.plan
        at = following.governed(reference, governed)
        stands = reference.q_ref == state.governor.q_ref and reference.S_ref == state.governor.S_ref
    r_q, r_S = at.reference.q_ref - at.q, at.reference.S_ref - at.S
    y_q, y_S, y_A, y_B = m.q - at.q, S - at.S, m.theta_A - at.theta_A, m.theta_B - at.theta_B

    answered = rejection.changed(tuning.rejection, state.rejection, tau_ext)
    before, by_now = rejection.answer(state.rejection, S), rejection.answer(answered, S)
    answered = rejection.step(tuning.rejection, answered, tau_ext)
    pushed = rejection.answer(answered, S)
    active = scheduling.select(tuning.schedule, state.active, at.reference.S_ref)
    gains_q, gains_S = scheduling.gains_at(tuning.schedule, active)
    position = i_p.bumpless(state.position_gains, gains_q, state.position, r_q, y_q - before.q)
    position = i_p.raised(position, before.q_e - by_now.q_e + gains_q.k_p * (before.q - by_now.q))
    stiffness = i_p.bumpless(state.stiffness_gains, gains_S, state.stiffness, r_S, y_S)
    inner = motors.bumpless(state.motor_gains, tuning.motors, state.motors, y_A, y_B)

    if position_loop:
        small = following.unseen(tuning.following, r_q - y_q, r_S - y_S)
    else:
        q_e = at.q_e if follows else at.reference.q_ref
        small = following.unseen_open(tuning.following, q_e - decoupler.equilibrium(d, m.theta_A, m.theta_B), r_S - y_S)
    resting = stands and small
    arrived = resting or (stands and state.arrived and following.near(tuning.following, r_q - y_q, r_S - y_S))
    dead = following.dead_zones(tuning.following, resting, follows or arrived)
    more_q, position = i_p.step(gains_q, position, r_q, y_q - pushed.q, state.correction_q, dead.q)
    more_S, stiffness = i_p.step(gains_S, stiffness, r_S, y_S, state.correction_S, dead.S)
    q_c, S_c = at.q_e + more_q + pushed.q_e, at.S_e + more_S
    if not position_loop:
        q_c = at.q_e if follows else at.reference.q_ref
    allowed, within = envelope.step(tuning.envelope, d, state.envelope, q_c, S_c, m.F_A, m.F_B)
    theta_A_ref, theta_B_ref = decoupler.motor_positions(d, allowed.q_c, allowed.S_c)
    motor, inner = motors.step(
        tuning.motors,
        inner,
        theta_A_ref - at.theta_A,
        theta_B_ref - at.theta_B,
        y_A,
        y_B,
        tuning.u_max,
        at.u_A,
        at.u_B,
        resting,
    )

    # A volt too many is worth 1/k_p radians of motor reference; the decoupler's inverse turns those into q and S.
    back_A = motor.excess_A / tuning.motors.A.k_p / TRACKING_TIME_S
    back_B = motor.excess_B / tuning.motors.B.k_p / TRACKING_TIME_S
    clipped_q, clipped_S = decoupler.rates(d, theta_A_ref, theta_B_ref, -back_A, -back_B)
    correction_q = clipped_q + (allowed.q_c - q_c) / TRACKING_TIME_S
    correction_S = clipped_S + (allowed.S_c - S_c) / TRACKING_TIME_S

    alone = following.absolute(tuning.motors, inner, is_at, at.u_A, at.u_B, m) if follows else inner
    clipped = motor.excess_A != 0.0 or motor.excess_B != 0.0
    clipped_s, reserve = following.patient(state.clipped_s, state.reserve, clipped, at.moving)

    output = Output(
        motor.u_A,
        motor.u_B,
        theta_A_ref,
        theta_B_ref,
        S,
        at.reference.q_ref,
        at.reference.S_ref,
        active,
        motor.excess_A != 0.0,
        motor.excess_B != 0.0,
        at.moving,
        allowed.at_floor,
        allowed.at_ceiling,
        allowed.at_range,
    )
    return output, State(
        at.reference,
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
        way,
        follows,
        clipped_s,
        reserve,
        alone,
        answered,
        resting,
        arrived,
    )


@compiled
def _changed(tuning: Tuning, state: State, S: float, position_loop: bool, m: Measurement) -> State:
    """State that goes on by the other of plan and governor, with the same voltages and, at rest, where it stands."""
    d, q, S_loop = tuning.decoupler, state.position_gains, state.stiffness_gains
    if state.follows:
        at = plan.now(d, state.plan)
        u_A, u_B = plan.voltages(d, tuning.following.model, state.plan, at)
        return _with(
            state,
            governor.State(at.q if position_loop else at.q_e, at.S),
            i_p.at_rest(q, at.q, m.q, at.q_e + state.position.integral - q.k_p * (m.q - at.q)),
            i_p.at_rest(S_loop, at.S, S, at.S + state.stiffness.integral - S_loop.k_p * (S - at.S)),
            following.absolute(state.motor_gains, state.motors, at, u_A, u_B, m),
            state.plan,
            False,
        )
    A, B = state.motor_gains.A, state.motor_gains.B
    omega_A, omega_B = _standing(_speed(A, state.motors.A, m.theta_A), _speed(B, state.motors.B, m.theta_B))
    q_e = decoupler.equilibrium(d, m.theta_A, m.theta_B)
    # Without position loop the equilibrium is what is commanded, and the joint of the model stands there. A model that
    # begins at rest is where it is sent already.
    q_m, S_m = m.q if position_loop else q_e, S
    if state.resting:
        q_m, S_m = state.governor.q_ref, state.governor.S_ref
    way = plan.begin(d, tuning.following.model, q_m, S_m, omega_A, omega_B)
    at, model = plan.now(d, way), tuning.following.model
    answered = rejection.answer(state.rejection, S)
    # The loops' references were ahead of motors that moved; from here on the model's voltages move them. What the
    # motors are off from the model's, as under a push, the outer loops go on giving.
    return _with(
        state,
        state.governor,
        i_p.at_rest(q, 0.0, m.q - at.q - answered.q, q_e - at.q_e - answered.q_e),
        i_p.at_rest(S_loop, 0.0, S - at.S, S - at.S),
        motors.State(
            i_pd.carried(A, state.motors.A, m.theta_A, -at.theta_A, -omega_A, -omega_A / model.K_A),
            i_pd.carried(B, state.motors.B, m.theta_B, -at.theta_B, -omega_B, -omega_B / model.K_B),
        ),
        way,
        True,
    )


@compiled
def _standing(omega_A: float, omega_B: float) -> tuple[float, float]:
    """Speeds of both motors [rad/s]; zero where what is read of them is no more than a count that has just changed."""
    if max(abs(omega_A), abs(omega_B)) < plan.STANDS:
        return 0.0, 0.0
    return omega_A, omega_B


@compiled
def _speed(gains: i_pd.Gains, state: i_pd.State, theta: float) -> float:
    """Speed of a motor [rad/s], from its loop's filter."""
    return (theta - state.y_f) / gains.t_f


@compiled
def _with(
    state: State,
    reference: governor.State,
    position: i_p.State,
    stiffness: i_p.State,
    inner: motors.State,
    way: plan.State,
    follows: bool,
) -> State:
    return State(
        reference,
        position,
        stiffness,
        state.envelope,
        inner,
        state.position_gains,
        state.stiffness_gains,
        state.motor_gains,
        state.active,
        state.correction_q,
        state.correction_S,
        way,
        follows,
        0.0,
        1.0,
        inner,
        state.rejection,
        state.resting,
        state.arrived,
    )


@compiled
def take_over(
    tuning: Tuning,
    inner: motors.State,
    motor_gains: motors.Gains,
    theta_A_ref: float,
    theta_B_ref: float,
    m: Measurement,
    q_ref: float,
) -> State:
    """State that continues motor loops already running towards theta_A_ref, theta_B_ref [rad], without a bump.

    The references begin at ``q_ref`` [rad] and S_ref = S. Motors that stand are left where they stand.
    """
    d = tuning.decoupler
    S = decoupler.stiffness(d, m.theta_A, m.theta_B)
    speed_A, speed_B = _speed(motor_gains.A, inner.A, m.theta_A), _speed(motor_gains.B, inner.B, m.theta_B)
    stands = _standing(speed_A, speed_B) == (0.0, 0.0)
    if stands:
        theta_A_ref, theta_B_ref = m.theta_A, m.theta_B
    active = scheduling.select(tuning.schedule, -1.0, S)
    gains_q, gains_S = scheduling.gains_at(tuning.schedule, active)
    return State(
        governor.State(q_ref, S),
        i_p.at_rest(gains_q, q_ref, m.q, decoupler.equilibrium(d, theta_A_ref, theta_B_ref)),
        i_p.at_rest(gains_S, S, S, decoupler.stiffness(d, theta_A_ref, theta_B_ref)),
        envelope.State(m.F_A - m.F_B),
        inner,
        gains_q,
        gains_S,
        motor_gains,
        active,
        0.0,
        0.0,
        plan.begin(d, tuning.following.model, m.q, S, 0.0, 0.0),
        False,
        0.0,
        1.0,
        inner,
        rejection.IDLE,
        stands,
        stands,
    )
