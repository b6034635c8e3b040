"""The cascade of figure 6: outer I-P loops, envelope, decoupler, inner I-PD loops, and what they are to follow.

As in the paper the loops are given the references, slowed down by the governor. With a plan they are given what is left
between actuator and model, and the model's voltages go to the motors directly: the loops are the same, so are λ, M_s
and margins, but their lags are no longer on the way (docs/decisions/0046).
"""

import math
from typing import NamedTuple

from backend.control import decoupler, disturbance_observer, pid, trajectory
from backend.control.decoupler import (
    Decoupler,
    Envelope,
    EnvelopeState,
    Schedule,
    interpolate_gains,
    motor_positions,
    select_entry,
    step_envelope,
)
from backend.control.trajectory import LoopReferences
from plant import Measurement, T_s, compiled

# Governor ------------------------------------------------------------------------------------------
#
# Reference governor: both references move together, no faster than the motors can follow.
#
# A step of the references asks for motor speeds that ±10 V cannot give; the loops would saturate,
# couple and wind up. The governor keeps the linear design valid instead: it walks (q_ref, S_ref)
# along the straight line to the target so that neither motor reference moves faster than
# ``omega_max`` (method section 5).


class GovernorState(NamedTuple):
    """References handed to the outer loops [rad, N·m/rad]."""

    q_ref: float
    S_ref: float


@compiled
def step_governor(
    d: Decoupler, omega_max: float, state: GovernorState, q_ref: float, S_ref: float
) -> tuple[GovernorState, bool]:
    """One tick towards (q_ref, S_ref). Returns the governed references and whether the governor held them back."""
    now_A, now_B = motor_positions(d, state.q_ref, state.S_ref)
    target_A, target_B = motor_positions(d, q_ref, S_ref)
    distance = max(abs(target_A - now_A), abs(target_B - now_B))
    reach = omega_max * T_s
    if distance <= reach:
        return GovernorState(q_ref, S_ref), False
    share = reach / distance
    return GovernorState(state.q_ref + share * (q_ref - state.q_ref), state.S_ref + share * (S_ref - state.S_ref)), True


# Following -----------------------------------------------------------------------------------------
#
# What the loops of the cascade follow: references as they are, or a model that a plan moves and
# what is left of it.


PATIENCE_S = 0.1
"""Voltage clipped for so long [s] says that the budget is more than the motors have: the rest is planned with less."""

LESS = 0.9
"""What is left of the budget then."""

NEARLY = 1.2
"""Rest is granted at so many times what the position's integrator leaves alone: a reference half-way between two counts
is read half a count off wherever the joint is, and a little more by one of the two."""


LEFT_Q, LEFT_S = 4.0, 20.0
"""A joint that is off by so many times what is left alone has been pushed away, and comes back by the linear loops;
what hunts against stiction is nearer."""

OPEN = 0.2
"""With the position loop open the motors alone position the joint: rest is granted within so much of ``unseen_q``."""


class Following(NamedTuple):
    """What the references are followed by: a plan within ``budget`` [V] and the model it moves; 0 V: the governor.

    ``unseen_q`` [rad], ``unseen_S`` [N·m/rad]: errors that the outer integrators leave alone; with the governor from
    when the joint has arrived, so that it gets there by the linear loops alone. While both are nearly within, and the
    references stand, all integrators rest.
    """

    budget: float
    model: trajectory.TrajectoryModel
    unseen_q: float
    unseen_S: float


class DeadZones(NamedTuple):
    """Errors that the outer integrators leave alone in a tick, of position [rad] and stiffness [N·m/rad]."""

    q: float
    S: float


class FollowedReferences(NamedTuple):
    """What the loops of this tick work on.

    ``reference`` and the place that position, stiffness and both motors count from; what is added to the outer loops'
    sum, ``q_e`` and ``S_e``; the model's voltages [V]; whether the references are still on their way.
    """

    reference: GovernorState
    q: float
    S: float
    theta_A: float
    theta_B: float
    q_e: float
    S_e: float
    u_A: float
    u_B: float
    moving: bool


@compiled
def follow_governed(reference: GovernorState, moving: bool) -> FollowedReferences:
    """Return references as the governor leaves them: the loops count from zero."""
    return FollowedReferences(
        reference=reference, q=0.0, S=0.0, theta_A=0.0, theta_B=0.0, q_e=0.0, S_e=0.0, u_A=0.0, u_B=0.0, moving=moving
    )


