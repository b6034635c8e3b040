"""Offline closed loop: compiled, linear, with trajectory and push; forecasts."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import (
    LANDING_S,
    Decoupler,
    LoopReferences,
    Rejection,
    cascade,
    decoupler,
    disturbance_observer,
    interpolate_gains,
    pid,
    select_entry,
    stiffness_slope,
    tension_under,
    trajectory,
)
from backend.tuning.robustness import decoupling_matrix, linear_plant
from plant import (
    DELAY_SLOTS,
    SIDES,
    Asymmetry,
    Dynamics,
    Measurement,
    MotorCommand,
    PlantParameters,
    PlantState,
    SafetyBounds,
    SensorModel,
    T_s,
    actuate_plant,
    compiled,
    compiled_run,
    compute_elastic_torques,
    is_limit_exceeded,
    make_sensor_model,
    motor_axes,
    sense_state,
)

# Closed loop ---------------------------------------------------------------------------------------
# The offline closed loop: the compiled functions of the live control step in one compiled loop over all ticks.


Array = NDArray[np.float64]

COLUMNS = (
    "q", "S", "S_true", "theta_A", "theta_B", "F_A", "F_B", "u_A", "u_B",
    "theta_A_ref", "theta_B_ref", "q_ref_gov", "S_ref_gov",
)  # fmt: skip
"""Columns of the array that ``simulate`` fills; SI units as in backend.sample."""


class SimulatedRig(NamedTuple):
    """The simulated plant with its sensors and limits."""

    plant: Dynamics
    sensors: SensorModel
    bounds: SafetyBounds
    u_max: float


class ClosedLoopInputs(NamedTuple):
    """Inputs of the closed loop in each tick.

    ``q_ref`` [rad], ``S_ref`` [N·m/rad], ``F_push`` [N], each (ticks,); ``noise`` of the load cells (ticks, 2) [N].
    """

    q_ref: Array
    S_ref: Array
    F_push: Array
    noise: Array


@compiled
def fill_delay_line(rig: SimulatedRig, x: PlantState, line: Array) -> None:
    """Fill the load cells' delay line with the constant state x.

    The first tick is DELAY_SLOTS.
    """
    for slot in range(DELAY_SLOTS):
        sense_state(
            plant=rig.plant,
            sensors=rig.sensors,
            x=x,
            line=line,
            tick=slot,
            noise_A=0.0,
            noise_B=0.0,
            F_push=0.0,
            safety_trip=0.0,
        )


@compiled
def record(row: Array, m: Measurement, y: cascade.CascadeOutput) -> None:
    """Write a tick into its row (len(COLUMNS),)."""
    row[0], row[1], row[2] = m.q, y.S, m.S_true
    row[3], row[4] = m.theta_A, m.theta_B
    row[5], row[6] = m.F_A, m.F_B
    row[7], row[8] = y.u_A, y.u_B
    row[9], row[10] = y.theta_A_ref, y.theta_B_ref
    row[11], row[12] = y.q_ref_gov, y.S_ref_gov


@compiled
def sense_rig(rig: SimulatedRig, x: PlantState, line: Array, k: int, inputs: ClosedLoopInputs) -> Measurement:
    """Return the measurement in tick ``k``; ``line`` is the load cells' delay line."""
    return sense_state(
        plant=rig.plant,
        sensors=rig.sensors,
        x=x,
        line=line,
        tick=k + DELAY_SLOTS,
        noise_A=inputs.noise[k, 0],
        noise_B=inputs.noise[k, 1],
        F_push=inputs.F_push[k],
        safety_trip=0.0,
    )


@compiled
def actuate_rig(rig: SimulatedRig, x: PlantState, y: cascade.CascadeOutput, F_push: float) -> PlantState:
    """Return the plant's state a tick later, under the voltages of ``y`` and a push.

    ``F_push`` is in N.
    """
    return actuate_plant(
        plant=rig.plant,
        sensors=rig.sensors,
        u_max=rig.u_max,
        x=x,
        command=MotorCommand(y.u_A, y.u_B),
        F_push=F_push,
    )


