"""One tick of the loop: detect faults, compute the motion's voltages, write the row. All in one control state.

What is rare stays with the interpreter, which gives its inputs before the tick and is told what came of it: a fault was
found, a motion is done, its push has changed. Whoever steps the plant, a clock or a batch, calls the same functions.
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

# Desk ----------------------------------------------------------------------------------------------


QUIET, FOUND, DONE, PUSHES, TUNES, WALLS, FELT = 0, 1, 2, 4, 16, 32, 64
"""What may come of a tick, as bits: a fault was found, before anything was decided; the motion is done; its push or
load, its tuning, its obstacle (or touch) is not the one in force; a contact was felt, before anything was decided."""


class StepInputs(NamedTuple):
    """What the interpreter says of a tick.

    Offsets of the motors' zeros and ``middle`` of the joint [rad], whether those zeros are known, whether slack would
    be a fault; ``felt_from`` [N]: an outside force that is a contact, inf where none is; ``deaf``: the safety module's
    trip is not heard, ``tripped``: it is in any case; ``reached``: that the motion is done is known. Push [N], loads
    [N·m] and numbers of the program's tuning, obstacle and touch in force. Mode, run, λ [s] and fault as the row
    shows them, and ``limits`` that act beside the motion's.
    """

    offset_A: float
    offset_B: float
    middle: float
    zeroed: bool
    taut_wanted: bool
    felt_from: float
    deaf: bool
    tripped: bool
    reached: bool
    F_push: float
    load: ShaftLoad
    tuning: int
    wall: int
    touch: int
    mode: int
    run: int
    lam_q: float
    lam_S: float
    fault: int
    limits: int


NO_INPUTS = StepInputs(
    offset_A=0.0,
    offset_B=0.0,
    middle=0.0,
    zeroed=False,
    taut_wanted=False,
    felt_from=math.inf,
    deaf=False,
    tripped=False,
    reached=False,
    F_push=0.0,
    load=NO_LOAD,
    tuning=0,
    wall=0,
    touch=0,
    mode=0,
    run=0,
    lam_q=0.0,
    lam_S=0.0,
    fault=0,
    limits=0,
)
"""Those of a loop that is just being made."""


class ControlState(NamedTuple):
    """All that is before the tick; ``m`` counts from the zeros, ``command`` is what was written last.

    ``F_ext_hat`` [N] comes of ``touch``, less the ``bias`` (n, 2) learned over S.
    """

    tuning: cascade.CascadeTuning
    watched: fault_detection.Watched
    inputs: StepInputs
    checks: fault_detection.FaultDetectionState
    found: fault_detection.DetectedFault
    velocity: motion_primitives.VelocityState
    m: Measurement
    command: MotorCommand
    decision: ControlOutput
    observer: disturbance_observer.Observer
    touch: disturbance_observer.DisturbanceObserverState
    bias: NDArray[np.float64]
    F_ext_hat: float


class Moving(NamedTuple):
    """A motion under way: the motor loops, what is asked for, and the state of the motion's kind."""

    carry: MotorLoopState
    target: Setpoint
    state: Any


class Resting(NamedTuple):
    """No motion."""

    volts: float


@compiled
def rest(
    tuning: cascade.CascadeTuning, carry: MotorLoopState, target: Setpoint, state: Resting, m: Measurement
) -> tuple[ControlOutput, MotorLoopState, Resting]:
    """Zero volts."""
    return AT_REST, carry, state