@compiled
def planned(p: trajectory.AxisState, by: trajectory.Driven) -> FollowedReferences:
    """Return the model of a plan: the loops count from it."""
    reference = GovernorState(p.q, p.S)
    return FollowedReferences(
        reference=reference,
        q=p.q,
        S=p.S,
        theta_A=p.theta_A,
        theta_B=p.theta_B,
        q_e=p.q_e,
        S_e=p.S,
        u_A=by.u_A,
        u_B=by.u_B,
        moving=by.moving,
    )


@compiled
def unseen(f: Following, e_q: float, e_S: float) -> bool:
    """Whether the errors of position [rad] and stiffness [N·m/rad] are both so small that they are left alone."""
    return abs(e_q) <= NEARLY * f.unseen_q and abs(e_S) <= f.unseen_S


@compiled
def near(f: Following, e_q: float, e_S: float) -> bool:
    """Whether errors of position [rad] and stiffness [N·m/rad] are those of a joint that has not been pushed away."""
    return abs(e_q) <= LEFT_Q * f.unseen_q and abs(e_S) <= LEFT_S * f.unseen_S


@compiled
def unseen_open(f: Following, e_q: float, e_S: float) -> bool:
    """As ``unseen``, for an error of the equilibrium [rad] where the position loop is open."""
    return abs(e_q) <= OPEN * f.unseen_q and abs(e_S) <= f.unseen_S


@compiled
def patient(clipped_s: float, reserve: float, clipped: bool, moving: bool) -> tuple[float, float]:
    """For how long voltage has been clipped on the way [s], and the share of the budget in use after this tick."""
    clipped_s = clipped_s + T_s if clipped and moving else 0.0
    reserve = reserve if moving else 1.0
    return (0.0, reserve * LESS) if clipped_s > PATIENCE_S else (clipped_s, reserve)


@compiled
def absolute(
    gains: pid.MotorPairGains,
    inner: pid.MotorPairState,
    at: trajectory.AxisState,
    u_A: float,
    u_B: float,
    m: Measurement,
) -> pid.MotorPairState:
    """Motor loops that count from zero, in place of the model, and give its voltages [V] too."""
    return pid.MotorPairState(
        pid.carried(
            gains=gains.A, state=inner.A, y=m.theta_A - at.theta_A, offset=at.theta_A, rate=at.omega_A, u_more=u_A
        ),
        pid.carried(
            gains=gains.B, state=inner.B, y=m.theta_B - at.theta_B, offset=at.theta_B, rate=at.omega_B, u_more=u_B
        ),
    )


@compiled
def dead_zones(f: Following, resting: bool, arrived: bool) -> DeadZones:
    """Dead zones of the outer integrators: everything at rest, nothing on the way."""
    if resting:
        return DeadZones(math.inf, math.inf)
    if arrived:
        return DeadZones(f.unseen_q, f.unseen_S)
    return DeadZones(0.0, 0.0)


# Cascade -------------------------------------------------------------------------------------------


TRACKING_TIME_S = 0.1
"""Time constant with which the outer integrators are bled of what the envelope held back, and of clipped voltage mapped
back through the decoupler."""


class CascadeTuning(NamedTuple):
    """All gains and bounds the tick needs, replaced as a whole.

    ``omega_max`` [rad/s] bounds the governor's motor references, ``u_max`` [V] the voltages.
    """

    motors: pid.MotorPairGains
    schedule: Schedule
    decoupler: Decoupler
    envelope: Envelope
    omega_max: float
    u_max: float
    following: Following
    rejection: disturbance_observer.Rejection


class CascadeState(NamedTuple):
    """Everything the cascade remembers from tick to tick.

    With a plan (``follows``) the loops count from the model: ``position`` and ``stiffness`` give what is added to its
    equilibrium. ``clipped_s`` [s]: for how long voltage has been clipped; ``reserve``: share of the budget in use.
    ``alone``: the motor loops as they are for who takes them over, without a model. ``resting``: all integrators rest;
    ``arrived``: they have, once, since the references have stood and the joint was not pushed away.
    """

    governor: GovernorState
    position: pid.IPState
    stiffness: pid.IPState
    envelope: EnvelopeState
    motors: pid.MotorPairState
    position_gains: pid.IPGains
    stiffness_gains: pid.IPGains
    motor_gains: pid.MotorPairGains
    active: float
    correction_q: float
    correction_S: float
    plan: trajectory.TrajectoryState
    follows: bool
    clipped_s: float
    reserve: float
    alone: pid.MotorPairState
    rejection: disturbance_observer.DisturbanceFeedforwardState
    resting: bool
    arrived: bool


