"""Cascade of figure 6: outer I-P loops, envelope, decoupler and inner I-PD loops.

As in the paper, the loops track the references limited by the governor. With trajectory feed-forward they act on the
difference between actuator and model, and the model's voltages go to the motors directly: loops, λ, M_s and margins are
the same, but the lags of the loops no longer delay the motion (docs/decisions/0046).
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
# Reference governor: both references move together, no faster than the motors can follow.
#
# A step of the references requires motor speeds that ±10 V cannot give; the loops would saturate, couple and wind up.
# The governor keeps the linear design valid: it moves (q_ref, S_ref) along the straight line to the target so that
# neither motor reference moves faster than ``omega_max`` (method section 5).


class GovernorState(NamedTuple):
    """References of the outer loops [rad, N·m/rad]."""

    q_ref: float
    S_ref: float


@compiled
def step_governor(
    d: Decoupler, omega_max: float, state: GovernorState, q_ref: float, S_ref: float
) -> tuple[GovernorState, bool]:
    """Move the references by one tick towards (q_ref, S_ref).

    Returns the governed references and whether the governor limited them.
    """
    now_A, now_B = motor_positions(d, state.q_ref, state.S_ref)
    target_A, target_B = motor_positions(d, q_ref, S_ref)
    distance = max(abs(target_A - now_A), abs(target_B - now_B))
    reach = omega_max * T_s
    if distance <= reach:
        return GovernorState(q_ref, S_ref), False
    share = reach / distance
    return GovernorState(state.q_ref + share * (q_ref - state.q_ref), state.S_ref + share * (S_ref - state.S_ref)), True


# Tracked signals -----------------------------------------------------------------------------------
# Signals that the loops of the cascade track: the governed references, or the difference to a model that a trajectory
# moves.


CLIPPING_TIMEOUT_S = 0.1
"""Time of clipped voltage [s] from which the voltage limit counts as too high; the rest of the motion uses a lower
one."""

BUDGET_REDUCTION = 0.9
"""Factor by which the voltage limit is then reduced."""

REST_FACTOR = 1.2
"""Errors up to this multiple of the position integrator's dead zone count as rest: with a reference halfway between two
encoder counts the reading is off by half a count everywhere, and slightly more at one of the two counts."""


NEAR_FACTOR_Q, NEAR_FACTOR_S = 4.0, 20.0
"""Multiples of the dead zones beyond which the joint has been pushed away and returns by the linear loops; hunting
against static friction stays within them."""

OPEN_LOOP_FACTOR = 0.2
"""Fraction of ``dead_zone_q`` within which the joint is at rest while the position loop is open."""


class ReferenceTracking(NamedTuple):
    """How references are tracked: ``budget`` [V] of a trajectory, 0 for the governor.

    ``model`` is the model that the trajectory moves. ``dead_zone_q`` [rad], ``dead_zone_S`` [N·m/rad]: errors that the
    outer integrators ignore; with the governor only after the joint has arrived, so that it arrives by the linear loops
    alone. While both errors are small and the references constant, no integrator integrates.
    """

    budget: float
    model: trajectory.TrajectoryModel
    dead_zone_q: float
    dead_zone_S: float


class DeadZones(NamedTuple):
    """Errors that the outer integrators ignore in this tick [rad], [N·m/rad]."""

    q: float
    S: float


class TrackedReferences(NamedTuple):
    """Signals that the loops of this tick track.

    ``reference``, and the origin of position, stiffness and both motors; ``q_e`` and ``S_e`` are added to the outputs
    of the outer loops; ``u_A``, ``u_B`` are the model's voltages [V]; ``moving``: the references still move.
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
def follow_governed(reference: GovernorState, moving: bool) -> TrackedReferences:
    """Return the signals of governed references: the origin of the loops is zero."""
    return TrackedReferences(
        reference=reference, q=0.0, S=0.0, theta_A=0.0, theta_B=0.0, q_e=0.0, S_e=0.0, u_A=0.0, u_B=0.0, moving=moving
    )


@compiled
def follow_trajectory(model: trajectory.AxisState, drive: trajectory.Driven) -> TrackedReferences:
    """Return the signals of a trajectory: the origin of the loops is its model."""
    reference = GovernorState(model.q, model.S)
    return TrackedReferences(
        reference=reference,
        q=model.q,
        S=model.S,
        theta_A=model.theta_A,
        theta_B=model.theta_B,
        q_e=model.q_e,
        S_e=model.S,
        u_A=drive.u_A,
        u_B=drive.u_B,
        moving=drive.moving,
    )