@compiled_run
def simulate(
    rig: SimulatedRig,
    tuning: cascade.CascadeTuning,
    x: PlantState,
    controller: cascade.CascadeState,
    inputs: ClosedLoopInputs,
    line: Array,
    out: Array,
) -> tuple[PlantState, cascade.CascadeState, int]:
    """Simulate the cascade on the plant, filling ``out`` (ticks, len(COLUMNS)).

    The run has len(inputs.q_ref) ticks. ``line`` (2, DELAY_SLOTS) is the load cells' delay line. Returns the final
    states and the tick of the safety module's trip (−1: none), at which the run ends.
    """
    fill_delay_line(rig, x, line)
    for k in range(inputs.q_ref.shape[0]):
        m = sense_rig(rig, x, line, k, inputs)
        r = LoopReferences(inputs.q_ref[k], inputs.S_ref[k], math.nan, math.nan)
        y, controller = cascade.step(tuning, controller, r, True, m)
        record(out[k], m, y)
        x = actuate_rig(rig, x, y, inputs.F_push[k])
        if is_limit_exceeded(rig.plant, rig.bounds, x):
            return x, controller, k
    return x, controller, -1


@compiled_run
def simulate_rejection(
    rig: SimulatedRig,
    tuning: cascade.CascadeTuning,
    observer: disturbance_observer.Observer,
    calibrated_at: int,
    x: PlantState,
    controller: cascade.CascadeState,
    inputs: ClosedLoopInputs,
    line: Array,
    out: Array,
) -> int:
    """Simulate with the observer's external torque and the disturbance rejection.

    Like ``simulate``; returns the tick of the trip. The bias is calibrated at the tick ``calibrated_at``; there is no
    compensation before.
    """
    fill_delay_line(rig, x, line)
    estimate, bias = disturbance_observer.UNKNOWN, math.nan
    for k in range(inputs.q_ref.shape[0]):
        m = sense_rig(rig, x, line, k, inputs)
        estimate = disturbance_observer.step_disturbance_observer(observer, estimate, m)
        if k == calibrated_at:
            bias = estimate.mean
        r = LoopReferences(inputs.q_ref[k], inputs.S_ref[k], math.nan, math.nan)
        y, controller = cascade.step(
            tuning=tuning, state=controller, r=r, position_loop=True, m=m, tau_ext=estimate.tau_ext - bias
        )
        record(out[k], m, y)
        x = actuate_rig(rig, x, y, inputs.F_push[k])
        if is_limit_exceeded(rig.plant, rig.bounds, x):
            return k
    return -1


@dataclass(frozen=True)
class Trajectory:
    """Result of a simulation: one array (ticks,) per column, SI units.

    ``tripped_at`` is a tick or −1.
    """

    q: Array
    S: Array
    S_true: Array
    theta_A: Array
    theta_B: Array
    F_A: Array
    F_B: Array
    u_A: Array
    u_B: Array
    theta_A_ref: Array
    theta_B_ref: Array
    q_ref_gov: Array
    S_ref_gov: Array
    tripped_at: int


def make_trajectory(out: Array, tripped_at: int) -> Trajectory:
    """Return the columns of a filled array (ticks, len(COLUMNS)) by name."""
    return Trajectory(**dict(zip(COLUMNS, out.T, strict=True)), tripped_at=tripped_at)


def make_simulated_rig(parameters: PlantParameters) -> SimulatedRig:
    """Return the compiled functions' constants of a parameter set."""
    return SimulatedRig(
        parameters.make_dynamics(),
        make_sensor_model(parameters.sensors, parameters.safety.F_max, parameters.motor.u_max),
        SafetyBounds(parameters.safety.F_max, parameters.geometry.q_max, parameters.safety.deflection_max),
        parameters.motor.u_max,
    )


def rest_state(rig: SimulatedRig, theta_A: float, theta_B: float) -> tuple[PlantState, float, float]:
    """Return the plant at rest at motor angles [rad], and the holding voltages [V]."""
    plant = rig.plant
    low, high = -rig.bounds.q_max, rig.bounds.q_max
    if plant.mechanism is not None:
        axes = motor_axes(plant.mechanism)
        centre = axes.v_A * theta_A + axes.v_B * theta_B
        low, high = centre - rig.bounds.deflection_max, centre + rig.bounds.deflection_max
    while low < (q := 0.5 * (low + high)) < high:
        tau, _, _ = compute_elastic_torques(plant, q, theta_A, theta_B)
        low, high = (q, high) if tau > 0.0 else (low, q)
    _, load_A, load_B = compute_elastic_torques(plant, q, theta_A, theta_B)
    x = PlantState(
        q=q,
        q_dot=0.0,
        theta_A=theta_A,
        omega_A=0.0,
        tau_A=load_A,
        theta_B=theta_B,
        omega_B=0.0,
        tau_B=load_B,
        z_A=0.0,
        z_B=0.0,
    )
    return x, load_A / plant.motor_A.K_t, load_B / plant.motor_B.K_t