class CascadeOutput(NamedTuple):
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
    tuning: CascadeTuning,
    state: CascadeState,
    r: LoopReferences,
    position_loop: bool,
    m: Measurement,
    tau_ext: float = math.nan,
) -> tuple[CascadeOutput, CascadeState]:
    """One tick: references and a measurement to motor voltages (figure 6).

    Without ``position_loop`` the decoupler's geometry alone positions the joint: the compliance experiment.
    ``tau_ext`` [N·m]: outside torque for the rejection, nan where it is not known.
    """
    d = tuning.decoupler
    S = decoupler.stiffness(d, m.theta_A, m.theta_B)
    # What a plan has set in motion it brings to a stand first: the loops alone let S run on by up to 0.5 N·m/rad.
    follows = tuning.following.budget > 0.0 or (
        state.follows and not trajectory.stands(tuning.following.model, state.plan)
    )
    tau_ext = tau_ext if position_loop and S > 0.0 else math.nan
    if follows != state.follows:
        state = _changed(tuning, state, S, position_loop, m)
    is_at = trajectory.now(d, state.plan)
    if follows:
        budget = tuning.following.budget * state.reserve
        by, way = trajectory.step(d=d, model=tuning.following.model, budget=budget, state=state.plan, at=is_at, r=r)
        at = planned(is_at, by)
        stands = not by.moving
    else:
        reference, governed = step_governor(d, tuning.omega_max, state.governor, r.q, r.S)
        way = state.plan
        at = follow_governed(reference, governed)
        stands = reference.q_ref == state.governor.q_ref and reference.S_ref == state.governor.S_ref
    r_q, r_S = at.reference.q_ref - at.q, at.reference.S_ref - at.S
    y_q, y_S, y_A, y_B = m.q - at.q, S - at.S, m.theta_A - at.theta_A, m.theta_B - at.theta_B

    answered = disturbance_observer.changed(tuning.rejection, state.rejection, tau_ext)
    before, by_now = disturbance_observer.answer(state.rejection, S), disturbance_observer.answer(answered, S)
    answered = disturbance_observer.step_disturbance_feedforward(tuning.rejection, answered, tau_ext)
    pushed = disturbance_observer.answer(answered, S)
    active = select_entry(tuning.schedule, state.active, at.reference.S_ref)
    gains_q, gains_S = interpolate_gains(tuning.schedule, active)
    position = pid.bumpless_i_p(state.position_gains, gains_q, state.position, r_q, y_q - before.q)
    position = pid.raised(position, before.q_e - by_now.q_e + gains_q.k_p * (before.q - by_now.q))
    stiffness = pid.bumpless_i_p(state.stiffness_gains, gains_S, state.stiffness, r_S, y_S)
    inner = pid.bumpless_motor_pair(state.motor_gains, tuning.motors, state.motors, y_A, y_B)

    if position_loop:
        small = unseen(tuning.following, r_q - y_q, r_S - y_S)
    else:
        q_e = at.q_e if follows else at.reference.q_ref
        small = unseen_open(tuning.following, q_e - decoupler.equilibrium(d, m.theta_A, m.theta_B), r_S - y_S)
    resting = stands and small
    arrived = resting or (stands and state.arrived and near(tuning.following, r_q - y_q, r_S - y_S))
    dead = dead_zones(tuning.following, resting, follows or arrived)
    more_q, position = pid.step_i_p(
        gains=gains_q, state=position, r=r_q, y=y_q - pushed.q, correction=state.correction_q, unseen=dead.q
    )
    more_S, stiffness = pid.step_i_p(
        gains=gains_S, state=stiffness, r=r_S, y=y_S, correction=state.correction_S, unseen=dead.S
    )
    q_c, S_c = at.q_e + more_q + pushed.q_e, at.S_e + more_S
    if not position_loop:
        q_c = at.q_e if follows else at.reference.q_ref
    allowed, within = step_envelope(
        envelope=tuning.envelope, d=d, state=state.envelope, q_c=q_c, S_c=S_c, F_A=m.F_A, F_B=m.F_B
    )
    theta_A_ref, theta_B_ref = decoupler.motor_positions(d, allowed.q_c, allowed.S_c)
    motor, inner = pid.step_motor_pair(
        gains=tuning.motors,
        state=inner,
        theta_A_ref=theta_A_ref - at.theta_A,
        theta_B_ref=theta_B_ref - at.theta_B,
        theta_A=y_A,
        theta_B=y_B,
        u_max=tuning.u_max,
        forward_A=at.u_A,
        forward_B=at.u_B,
        resting=resting,
    )

    # A volt too many is worth 1/k_p radians of motor reference; the decoupler's inverse turns those into q and S.
    back_A = motor.excess_A / tuning.motors.A.k_p / TRACKING_TIME_S
    back_B = motor.excess_B / tuning.motors.B.k_p / TRACKING_TIME_S
    clipped_q, clipped_S = decoupler.rates(d, theta_A_ref, theta_B_ref, -back_A, -back_B)
    correction_q = clipped_q + (allowed.q_c - q_c) / TRACKING_TIME_S
    correction_S = clipped_S + (allowed.S_c - S_c) / TRACKING_TIME_S

    alone = absolute(gains=tuning.motors, inner=inner, at=is_at, u_A=at.u_A, u_B=at.u_B, m=m) if follows else inner
    clipped = motor.excess_A != 0.0 or motor.excess_B != 0.0
    clipped_s, reserve = patient(state.clipped_s, state.reserve, clipped, at.moving)

    output = CascadeOutput(
        u_A=motor.u_A,
        u_B=motor.u_B,
        theta_A_ref=theta_A_ref,
        theta_B_ref=theta_B_ref,
        S=S,
        q_ref_gov=at.reference.q_ref,
        S_ref_gov=at.reference.S_ref,
        bank_entry=active,
        clipped_A=motor.excess_A != 0.0,
        clipped_B=motor.excess_B != 0.0,
        governed=at.moving,
        at_floor=allowed.at_floor,
        at_ceiling=allowed.at_ceiling,
        at_range=allowed.at_range,
    )
    return output, CascadeState(
        governor=at.reference,
        position=position,
        stiffness=stiffness,
        envelope=within,
        motors=inner,
        position_gains=gains_q,
        stiffness_gains=gains_S,
        motor_gains=tuning.motors,
        active=active,
        correction_q=correction_q,
        correction_S=correction_S,
        plan=way,
        follows=follows,
        clipped_s=clipped_s,
        reserve=reserve,
        alone=alone,
        rejection=answered,
        resting=resting,
        arrived=arrived,
    )


