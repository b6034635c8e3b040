"""One control step: detect faults, compute the motion's voltages, write the row.

The step is compiled; its state is one ``ControlState`` block. Rare events (a fault, the end of a motion, a changed
disturbance) are returned as bits and handled in Python by ``backend.realtime.control_loop``. The real-time loop and the
batch simulator call the same functions.
"""

import math
from typing import Any, NamedTuple, cast

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from backend.control import cascade, decoupler, disturbance_observer, fault_detection, motion_primitives, tracking
from backend.control.motion_types import AT_REST, ControlOutput, MotorLoopState, Setpoint
from backend.sample import INDEX
from plant import (
    NO_LOAD,
    NO_RAW,
    STRICT,
    Measurement,
    MotorCommand,
    RawReading,
    ShaftLoad,
    Simulated,
    StateBlock,
    T_s,
    compiled,
    compiled_run,
    simulate_period,
    store_compiled,
)

# Step ----------------------------------------------------------------------------------------------


NO_EVENT, FAULT_DETECTED, MOTION_DONE, DISTURBANCE_CHANGED = 0, 1, 2, 4
GAINS_CHANGED, OBSTACLE_CHANGED, CONTACT_DETECTED = 16, 32, 64
"""Events of a step, as bits. After ``FAULT_DETECTED`` and ``CONTACT_DETECTED`` no control was computed. The others: the
motion has ended; its push or load, its tuning, its obstacle or contact detection differs from the active one."""


class StepInputs(NamedTuple):
    """Inputs of a control step, set by the control loop.

    - ``offset_A``, ``offset_B`` [rad]: offsets of the motor encoders; ``joint_centre`` [rad]: centre of the joint.
    - ``zeroed``: the motor zeros are known. ``tension_required``: slack would be a fault.
    - ``contact_threshold`` [N]: external force that counts as a contact, inf for none.
    - ``ignores_safety_trip``: ``tripped`` replaces the safety module's signal.
    - ``completion_reported``: the end of the motion has been reported.
    - ``F_push`` [N], ``load`` [N·m], ``tuning``, ``obstacle``, ``contact_detection``: the active ones.
    - ``mode``, ``run``, ``lam_q``, ``lam_S`` [s], ``fault``: values for the sample row.
    - ``limits``: limit flags in addition to the motion's.
    """

    offset_A: float
    offset_B: float
    joint_centre: float
    zeroed: bool
    tension_required: bool
    contact_threshold: float
    ignores_safety_trip: bool
    tripped: bool
    completion_reported: bool
    F_push: float
    load: ShaftLoad
    tuning: int
    obstacle: int
    contact_detection: int
    mode: int
    run: int
    lam_q: float
    lam_S: float
    fault: int
    limits: int


NO_INPUTS = StepInputs(
    offset_A=0.0,
    offset_B=0.0,
    joint_centre=0.0,
    zeroed=False,
    tension_required=False,
    contact_threshold=math.inf,
    ignores_safety_trip=False,
    tripped=False,
    completion_reported=False,
    F_push=0.0,
    load=NO_LOAD,
    tuning=0,
    obstacle=0,
    contact_detection=0,
    mode=0,
    run=0,
    lam_q=0.0,
    lam_S=0.0,
    fault=0,
    limits=0,
)
"""Inputs of a loop before its first step."""


class ControlState(NamedTuple):
    """State of a control step.

    ``m`` is the measurement with zeroed motors, ``command`` the last command written. ``F_ext_hat`` [N] is the
    observer's estimate of the external force, less the calibrated ``bias`` (n, 2) over S.
    """

    tuning: cascade.CascadeTuning
    fault_limits: fault_detection.FaultDetectionLimits
    inputs: StepInputs
    fault_state: fault_detection.FaultDetectionState
    detected_fault: fault_detection.DetectedFault
    velocity: motion_primitives.VelocityState
    m: Measurement
    command: MotorCommand
    output: ControlOutput
    observer: disturbance_observer.Observer
    observer_state: disturbance_observer.DisturbanceObserverState
    bias: NDArray[np.float64]
    F_ext_hat: float


class Moving(NamedTuple):
    """Active motion: its motor loops, setpoint and state."""

    motor_loops: MotorLoopState
    setpoint: Setpoint
    state: Any


