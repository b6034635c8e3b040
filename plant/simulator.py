"""Simulated rig: dynamics, sensors and safety module behind the Plant interface."""

import math
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant import messages
from plant.compilation import PrecompiledCall, StateBlock, compiled, store_compiled
from plant.dynamics import (
    AT_REST,
    NO_OBSTACLE,
    SUBSTEPS,
    Dynamics,
    Obstacle,
    PlantState,
    advance_state,
    compute_stiffness,
    contact_force,
    elongation_A,
    elongation_B,
    require_free,
    require_possible_wall,
    tendon_tension,
)
from plant.interface import (
    NO_LOAD,
    NO_RAW,
    NOT_MEASURED,
    ON_SENSORS,
    ONLY_OF_A_CARD,
    ZERO_VOLTS,
    InjectedFault,
    InjectedFaultKind,
    Measurement,
    MotorCommand,
    PlantError,
    Sensor,
    ShaftLoad,
    T_s,
    require_numbers,
)
from plant.mechanisms import Mechanism, elastic_deflection
from plant.parameters import PlantParameters, Sensors
from plant.safety_card import Card

# Fault effects -------------------------------------------------------------------------------------
# Effect of one injected fault on readings and writes.


JUMPS = {Sensor.Q: 0.3, Sensor.THETA_A: 1.0, Sensor.THETA_B: 1.0, Sensor.F_A: 15.0, Sensor.F_B: 15.0}
"""Size of a jump [rad, N]: more than the plant can move in a tick, but not beyond a limit by its size alone."""

DRIFTS = {
    Sensor.Q: (20.0, 3.0),
    Sensor.THETA_A: (10.0, 2.0),
    Sensor.THETA_B: (10.0, 2.0),
    Sensor.F_A: (400.0, 100.0),
    Sensor.F_B: (400.0, 100.0),
}
"""Rate and limit of a drift [rad/s, rad; N/s, N]; at a motor encoder a drift represents a slipping tendon."""

LATE_S = 0.41
"""Delay of the next tick by LATE [s]: just more than ``unattended_max_s``, so that the loop is back before the card's
watchdog expires on a busy machine too."""

HANG_S = 0.65
"""Delay by HANG [s]: more than the card's watchdog waits, less than the service waits before it kills the loop."""


class FaultInjector:
    """Active fault; its effect starts at construction."""

    def __init__(self, injected_fault: InjectedFault) -> None:
        self._injected_fault = injected_fault
        self._ticks = 0
        self._frozen: float | None = None

    @property
    def description(self) -> str:
        """Description of the fault."""
        return self._injected_fault.words

    @property
    def blocks_access(self) -> bool:
        """Whether the plant cannot be read or written while the fault lasts."""
        return self._injected_fault.kind in (InjectedFaultKind.READ_ERROR, InjectedFaultKind.WRITE_ERROR)

    def distort(self, m: Measurement) -> Measurement:
        """Return a measurement with the fault applied. Raises PlantError."""
        kind, sensor = self._injected_fault.kind, self._injected_fault.sensor
        if kind is InjectedFaultKind.READ_ERROR:
            raise PlantError(messages.reading_failed_by_injection())
        if kind not in ON_SENSORS:
            return m
        self._ticks += 1
        return m._replace(**{sensor.value: self._distort_reading(getattr(m, sensor.value))})

    def _distort_reading(self, value: float) -> float:
        sensor = self._injected_fault.sensor
        rate, drift_max = DRIFTS[sensor]
        drift = min(rate * T_s * self._ticks, drift_max)
        match self._injected_fault.kind:
            case InjectedFaultKind.NO_NUMBER:
                return math.nan
            case InjectedFaultKind.STUCK:
                self._frozen = value if self._frozen is None else self._frozen
                return self._frozen
            case InjectedFaultKind.JUMP:
                return value + JUMPS[sensor]
            case InjectedFaultKind.DRIFT_UP:
                return value + drift
            case InjectedFaultKind.DRIFT_DOWN:
                # A load cell never reads below zero.
                return max(value - drift, 0.0) if sensor in (Sensor.F_A, Sensor.F_B) else value - drift
            case _:
                return value

    def delay_write(self) -> None:
        """Delay the write. Raises PlantError for a write error."""
        if self._injected_fault.kind is InjectedFaultKind.WRITE_ERROR:
            raise PlantError(messages.writing_failed_by_injection())
        pause_s = {InjectedFaultKind.LATE: LATE_S, InjectedFaultKind.HANG: HANG_S}.get(self._injected_fault.kind, 0.0)
        if pause_s and not self._ticks:
            self._ticks += 1
            time.sleep(pause_s)