@compiled
def is_within_dead_zone(f: ReferenceTracking, e_q: float, e_S: float) -> bool:
    """Return whether both errors [rad], [N·m/rad] are within the dead zones."""
    return abs(e_q) <= REST_FACTOR * f.dead_zone_q and abs(e_S) <= f.dead_zone_S


@compiled
def is_near_reference(f: ReferenceTracking, e_q: float, e_S: float) -> bool:
    """Return whether the errors [rad], [N·m/rad] show a joint not pushed away."""
    return abs(e_q) <= NEAR_FACTOR_Q * f.dead_zone_q and abs(e_S) <= NEAR_FACTOR_S * f.dead_zone_S


@compiled
def is_within_dead_zone_open_loop(f: ReferenceTracking, e_q: float, e_S: float) -> bool:
    """Like ``is_within_dead_zone``, for an error of the equilibrium [rad].

    Used while the position loop is open.
    """
    return abs(e_q) <= OPEN_LOOP_FACTOR * f.dead_zone_q and abs(e_S) <= f.dead_zone_S


@compiled
def update_voltage_reserve(clipped_s: float, reserve: float, clipped: bool, moving: bool) -> tuple[float, float]:
    """Return the time of clipping in motion [s] and the factor on the voltage limit."""
    clipped_s = clipped_s + T_s if clipped and moving else 0.0
    reserve = reserve if moving else 1.0
    return (0.0, reserve * BUDGET_REDUCTION) if clipped_s > CLIPPING_TIMEOUT_S else (clipped_s, reserve)


@compiled
def convert_to_absolute(
    gains: pid.MotorPairGains,
    inner: pid.MotorPairState,
    model: trajectory.AxisState,
    u_A: float,
    u_B: float,
    m: Measurement,
) -> pid.MotorPairState:
    """Return motor loops with origin zero that also give the model's voltages [V]."""
    return pid.MotorPairState(
        pid.rebase_i_pd(
            gains=gains.A,
            state=inner.A,
            y=m.theta_A - model.theta_A,
            offset=model.theta_A,
            rate=model.omega_A,
            u_added=u_A,
        ),
        pid.rebase_i_pd(
            gains=gains.B,
            state=inner.B,
            y=m.theta_B - model.theta_B,
            offset=model.theta_B,
            rate=model.omega_B,
            u_added=u_B,
        ),
    )


@compiled
def select_dead_zones(f: ReferenceTracking, resting: bool, arrived: bool) -> DeadZones:
    """Return the dead zones of the outer integrators.

    They are infinite at rest, and zero while the joint moves towards a governed reference.
    """
    if resting:
        return DeadZones(math.inf, math.inf)
    if arrived:
        return DeadZones(f.dead_zone_q, f.dead_zone_S)
    return DeadZones(0.0, 0.0)


# Cascade -------------------------------------------------------------------------------------------


TRACKING_TIME_S = 0.1
"""Time constant with which the outer integrators are corrected by the envelope's limits, and by clipped voltage mapped
through the inverse of the decoupler."""


class CascadeTuning(NamedTuple):
    """Gains and limits of the cascade, replaced as a whole.

    ``omega_max`` [rad/s] limits the governor's motor references, ``u_max`` [V] the voltages.
    """

    motors: pid.MotorPairGains
    schedule: Schedule
    decoupler: Decoupler
    envelope: Envelope
    omega_max: float
    u_max: float
    reference_tracking: ReferenceTracking
    disturbance_feedforward: disturbance_observer.Rejection