class Resting(NamedTuple):
    """State while no motion is active."""

    volts: float


@compiled
def step_resting(
    tuning: cascade.CascadeTuning, motor_loops: MotorLoopState, setpoint: Setpoint, state: Resting, m: Measurement
) -> tuple[ControlOutput, MotorLoopState, Resting]:
    """Return zero volts."""
    return AT_REST, motor_loops, state


STEP_FUNCTIONS: dict[type, Any] = {
    Resting: step_resting,
    motion_primitives.WindingState: motion_primitives.step_winding,
    motion_primitives.TravelState: motion_primitives.step_travel,
    motion_primitives.SoftStopState: motion_primitives.step_soft_stop,
    tracking.TrackingState: tracking.step,
    tracking.SingleLoop: tracking.step_single_loop,
    tracking.FeedbackLinearization: tracking.step_feedback_linearization,
    motion_primitives.TensionHoldState: motion_primitives.step_tension_hold,
    motion_primitives.TensionSweepState: motion_primitives.step_tension_sweep,
    motion_primitives.VoltageStepsState: motion_primitives.step_voltage_steps,
}
"""Step function of each motion, by the type of its state."""


def step(
    tuning: cascade.CascadeTuning, motor_loops: MotorLoopState, setpoint: Setpoint, state: Any, m: Measurement
) -> Any:
    """Step a motion of any kind; compiled code contains only that of its kind."""
    return STEP_FUNCTIONS[type(state)](tuning, motor_loops, setpoint, state, m)


@overload(step, cast(Any, STRICT), strict=False)
def _overload_step(tuning: Any, motor_loops: Any, setpoint: Any, state: Any, m: Any) -> Any:
    # the Python function, so that it is compiled only once, inlined here
    return STEP_FUNCTIONS[state.instance_class].py_func


def set_external_torque(state: Any, tau_ext: float) -> Any:
    """Return a motion's state with an external torque [N·m]; only the cascade uses it."""
    return state._replace(tau_ext=tau_ext) if isinstance(state, tracking.TrackingState) else state


@overload(set_external_torque, cast(Any, STRICT), strict=False)
def _overload_external_torque(state: Any, tau_ext: Any) -> Any:
    if state.instance_class is tracking.TrackingState:
        return lambda state, tau_ext: tracking.TrackingState(
            state.law, state.position_loop, state.has_program, state.player, tau_ext
        )
    return lambda state, tau_ext: state


@compiled
def detect_faults(control: StateBlock[ControlState], raw: Measurement, missed: int) -> int:
    """Check a measurement; return FAULT_DETECTED, CONTACT_DETECTED or NO_EVENT.

    ``missed`` is the number of deadlines missed since the last tick.
    """
    inputs = control.inputs.value
    theta_A, theta_B = raw.theta_A + inputs.offset_A, raw.theta_B + inputs.offset_B
    trip = raw.safety_trip
    m = Measurement(
        q=raw.q,
        theta_A=theta_A,
        theta_B=theta_B,
        F_A=raw.F_A,
        F_B=raw.F_B,
        S_true=raw.S_true,
        F_push=raw.F_push,
        safety_trip=trip,
        F_wall=raw.F_wall,
    )
    store_compiled(control.m, m)
    store_compiled(control.velocity, motion_primitives.step_velocity(control.velocity.value, raw.q))
    if inputs.ignores_safety_trip:
        trip = 1.0 if inputs.tripped else 0.0
    q = raw.q - inputs.joint_centre
    checked = Measurement(
        q=q,
        theta_A=theta_A,
        theta_B=theta_B,
        F_A=raw.F_A,
        F_B=raw.F_B,
        S_true=raw.S_true,
        F_push=raw.F_push,
        safety_trip=trip,
        F_wall=raw.F_wall,
    )
    fault, next_state = fault_detection.detect_fault(
        fault_limits=control.fault_limits.value,
        state=control.fault_state.value,
        raw=raw,
        m=checked,
        command=control.command.value,
        zeroed=inputs.zeroed,
        tension_required=inputs.tension_required,
        missed=missed,
    )
    store_compiled(control.fault_state, next_state)
    store_compiled(control.detected_fault, fault)
    F_ext_hat = _estimate_external_force(control, m, inputs.zeroed)
    if fault.kind != fault_detection.NO_FAULT:
        return FAULT_DETECTED
    return CONTACT_DETECTED if abs(F_ext_hat) > inputs.contact_threshold else NO_EVENT