# Safety --------------------------------------------------------------------------------------------
# The independent safety module: monitors springs and joint, disables the motors, and latches.


class SafetyBounds(NamedTuple):
    """Limits: ``F_max`` [N] on each tendon, ``q_max`` [rad] to either side.

    An actuator without tendons has ``deflection_max`` [rad], to either side, in place of ``F_max``.
    """

    F_max: float
    q_max: float
    deflection_max: float = math.inf


@compiled
def is_limit_exceeded(plant: Dynamics, bounds: SafetyBounds, x: PlantState) -> bool:
    """Return whether tendon force, deflection or joint position exceeds its limit.

    The module has its own, exact sensors.
    """
    return abs(x.q) > bounds.q_max or _is_spring_overloaded(plant, plant.mechanism, bounds, x)


@compiled
def _is_spring_overloaded(plant: Dynamics, mechanism: Mechanism | None, bounds: SafetyBounds, x: PlantState) -> bool:
    if mechanism is None:
        F_A, F_B = _tendon_tensions(plant, mechanism, x)
        return bounds.F_max < F_A or bounds.F_max < F_B
    return abs(elastic_deflection(mechanism, x.q, x.theta_A, x.theta_B)) > bounds.deflection_max


@compiled
def _tendon_tensions(plant: Dynamics, mechanism: Mechanism | None, x: PlantState) -> tuple[float, float]:
    """Return the tensions [N], NaN for an actuator without tendons."""
    if mechanism is not None:
        return math.nan, math.nan
    F_A = tendon_tension(plant.spring_A, elongation_A(plant.joint, x.theta_A, x.q))
    F_B = tendon_tension(plant.spring_B, elongation_B(plant.joint, x.theta_B, x.q))
    return F_A, F_B


# Sensors -------------------------------------------------------------------------------------------
# Encoders, load cells and converters: measurement of the true state.


DELAY_SLOTS = 64
"""Length of the load cells' delay line [ticks]."""


class SensorModel(NamedTuple):
    """Resolutions (0: exact) and load cell delay.

    ``joint_step``, ``motor_step`` [rad] per count; ``force_step`` [N] and ``voltage_step`` [V] per converter step;
    ``delay_ticks`` of the load cells.
    """

    joint_step: float
    motor_step: float
    force_step: float
    voltage_step: float
    delay_ticks: int


@compiled
def quantize(value: float, step: float) -> float:
    """Round to the nearest multiple of ``step``; unchanged if ``step`` is 0."""
    if step == 0.0:
        return value
    return math.floor(value / step + 0.5) * step


@compiled
def delay_forces(line: NDArray[np.float64], tick: int, delay_ticks: int, F_A: float, F_B: float) -> tuple[float, float]:
    """Store this tick's forces [N] in ``line``; return those of ``delay_ticks`` ago.

    ``line`` is the delay line, shape (2, DELAY_SLOTS).
    """
    slots = line.shape[1]
    line[0, tick % slots] = F_A
    line[1, tick % slots] = F_B
    delayed_tick = tick - delay_ticks
    if delayed_tick < 0:
        delayed_tick = 0
    return line[0, delayed_tick % slots], line[1, delayed_tick % slots]


@compiled
def sense_state(
    plant: Dynamics,
    sensors: SensorModel,
    x: PlantState,
    line: NDArray[np.float64],
    tick: int,
    noise_A: float,
    noise_B: float,
    F_push: float,
    safety_trip: float,
    obstacle: Obstacle = NO_OBSTACLE,
) -> Measurement:
    """Return the measurement of the true state x.

    ``noise_A``, ``noise_B`` [N] are this tick's load cell errors. An actuator without tendons has no load cells: F_A
    and F_B are NaN.
    """
    F_A, F_B = _tendon_tensions(plant, plant.mechanism, x)
    F_A, F_B = delay_forces(line, tick, sensors.delay_ticks, F_A, F_B)
    return Measurement(
        q=quantize(x.q, sensors.joint_step),
        theta_A=quantize(x.theta_A, sensors.motor_step),
        theta_B=quantize(x.theta_B, sensors.motor_step),
        F_A=quantize(F_A + noise_A, sensors.force_step),
        F_B=quantize(F_B + noise_B, sensors.force_step),
        S_true=compute_stiffness(plant, x.q, x.theta_A, x.theta_B),
        F_push=F_push,
        safety_trip=safety_trip,
        F_wall=contact_force(obstacle, plant.joint, x.q, x.q_dot),
    )


