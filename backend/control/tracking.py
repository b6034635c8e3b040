"""Motions that follow references: the cascade and the baseline laws."""

import math
from typing import NamedTuple

from backend.control import baselines, cascade, decoupler, pid
from backend.control.decoupler import Bounds
from backend.control.motion_types import VOLTAGE_A, VOLTAGE_B, ControlOutput, MotorLoopState, Setpoint
from backend.control.setpoint_player import SetpointPlayer, find_ramp_end, step_setpoint_player
from backend.control.trajectory import LoopReferences
from backend.faults import Limit
from plant import Measurement, compiled

# Tracking ------------------------------------------------------------------------------------------
# The cascade, which follows the operator's references or a program's segments.


_GOVERNOR, _FLOOR, _CEILING, _RANGE = (
    int(flag) for flag in (Limit.GOVERNOR, Limit.TENSION_FLOOR, Limit.TENSION_CEILING, Limit.JOINT_RANGE)
)


class TrackingState(NamedTuple):
    """State of the cascade that follows references or a program.

    ``position_loop``: closed; otherwise the decoupler's geometry alone positions the joint. ``has_program``: it plays a
    program. ``tau_ext`` [N·m]: external torque in this tick, NaN unless its bias is known.
    """

    law: cascade.CascadeState
    position_loop: bool
    has_program: bool
    player: SetpointPlayer
    tau_ext: float = math.nan


@compiled
def step(
    tuning: cascade.CascadeTuning, motor_loops: MotorLoopState, setpoint: Setpoint, state: TrackingState, m: Measurement
) -> tuple[ControlOutput, MotorLoopState, TrackingState]:
    """Execute a step of the cascade."""
    done, player, q_end, S_end = False, state.player, math.nan, math.nan
    if state.has_program:
        done, setpoint, player = step_setpoint_player(player, setpoint)
        q_end, S_end = find_ramp_end(player)
    references = LoopReferences(setpoint.q_ref, setpoint.S_ref, q_end, S_end)
    y, law = cascade.step(
        tuning=tuning, state=state.law, r=references, position_loop=state.position_loop, m=m, tau_ext=state.tau_ext
    )
    motor_loops = MotorLoopState(law.standalone_motors, tuning.motors, y.theta_A_ref, y.theta_B_ref)
    return (
        make_control_output(y, setpoint, state.has_program, done),
        motor_loops,
        TrackingState(law, state.position_loop, state.has_program, player, state.tau_ext),
    )


@compiled
def make_control_output(
    y: cascade.CascadeOutput, setpoint: Setpoint, sets_disturbance: bool, done: bool
) -> ControlOutput:
    """Return the control output of a law of position and stiffness."""
    return ControlOutput(
        u_A=y.u_A,
        u_B=y.u_B,
        theta_A_ref=y.theta_A_ref,
        theta_B_ref=y.theta_B_ref,
        setpoint=setpoint,
        q_ref_gov=y.q_ref_gov,
        S_ref_gov=y.S_ref_gov,
        bank_entry=y.bank_entry,
        limits=make_limit_flags(y),
        sets_disturbance=sets_disturbance,
        done=done,
    )


@compiled
def make_limit_flags(y: cascade.CascadeOutput) -> int:
    """Return the limit flags of a step."""
    return (
        (VOLTAGE_A if y.clipped_A else 0)
        | (VOLTAGE_B if y.clipped_B else 0)
        | (_GOVERNOR if y.governed else 0)
        | (_FLOOR if y.at_floor else 0)
        | (_CEILING if y.at_ceiling else 0)
        | (_RANGE if y.at_range else 0)
    )


def find_resting_setpoint(
    tuning: cascade.CascadeTuning, m: Measurement, bounds: Bounds, *, position_loop: bool = True
) -> Setpoint:
    """Return references that require no motion, within the bounds.

    Without position loop q_ref is the equilibrium of the motors [rad], not the position at which a push holds the
    joint.
    """
    d = tuning.decoupler
    q = m.q if position_loop else decoupler.equilibrium(d, m.theta_A, m.theta_B)
    S = decoupler.measured_stiffness(d, m.q, m.theta_A, m.theta_B)
    return Setpoint(min(max(q, bounds.q_min), bounds.q_max), min(max(S, bounds.S_min), bounds.S_max), 0.0)


# Baselines -----------------------------------------------------------------------------------------
# Baseline laws that play a program; their gains do not change during it.


class SingleLoop(NamedTuple):
    """One loop on position and one on stiffness."""

    tuning: baselines.SingleLoopTuning
    law: baselines.SingleLoopState
    player: SetpointPlayer


class FeedbackLinearization(NamedTuple):
    """Law with a full model."""

    tuning: baselines.FeedbackLinearizationTuning
    law: baselines.FeedbackLinearizationState
    player: SetpointPlayer


@compiled
def step_single_loop(
    tuning: cascade.CascadeTuning, motor_loops: MotorLoopState, setpoint: Setpoint, state: SingleLoop, m: Measurement
) -> tuple[ControlOutput, MotorLoopState, SingleLoop]:
    """Execute a step; ``tuning`` of the cascade is only passed to the next motion."""
    done, setpoint, player = step_setpoint_player(state.player, setpoint)
    y, law = baselines.step_single_loop(state.tuning, state.law, setpoint.q_ref, setpoint.S_ref, m)
    return (
        make_control_output(y, setpoint, True, done),
        _hold_motors(tuning, y, m),
        SingleLoop(state.tuning, law, player),
    )


@compiled
def step_feedback_linearization(
    tuning: cascade.CascadeTuning,
    motor_loops: MotorLoopState,
    setpoint: Setpoint,
    state: FeedbackLinearization,
    m: Measurement,
) -> tuple[ControlOutput, MotorLoopState, FeedbackLinearization]:
    """Execute a step; ``tuning`` of the cascade is only passed to the next motion."""
    done, setpoint, player = step_setpoint_player(state.player, setpoint)
    y, law = baselines.step_feedback_linearization(state.tuning, state.law, setpoint.q_ref, setpoint.S_ref, m)
    return (
        make_control_output(y, setpoint, True, done),
        _hold_motors(tuning, y, m),
        FeedbackLinearization(state.tuning, law, player),
    )


@compiled
def _hold_motors(tuning: cascade.CascadeTuning, y: cascade.CascadeOutput, m: Measurement) -> MotorLoopState:
    """Return motor loops that hold the joint at its current position."""
    state = pid.at_rest_motor_pair(tuning.motors, m.theta_A, m.theta_B, y.u_A, y.u_B)
    return MotorLoopState(state, tuning.motors, m.theta_A, m.theta_B)