@compiled
def _changed(tuning: CascadeTuning, state: CascadeState, S: float, position_loop: bool, m: Measurement) -> CascadeState:
    """State that goes on by the other of plan and governor, with the same voltages and, at rest, where it stands."""
    d, q, S_loop = tuning.decoupler, state.position_gains, state.stiffness_gains
    if state.follows:
        at = trajectory.now(d, state.plan)
        u_A, u_B = trajectory.voltages(d, tuning.following.model, state.plan, at)
        return _with(
            state=state,
            reference=GovernorState(at.q if position_loop else at.q_e, at.S),
            position=pid.at_rest_i_p(q, at.q, m.q, at.q_e + state.position.integral - q.k_p * (m.q - at.q)),
            stiffness=pid.at_rest_i_p(S_loop, at.S, S, at.S + state.stiffness.integral - S_loop.k_p * (S - at.S)),
            inner=absolute(gains=state.motor_gains, inner=state.motors, at=at, u_A=u_A, u_B=u_B, m=m),
            way=state.plan,
            follows=False,
        )
    A, B = state.motor_gains.A, state.motor_gains.B
    omega_A, omega_B = _standing(_speed(A, state.motors.A, m.theta_A), _speed(B, state.motors.B, m.theta_B))
    q_e = decoupler.equilibrium(d, m.theta_A, m.theta_B)
    # Without position loop the equilibrium is what is commanded, and the joint of the model stands there. A model that
    # begins at rest is where it is sent already.
    q_m, S_m = m.q if position_loop else q_e, S
    if state.resting:
        q_m, S_m = state.governor.q_ref, state.governor.S_ref
    way = trajectory.begin(d=d, model=tuning.following.model, q=q_m, S=S_m, omega_A=omega_A, omega_B=omega_B)
    at, model = trajectory.now(d, way), tuning.following.model
    answered = disturbance_observer.answer(state.rejection, S)
    # The loops' references were ahead of motors that moved; from here on the model's voltages move them. What the
    # motors are off from the model's, as under a push, the outer loops go on giving.
    return _with(
        state=state,
        reference=state.governor,
        position=pid.at_rest_i_p(q, 0.0, m.q - at.q - answered.q, q_e - at.q_e - answered.q_e),
        stiffness=pid.at_rest_i_p(S_loop, 0.0, S - at.S, S - at.S),
        inner=pid.MotorPairState(
            pid.carried(
                gains=A,
                state=state.motors.A,
                y=m.theta_A,
                offset=-at.theta_A,
                rate=-omega_A,
                u_more=-omega_A / model.K_A,
            ),
            pid.carried(
                gains=B,
                state=state.motors.B,
                y=m.theta_B,
                offset=-at.theta_B,
                rate=-omega_B,
                u_more=-omega_B / model.K_B,
            ),
        ),
        way=way,
        follows=True,
    )