@compiled
def _estimate_external_force(control: StateBlock[ControlState], m: Measurement, zeroed: bool) -> float:
    """Return the external force [N] in this tick; NaN unless the motors are zeroed."""
    observer, bias = control.observer.value, control.bias.value
    state = (
        disturbance_observer.step_disturbance_observer(observer, control.observer_state.value, m)
        if zeroed
        else disturbance_observer.UNKNOWN
    )
    S = decoupler.measured_stiffness(control.tuning.decoupler.value, m.q, m.theta_A, m.theta_B)
    F_ext_hat = disturbance_observer.estimate_force(observer, state, bias, S)
    store_compiled(control.observer_state, state)
    store_compiled(control.F_ext_hat, F_ext_hat)
    return F_ext_hat


@compiled
def compute_control(control: StateBlock[ControlState], moving: StateBlock[Moving]) -> tuple[int, float, float]:
    """Step the motion; return the events as bits and the voltages [V]."""
    motion, inputs = moving.value, control.inputs.value
    tau_ext = (
        control.F_ext_hat.value * control.observer.tendons.r_j.value if control.bias.value.shape[0] > 0 else math.nan
    )
    output, motor_loops, state = step(
        control.tuning.value,
        motion.motor_loops,
        motion.setpoint,
        set_external_torque(motion.state, tau_ext),
        control.m.value,
    )
    store_compiled(moving, Moving(motor_loops, output.setpoint, state))
    store_compiled(control.output, output)
    events = MOTION_DONE if output.done and not inputs.completion_reported else NO_EVENT
    setpoint, load = output.setpoint, output.setpoint.load
    push_changed = setpoint.F_push != inputs.F_push
    load_changed = load.load_A != inputs.load.load_A or load.load_B != inputs.load.load_B
    if output.sets_disturbance and (push_changed or load_changed):
        events |= DISTURBANCE_CHANGED
    if output.sets_disturbance and setpoint.tuning != inputs.tuning:
        events |= GAINS_CHANGED
    if output.sets_disturbance and (
        setpoint.obstacle != inputs.obstacle or setpoint.contact_detection != inputs.contact_detection
    ):
        events |= DISTURBANCE_CHANGED | OBSTACLE_CHANGED
    return events, output.u_A, output.u_B


_TICK, _T, _MODE, _RUN = (INDEX[name] for name in ("tick", "t", "mode", "run"))
_Q, _Q_REF, _Q_REF_GOV, _Q_DOT = (INDEX[name] for name in ("q", "q_ref", "q_ref_gov", "q_dot"))
_S, _S_REF, _S_REF_GOV, _S_TRUE = (INDEX[name] for name in ("S", "S_ref", "S_ref_gov", "S_true"))
_THETA_A, _THETA_A_REF, _THETA_B, _THETA_B_REF = (
    INDEX[name] for name in ("theta_A", "theta_A_ref", "theta_B", "theta_B_ref")
)
_F_A, _F_B, _U_A, _U_B = (INDEX[name] for name in ("F_A", "F_B", "u_A", "u_B"))
_F_PUSH, _F_EXT_HAT, _F_WALL = (INDEX[name] for name in ("F_push", "F_ext_hat", "F_wall"))
_V_A, _V_B, _N_Q, _N_A, _N_B = (INDEX[name] for name in RawReading._fields)
_LAM_Q, _LAM_S, _BANK_ENTRY = (INDEX[name] for name in ("lam_q", "lam_S", "bank_entry"))
_LIMITS, _FAULT, _LATENESS, _OVERRUNS = (INDEX[name] for name in ("limits", "fault", "lateness_s", "overruns"))


