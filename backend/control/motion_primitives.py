"""Motions without the cascade: pretension, soft stop, travel, identification."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade, pid
from backend.control.motion_types import (
    ControlOutput,
    MotorLoopState,
    Setpoint,
    output_voltages,
    step_along_line,
    step_voltages,
    track_motors,
)
from plant import Measurement, T_s, compiled

# Brake ---------------------------------------------------------------------------------------------
# Braking of both motors as fast as ±10 V allow, with the tendons taut.
#
# The motor loops follow a reference through four lags: with constant references the joint would move on for 0.66 s.
# Damping the measured speed directly stops it in a fifth of that. The tendons' load makes both motors creep meanwhile,
# at 0.3 rad/s with 20 N and equally, so the joint remains at rest. No load cell is used, so a stop works with a broken
# load cell.


DAMPING = 1.5
"""Braking voltage per speed [V·s/rad]: the full 10 V above 7 rad/s, a time constant of 42 ms below."""

SPEED_FILTER_S = 0.005
"""Time constant of the speed estimate [s]: one encoder count in one tick would read as 0.8 rad/s."""


class BrakeState(NamedTuple):
    """Last angles [rad] and estimated speeds [rad/s] of both motors."""

    theta_A: float
    theta_B: float
    omega_A: float
    omega_B: float


@compiled
def step_brake(state: BrakeState, theta_A: float, theta_B: float, u_max: float) -> tuple[float, float, BrakeState]:
    """Return braking voltages [V] within ±u_max for measured angles [rad]."""
    pass_through = 1.0 - math.exp(-T_s / SPEED_FILTER_S)
    omega_A = state.omega_A + pass_through * ((theta_A - state.theta_A) / T_s - state.omega_A)
    omega_B = state.omega_B + pass_through * ((theta_B - state.theta_B) / T_s - state.omega_B)
    u_A = min(max(-DAMPING * omega_A, -u_max), u_max)
    u_B = min(max(-DAMPING * omega_B, -u_max), u_max)
    return u_A, u_B, BrakeState(theta_A, theta_B, omega_A, omega_B)


# Pretension ----------------------------------------------------------------------------------------
# Pretension: wind both motors from slack, each by its own load cell.


RATE_PER_NEWTON = 0.15
"""Winding speed per missing newton [rad/(s·N)]: with 5.5 N/rad at 10 N a time constant of 1.2 s, four times that of the
motor loops."""

RATE_MAX = 1.5
"""Fastest winding [rad/s]."""

FILTER_S = 0.1
"""Time constant of the load cell filter [s]."""

TOLERANCE_N = 0.1
"""Tolerance of the pretension [N]."""

STANDSTILL_S = 0.5
"""Time that both tensions must stay within tolerance [s]."""


class PretensionState(NamedTuple):
    """Filtered tensions [N], motor references [rad], and time within tolerance [s]."""

    F_A: float
    F_B: float
    theta_A_ref: float
    theta_B_ref: float
    steady_s: float


@compiled
def step_pretension(state: PretensionState, F_ref: float, F_A: float, F_B: float) -> PretensionState:
    """Step towards tension F_ref [N] in each tendon, from load cell readings [N]."""
    pass_through = 1.0 - math.exp(-T_s / FILTER_S)
    F_A = state.F_A + pass_through * (F_A - state.F_A)
    F_B = state.F_B + pass_through * (F_B - state.F_B)
    rate_A = min(max(RATE_PER_NEWTON * (F_ref - F_A), -RATE_MAX), RATE_MAX)
    rate_B = min(max(RATE_PER_NEWTON * (F_ref - F_B), -RATE_MAX), RATE_MAX)
    right = abs(F_A - F_ref) < TOLERANCE_N and abs(F_B - F_ref) < TOLERANCE_N
    return PretensionState(
        F_A,
        F_B,
        state.theta_A_ref + T_s * rate_A,
        state.theta_B_ref + T_s * rate_B,
        state.steady_s + T_s if right else 0.0,
    )


# Soft stop -----------------------------------------------------------------------------------------
# Soft stop: brake both motors until the joint is at rest under tension.


SOFT_STOP_S = 0.5
"""Duration of a soft stop [s]: the joint stops after 0.15 s, and settles before the outputs are set to zero."""


RELEASE_S = 0.010
"""Time constant with which the previous voltages decay [s]."""

LARGEST_STEP_V = 1.8
"""Largest change of a voltage per tick [V]: full reversal takes 11 ms."""


class SoftStopState(NamedTuple):
    """Brake of both motors, its duration [s], the last and the initial voltages [V]."""

    brake: BrakeState
    elapsed_s: float
    u_A: float
    u_B: float
    began_A: float
    began_B: float


@compiled
def step_soft_stop(
    tuning: cascade.CascadeTuning, motor_loops: MotorLoopState, setpoint: Setpoint, state: SoftStopState, m: Measurement
) -> tuple[ControlOutput, MotorLoopState, SoftStopState]:
    """Execute a step of the soft stop."""
    braked_A, braked_B, braking = step_brake(state.brake, m.theta_A, m.theta_B, tuning.u_max)
    elapsed_s = state.elapsed_s + T_s
    remaining = math.exp(-elapsed_s / RELEASE_S)
    u_A = _limit_voltage_change(state.u_A, braked_A + remaining * state.began_A, tuning.u_max)
    u_B = _limit_voltage_change(state.u_B, braked_B + remaining * state.began_B, tuning.u_max)
    output = output_voltages(tuning.u_max, setpoint, u_A, u_B, elapsed_s >= SOFT_STOP_S)
    after = SoftStopState(
        brake=braking, elapsed_s=elapsed_s, u_A=u_A, u_B=u_B, began_A=state.began_A, began_B=state.began_B
    )
    return output, motor_loops, after


@compiled
def _limit_voltage_change(previous: float, requested: float, u_max: float) -> float:
    """Return the voltage [V] within ±u_max that is nearest to ``requested``.

    The change per tick is limited.
    """
    requested = min(max(requested, -u_max), u_max)
    return previous + min(max(requested - previous, -LARGEST_STEP_V), LARGEST_STEP_V)


def begin_soft_stop(u_A: float, u_B: float, m: Measurement) -> SoftStopState:
    """Return the state of a soft stop that starts from the voltages [V]."""
    return SoftStopState(
        brake=BrakeState(m.theta_A, m.theta_B, 0.0, 0.0), elapsed_s=0.0, u_A=u_A, u_B=u_B, began_A=u_A, began_B=u_B
    )


# Tension hold --------------------------------------------------------------------------------------
# Actuator identification: theta_B_ref at zero, tension held by motor A, excitation added (figure 5).


class ExcitationChips(NamedTuple):
    """Excitation: offsets of theta_A_ref [rad] in one period (n,), and its duration.

    ``chip_ticks`` [ticks] of one chip and ``ticks`` of the whole excitation.
    """

    levels: NDArray[np.float64]
    chip_ticks: int
    ticks: int


class TensionHoldState(NamedTuple):
    """State of the tension hold.

    ``base_A``, ``base_B`` [rad] move to ``target_A`` and zero. ``tick`` counts the ticks of the excitation.
    """

    F_ref: float
    target_A: float
    base_A: float
    base_B: float
    settle_ticks: int
    chips: ExcitationChips
    tick: int
    hold: pid.ForceHoldState


@compiled
def step_tension_hold(
    tuning: cascade.CascadeTuning,
    motor_loops: MotorLoopState,
    setpoint: Setpoint,
    state: TensionHoldState,
    m: Measurement,
) -> tuple[ControlOutput, MotorLoopState, TensionHoldState]:
    """Execute a step: move to the tension, settle, excite."""
    base_A, base_B, settle_ticks, tick = state.base_A, state.base_B, state.settle_ticks, state.tick
    chips, hold = state.chips, state.hold
    arrived = base_A == state.target_A and base_B == 0.0
    offset, done = 0.0, False
    if not arrived:
        base_A, base_B = step_along_line(base_A, base_B, state.target_A, 0.0)
    elif settle_ticks > 0:
        settle_ticks -= 1
    elif tick >= chips.ticks:
        done = True
    else:
        offset = chips.levels[(tick // chips.chip_ticks) % chips.levels.shape[0]]
        tick += 1
    trim, next_hold = pid.step_force_hold(hold, state.F_ref, m.F_A, m.F_B)
    if arrived:
        hold = next_hold
    output, motor_loops = track_motors(
        tuning=tuning,
        motor_loops=motor_loops,
        setpoint=setpoint,
        theta_A_ref=base_A + trim + offset,
        theta_B_ref=base_B,
        m=m,
        done=done,
    )
    return (
        output,
        motor_loops,
        TensionHoldState(
            F_ref=state.F_ref,
            target_A=state.target_A,
            base_A=base_A,
            base_B=base_B,
            settle_ticks=settle_ticks,
            chips=chips,
            tick=tick,
            hold=hold,
        ),
    )


# Tension sweep -------------------------------------------------------------------------------------
# A slow sweep of both tensions together, for the springs: the antagonistic tendons hold the joint in place.


class TensionSweepState(NamedTuple):
    """State of the tension sweep.

    ``targets`` (n + 1, 2): theta_A, theta_B [rad] at the start and after each leg. ``ticks`` (n,) of the legs; ``leg``
    is -1 during the motion to the start.
    """

    targets: NDArray[np.float64]
    ticks: NDArray[np.int64]
    settle_ticks: int
    leg: int
    elapsed: int


@compiled
def step_tension_sweep(
    tuning: cascade.CascadeTuning,
    motor_loops: MotorLoopState,
    setpoint: Setpoint,
    state: TensionSweepState,
    m: Measurement,
) -> tuple[ControlOutput, MotorLoopState, TensionSweepState]:
    """Execute a step: move to the start, settle, then follow the legs."""
    targets, ticks, leg, elapsed, done = state.targets, state.ticks, state.leg, state.elapsed, False
    if leg < 0:
        theta_A, theta_B = step_along_line(
            motor_loops.theta_A_ref, motor_loops.theta_B_ref, targets[0, 0], targets[0, 1]
        )
        if theta_A == targets[0, 0] and theta_B == targets[0, 1]:
            elapsed += 1
            if elapsed >= state.settle_ticks:
                leg, elapsed = 0, 0
    else:
        elapsed += 1
        share = elapsed / ticks[leg]
        theta_A = targets[leg, 0] + share * (targets[leg + 1, 0] - targets[leg, 0])
        theta_B = targets[leg, 1] + share * (targets[leg + 1, 1] - targets[leg, 1])
        if elapsed >= ticks[leg]:
            done = leg + 1 == ticks.shape[0]
            if not done:
                leg, elapsed = leg + 1, 0
    output, motor_loops = track_motors(
        tuning=tuning,
        motor_loops=motor_loops,
        setpoint=setpoint,
        theta_A_ref=theta_A,
        theta_B_ref=theta_B,
        m=m,
        done=done,
    )
    return output, motor_loops, TensionSweepState(targets, ticks, state.settle_ticks, leg, elapsed)


# Travel --------------------------------------------------------------------------------------------
# Move the motor references along a straight line to a target and hold them there.


class TravelState(NamedTuple):
    """Target ``theta_A``, ``theta_B`` [rad], and time since the arrival there [s]."""

    theta_A: float
    theta_B: float
    settled_s: float


@compiled
def step_travel(
    tuning: cascade.CascadeTuning, motor_loops: MotorLoopState, setpoint: Setpoint, state: TravelState, m: Measurement
) -> tuple[ControlOutput, MotorLoopState, TravelState]:
    """Execute a step of moving to the target, or of holding it."""
    theta_A, theta_B, settled_s = state.theta_A, state.theta_B, state.settled_s
    theta_A_ref, theta_B_ref = step_along_line(motor_loops.theta_A_ref, motor_loops.theta_B_ref, theta_A, theta_B)
    if theta_A_ref == theta_A and theta_B_ref == theta_B:
        settled_s += T_s
    done = settled_s >= STANDSTILL_S
    output, motor_loops = track_motors(
        tuning=tuning,
        motor_loops=motor_loops,
        setpoint=setpoint,
        theta_A_ref=theta_A_ref,
        theta_B_ref=theta_B_ref,
        m=m,
        done=done,
    )
    return output, motor_loops, TravelState(theta_A, theta_B, settled_s)


# Velocity ------------------------------------------------------------------------------------------
# Joint velocity: filtered difference of encoder readings.


VELOCITY_FILTER_S = 0.010
"""Time constant of the estimate [s]: one encoder count in one tick would read as 1.6 rad/s."""

_PASS_THROUGH = 1.0 - math.exp(-T_s / VELOCITY_FILTER_S)


class VelocityState(NamedTuple):
    """Estimate ``q_dot`` [rad/s], and the previous angle [rad]."""

    q_dot: float
    q_before: float


@compiled
def step_velocity(state: VelocityState, q: float) -> VelocityState:
    """Advance the estimate by a reading [rad]; NaN is skipped, as it would persist."""
    if not math.isfinite(q):
        return state
    before = state.q_before if math.isfinite(state.q_before) else q
    return VelocityState(state.q_dot + _PASS_THROUGH * ((q - before) / T_s - state.q_dot), q)


# Voltage steps -------------------------------------------------------------------------------------
# Unloaded voltage steps: slack tendons, each step from rest, braked within the range of the motors.


ZERO_VOLTS_S = 0.2
"""Time at zero volts before a voltage step [s], so that the step starts from rest."""

STEP_BRAKING_S = 0.5
"""Duration of braking after a voltage step [s]: from full speed it takes 0.3 s."""

_ZERO_TICKS = round(ZERO_VOLTS_S / T_s)
_BRAKING_TICKS = round(STEP_BRAKING_S / T_s)
_START, _VOLTS, _TICKS, _TRAVEL = range(4)
CENTRED, _POSITIONED, _AT_ZERO_VOLTS, _DRIVEN, _BRAKED = range(5)


class VoltageMargin(NamedTuple):
    """Limits of the voltage steps.

    The motors move to the first step via ``centre_A``, ``centre_B`` [rad], which hold the joint at q = 0: a joint
    released elsewhere would leave one of the tendons taut. A step ends early if a tension exceeds ``F_slack`` [N] or a
    motor angle ``theta_max`` [rad].
    """

    centre_A: float
    centre_B: float
    F_slack: float
    theta_max: float


class VoltageStepsState(NamedTuple):
    """State of the voltage steps.

    ``steps`` (n, 4): start [rad], voltage [V], ticks, travel [rad]. ``step`` is the current step, ``stage`` its stage
    and ``ticks`` the time since the stage began; ``began_A``, ``began_B`` [rad] are the motor angles at the start of
    the voltage.
    """

    margin: VoltageMargin
    steps: NDArray[np.float64]
    settle_ticks: int
    step: int
    stage: int
    ticks: int
    began_A: float
    began_B: float
    brake: BrakeState


@compiled
def step_voltage_steps(
    tuning: cascade.CascadeTuning,
    motor_loops: MotorLoopState,
    setpoint: Setpoint,
    state: VoltageStepsState,
    m: Measurement,
) -> tuple[ControlOutput, MotorLoopState, VoltageStepsState]:
    """Execute a step of the current stage: travel, settle, zero volts, step, brake."""
    margin, steps, settle_ticks, at, stage, ticks, began_A, began_B, braking = state
    ticks += 1
    theta_A = theta_B = u_A = u_B = 0.0
    done, is_travelling = False, stage in (CENTRED, _POSITIONED)
    if stage == _DRIVEN:
        turned = max(abs(m.theta_A - began_A), abs(m.theta_B - began_B))
        is_out_of_margin = turned >= steps[at, _TRAVEL] or max(abs(m.theta_A), abs(m.theta_B)) > margin.theta_max
        if ticks > steps[at, _TICKS] or is_out_of_margin or max(m.F_A, m.F_B) > margin.F_slack:
            stage, ticks, braking = _BRAKED, 0, BrakeState(m.theta_A, m.theta_B, 0.0, 0.0)
    if is_travelling:
        target_A, target_B = (
            (margin.centre_A, margin.centre_B) if stage == CENTRED else (steps[at, _START], steps[at, _START])
        )
        theta_A, theta_B = step_along_line(motor_loops.theta_A_ref, motor_loops.theta_B_ref, target_A, target_B)
        if theta_A != target_A or theta_B != target_B:
            ticks = 0
        elif ticks >= settle_ticks:
            stage, ticks = stage + 1, 0
    elif stage == _AT_ZERO_VOLTS:
        if ticks >= _ZERO_TICKS:
            stage, ticks, began_A, began_B = _DRIVEN, 0, m.theta_A, m.theta_B
    elif stage == _DRIVEN:
        u_A = u_B = steps[at, _VOLTS]
    else:
        u_A, u_B, braking = step_brake(braking, m.theta_A, m.theta_B, tuning.u_max)
        if ticks >= _BRAKING_TICKS:
            at += 1
            done = at == steps.shape[0]
            if not done:
                stage, ticks = _POSITIONED, 0
    if is_travelling:
        output, motor_loops = track_motors(
            tuning=tuning,
            motor_loops=motor_loops,
            setpoint=setpoint,
            theta_A_ref=theta_A,
            theta_B_ref=theta_B,
            m=m,
            done=done,
        )
    else:
        output, motor_loops = step_voltages(tuning=tuning, setpoint=setpoint, u_A=u_A, u_B=u_B, m=m, done=done)
    after = VoltageStepsState(
        margin=margin,
        steps=steps,
        settle_ticks=settle_ticks,
        step=at,
        stage=stage,
        ticks=ticks,
        began_A=began_A,
        began_B=began_B,
        brake=braking,
    )
    return output, motor_loops, after


# Pretension from slack -----------------------------------------------------------------------------
# Pretension from slack: both motors wind until both load cells read the pretension.


PRETENSION_N = 10.0
"""Tension of mode pretension [N] (method section 7)."""


class WindingState(NamedTuple):
    """State of the pretension of both motors."""

    winding: PretensionState


@compiled
def step_winding(
    tuning: cascade.CascadeTuning, motor_loops: MotorLoopState, setpoint: Setpoint, state: WindingState, m: Measurement
) -> tuple[ControlOutput, MotorLoopState, WindingState]:
    """Execute a step of winding."""
    pretension = step_pretension(state.winding, PRETENSION_N, m.F_A, m.F_B)
    done = pretension.steady_s >= STANDSTILL_S
    output, motor_loops = track_motors(
        tuning=tuning,
        motor_loops=motor_loops,
        setpoint=setpoint,
        theta_A_ref=pretension.theta_A_ref,
        theta_B_ref=pretension.theta_B_ref,
        m=m,
        done=done,
    )
    return output, motor_loops, WindingState(pretension)


def begin_winding(motor_loops: MotorLoopState) -> WindingState:
    """Return the state that winds from the current motor references.

    The tendons are assumed to be slack.
    """
    return WindingState(PretensionState(0.0, 0.0, motor_loops.theta_A_ref, motor_loops.theta_B_ref, 0.0))
