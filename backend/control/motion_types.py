"""Inputs and outputs of motions, and the pair of motor loops that they share."""

import math
from typing import NamedTuple

from backend.control import cascade, pid
from backend.faults import Limit
from plant import NO_LOAD, Measurement, ShaftLoad, T_s, compiled

TRAVEL_SPEED = 3.0
"""Speed of the motor references between modes [rad/s]: 0.3 rad/s at the joint, 3 V of 10 V."""

VOLTAGE_A, VOLTAGE_B = int(Limit.VOLTAGE_A), int(Limit.VOLTAGE_B)


class Setpoint(NamedTuple):
    """Setpoint of a tick: q_ref [rad], S_ref [N·m/rad], F_push [N], shaft loads [N·m].

    ``tuning``, ``obstacle`` and ``contact_detection`` are numbers in the program, 0 for those at its start.
    """

    q_ref: float
    S_ref: float
    F_push: float
    load: ShaftLoad = NO_LOAD
    tuning: int = 0
    obstacle: int = 0
    contact_detection: int = 0


class MotorLoopState(NamedTuple):
    """Motor loops that one motion passes to the next.

    They consist of state, gains and references [rad].
    """

    state: pid.MotorPairState
    gains: pid.MotorPairGains
    theta_A_ref: float
    theta_B_ref: float


class ControlOutput(NamedTuple):
    """Output of a motion in one step; ``limits`` are bits of ``backend.faults.Limit``.

    ``sets_disturbance``: push and loads of the plant follow the setpoint; otherwise they do not change. ``done``: the
    motion has reached its end, where it holds.
    """

    u_A: float
    u_B: float
    theta_A_ref: float
    theta_B_ref: float
    setpoint: Setpoint
    q_ref_gov: float
    S_ref_gov: float
    bank_entry: float
    limits: int
    sets_disturbance: bool
    done: bool


NO_REFERENCE = Setpoint(math.nan, math.nan, 0.0)
AT_REST = ControlOutput(
    u_A=0.0,
    u_B=0.0,
    theta_A_ref=math.nan,
    theta_B_ref=math.nan,
    setpoint=NO_REFERENCE,
    q_ref_gov=math.nan,
    S_ref_gov=math.nan,
    bank_entry=math.nan,
    limits=0,
    sets_disturbance=False,
    done=False,
)
"""Zero volts, without references."""


@compiled
def track_motors(
    tuning: cascade.CascadeTuning,
    motor_loops: MotorLoopState,
    setpoint: Setpoint,
    theta_A_ref: float,
    theta_B_ref: float,
    m: Measurement,
    done: bool,
) -> tuple[ControlOutput, MotorLoopState]:
    """Step both motor loops towards motor references [rad]."""
    gains = tuning.motors
    state = pid.bumpless_motor_pair(motor_loops.gains, gains, motor_loops.state, m.theta_A, m.theta_B)
    y, state = pid.step_motor_pair(
        gains=gains,
        state=state,
        theta_A_ref=theta_A_ref,
        theta_B_ref=theta_B_ref,
        theta_A=m.theta_A,
        theta_B=m.theta_B,
        u_max=tuning.u_max,
    )
    limits = make_voltage_limit_flags(y.excess_A != 0.0, y.excess_B != 0.0)
    output = ControlOutput(
        u_A=y.u_A,
        u_B=y.u_B,
        theta_A_ref=theta_A_ref,
        theta_B_ref=theta_B_ref,
        setpoint=setpoint,
        q_ref_gov=setpoint.q_ref,
        S_ref_gov=setpoint.S_ref,
        bank_entry=0.0,
        limits=limits,
        sets_disturbance=False,
        done=done,
    )
    return output, MotorLoopState(state, gains, theta_A_ref, theta_B_ref)


@compiled
def output_voltages(u_max: float, setpoint: Setpoint, u_A: float, u_B: float, done: bool) -> ControlOutput:
    """Return the output of a motion that sets voltages [V] without motor references."""
    nan = math.nan
    return ControlOutput(
        u_A=u_A,
        u_B=u_B,
        theta_A_ref=nan,
        theta_B_ref=nan,
        setpoint=setpoint,
        q_ref_gov=nan,
        S_ref_gov=nan,
        bank_entry=nan,
        limits=make_voltage_limit_flags(abs(u_A) == u_max, abs(u_B) == u_max),
        sets_disturbance=False,
        done=done,
    )


@compiled
def step_voltages(
    tuning: cascade.CascadeTuning, setpoint: Setpoint, u_A: float, u_B: float, m: Measurement, done: bool
) -> tuple[ControlOutput, MotorLoopState]:
    """Apply voltages [V] without a loop.

    The next motion continues from these voltages.
    """
    state = pid.at_rest_motor_pair(tuning.motors, m.theta_A, m.theta_B, u_A, u_B)
    output = output_voltages(tuning.u_max, setpoint, u_A, u_B, done)
    return output, MotorLoopState(state, tuning.motors, m.theta_A, m.theta_B)


@compiled
def make_voltage_limit_flags(A: bool, B: bool) -> int:
    """Return the limit flags of clipped voltages."""
    return (VOLTAGE_A if A else 0) | (VOLTAGE_B if B else 0)


@compiled
def step_along_line(theta_A: float, theta_B: float, target_A: float, target_B: float) -> tuple[float, float]:
    """Step along the straight line to the target at TRAVEL_SPEED, ending exactly there."""
    distance = max(abs(target_A - theta_A), abs(target_B - theta_B))
    reach = TRAVEL_SPEED * T_s
    if distance <= reach:
        return target_A, target_B
    share = reach / distance
    return theta_A + share * (target_A - theta_A), theta_B + share * (target_B - theta_B)
