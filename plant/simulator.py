"""The simulated rig: dynamics, sensors and safety module behind the Plant interface."""

import math

import numpy as np
from numpy.typing import NDArray

from plant.breakage import ONLY_OF_A_CARD, Breakage, Broken
from plant.broken_part import BrokenPart
from plant.card import Card
from plant.compiled import Specialised, compiled
from plant.dynamics import AT_REST, SUBSTEPS, Dynamics, PlantState, advance
from plant.interface import (
    NO_LOAD,
    NO_RAW,
    ZERO_VOLTS,
    Measurement,
    MotorCommand,
    PlantError,
    ShaftLoad,
    T_s,
    require_numbers,
)
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
) -> PlantState:
    """State one period later, under the command as the converter puts it out, a push F_push [N] at r_j and a load."""
    u_A = quantise(min(max(command.u_A, -u_max), u_max), sensors.voltage_step)
    u_B = quantise(min(max(command.u_B, -u_max), u_max), sensors.voltage_step)
    return advance(plant, x, u_A, u_B, plant.joint.r_j * F_push, T_s, SUBSTEPS, load)


@compiled
def period(
    plant: Dynamics,
    sensors: SensorModel,
    bounds: SafetyBounds,
    u_max: float,
    x: PlantState,
    command: MotorCommand,
    load: ShaftLoad,
    F_push: float,
    tripped: bool,
    line: NDArray[np.float64],
    tick: int,
    noise: NDArray[np.float64],
    row: int,
) -> tuple[PlantState, bool, Measurement]:
    """State after a period, whether the safety module has tripped by then, and what is measured in ``tick``, its end.

    In one call: that numba reads the plant's constants out of their tuples costs as much as the physics.
    """
    x = actuate(plant, sensors, u_max, x, command, F_push, load)
    tripped = tripped or exceeded(plant, bounds, x)
    trip = 1.0 if tripped else 0.0
    return x, tripped, sense(plant, sensors, x, line, tick, noise[row, 0], noise[row, 1], F_push, trip)


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
        self.x = x
        self._plant = parameters.dynamics()
        self._u_max = parameters.motor.u_max
        self._sensors = sensor_model(parameters.sensors, parameters.safety.F_max, self._u_max)
        self._F_max = parameters.safety.F_max
        self._bounds = SafetyBounds(parameters.safety.F_max, parameters.geometry.q_max)
        self._noise_N = parameters.sensors.force_noise
        self._random = np.random.default_rng(seed)
        self._noise = np.zeros((_NOISE_BLOCK, 2))
        self._noise_block = -1
        self._line = np.zeros((2, DELAY_SLOTS))
        self._tick = 0
        self._m: Measurement | None = None
        self._F_push = 0.0
        self._load = NO_LOAD
        self._tripped = False
        self._card = card
        self._broken: BrokenPart | None = None
        self.module_cuts = True, True
        plant, sensors = self._plant, self._sensors
        self._sense = Specialised(sense, plant, sensors, AT_REST, self._line, 0, 0.0, 0.0, 0.0, 0.0)
        self._period = Specialised(
            period,
            plant,
            sensors,
            self._bounds,
            0.0,
            AT_REST,
            ZERO_VOLTS,
            NO_LOAD,
            0.0,
            False,
            self._line,
            0,
            self._noise,
            0,
        )
        self._exceeded = Specialised(exceeded, plant, self._bounds, AT_REST)

    def open(self) -> None:
        """Try the card's watchdog and enable its drives, where there is one. Raises PlantError where that fails."""
        if self._card is not None:
            self._card.arm()

    def read(self) -> Measurement:
        """Return the sensors' view of the present state."""
        m = self._m
        if m is None:  # nothing has been written yet, or what is read has changed since
            row = self._noise_row()
            noise_A, noise_B = self._noise[row]
            F_push, trip = self._F_push, 1.0 if self._tripped else 0.0
            m = self._sense(self._plant, self._sensors, self.x, self._line, self._tick, noise_A, noise_B, F_push, trip)
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
        row = self._noise_row()
        self.x, self._tripped, self._m = self._period(
            self._plant,
            self._sensors,
            self._bounds,
            self._u_max,
            self.x,
            driven,
            self._load,
            self._F_push,
            self._tripped,
            self._line,
            self._tick,
            self._noise,
            row,
        )
        if self._card is not None:
            self._card.put(driven, self._tripped)

    def _noise_row(self) -> int:
        """Row of ``_noise`` for this tick; a block is drawn where it begins, and by each reading before all writes."""
        block, row = divmod(self._tick, _NOISE_BLOCK)
        if (block != self._noise_block or self._tick == 0) and self._noise_N > 0.0:
            self._noise_block = block
            self._noise = self._noise_N * self._random.standard_normal((_NOISE_BLOCK, 2))
        return row

    def _cut(self, command: MotorCommand) -> MotorCommand:
        cuts_A, cuts_B = self.module_cuts
        return MotorCommand(0.0 if cuts_A else command.u_A, 0.0 if cuts_B else command.u_B)

    @property
    def F_push(self) -> float:
        """The push that is applied now [N]."""
        return self._F_push

    def push(self, F_push: float) -> None:
        """Apply an external force [N] from the next period on."""
        self._F_push = float(F_push)
        self._m = None

    def load(self, load: ShaftLoad) -> None:
        """Load the motors' shafts from the next period on. Raises PlantError for a load that would pull backwards."""
        if not all(0.0 <= torque < math.inf for torque in load):
            raise PlantError(
                f"loads of {load.load_A:g} and {load.load_B:g} N·m: loads pull as tendons do, from 0 N·m on"
            )
        self._load = ShaftLoad(float(load.load_A), float(load.load_B))

    def inject(self, broken: Broken | None) -> None:
        """Break something from the next reading on; None mends it. Raises PlantError for what only a card has."""
        if broken is not None and broken.kind in ONLY_OF_A_CARD:
            raise PlantError(f"{broken.words}: only a card has that, try it with --plant rig --virtual-card")
        self._broken = None if broken is None else BrokenPart(broken)
        if broken is not None and broken.kind is Breakage.SAFETY_TRIP:
            self._tripped = True
            self._m = None
        if broken is not None and broken.kind is Breakage.WATCHDOG_DEATH and self._card is not None:
            self._card.kill_watchdog()

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Refuse: it knows where it stands."""
        raise PlantError("the simulator knows where joint and motors stand: there is nothing to zero")

    def limit_tension(self, F_limit: float | None) -> None:
        """Set the tension at which the safety module trips [N], None for its own."""
        self._bounds = self._bounds._replace(F_max=self._F_max if F_limit is None else F_limit)

    def acknowledge(self) -> None:
        """Re-arm safety module and watchdog. PlantError while a cause is still there, or the watchdog is dead."""
        if self._broken is not None and self._broken.keeps_from_working:
            raise PlantError(f"still broken: {self._broken.description}; mend it first")
        if self._exceeded(self._plant, self._bounds, self.x):
            raise PlantError("the safety module stays tripped: tendon force or joint position is still out of bounds")
        self._tripped = False
        self._m = None
        if self._card is not None:
            self._card.rearm()

    def close(self) -> None:
        """Zero volts and drives off at the card; the physics stands still without writes."""
        if self._card is not None:
            self._card.disarm()