def simulate_cascade(
    parameters: PlantParameters,
    tuning: cascade.CascadeTuning,
    q_ref: Array,
    S_ref: Array,
    F_push: Array | None = None,
    seed: int = 0,
    entry: float = -1.0,
    calibrated_at: int | None = None,
    rig: SimulatedRig | None = None,
) -> Trajectory:
    """Simulate the cascade from rest at (q_ref[0], S_ref[0]).

    References (ticks,) are in rad and N·m/rad; ``F_push`` (ticks,) [N] defaults to none. ``entry``: active bank entry
    at the start, −1 for the one nearest to S. From the tick ``calibrated_at`` on the external force is estimated and
    rejected as ``tuning`` says; None: it is not. ``rig``: that of ``parameters``, if available; making it takes as long
    as some seconds of simulation. The same arguments give the same trajectory to the last bit.
    """
    rig = rig or make_simulated_rig(parameters)
    x, controller = at_rest(rig, tuning, float(q_ref[0]), float(S_ref[0]))
    if entry >= 0.0:
        controller = controller._replace(active=float(entry))
    inputs = make_closed_loop_inputs(parameters, q_ref, S_ref, F_push, seed)
    line, out = empty_arrays(q_ref.size)
    if calibrated_at is not None:
        observer = disturbance_observer.build_observer(parameters)
        return make_trajectory(
            out,
            simulate_rejection(
                rig=rig,
                tuning=tuning,
                observer=observer,
                calibrated_at=calibrated_at,
                x=x,
                controller=controller,
                inputs=inputs,
                line=line,
                out=out,
            ),
        )
    _, _, tripped_at = simulate(rig=rig, tuning=tuning, x=x, controller=controller, inputs=inputs, line=line, out=out)
    return make_trajectory(out, tripped_at)


def at_rest(
    rig: SimulatedRig, tuning: cascade.CascadeTuning, q_ref: float, S_ref: float
) -> tuple[PlantState, cascade.CascadeState]:
    """Return plant and cascade at rest at (q_ref [rad], S_ref [N·m/rad])."""
    theta_A, theta_B = decoupler.motor_positions(tuning.decoupler, q_ref, S_ref)
    x, u_A, u_B = rest_state(rig, theta_A, theta_B)
    m = Measurement(
        q=x.q, theta_A=x.theta_A, theta_B=x.theta_B, F_A=0.0, F_B=0.0, S_true=0.0, F_push=0.0, safety_trip=0.0
    )
    inner = pid.at_rest_motor_pair(tuning.motors, theta_A, theta_B, u_A, u_B)
    return x, cascade.initialize_bumpless(
        tuning=tuning, inner=inner, motor_gains=tuning.motors, theta_A_ref=theta_A, theta_B_ref=theta_B, m=m, q_ref=x.q
    )


def empty_arrays(ticks: int) -> tuple[Array, Array]:
    """Return an empty delay line of the load cells, and rows of NaN."""
    return np.zeros((2, DELAY_SLOTS)), np.full((ticks, len(COLUMNS)), np.nan)


def make_closed_loop_inputs(
    parameters: PlantParameters, q_ref: Array, S_ref: Array, F_push: Array | None = None, seed: int = 0
) -> ClosedLoopInputs:
    """Return references and push (ticks,) with the load cell noise of the seed."""
    noise = parameters.sensors.force_noise * np.random.default_rng(seed).standard_normal((q_ref.size, 2))
    return ClosedLoopInputs(q_ref, S_ref, np.zeros(q_ref.size) if F_push is None else F_push, noise)


# Sampled loop --------------------------------------------------------------------------------------
# The closed loop as executed, linear and sampled: response to references and joint torques, tick by tick.
#
# The plant between two ticks is exact (constant voltages), the laws are the control step's own functions without
# limits: no delay of the sampling is neglected, unlike in the continuous models of ``robustness``. Friction, encoder
# counts and dead zones are neglected.


Rule = Callable[[Array, Array], tuple[Array, Array]]

_PLANT, _LAWS = 8, 8
_Q, _THETA_A, _THETA_B = 0, 2, 5
"""Indices of the angles in the plant's state."""


class SampledLoopInputs(NamedTuple):
    """Indices of the inputs: references [rad, N·m/rad], joint torque [N·m], rejection.

    ``q_e`` [rad] is added to the position loop's output, ``q_off`` [rad] is the expected deviation of its measurement.
    """

    q_ref: int = 0
    S_ref: int = 1
    tau_ext: int = 2
    q_e: int = 3
    q_off: int = 4


class Outputs(NamedTuple):
    """Indices of the outputs [rad, N·m/rad]."""

    q: int = 0
    S: int = 1


Complex = NDArray[np.complex128]
INPUTS, OUTPUTS = SampledLoopInputs(), Outputs()


