"""The simulated rig: dynamics, sensors and safety module behind the Plant interface."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.breakage import ONLY_OF_A_CARD, Breakage, Broken
from plant.broken_part import BrokenPart
from plant.card import Card
from plant.cell import Cell, keep
from plant.compiled import Specialised, compiled
from plant.dynamics import AT_REST, SUBSTEPS, Dynamics, PlantState, advance
from plant.interface import (
    NO_LOAD,
    NO_RAW,
    NOT_MEASURED,
    ZERO_VOLTS,
    Measurement,
    MotorCommand,
    PlantError,
    ShaftLoad,
    T_s,
    require_numbers,
)
from plant.obstacle import NO_OBSTACLE, Obstacle, require_free, require_possible
from plant.parameters import PlantParameters
from plant.safety import SafetyBounds, exceeded
from plant.sensors import DELAY_SLOTS, SensorModel, quantise, sense, sensor_model

_NOISE_BLOCK = 4096
"""Ticks of load cell noise drawn at a time: drawing in the tick would cost more than the physics."""


@compiled
def actuate(
    plant: Dynamics,
    sensors: SensorModel,
    u_max: float,
    x: PlantState,
    command: MotorCommand,
    F_push: float,
    load: ShaftLoad = NO_LOAD,
    obstacle: Obstacle = NO_OBSTACLE,
) -> PlantState:
    """State one period later, under the command as the converter puts it out, a push [N] at r_j, a load, a wall."""
    u_A = quantise(min(max(command.u_A, -u_max), u_max), sensors.voltage_step)
    u_B = quantise(min(max(command.u_B, -u_max), u_max), sensors.voltage_step)
    return advance(plant, x, u_A, u_B, plant.joint.r_j * F_push, T_s, SUBSTEPS, load, obstacle)


class Simulated(NamedTuple):
    """A simulated plant: what it is made of, what acts on it, and its state.

    ``line`` (2, DELAY_SLOTS) is the load cells' memory, ``noise`` (n, 2) their errors [N] over and over; push [N],
    loads [N·m] and obstacle act until they change. ``m`` is what is measured at the end of a period.
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
def period(simulated: Cell[Simulated], u_A: float, u_B: float, tick: int) -> Measurement:
    """Advance by a period under voltages [V]; return what is measured in ``tick``, its end."""
    s = simulated.value
    x = actuate(s.plant, s.sensors, s.u_max, s.x, MotorCommand(u_A, u_B), s.F_push, s.load, s.obstacle)
    tripped = s.tripped or exceeded(s.plant, s.bounds, x)
    keep(simulated.x, x)
    keep(simulated.tripped, tripped)
    return _measured(simulated, tick)


@compiled
def _measured(simulated: Cell[Simulated], tick: int) -> Measurement:
    s = simulated.value
    row = tick % s.noise.shape[0]
    trip = 1.0 if s.tripped else 0.0
    m = sense(s.plant, s.sensors, s.x, s.line, tick, s.noise[row, 0], s.noise[row, 1], s.F_push, trip, s.obstacle)
    keep(simulated.m, m)
    return m


@compiled
def _exceeds(simulated: Cell[Simulated]) -> bool:
    return exceeded(simulated.plant.value, simulated.bounds.value, simulated.x.value)