class CascadeState(NamedTuple):
    """State of the cascade.

    With a trajectory (``follows_trajectory``) the origin of the loops is the model, and ``position`` and ``stiffness``
    give increments to its equilibrium. ``clipped_s`` [s]: time for which a voltage has been clipped; ``reserve``:
    factor on the voltage limit. ``standalone_motors``: motor loops without a model, for the next motion. ``resting``:
    no integrator integrates; ``arrived``: that was so once since the references became constant, and the joint was not
    pushed away since.
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
    trajectory_state: trajectory.TrajectoryState
    follows_trajectory: bool
    clipped_s: float
    reserve: float
    standalone_motors: pid.MotorPairState
    disturbance_feedforward: disturbance_observer.DisturbanceFeedforwardState
    resting: bool
    arrived: bool


class CascadeOutput(NamedTuple):
    """Output of the cascade in a step, as in the sample."""

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
    """Execute one step: references and a measurement to voltages (figure 6).

    Without ``position_loop`` the geometry of the decoupler alone positions the joint: the compliance experiment.
    ``tau_ext`` [N·m]: external torque for the disturbance rejection, NaN if it is unknown.
    """
    d = tuning.decoupler
    S = decoupler.measured_stiffness(d, m.q, m.theta_A, m.theta_B)
    # A trajectory first brings its motion to rest: the loops alone let S overshoot by up to 0.5 N·m/rad.
    follows_trajectory = tuning.reference_tracking.budget > 0.0 or (
        state.follows_trajectory and not trajectory.is_at_rest(tuning.reference_tracking.model, state.trajectory_state)
    )
    tau_ext = tau_ext if position_loop and S > 0.0 else math.nan
    if follows_trajectory != state.follows_trajectory:
        state = _switch_following(tuning, state, S, position_loop, m)
    model = trajectory.compute_axis_state(d, state.trajectory_state)
    if follows_trajectory:
        budget = tuning.reference_tracking.budget * state.reserve
        drive, trajectory_state = trajectory.step(
            d=d, model=tuning.reference_tracking.model, budget=budget, state=state.trajectory_state, at=model, r=r
        )
        followed = follow_trajectory(model, drive)
        is_reference_constant = not drive.moving
    else:
        reference, governed = step_governor(d, tuning.omega_max, state.governor, r.q, r.S)
        trajectory_state = state.trajectory_state
        followed = follow_governed(reference, governed)
        is_reference_constant = reference.q_ref == state.governor.q_ref and reference.S_ref == state.governor.S_ref
    r_q, r_S = followed.reference.q_ref - followed.q, followed.reference.S_ref - followed.S
    y_q, y_S, y_A, y_B = m.q - followed.q, S - followed.S, m.theta_A - followed.theta_A, m.theta_B - followed.theta_B

    feedforward = disturbance_observer.update_gain(
        tuning.disturbance_feedforward, state.disturbance_feedforward, tau_ext
    )
    compensation_before, compensation_after_change = (
        disturbance_observer.compute_compensation(state.disturbance_feedforward, S),
        disturbance_observer.compute_compensation(feedforward, S),
    )
    feedforward = disturbance_observer.step_disturbance_feedforward(
        tuning.disturbance_feedforward, feedforward, tau_ext
    )
    compensation = disturbance_observer.compute_compensation(feedforward, S)
    active = select_entry(tuning.schedule, state.active, followed.reference.S_ref)
    gains_q, gains_S = interpolate_gains(tuning.schedule, active)
    position = pid.bumpless_i_p(state.position_gains, gains_q, state.position, r_q, y_q - compensation_before.q)
    position = pid.add_to_integral(
        position,
        compensation_before.q_e
        - compensation_after_change.q_e
        + gains_q.k_p * (compensation_before.q - compensation_after_change.q),
    )
    stiffness = pid.bumpless_i_p(state.stiffness_gains, gains_S, state.stiffness, r_S, y_S)
    inner = pid.bumpless_motor_pair(state.motor_gains, tuning.motors, state.motors, y_A, y_B)

    if position_loop:
        is_small = is_within_dead_zone(tuning.reference_tracking, r_q - y_q, r_S - y_S)
    else:
        q_e = followed.q_e if follows_trajectory else followed.reference.q_ref
        is_small = is_within_dead_zone_open_loop(
            tuning.reference_tracking, q_e - decoupler.equilibrium(d, m.theta_A, m.theta_B), r_S - y_S
        )
    resting = is_reference_constant and is_small
    arrived = resting or (
        is_reference_constant and state.arrived and is_near_reference(tuning.reference_tracking, r_q - y_q, r_S - y_S)
    )
    dead_zone = select_dead_zones(tuning.reference_tracking, resting, follows_trajectory or arrived)
    delta_q, position = pid.step_i_p(
        gains=gains_q,
        state=position,
        r=r_q,
        y=y_q - compensation.q,
        correction=state.correction_q,
        dead_zone=dead_zone.q,
    )
    delta_S, stiffness = pid.step_i_p(
        gains=gains_S, state=stiffness, r=r_S, y=y_S, correction=state.correction_S, dead_zone=dead_zone.S
    )
    q_c, S_c = followed.q_e + delta_q + compensation.q_e, followed.S_e + delta_S
    if not position_loop:
        q_c = followed.q_e if follows_trajectory else followed.reference.q_ref
    limited, envelope = step_envelope(
        envelope=tuning.envelope, d=d, state=state.envelope, q_c=q_c, S_c=S_c, F_A=m.F_A, F_B=m.F_B
    )
    theta_A_ref, theta_B_ref = decoupler.motor_positions(d, limited.q_c, limited.S_c)
    motor, inner = pid.step_motor_pair(
        gains=tuning.motors,
        state=inner,
        theta_A_ref=theta_A_ref - followed.theta_A,
        theta_B_ref=theta_B_ref - followed.theta_B,
        theta_A=y_A,
        theta_B=y_B,
        u_max=tuning.u_max,
        forward_A=followed.u_A,
        forward_B=followed.u_B,
        resting=resting,
    )

    # An excess voltage corresponds to 1/k_p radians per volt of motor reference; the decoupler's inverse maps those to
    # q and S.
    unwind_A = motor.excess_A / tuning.motors.A.k_p / TRACKING_TIME_S
    unwind_B = motor.excess_B / tuning.motors.B.k_p / TRACKING_TIME_S
    clipped_q, clipped_S = decoupler.rates(d, theta_A_ref, theta_B_ref, -unwind_A, -unwind_B)
    correction_q = clipped_q + (limited.q_c - q_c) / TRACKING_TIME_S
    correction_S = clipped_S + (limited.S_c - S_c) / TRACKING_TIME_S

    standalone_motors = (
        convert_to_absolute(gains=tuning.motors, inner=inner, model=model, u_A=followed.u_A, u_B=followed.u_B, m=m)
        if follows_trajectory
        else inner
    )
    clipped = motor.excess_A != 0.0 or motor.excess_B != 0.0
    clipped_s, reserve = update_voltage_reserve(state.clipped_s, state.reserve, clipped, followed.moving)

    output = CascadeOutput(
        u_A=motor.u_A,
        u_B=motor.u_B,
        theta_A_ref=theta_A_ref,
        theta_B_ref=theta_B_ref,
        S=S,
        q_ref_gov=followed.reference.q_ref,
        S_ref_gov=followed.reference.S_ref,
        bank_entry=active,
        clipped_A=motor.excess_A != 0.0,
        clipped_B=motor.excess_B != 0.0,
        governed=followed.moving,
        at_floor=limited.at_floor,
        at_ceiling=limited.at_ceiling,
        at_range=limited.at_range,
    )
    return output, CascadeState(
        governor=followed.reference,
        position=position,
        stiffness=stiffness,
        envelope=envelope,
        motors=inner,
        position_gains=gains_q,
        stiffness_gains=gains_S,
        motor_gains=tuning.motors,
        active=active,
        correction_q=correction_q,
        correction_S=correction_S,
        trajectory_state=trajectory_state,
        follows_trajectory=follows_trajectory,
        clipped_s=clipped_s,
        reserve=reserve,
        standalone_motors=standalone_motors,
        disturbance_feedforward=feedforward,
        resting=resting,
        arrived=arrived,
    )


@compiled
def _switch_following(
    tuning: CascadeTuning, state: CascadeState, S: float, position_loop: bool, m: Measurement
) -> CascadeState:
    """Switch between trajectory and governor with continuous voltages.

    At rest the position is continuous too.
    """
    d, position_gains, stiffness_gains = tuning.decoupler, state.position_gains, state.stiffness_gains
    if state.follows_trajectory:
        model_state = trajectory.compute_axis_state(d, state.trajectory_state)
        u_A, u_B = trajectory.compute_voltages(d, tuning.reference_tracking.model, state.trajectory_state, model_state)
        return _with_following(
            state=state,
            reference=GovernorState(model_state.q if position_loop else model_state.q_e, model_state.S),
            position=pid.at_rest_i_p(
                position_gains,
                model_state.q,
                m.q,
                model_state.q_e + state.position.integral - position_gains.k_p * (m.q - model_state.q),
            ),
            stiffness=pid.at_rest_i_p(
                stiffness_gains,
                model_state.S,
                S,
                model_state.S + state.stiffness.integral - stiffness_gains.k_p * (S - model_state.S),
            ),
            inner=convert_to_absolute(
                gains=state.motor_gains, inner=state.motors, model=model_state, u_A=u_A, u_B=u_B, m=m
            ),
            trajectory_state=state.trajectory_state,
            follows_trajectory=False,
        )
    A, B = state.motor_gains.A, state.motor_gains.B
    omega_A, omega_B = _zero_standstill_speeds(
        _compute_motor_speed(A, state.motors.A, m.theta_A), _compute_motor_speed(B, state.motors.B, m.theta_B)
    )
    q_e = decoupler.equilibrium(d, m.theta_A, m.theta_B)
    # Without position loop the commanded equilibrium is the model's joint position. A model that starts at rest starts
    # at its reference.
    q_m, S_m = m.q if position_loop else q_e, S
    if state.resting:
        q_m, S_m = state.governor.q_ref, state.governor.S_ref
    trajectory_state = trajectory.begin_trajectory(
        d=d, model=tuning.reference_tracking.model, q=q_m, S=S_m, omega_A=omega_A, omega_B=omega_B
    )
    model_state, model = trajectory.compute_axis_state(d, trajectory_state), tuning.reference_tracking.model
    compensation = disturbance_observer.compute_compensation(state.disturbance_feedforward, S)
    # The loops' references were ahead of the moving motors; from here on the model's voltages move them. The outer
    # loops keep the offset of the motors from the model, such as under a push.
    return _with_following(
        state=state,
        reference=state.governor,
        position=pid.at_rest_i_p(
            position_gains, 0.0, m.q - model_state.q - compensation.q, q_e - model_state.q_e - compensation.q_e
        ),
        stiffness=pid.at_rest_i_p(stiffness_gains, 0.0, S - model_state.S, S - model_state.S),
        inner=pid.MotorPairState(
            pid.rebase_i_pd(
                gains=A,
                state=state.motors.A,
                y=m.theta_A,
                offset=-model_state.theta_A,
                rate=-omega_A,
                u_added=-omega_A / model.K_A,
            ),
            pid.rebase_i_pd(
                gains=B,
                state=state.motors.B,
                y=m.theta_B,
                offset=-model_state.theta_B,
                rate=-omega_B,
                u_added=-omega_B / model.K_B,
            ),
        ),
        trajectory_state=trajectory_state,
        follows_trajectory=True,
    )


@compiled
def _zero_standstill_speeds(omega_A: float, omega_B: float) -> tuple[float, float]:
    """Return the motor speeds [rad/s], zero if they may be single encoder counts."""
    if max(abs(omega_A), abs(omega_B)) < trajectory.STANDSTILL_RAD_S:
        return 0.0, 0.0
    return omega_A, omega_B


@compiled
def _compute_motor_speed(gains: pid.IPDGains, state: pid.IPDState, theta: float) -> float:
    """Return the speed of a motor [rad/s] from its loop's filter."""
    return (theta - state.y_f) / gains.t_f