def make_sensor_model(parameters: Sensors, F_max: float, u_max: float) -> SensorModel:
    """Return resolutions from counts and converter bits over ±2 F_max and ±u_max."""
    steps = 2.0**parameters.converter_bits
    exact = parameters.converter_bits == 0.0
    return SensorModel(
        joint_step=parameters.joint_step,
        motor_step=parameters.motor_step,
        force_step=0.0 if exact else 4.0 * F_max / steps,
        voltage_step=0.0 if exact else 2.0 * u_max / steps,
        delay_ticks=round(parameters.force_delay / T_s),
    )


# Simulator -----------------------------------------------------------------------------------------


_NOISE_BLOCK = 4096
"""Ticks of load cell noise per draw: drawing at each tick would cost more than the physics."""


@compiled
def actuate_plant(
    plant: Dynamics,
    sensors: SensorModel,
    u_max: float,
    x: PlantState,
    command: MotorCommand,
    F_push: float,
    load: ShaftLoad = NO_LOAD,
    obstacle: Obstacle = NO_OBSTACLE,
) -> PlantState:
    """Return the state one period later.

    The command is limited and quantized as by the converter; a push [N] at r_j, a load and an obstacle act too.
    """
    u_A = quantize(min(max(command.u_A, -u_max), u_max), sensors.voltage_step)
    u_B = quantize(min(max(command.u_B, -u_max), u_max), sensors.voltage_step)
    return advance_state(
        plant=plant,
        x=x,
        u_A=u_A,
        u_B=u_B,
        tau_ext=plant.joint.r_j * F_push,
        duration_s=T_s,
        substeps=SUBSTEPS,
        load=load,
        obstacle=obstacle,
    )


class Simulated(NamedTuple):
    """Simulated plant: constants, inputs and state.

    ``line`` (2, DELAY_SLOTS) is the load cells' delay line, ``noise`` (n, 2) their errors [N], used cyclically. Push
    [N], loads [N·m] and obstacle act until they change. ``m`` is the measurement at the end of a period.
    """

    plant: Dynamics
    sensors: SensorModel
    bounds: SafetyBounds
    u_max: float
    line: NDArray[np.float64]
    noise: NDArray[np.float64]
    F_push: float
    load: ShaftLoad
    obstacle: Obstacle
    x: PlantState
    tripped: bool
    m: Measurement


@compiled
def simulate_period(simulated: StateBlock[Simulated], u_A: float, u_B: float, tick: int) -> Measurement:
    """Advance by one period under voltages [V]; return the measurement at its end.

    ``tick`` is the number of the tick at the end.
    """
    s = simulated.value
    x = actuate_plant(
        plant=s.plant,
        sensors=s.sensors,
        u_max=s.u_max,
        x=s.x,
        command=MotorCommand(u_A, u_B),
        F_push=s.F_push,
        load=s.load,
        obstacle=s.obstacle,
    )
    tripped = s.tripped or is_limit_exceeded(s.plant, s.bounds, x)
    store_compiled(simulated.x, x)
    store_compiled(simulated.tripped, tripped)
    return _measure(simulated, tick)


@compiled
def _measure(simulated: StateBlock[Simulated], tick: int) -> Measurement:
    s = simulated.value
    row = tick % s.noise.shape[0]
    trip = 1.0 if s.tripped else 0.0
    m = sense_state(
        plant=s.plant,
        sensors=s.sensors,
        x=s.x,
        line=s.line,
        tick=tick,
        noise_A=s.noise[row, 0],
        noise_B=s.noise[row, 1],
        F_push=s.F_push,
        safety_trip=trip,
        obstacle=s.obstacle,
    )
    store_compiled(simulated.m, m)
    return m