@dataclass(frozen=True)
class Sampled:
    """Linear discrete-time system: x ← A x + B w, y = C x + D w, relative to rest."""

    A: Array
    B: Array
    C: Array
    D: Array

    def response(self, f: Array) -> Complex:
        """Return the frequency response at ``f`` (n,) [Hz], shape (n, outputs, inputs)."""
        z = np.exp(2j * np.pi * np.asarray(f) * T_s)
        resolvent = z[:, None, None] * np.eye(len(self.A)) - self.A
        states = np.linalg.solve(resolvent, np.broadcast_to(self.B, (z.size, *self.B.shape)))
        return np.asarray(self.C @ states + self.D)

    def simulate(self, w: Array) -> Array:
        """Return the outputs (ticks, outputs) for inputs (ticks, inputs), from rest."""
        x = np.zeros(len(self.A))
        y = np.empty((len(w), len(self.C)))
        for k, now in enumerate(w):
            y[k] = self.C @ x + self.D @ now
            x = self.A @ x + self.B @ now
        return y


@dataclass(frozen=True)
class SampledLoop:
    """The loop and its parts, linearized at rest.

    ``plant``: voltages [V] and a joint torque [N·m] to q, θ_A, θ_B [rad]. ``law``: q_ref, S_ref, q, θ_A, θ_B, and the
    rejection's inputs, to voltages. ``closed``: inputs as in ``INPUTS``, outputs as in ``OUTPUTS``. ``split`` (2, 2):
    motor references [rad] per q_c and S_c; ``slope``: stiffness per angle of either motor.
    """

    plant: Sampled
    law: Sampled
    closed: Sampled
    split: Array
    slope: float


def make_sampled_loop(
    parameters: PlantParameters,
    tuning: cascade.CascadeTuning,
    S: float,
    *,
    position_loop: bool = True,
    plant: Sampled | None = None,
) -> SampledLoop:
    """Return the loop of ``tuning`` at rest at S [N·m/rad] and q = 0.

    The plant has its identified parameters. Without ``position_loop`` the decoupler's geometry alone positions the
    joint. The active bank entry is that for S. ``plant``: ``held_plant`` at S, if available.
    """
    d = tuning.decoupler
    plant = plant or held_plant(parameters, d, S)
    split, slope = decoupling_matrix(d, S), stiffness_slope(d, S)
    gains_q, gains_S = interpolate_gains(tuning.schedule, select_entry(tuning.schedule, -1.0, S))
    inner = tuning.motors

    def law(x: Array, w: Array) -> tuple[Array, Array]:
        q_ref, S_ref, q, theta_A, theta_B, q_e, q_off = w
        q_c, position = pid.step_i_p(gains_q, pid.IPState(x[6]), q_ref, q - q_off, 0.0)
        S_c, stiffness = pid.step_i_p(gains_S, pid.IPState(x[7]), S_ref, slope * (theta_A + theta_B), 0.0)
        if not position_loop:
            q_c, position, q_e = q_ref, pid.IPState(0.0), 0.0
        ref_A, ref_B = split @ (q_c + q_e, S_c)
        u_A, _, A = pid.step_i_pd(inner.A, pid.IPDState(*x[:3]), ref_A, theta_A, np.inf)
        u_B, _, B = pid.step_i_pd(inner.B, pid.IPDState(*x[3:6]), ref_B, theta_B, np.inf)
        return np.array([u_A, u_B]), np.concatenate([A, B, position, stiffness])

    def tick(x: Array, w: Array) -> tuple[Array, Array]:
        at = plant.C @ x[:_PLANT]
        u, laws = law(x[_PLANT:], np.concatenate([w[:2], at, w[3:]]))
        moved = plant.A @ x[:_PLANT] + plant.B @ np.append(u, w[INPUTS.tau_ext])
        return np.array([at[0], slope * (at[1] + at[2])]), np.concatenate([moved, laws])

    return SampledLoop(plant, _linear(law, _LAWS, 5 + 2), _linear(tick, _PLANT + _LAWS, len(INPUTS)), split, slope)


def _linear(rule: Rule, states: int, inputs: int) -> Sampled:
    """Return the matrices of a linear rule.

    The rule maps state and input to output and next state.
    """
    of_states = [rule(x, np.zeros(inputs)) for x in np.eye(states)]
    of_inputs = [rule(np.zeros(states), w) for w in np.eye(inputs)]
    C, A = (np.column_stack([pair[place] for pair in of_states]) for place in (0, 1))
    D, B = (np.column_stack([pair[place] for pair in of_inputs]) for place in (0, 1))
    return Sampled(A, B, C, D)