@compiled
def _with_following(
    state: CascadeState,
    reference: GovernorState,
    position: pid.IPState,
    stiffness: pid.IPState,
    inner: pid.MotorPairState,
    trajectory_state: trajectory.TrajectoryState,
    follows_trajectory: bool,
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
        trajectory_state=trajectory_state,
        follows_trajectory=follows_trajectory,
        clipped_s=0.0,
        reserve=1.0,
        standalone_motors=inner,
        disturbance_feedforward=state.disturbance_feedforward,
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
    """Return the state that continues running motor loops without a bump.

    The loops run towards theta_A_ref, theta_B_ref [rad]. The references start at ``q_ref`` [rad] and S_ref = S. Motors
    at rest stay where they are.
    """
    d = tuning.decoupler
    S = decoupler.measured_stiffness(d, m.q, m.theta_A, m.theta_B)
    speed_A, speed_B = (
        _compute_motor_speed(motor_gains.A, inner.A, m.theta_A),
        _compute_motor_speed(motor_gains.B, inner.B, m.theta_B),
    )
    is_at_standstill = _zero_standstill_speeds(speed_A, speed_B) == (0.0, 0.0)
    if is_at_standstill:
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
        trajectory_state=trajectory.begin_trajectory(
            d=d, model=tuning.reference_tracking.model, q=m.q, S=S, omega_A=0.0, omega_B=0.0
        ),
        follows_trajectory=False,
        clipped_s=0.0,
        reserve=1.0,
        standalone_motors=inner,
        disturbance_feedforward=disturbance_observer.IDLE,
        resting=is_at_standstill,
        arrived=is_at_standstill,
    )