@compiled
def write_row(
    control: StateBlock[ControlState],
    row: NDArray[np.float64],
    tick: int,
    command: MotorCommand,
    raw: RawReading,
    lateness_s: float,
    overruns: int,
) -> None:
    """Write the step's sample row (``backend.sample``) and store ``command``."""
    inputs, m, y = control.inputs.value, control.m.value, control.output.value
    store_compiled(control.command, command)
    row[_TICK], row[_T], row[_MODE], row[_RUN] = tick, tick * T_s, inputs.mode, inputs.run
    row[_Q], row[_Q_REF], row[_Q_REF_GOV], row[_Q_DOT] = (
        m.q,
        y.setpoint.q_ref,
        y.q_ref_gov,
        control.velocity.q_dot.value,
    )
    row[_S] = math.nan
    if inputs.zeroed and not fault_detection.has_slack(control.observer.tendons.value, m):
        row[_S] = decoupler.measured_stiffness(control.tuning.decoupler.value, m.q, m.theta_A, m.theta_B)
    row[_S_REF], row[_S_REF_GOV], row[_S_TRUE] = y.setpoint.S_ref, y.S_ref_gov, m.S_true
    row[_THETA_A], row[_THETA_A_REF], row[_THETA_B], row[_THETA_B_REF] = (
        m.theta_A,
        y.theta_A_ref,
        m.theta_B,
        y.theta_B_ref,
    )
    row[_F_A], row[_F_B], row[_U_A], row[_U_B] = m.F_A, m.F_B, command.u_A, command.u_B
    row[_F_PUSH], row[_F_EXT_HAT], row[_F_WALL] = m.F_push, control.F_ext_hat.value, m.F_wall
    row[_V_A], row[_V_B], row[_N_Q], row[_N_A], row[_N_B] = raw
    row[_LAM_Q], row[_LAM_S], row[_BANK_ENTRY] = inputs.lam_q, inputs.lam_S, y.bank_entry
    row[_LIMITS], row[_FAULT], row[_LATENESS], row[_OVERRUNS] = (
        y.limits | inputs.limits, inputs.fault, lateness_s, overruns,
    )  # fmt: skip


# Batch ---------------------------------------------------------------------------------------------
# Consecutive steps on the simulator, until an event needs handling in Python.


CONTROL_COMPUTED = 8
"""The control of the step after the last complete one was computed; Python code completes that step."""


class TickRange(NamedTuple):
    """Ticks to execute.

    Number of the ``first`` tick, ``period`` of the simulator before it, number of ``ticks``, ``overruns`` so far.
    """

    first: int
    period: int
    ticks: int
    overruns: int


@compiled_run
def run_batch(
    control: StateBlock[ControlState],
    moving: StateBlock[Moving],
    simulated: StateBlock[Simulated],
    m: Measurement,
    tick_range: TickRange,
    rows: NDArray[np.float64],
) -> tuple[int, int, float, float, Measurement]:
    """Execute steps on the simulator from measurement ``m``, each with its sample row.

    Rows go into the ring ``rows`` (capacity, n) by tick number. Returns the number of complete steps, the event of the
    next one (NO_EVENT: not started; FAULT_DETECTED, CONTACT_DETECTED: measured; with CONTROL_COMPUTED: control
    computed), its voltages [V], and its measurement.
    """
    for count in range(tick_range.ticks):
        detected = detect_faults(control, m, 0)
        if detected != NO_EVENT:
            return count, detected, 0.0, 0.0, m
        events, u_A, u_B = compute_control(control, moving)
        if events & (MOTION_DONE | GAINS_CHANGED | OBSTACLE_CHANGED) or not math.isfinite(u_A + u_B):
            return count, events | CONTROL_COMPUTED, u_A, u_B, m
        if events & DISTURBANCE_CHANGED:
            setpoint = control.output.setpoint.value
            store_compiled(control.inputs.F_push, setpoint.F_push)
            store_compiled(control.inputs.load, setpoint.load)
            store_compiled(simulated.F_push, setpoint.F_push)
            store_compiled(simulated.load, setpoint.load)
        m = simulate_period(simulated, u_A, u_B, tick_range.period + count + 1)
        number = tick_range.first + count
        write_row(
            control=control,
            row=rows[number % rows.shape[0]],
            tick=number,
            command=MotorCommand(u_A, u_B),
            raw=NO_RAW,
            lateness_s=0.0,
            overruns=tick_range.overruns,
        )
    return tick_range.ticks, NO_EVENT, 0.0, 0.0, m