def held_plant(parameters: PlantParameters, d: Decoupler, S: float) -> Sampled:
    """Return the plant at rest at S [N·m/rad] with inputs held over a tick."""
    from scipy.linalg import expm

    plant = linear_plant(parameters, d, S)
    states, inputs = plant.B.shape
    both = np.zeros((states + inputs, states + inputs))
    both[:states, :states], both[:states, states:] = plant.A, plant.B
    held = expm(both * T_s)
    C = np.eye(states)[[_Q, _THETA_A, _THETA_B]]
    return Sampled(held[:states, :states], held[:states, states:], C, np.zeros((len(C), inputs)))


# Trajectory response -------------------------------------------------------------------------------
# Response of small motions of the references with a trajectory: its model, its voltages, and the loops on the
# difference.
#
# The model responds with its landing, its averaging, the motors' electrical lag and the oscillation of its joint: 1
# except for some hundredths of a second, independent of λ and gains. These act on the difference between actuator and
# model. This is valid while the required voltage is within the limit (docs/decisions/0046).


_STEP = 1e-6


class AxisResponse(NamedTuple):
    """Responses of an axis to its target, each (n,).

    Angle and speed [1/s] after averaging and electrical lag; ``driven`` and ``lagged`` [1/s] are K times the mean
    voltage before and after the lag.
    """

    theta: Complex
    omega: Complex
    driven: Complex
    lagged: Complex


def axis_response(model: trajectory.TrajectoryModel, f: Array) -> AxisResponse:
    """Return the response to a moving target at ``f`` (n,) [Hz], close to the target.

    ω⁺ = rate + (target − θ − T_s (ω − rate))/LANDING_S (``compute_approach_voltage``), and θ⁺ as the motor turns; its
    voltage, after averaging over some ticks and the electrical lag, moves the model's motors (``advance_lagged_axis``).
    """
    z = np.exp(2j * np.pi * np.asarray(f) * T_s)
    T = max(model.T_A, model.T_B)
    decay = np.exp(-T_s / T)
    lost = T * (1.0 - decay)
    turning = (T_s - lost) * (z - decay) / (1.0 - decay) + lost  # θ (z − 1) = ω turning
    ahead = T_s / LANDING_S
    asked = (1.0 - 1.0 / z) / T_s * (1.0 + ahead) + 1.0 / LANDING_S
    reached = (z - 1.0) * (z + ahead) / turning + 1.0 / LANDING_S
    averaged = sum(z**-ticks for ticks in range(trajectory.WINDOW_TICKS)) / trajectory.WINDOW_TICKS
    driven = asked / reached * (z - 1.0) / turning * (z - decay) / (1.0 - decay) * averaged
    tau_e = max(model.tau_e_A, model.tau_e_B)
    behind = np.exp(-T_s / tau_e)
    lagged = driven * (1.0 - behind) / (z - behind)
    left = (lagged - driven) * tau_e / (tau_e - T)
    omega = (driven * (1.0 - decay) + left * (behind - decay)) / (z - decay)
    over = omega - driven - left
    theta = (driven * T_s + left * tau_e * (1.0 - behind) + over * lost) / (z - 1.0)
    return AxisResponse(theta, omega, driven, lagged)


def joint_response(model: trajectory.TrajectoryModel, S: float, f: Array) -> Complex:
    """Return the response of the model's joint to its equilibrium at S [N·m/rad].

    J_j q'' + B_j q' + S q = S q_e.
    """
    s = 2j * np.pi * np.asarray(f)
    return np.asarray(S / (model.J_j * s**2 + model.B_j * s + S))


def planned_response(
    parameters: PlantParameters, tuning: cascade.CascadeTuning, S: float, f: Array, *, position_loop: bool = True
) -> Complex:
    """Return the response from (q_ref, S_ref) to (q, S), shape (n, 2, 2).

    The frequencies are ``f`` (n,) [Hz]; S is in N·m/rad.
    """
    model = tuning.reference_tracking.model
    loop = make_sampled_loop(parameters, tuning, S, position_loop=position_loop)
    axis, joint = axis_response(model, f), joint_response(model, S, f)
    modelled = np.empty((axis.theta.size, 3, 2), dtype=np.complex128)
    modelled[:, 0, :] = (axis.theta * joint)[:, None] * np.array([1.0, 0.0])
    modelled[:, 1:, :] = axis.theta[:, None, None] * loop.split
    forward = _forward(tuning=tuning, loop=loop, S=S, f=f, axis=axis, joint=joint)

    plant, law = loop.plant.response(f)[:, :, :2], loop.law.response(f)
    # The loops act on y − y_m alone, so y − y_m = P (u_m + L (y − y_m)) − y_m.
    coupled = np.linalg.solve(np.eye(3) - plant @ law[:, :, 2:5], plant @ forward - modelled)
    seen = np.array([[1.0, 0.0, 0.0], [0.0, loop.slope, loop.slope]])
    return np.asarray(seen @ (modelled + coupled))