@compiled
def _is_limit_exceeded(simulated: StateBlock[Simulated]) -> bool:
    return is_limit_exceeded(simulated.plant.value, simulated.bounds.value, simulated.x.value)


class Simulator:
    """A plant that advances one period at each write, reproducible by its seed.

    The same seed gives the same run to the last bit. With ``card`` its outputs pass the registers, watchdog and
    drive-enable line of that card. ``module_cuts``: which motors the safety module really disables when it trips; it
    reports the trip in any case.
    """

    paces_loop = False
    stepped = True
    pushes = True
    loads_shafts = True
    unattended_max_s = 0.4
    description = "simulator"
    raw = NO_RAW
    unready = ""

    def __init__(
        self, parameters: PlantParameters, seed: int = 0, x: PlantState = AT_REST, card: Card | None = None
    ) -> None:
        u_max, F_max = parameters.motor.u_max, parameters.safety.F_max
        self._F_max = F_max
        self._has_no_load_cells = parameters.mechanism is not None
        self._noise_N = parameters.sensors.force_noise
        self._random = np.random.default_rng(seed)
        self._noise_block = -1
        self._tick = 0
        self._m: Measurement | None = None
        self._card = card
        self._fault_injector: FaultInjector | None = None
        self.module_cuts = True, True
        self._tripped = False
        self.simulated = simulated = StateBlock(
            Simulated(
                plant=parameters.make_dynamics(),
                sensors=make_sensor_model(parameters.sensors, F_max, u_max),
                bounds=SafetyBounds(F_max, parameters.geometry.q_max, parameters.safety.deflection_max),
                u_max=u_max,
                line=np.zeros((2, DELAY_SLOTS)),
                noise=np.zeros((_NOISE_BLOCK, 2)),
                F_push=0.0,
                load=NO_LOAD,
                obstacle=NO_OBSTACLE,
                x=PlantState(*map(float, x)),
                tripped=False,
                m=NOT_MEASURED,
            )
        )
        self._period = PrecompiledCall(simulate_period, simulated, 0.0, 0.0, 0)
        self._sense = PrecompiledCall(_measure, simulated, 0)
        self._is_limit_exceeded = PrecompiledCall(_is_limit_exceeded, simulated)
        self._x, self._push_force, self._trip = (simulated.field(name) for name in ("x", "F_push", "tripped"))
        self._wall_force = simulated.field("m").field("F_wall")

    @property
    def x(self) -> PlantState:
        """State of the plant."""
        x: PlantState = self._x.get()
        return x

    def open(self) -> None:
        """Test the card's watchdog and enable its drives, if there is a card.

        Raises PlantError if that fails.
        """
        if self._card is not None:
            self._card.arm()

    def read(self) -> Measurement:
        """Return the measurement of the current state."""
        m = self._m
        if m is None:  # before the first write, or after an input has changed
            self._draw_noise()
            m = self._sense(self.simulated, self._tick)
        return m if self._fault_injector is None else self._fault_injector.distort(m)

    def write(self, command: MotorCommand) -> None:
        """Advance the physics by one period. Raises PlantError.

        The command takes effect with drive-enable on and without a trip.
        """
        require_numbers(command)
        if self._fault_injector is not None:
            self._fault_injector.delay_write()
        driven = command
        if self._card is not None and not self._card.drives_on:
            driven = ZERO_VOLTS
        elif self._tripped:
            driven = self._cut(command)
        self._tick += 1
        self._draw_noise()
        self._m = m = self._period(self.simulated, driven.u_A, driven.u_B, self._tick)
        self._tripped = m.safety_trip != 0.0
        if self._card is not None:
            self._card.write(driven, self._tripped)

    @property
    def periods(self) -> int:
        """Number of periods since construction."""
        return self._tick

    def count_batchable_ticks(self, ticks: int) -> int:
        """Return how many of the next ticks can be computed in one compiled run."""
        if self._card is not None or self._fault_injector is not None or self._tripped:
            return 0
        return min(ticks, _NOISE_BLOCK - 1 - self._tick % _NOISE_BLOCK)

    def complete_batch(self, ticks: int, m: Measurement) -> None:
        """Update the state after a compiled run of ``ticks`` with the last measurement."""
        self._tick += ticks
        self._m = m
        self._tripped = m.safety_trip != 0.0

    def _draw_noise(self) -> None:
        """Draw a block of noise at its start, and at each reading before the first write."""
        block = self._tick // _NOISE_BLOCK
        if (block != self._noise_block or self._tick == 0) and self._noise_N > 0.0:
            self._noise_block = block
            noise = self._noise_N * self._random.standard_normal((_NOISE_BLOCK, 2))
            self.simulated.field("noise").set(noise)

    def _cut(self, command: MotorCommand) -> MotorCommand:
        cuts_A, cuts_B = self.module_cuts
        return MotorCommand(0.0 if cuts_A else command.u_A, 0.0 if cuts_B else command.u_B)

    @property
    def F_push(self) -> float:
        """Current push [N]."""
        F_push: float = self._push_force.get()
        return F_push

    @property
    def F_wall(self) -> float:
        """Force of the obstacle on the joint [N] in the last measurement."""
        F_wall: float = self._wall_force.get()
        return F_wall

    def push(self, F_push: float) -> None:
        """Apply an external force [N] from the next period on."""
        self._push_force.set(float(F_push))
        self._m = None

    def load(self, load: ShaftLoad) -> None:
        """Load the motors' shafts from the next period on.

        Raises PlantError for a negative load.
        """
        if not all(0.0 <= torque < math.inf for torque in load):
            raise PlantError(messages.shaft_load_negative(load_A=load.load_A, load_B=load.load_B))
        self.simulated.field("load").set(ShaftLoad(float(load.load_A), float(load.load_B)))

    def obstacle(self, obstacle: Obstacle | None) -> None:
        """Set the obstacle from the next period on, None removes it.

        Raises PlantError for an obstacle that is out of range, contains the joint, or is too stiff for the integration
        steps.
        """
        if obstacle is not None:
            joint, bounds = self.simulated.field("plant").field("joint").get(), self.simulated.field("bounds").get()
            require_possible_wall(obstacle, joint, self._F_max, bounds.q_max, T_s / SUBSTEPS)
            require_free(obstacle, self.x.q)
        self.simulated.field("obstacle").set(NO_OBSTACLE if obstacle is None else Obstacle(*map(float, obstacle)))
        self._m = None

    def inject(self, injected_fault: InjectedFault | None) -> None:
        """Inject a fault from the next reading on; None clears it.

        Raises PlantError for a fault that only a card has, or of a load cell that the actuator does not have.
        """
        if injected_fault is not None and injected_fault.kind in ONLY_OF_A_CARD:
            raise PlantError(messages.fault_requires_card(fault=injected_fault.words))
        if injected_fault is not None and self._has_no_load_cells and injected_fault.concerns_load_cell:
            raise PlantError(messages.load_cells_missing(fault=injected_fault.words))
        self._fault_injector = None if injected_fault is None else FaultInjector(injected_fault)
        if injected_fault is not None and injected_fault.kind is InjectedFaultKind.SAFETY_TRIP:
            self._trips(tripped=True)
        if (
            injected_fault is not None
            and injected_fault.kind is InjectedFaultKind.WATCHDOG_DEATH
            and self._card is not None
        ):
            self._card.kill_watchdog()

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Raise PlantError: the positions of the simulator are always known."""
        raise PlantError(messages.simulator_has_its_zeros())

    def limit_tension(self, F_limit: float | None) -> None:
        """Set the tension at which the safety module trips [N], None for its own limit."""
        bounds = self.simulated.field("bounds")
        bounds.set(bounds.get()._replace(F_max=self._F_max if F_limit is None else F_limit))

    def acknowledge(self) -> None:
        """Re-arm safety module and watchdog.

        Raises PlantError while a cause persists or the watchdog is dead.
        """
        if self._fault_injector is not None and self._fault_injector.blocks_access:
            raise PlantError(messages.injected_fault_persists(fault=self._fault_injector.description))
        if self._is_limit_exceeded(self.simulated):
            raise PlantError(messages.limit_still_exceeded())
        self._trips(tripped=False)
        if self._card is not None:
            self._card.rearm()

    def _trips(self, *, tripped: bool) -> None:
        self._tripped = tripped
        self._trip.set(tripped)
        self._m = None

    def close(self) -> None:
        """Zero volts and drives off at the card.

        Without writes the physics does not advance.
        """
        if self._card is not None:
            self._card.disarm()