KINDS: dict[type, Any] = {
    Resting: rest,
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
"""The tick of each kind of motion, by its state."""


def step(tuning: cascade.CascadeTuning, carry: MotorLoopState, target: Setpoint, state: Any, m: Measurement) -> Any:
    """One tick of a motion of whatever kind; compiled code has that of its kind alone."""
    return KINDS[type(state)](tuning, carry, target, state, m)


@overload(step, cast(Any, STRICT), strict=False)
def _step(tuning: Any, carry: Any, target: Any, state: Any, m: Any) -> Any:
    return KINDS[state.instance_class].py_func  # as it is written: compiled here, it is compiled once


def with_outside_torque(state: Any, tau_ext: float) -> Any:
    """State of a motion that is told of an outside torque [N·m]: the cascade alone wants to know."""
    return state._replace(tau_ext=tau_ext) if isinstance(state, tracking.TrackingState) else state


@overload(with_outside_torque, cast(Any, STRICT), strict=False)
def _told(state: Any, tau_ext: Any) -> Any:
    if state.instance_class is tracking.TrackingState:
        return lambda state, tau_ext: tracking.TrackingState(
            state.law, state.position_loop, state.plays, state.player, tau_ext
        )
    return lambda state, tau_ext: state


@compiled
def detect_faults(control: StateBlock[ControlState], raw: Measurement, missed: int) -> int:
    """Take in what is measured; FOUND where something is wrong with it, FELT where all is well but for a contact.

    ``missed`` deadlines since the last tick.
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
    if inputs.deaf:
        trip = 1.0 if inputs.tripped else 0.0
    q = raw.q - inputs.middle
    heard = Measurement(
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
    found, after = fault_detection.check(
        watched=control.watched.value,
        state=control.checks.value,
        raw=raw,
        m=heard,
        command=control.command.value,
        zeroed=inputs.zeroed,
        taut_wanted=inputs.taut_wanted,
        missed=missed,
    )
    store_compiled(control.checks, after)
    store_compiled(control.found, found)
    F_ext_hat = _estimate_outside_force(control, m, inputs.zeroed)
    if found.what != fault_detection.NOTHING:
        return FOUND
    return FELT if abs(F_ext_hat) > inputs.felt_from else QUIET


@compiled
def _estimate_outside_force(control: StateBlock[ControlState], m: Measurement, zeroed: bool) -> float:
    """Outside force [N] in this tick; nan as long as it is not known where the motors stand."""
    observer, bias = control.observer.value, control.bias.value
    state = (
        disturbance_observer.step_disturbance_observer(observer, control.touch.value, m)
        if zeroed
        else disturbance_observer.UNKNOWN
    )
    S = decoupler.stiffness(control.tuning.decoupler.value, m.theta_A, m.theta_B)
    F_ext_hat = disturbance_observer.force(observer, state, bias, S)
    store_compiled(control.touch, state)
    store_compiled(control.F_ext_hat, F_ext_hat)
    return F_ext_hat


@compiled
def compute_control(control: StateBlock[ControlState], moving: StateBlock[Moving]) -> tuple[int, float, float]:
    """Let the motion decide; the bits of what came of it, and the voltages [V]."""
    was, inputs = moving.value, control.inputs.value
    tau_ext = (
        control.F_ext_hat.value * control.observer.tendons.r_j.value if control.bias.value.shape[0] > 0 else math.nan
    )
    decision, carry, state = step(
        control.tuning.value, was.carry, was.target, with_outside_torque(was.state, tau_ext), control.m.value
    )
    store_compiled(moving, Moving(carry, decision.target, state))
    store_compiled(control.decision, decision)
    came = DONE if decision.done and not inputs.reached else QUIET
    target, load = decision.target, decision.target.load
    other_push = target.F_push != inputs.F_push
    other_load = load.load_A != inputs.load.load_A or load.load_B != inputs.load.load_B
    if decision.pushes and (other_push or other_load):
        came |= PUSHES
    if decision.pushes and target.tuning != inputs.tuning:
        came |= TUNES
    if decision.pushes and (target.wall != inputs.wall or target.touch != inputs.touch):
        came |= PUSHES | WALLS
    return came, decision.u_A, decision.u_B


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
    put: MotorCommand,
    at_card: RawReading,
    lateness_s: float,
    overruns: int,
) -> None:
    """Put the tick into its row (``backend.sample``); ``put`` is what was written last, and is kept as that."""
    inputs, m, y = control.inputs.value, control.m.value, control.decision.value
    store_compiled(control.command, put)
    row[_TICK], row[_T], row[_MODE], row[_RUN] = tick, tick * T_s, inputs.mode, inputs.run
    row[_Q], row[_Q_REF], row[_Q_REF_GOV], row[_Q_DOT] = m.q, y.target.q_ref, y.q_ref_gov, control.velocity.q_dot.value
    row[_S] = math.nan
    if inputs.zeroed and not fault_detection.has_slack(control.observer.tendons.value, m):
        row[_S] = decoupler.stiffness(control.tuning.decoupler.value, m.theta_A, m.theta_B)
    row[_S_REF], row[_S_REF_GOV], row[_S_TRUE] = y.target.S_ref, y.S_ref_gov, m.S_true
    row[_THETA_A], row[_THETA_A_REF], row[_THETA_B], row[_THETA_B_REF] = (
        m.theta_A,
        y.theta_A_ref,
        m.theta_B,
        y.theta_B_ref,
    )
    row[_F_A], row[_F_B], row[_U_A], row[_U_B] = m.F_A, m.F_B, put.u_A, put.u_B
    row[_F_PUSH], row[_F_EXT_HAT], row[_F_WALL] = m.F_push, control.F_ext_hat.value, m.F_wall
    row[_V_A], row[_V_B], row[_N_Q], row[_N_A], row[_N_B] = at_card
    row[_LAM_Q], row[_LAM_S], row[_BANK_ENTRY] = inputs.lam_q, inputs.lam_S, y.bank_entry
    row[_LIMITS], row[_FAULT], row[_LATENESS], row[_OVERRUNS] = (
        y.limits | inputs.limits, inputs.fault, lateness_s, overruns,
    )  # fmt: skip


# Batch ---------------------------------------------------------------------------------------------
#
# Ticks in a row on the simulator, as long as nothing comes of them that the interpreter has to see
# to.


DECIDED = 8
"""Of the tick after the last whole one: the motion has decided, and the rest is the interpreter's."""


class TickRange(NamedTuple):
    """Ticks to be made: number of the first, and of the simulator's period before it; how many; overruns so far."""

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
    stretch: TickRange,
    rows: NDArray[np.float64],
) -> tuple[int, int, float, float, Measurement]:
    """Make ticks, each with its row in ``rows`` (capacity, n), at the place of its number; ``m`` is measured now.

    Returns how many are whole, what came of the next one (QUIET: it was not begun; FOUND, FELT: it was looked at; DONE,
    TUNES, WALLS, DECIDED: it was decided), its voltages [V], and what is measured then.
    """
    for made in range(stretch.ticks):
        seen = detect_faults(control, m, 0)
        if seen != QUIET:
            return made, seen, 0.0, 0.0, m
        came, u_A, u_B = compute_control(control, moving)
        if came & (DONE | TUNES | WALLS) or not math.isfinite(u_A + u_B):
            return made, came | DECIDED, u_A, u_B, m
        if came & PUSHES:
            target = control.decision.target.value
            store_compiled(control.inputs.F_push, target.F_push)
            store_compiled(control.inputs.load, target.load)
            store_compiled(simulated.F_push, target.F_push)
            store_compiled(simulated.load, target.load)
        m = simulate_period(simulated, u_A, u_B, stretch.period + made + 1)
        number = stretch.first + made
        write_row(
            control=control,
            row=rows[number % rows.shape[0]],
            tick=number,
            put=MotorCommand(u_A, u_B),
            at_card=NO_RAW,
            lateness_s=0.0,
            overruns=stretch.overruns,
        )
    return stretch.ticks, QUIET, 0.0, 0.0, m