def _forward(
    tuning: cascade.CascadeTuning, loop: SampledLoop, S: float, f: Array, axis: AxisResponse, joint: Complex
) -> Complex:
    """Return the voltages of the model per (q_ref, S_ref), shape (n, 2, 2).

    They are those that ``trajectory.compute_voltages`` computes.
    """
    model, d = tuning.reference_tracking.model, tuning.decoupler
    T, tau_e = max(model.T_A, model.T_B), max(model.tau_e_A, model.tau_e_B)
    turning = (axis.lagged - axis.omega) / T
    jerk = ((axis.driven - axis.lagged) / tau_e - turning) / T
    stiffer = (tension_under(d, S + _STEP) - tension_under(d, S - _STEP)) / (2.0 * _STEP)
    pull = 0.5 * S / d.r_j * axis.theta * (1.0 - joint)
    tendon = 0.5 * S / d.r_j**2
    swing = 2j * np.pi * np.asarray(f) * axis.theta * joint
    forward = np.empty((axis.theta.size, 2, 2), dtype=np.complex128)
    for motor, (K, T_own, tau_own, K_t, side) in enumerate(
        (
            (model.K_A, model.T_A, model.tau_e_A, model.K_t_A, 1.0),
            (model.K_B, model.T_B, model.tau_e_B, model.K_t_B, -1.0),
        )
    ):
        driven = (axis.omega + (T_own + tau_own) * turning + T_own * tau_own * jerk) / K
        driven += d.r_m / K_t * tau_own * tendon * d.r_m * axis.omega
        forward[:, motor, :] = driven[:, None] * loop.split[motor]
        forward[:, motor, 0] += d.r_m / K_t * side * (pull - tau_own * tendon * d.r_j * swing)
        forward[:, motor, 1] += d.r_m / K_t * stiffer * axis.theta
    return forward


# Preview plant -------------------------------------------------------------------------------------
# The plant that a preview simulates: identified motors and springs, with friction and sensors of the parameter file.
#
# A preview must not use more than is known about a rig: it has the identified motors and springs, not the simulator's
# true ones, and both sides are equal. Friction, electrical lag, encoder counts and the delay of the load cells are
# those of the active parameters.


_ALIKE = Asymmetry(spring_A=1.0, spring_B=1.0, motor_A=1.0, motor_B=1.0)


def expected_plant(parameters: PlantParameters) -> PlantParameters:
    """Return ``parameters`` with the identified motors and springs as true ones.

    Both sides are equal.
    """
    sided: dict[str, dict[str, Any]] = dict(parameters.sided)
    for side in SIDES:
        identified = parameters.select_identified(side)
        motor, spring = (parameters.sided.get(f"{section}_{side}", {}) for section in ("motor", "spring"))
        sided[f"motor_{side}"] = {**motor, "K_m": identified.K_m, "T_m": identified.T_m}
        sided[f"spring_{side}"] = {**spring, "k": identified.k, "points": identified.points}
    return replace(parameters, asymmetry=_ALIKE, sided=sided)


# Step forecast -------------------------------------------------------------------------------------
# Forecast of a reference step: the compiled closed loop, simulated on the expected plant.


BAND = 0.02
"""Band of settling around the new reference, as a fraction of the step (method section 7)."""

HELD_S = 1.0
"""Time before the step or the push [s]: friction, dead zones and load cells come to rest."""

_POINTS = 160
"""Points of the curve that the page draws."""


@dataclass(frozen=True)
class StepForecast:
    """A step of q [rad] or S [N·m/rad] from ``start`` to ``end``.

    ``t90_s``: time to 90 % of the step; ``settling_s``: time until it stays within BAND of the step; both NaN if that
    does not happen in the simulated time. ``overshoot_percent`` of the step. ``peak_voltage`` [V] and ``least_tension``
    [N] of both sides. ``y`` (n,): progress from 0 to 1 over ``t`` (n,) [s].
    """

    start: float
    end: float
    t90_s: float
    settling_s: float
    overshoot_percent: float
    peak_voltage: float
    least_tension: float
    t: Array
    y: Array