class Simulator:
    """A plant that advances one period at each write; the same seed gives the same run to the last bit.

    With ``card`` its outputs go through that card's registers, watchdog and drive-enable line. ``module_cuts`` tells
    which motors the safety module really cuts when it trips; it says that it has tripped in any case.
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
        self._noise_N = parameters.sensors.force_noise
        self._random = np.random.default_rng(seed)
        self._noise_block = -1
        self._tick = 0
        self._m: Measurement | None = None
        self._card = card
        self._broken: BrokenPart | None = None
        self.module_cuts = True, True
        self._tripped = False
        self.simulated = simulated = Cell(
            Simulated(
                parameters.dynamics(),
                sensor_model(parameters.sensors, F_max, u_max),
                SafetyBounds(F_max, parameters.geometry.q_max),
                u_max,
                np.zeros((2, DELAY_SLOTS)),
                np.zeros((_NOISE_BLOCK, 2)),
                0.0,
                NO_LOAD,
                NO_OBSTACLE,
                PlantState(*map(float, x)),
                False,
                NOT_MEASURED,
            )
        )
        self._period = Specialised(period, simulated, 0.0, 0.0, 0)
        self._sense = Specialised(_measured, simulated, 0)
        self._exceeds = Specialised(_exceeds, simulated)
        self._x, self._pushed, self._trip = (simulated.field(name) for name in ("x", "F_push", "tripped"))
        self._felt = simulated.field("m").field("F_wall")

    @property
    def x(self) -> PlantState:
        """Its state."""
        x: PlantState = self._x.get()
        return x

    def open(self) -> None:
        """Try the card's watchdog and enable its drives, where there is one. Raises PlantError where that fails."""
        if self._card is not None:
            self._card.arm()

    def read(self) -> Measurement:
        """Return the sensors' view of the present state."""
        m = self._m
        if m is None:  # nothing has been written yet, or what is read has changed since
            self._draw_noise()
            m = self._sense(self.simulated, self._tick)
        return m if self._broken is None else self._broken.seen(m)

    def write(self, command: MotorCommand) -> None:
        """Advance the physics by one period; the command gets through with drive-enable on and no trip. PlantError."""
        require_numbers(command)
        if self._broken is not None:
            self._broken.delay_write()
        driven = command
        if self._card is not None and not self._card.drives:
            driven = ZERO_VOLTS
        elif self._tripped:
            driven = self._cut(command)
        self._tick += 1
        self._draw_noise()
        self._m = m = self._period(self.simulated, driven.u_A, driven.u_B, self._tick)
        self._tripped = m.safety_trip != 0.0
        if self._card is not None:
            self._card.put(driven, self._tripped)

    @property
    def periods(self) -> int:
        """Periods since it was made."""
        return self._tick

    def alone_for(self, ticks: int) -> int:
        """Return for how many of the next ticks it can be stepped without being asked in between."""
        if self._card is not None or self._broken is not None or self._tripped:
            return 0
        return min(ticks, _NOISE_BLOCK - 1 - self._tick % _NOISE_BLOCK)

    def has_gone(self, ticks: int, m: Measurement) -> None:
        """Take note that it was stepped so often, and what was measured last."""
        self._tick += ticks
        self._m = m
        self._tripped = m.safety_trip != 0.0

    def _draw_noise(self) -> None:
        """Draw a block of noise where it begins, and by each reading before all writes."""
        block = self._tick // _NOISE_BLOCK
        if (block != self._noise_block or self._tick == 0) and self._noise_N > 0.0:
            self._noise_block = block
            noise = self._noise_N * self._random.standard_normal((_NOISE_BLOCK, 2))
            self.simulated.field("noise").put(noise)

    def _cut(self, command: MotorCommand) -> MotorCommand:
        cuts_A, cuts_B = self.module_cuts
        return MotorCommand(0.0 if cuts_A else command.u_A, 0.0 if cuts_B else command.u_B)

    @property
    def F_push(self) -> float:
        """The push that is applied now [N]."""
        F_push: float = self._pushed.get()
        return F_push

    @property
    def F_wall(self) -> float:
        """The force of a wall on the joint [N], as it was measured last."""
        F_wall: float = self._felt.get()
        return F_wall

    def push(self, F_push: float) -> None:
        """Apply an external force [N] from the next period on."""
        self._pushed.put(float(F_push))
        self._m = None

    def load(self, load: ShaftLoad) -> None:
        """Load the motors' shafts from the next period on. Raises PlantError for a load that would pull backwards."""
        if not all(0.0 <= torque < math.inf for torque in load):
            raise PlantError(
                f"loads of {load.load_A:g} and {load.load_B:g} N·m: loads pull as tendons do, from 0 N·m on"
            )
        self.simulated.field("load").put(ShaftLoad(float(load.load_A), float(load.load_B)))

    def obstacle(self, obstacle: Obstacle | None) -> None:
        """Put a wall in the joint's way from the next period on, None takes it away.

        Raises PlantError for one that cannot be, that stands where the joint is, or that the steps do not resolve.
        """
        if obstacle is not None:
            joint, bounds = self.simulated.field("plant").field("joint").get(), self.simulated.field("bounds").get()
            require_possible(obstacle, joint, self._F_max, bounds.q_max, T_s / SUBSTEPS)
            require_free(obstacle, self.x.q)
        self.simulated.field("obstacle").put(NO_OBSTACLE if obstacle is None else Obstacle(*map(float, obstacle)))
        self._m = None

    def inject(self, broken: Broken | None) -> None:
        """Break something from the next reading on; None mends it. Raises PlantError for what only a card has."""
        if broken is not None and broken.kind in ONLY_OF_A_CARD:
            raise PlantError(f"{broken.words}: only a card has that, try it with --plant rig --virtual-card")
        self._broken = None if broken is None else BrokenPart(broken)
        if broken is not None and broken.kind is Breakage.SAFETY_TRIP:
            self._trips(tripped=True)
        if broken is not None and broken.kind is Breakage.WATCHDOG_DEATH and self._card is not None:
            self._card.kill_watchdog()

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Refuse: it knows where it stands."""
        raise PlantError("the simulator knows where joint and motors stand: there is nothing to zero")

    def limit_tension(self, F_limit: float | None) -> None:
        """Set the tension at which the safety module trips [N], None for its own."""
        bounds = self.simulated.field("bounds")
        bounds.put(bounds.get()._replace(F_max=self._F_max if F_limit is None else F_limit))

    def acknowledge(self) -> None:
        """Re-arm safety module and watchdog. PlantError while a cause is still there, or the watchdog is dead."""
        if self._broken is not None and self._broken.keeps_from_working:
            raise PlantError(f"still broken: {self._broken.description}; mend it first")
        if self._exceeds(self.simulated):
            raise PlantError("the safety module stays tripped: tendon force or joint position is still out of bounds")
        self._trips(tripped=False)
        if self._card is not None:
            self._card.rearm()

    def _trips(self, *, tripped: bool) -> None:
        self._tripped = tripped
        self._trip.put(tripped)
        self._m = None

    def close(self) -> None:
        """Zero volts and drives off at the card; the physics stands still without writes."""
        if self._card is not None:
            self._card.disarm()