@compiled
def _standing(omega_A: float, omega_B: float) -> tuple[float, float]:
    """Speeds of both motors [rad/s]; zero where what is read of them is no more than a count that has just changed."""
    if max(abs(omega_A), abs(omega_B)) < trajectory.STANDS:
        return 0.0, 0.0
    return omega_A, omega_B


@compiled
def _speed(gains: pid.IPDGains, state: pid.IPDState, theta: float) -> float:
    """Speed of a motor [rad/s], from its loop's filter."""
    return (theta - state.y_f) / gains.t_f


@compiled
def _with(
    state: CascadeState,
    reference: GovernorState,
    position: pid.IPState,
    stiffness: pid.IPState,
    inner: pid.MotorPairState,
    way: trajectory.TrajectoryState,
    follows: bool,
) -> CascadeState:
    return CascadeState(
        governor=reference,
        position=position,
        stiffness=stiffness,
        envelope=state.envelope,
        motors=inner,
        position_gains=state.position_gains,
        stiffness_gains=state.stiffness_gains,
        motor_gains=state.motor_gains,
        active=state.active,
        correction_q=state.correction_q,
        correction_S=state.correction_S,
        plan=way,
        follows=follows,
        clipped_s=0.0,
        reserve=1.0,
        alone=inner,
        rejection=state.rejection,
        resting=state.resting,
        arrived=state.arrived,
    )


@compiled
def initialize_bumpless(
    tuning: CascadeTuning,
    inner: pid.MotorPairState,
    motor_gains: pid.MotorPairGains,
    theta_A_ref: float,
    theta_B_ref: float,
    m: Measurement,
    q_ref: float,
) -> CascadeState:
    """State that continues motor loops already running towards theta_A_ref, theta_B_ref [rad], without a bump.

    The references begin at ``q_ref`` [rad] and S_ref = S. Motors that stand are left where they stand.
    """
    d = tuning.decoupler
    S = decoupler.stiffness(d, m.theta_A, m.theta_B)
    speed_A, speed_B = _speed(motor_gains.A, inner.A, m.theta_A), _speed(motor_gains.B, inner.B, m.theta_B)
    stands = _standing(speed_A, speed_B) == (0.0, 0.0)
    if stands:
        theta_A_ref, theta_B_ref = m.theta_A, m.theta_B
    active = select_entry(tuning.schedule, -1.0, S)
    gains_q, gains_S = interpolate_gains(tuning.schedule, active)
    return CascadeState(
        governor=GovernorState(q_ref, S),
        position=pid.at_rest_i_p(gains_q, q_ref, m.q, decoupler.equilibrium(d, theta_A_ref, theta_B_ref)),
        stiffness=pid.at_rest_i_p(gains_S, S, S, decoupler.stiffness(d, theta_A_ref, theta_B_ref)),
        envelope=EnvelopeState(m.F_A - m.F_B),
        motors=inner,
        position_gains=gains_q,
        stiffness_gains=gains_S,
        motor_gains=motor_gains,
        active=active,
        correction_q=0.0,
        correction_S=0.0,
        plan=trajectory.begin(d=d, model=tuning.following.model, q=m.q, S=S, omega_A=0.0, omega_B=0.0),
        follows=False,
        clipped_s=0.0,
        reserve=1.0,
        alone=inner,
        rejection=disturbance_observer.IDLE,
        resting=stands,
        arrived=stands,
    )