def step_forecast(
    plant: PlantParameters,
    tuning: cascade.CascadeTuning,
    q: tuple[float, float],
    S: tuple[float, float],
    seconds: float,
    entry: float = -1.0,
    rig: SimulatedRig | None = None,
) -> StepForecast:
    """Simulate one step; the step is the pair of ``q`` and ``S`` that differs.

    ``q`` [rad] and ``S`` [N·m/rad]: references before and after; ``seconds``: simulated time after the step; ``entry``:
    active bank entry before it, −1 for the one nearest to S; ``rig``: that of ``plant``, if available.
    """
    ticks = round(HELD_S / T_s), round(seconds / T_s)
    trajectory = simulate_cascade(plant, tuning, np.repeat(q, ticks), np.repeat(S, ticks), entry=entry, rig=rig)
    moves_q = q[0] != q[1]
    (start, end), signal = (q, trajectory.q) if moves_q else (S, trajectory.S)
    after = slice(ticks[0], None)
    y = (signal[after] - start) / (end - start)
    t90_s, settling_s, overshoot_percent = step_figures(y)
    voltages, tensions = (trajectory.u_A, trajectory.u_B), (trajectory.F_A, trajectory.F_B)
    if trajectory.tripped_at >= 0:
        t90_s = settling_s = np.nan
        y = y[: max(trajectory.tripped_at - ticks[0], 0) + 1]
    shown = shown_ticks(y.size, settling_s)
    return StepForecast(
        start=start,
        end=end,
        t90_s=t90_s,
        settling_s=settling_s,
        overshoot_percent=overshoot_percent,
        peak_voltage=max(float(np.nanmax(np.abs(u[after]))) for u in voltages),
        least_tension=min(float(np.nanmin(F[after])) for F in tensions),
        t=np.asarray(shown * T_s, dtype=np.float64),
        y=y[shown],
    )


def step_figures(y: Array) -> tuple[float, float, float]:
    """Return t90 [s], settling time [s] and overshoot [%] of a step.

    ``y`` (ticks,) is its progress, 0 to 1. Times are NaN if 90 % is not reached, or if the end is not within BAND.
    """
    reached, outside = y >= 0.9, np.flatnonzero(~(np.abs(y - 1.0) <= BAND + 1e-9))
    t90_s = float(np.argmax(reached)) * T_s if reached.any() else np.nan
    settled = int(outside[-1]) + 1 if outside.size else 0
    return t90_s, settled * T_s if settled < y.size else np.nan, 100.0 * max(float(np.nanmax(y)) - 1.0, 0.0)


def shown_ticks(ticks: int, settling_s: float) -> NDArray[np.int64]:
    """Return the ticks (n,) of a curve of ``ticks``, up to 25 % beyond its settling."""
    last = ticks - 1 if np.isnan(settling_s) else min(ticks - 1, round((1.25 * settling_s + 0.1) / T_s))
    return np.unique(np.linspace(0, last, _POINTS).round().astype(np.int64))


# Push forecast -------------------------------------------------------------------------------------
# Forecast of a constant push: deflection, recovery and apparent stiffness of the joint.
#
# Deflection and recovery are those of the compiled closed loop on the expected plant, with friction, encoder counts,
# dead zones and rejection; the apparent stiffness is that of the linear sampled loop. The springs deflect before any
# motor has moved, so the first deflection is r_j F/S for any loops; they determine how long it lasts.


_LASTS = 9.0
"""Simulated time of a push in λ_q, in addition to 2 s."""

PUSH_N = 5.0
"""Constant push of the forecast [N]."""

APPARENT_STIFFNESS_HZ = (0.1, 1.0)
"""Frequencies of the apparent stiffness [Hz]: for a person who leans on the joint, and for one who shakes it."""

NEAR_RAD = float(np.radians(0.3))
"""Band around the reference in which the joint has recovered [rad]: 3.3 counts of the paper's encoder. One count would
be too small: friction and the dead zone of the integrators may leave the joint a count off, and a reference between two
counts shifts the band by half a count."""

LEARNED_S = 2.0
"""Time at rest before the push if the bias of the external force must be calibrated first [s]."""


@dataclass(frozen=True)
class PushForecast:
    """Response to a constant push, and to a sine of force beyond the dead zone.

    ``deflection`` [rad]: largest deviation. ``recovery_s`` [s]: time until it stays within NEAR_RAD, NaN if it does
    not. ``apparent_stiffness_slow``, ``apparent_stiffness_fast`` [N·m/rad]: external torque over
    deviation, at APPARENT_STIFFNESS_HZ. ``off`` (n,): deviation [rad] over ``t`` (n,) [s].
    """

    deflection: float
    recovery_s: float
    apparent_stiffness_slow: float
    apparent_stiffness_fast: float
    t: Array
    off: Array


def forecast_push(
    parameters: PlantParameters,
    tuning: cascade.CascadeTuning,
    S: float,
    lam_q: float,
    F_push: float = PUSH_N,
    q: float = 0.0,
    entry: float = -1.0,
    *,
    rig: SimulatedRig | None = None,
    held: Sampled | None = None,
) -> PushForecast:
    """Return the response to a constant push ``F_push`` [N].

    The joint is at ``q`` [rad] and S [N·m/rad]. ``entry``: active bank entry before it, −1 for the one nearest to S.
    ``lam_q`` [s] determines the simulated time: the deviation has then fallen to a hundredth. ``rig``: that of the
    expected plant, and ``held``: ``held_plant`` at S, if available.
    """
    rejects = tuning.disturbance_feedforward.k_ext > 0.0
    rest, pushed = round((LEARNED_S if rejects else HELD_S) / T_s), round((2.0 + _LASTS * lam_q) / T_s)
    force = np.repeat((0.0, F_push), (rest, pushed))
    trajectory = simulate_cascade(
        expected_plant(parameters),
        tuning,
        np.full(force.size, q),
        np.full(force.size, S),
        force,
        entry=entry,
        calibrated_at=rest - 1 if rejects else None,
        rig=rig,
    )
    off = trajectory.q[rest:] - q
    away = np.flatnonzero(~(np.abs(off) <= NEAR_RAD + 1e-9))
    recovery_ticks = int(away[-1]) + 1 if away.size else 0
    recovery_s = recovery_ticks * T_s if recovery_ticks < off.size else np.nan
    shown = shown_ticks(off.size, recovery_s)
    closed = make_sampled_loop(parameters, tuning, S, plant=held).closed
    apparent_stiffness_slow, apparent_stiffness_fast = map(
        float,
        np.abs(compute_apparent_stiffness(closed, tuning.disturbance_feedforward, S, np.array(APPARENT_STIFFNESS_HZ))),
    )
    deflection = float(np.nanmax(np.abs(off)))
    return PushForecast(
        deflection=deflection,
        recovery_s=recovery_s,
        apparent_stiffness_slow=apparent_stiffness_slow,
        apparent_stiffness_fast=apparent_stiffness_fast,
        t=np.asarray(shown * T_s, dtype=np.float64),
        off=off[shown],
    )


def disturbance_response(r: Rejection, tau: Array, S: float) -> tuple[Array, Array]:
    """Return the rejection's inputs of the loop, ``q_e`` and ``q_off``, each (n,).

    ``tau`` (n,) [N·m] is the torque, which the observer estimates with three lags of its pole; the estimate acts at
    once, as in the control step.
    """
    q_e, q_off = np.zeros(tau.size), np.zeros(tau.size)
    if r.k_ext == 0.0:
        return q_e, q_off
    state, estimate = disturbance_observer.update_gain(r, disturbance_observer.IDLE, 0.0), estimate_torque(tau)
    for k, seen in enumerate(estimate):
        state = disturbance_observer.step_disturbance_feedforward(r, state, float(seen))
        q_e[k], q_off[k] = disturbance_observer.compute_compensation(state, S)
    return q_e, q_off


def estimate_torque(tau: Array) -> Array:
    """Return the observer's estimate (n,) of a torque (n,) [N·m].

    The estimate in a tick contains the torque up to the previous tick.
    """
    from scipy.signal import lfilter

    decay = np.exp(-disturbance_observer.POLE * T_s)
    estimate = np.append(0.0, tau[:-1])
    for _ in range(3):
        estimate = lfilter([1.0 - decay], [1.0, -decay], estimate)
    return np.asarray(estimate)


def compute_apparent_stiffness(closed: Sampled, r: Rejection, S: float, f: Array) -> Complex:
    """Return external torque over deviation of q [N·m/rad] at ``f`` (n,) [Hz].

    This applies to a push beyond the rejection's dead zone. ``closed`` is the loop at S [N·m/rad].
    """
    z = np.exp(2j * np.pi * np.asarray(f) * T_s)
    decay = np.exp(-disturbance_observer.POLE * T_s)
    estimate = ((1.0 - decay) / (1.0 - decay / z)) ** 3 / z
    behind = ((1.0 - r.lag_decay) / (1.0 - r.lag_decay / z)) ** 4
    H = closed.response(f)[:, OUTPUTS.q, :]
    share = r.k_ext * estimate / S
    return np.asarray(
        1.0 / (H[:, INPUTS.tau_ext] - share * H[:, INPUTS.q_e] + share * (1.0 - behind) * H[:, INPUTS.q_off])
    )
