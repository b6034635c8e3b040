"""Interface between the control loop and a plant: rig, simulator or recording."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol, runtime_checkable

from plant import messages
from plant.errors import ErrorCode, SinewError

# Fault injection -----------------------------------------------------------------------------------
# Faults that can be injected by name, to test every reaction of the control loop.


class Sensor(StrEnum):
    """Sensor of the plant, by its name in ``Measurement``."""

    Q = "q"
    THETA_A = "theta_A"
    THETA_B = "theta_B"
    F_A = "F_A"
    F_B = "F_B"


class InjectedFaultKind(StrEnum):
    """Kind of an injected fault. The first five concern one sensor.

    LATE to WATCHDOG_DEATH and LOST_SAMPLE happen once, all others last until they are cleared. DEVICE_GONE and the
    kinds after it exist on a card only; the virtual card injects them.
    """

    NO_NUMBER = "no_number"
    STUCK = "stuck"
    JUMP = "jump"
    DRIFT_UP = "drift_up"
    DRIFT_DOWN = "drift_down"
    READ_ERROR = "read_error"
    WRITE_ERROR = "write_error"
    LATE = "late"
    HANG = "hang"
    SAFETY_TRIP = "safety_trip"
    WATCHDOG_DEATH = "watchdog_death"
    DEVICE_GONE = "device_gone"
    BUFFER_OVERRUN = "buffer_overrun"
    LOST_SAMPLE = "lost_sample"
    SATURATION = "saturation"
    LOST_COUNTS = "lost_counts"
    SWAPPED_LOAD_CELLS = "swapped_load_cells"
    SWAPPED_ENCODERS = "swapped_encoders"
    SWAPPED_MOTORS = "swapped_motors"


@dataclass(frozen=True)
class InjectedFault:
    """Fault to inject; ``sensor`` is used if ``kind`` concerns a sensor."""

    kind: InjectedFaultKind
    sensor: Sensor = Sensor.Q

    @property
    def words(self) -> str:
        """Text for the operator, such as "drift up of θ_A"."""
        kind = str(self.kind).replace("_", " ")
        named = self.kind in (*ON_SENSORS, *_AT_TERMINALS)
        return f"{kind} of {str(self.sensor).replace('theta', 'θ')}" if named else kind

    @property
    def concerns_load_cell(self) -> bool:
        """Whether the fault changes the reading of a load cell."""
        return self.kind in ON_SENSORS and self.sensor in (Sensor.F_A, Sensor.F_B)


ONLY_OF_A_CARD = tuple(InjectedFaultKind)[tuple(InjectedFaultKind).index(InjectedFaultKind.DEVICE_GONE) :]
"""Faults that a simulator without a card does not have."""

ON_SENSORS = (
    InjectedFaultKind.NO_NUMBER,
    InjectedFaultKind.STUCK,
    InjectedFaultKind.JUMP,
    InjectedFaultKind.DRIFT_UP,
    InjectedFaultKind.DRIFT_DOWN,
)
"""Faults that change one reading."""

_AT_TERMINALS = (InjectedFaultKind.SATURATION, InjectedFaultKind.LOST_COUNTS)


# Interface -----------------------------------------------------------------------------------------


T_s = 1e-3
"""Sampling period of everything [s] (method section 1)."""


class Measurement(NamedTuple):
    """One reading of the plant. SI units: rad, N, N·m/rad.

    ``S_true``, ``F_push`` and ``F_wall``, the force of an obstacle on the joint at r_j, are known to the simulator
    only; the rig reports NaN, 0 and NaN. ``safety_trip`` is 1.0 once the independent safety module has disabled the
    motors, else 0.0.
    """

    q: float
    theta_A: float
    theta_B: float
    F_A: float
    F_B: float
    S_true: float
    F_push: float
    safety_trip: float
    F_wall: float = math.nan


NOT_MEASURED = Measurement(*(9 * [math.nan]))


class RawReading(NamedTuple):
    """Raw values of a card: load cell volts, encoder counts; NaN without a card."""

    V_A: float
    V_B: float
    n_q: float
    n_A: float
    n_B: float


NO_RAW = RawReading(*(math.nan for _ in RawReading._fields))


class ShaftLoad(NamedTuple):
    """Torques [N·m] on the gearbox outputs, in the direction of the tendons; >= 0."""

    load_A: float
    load_B: float


NO_LOAD = ShaftLoad(0.0, 0.0)


class MotorCommand(NamedTuple):
    """Voltages at the two analog outputs [V], each within ±10 V."""

    u_A: float
    u_B: float


ZERO_VOLTS = MotorCommand(0.0, 0.0)


class PlantError(SinewError):
    """The plant cannot be opened, read or written; the message contains the remedy."""

    category = ErrorCode.UNAVAILABLE


def require_numbers(command: MotorCommand) -> None:
    """Raise PlantError for a voltage that is not finite: no output can represent it."""
    if not math.isfinite(command.u_A + command.u_B):
        raise PlantError(messages.voltages_not_finite(u_A=command.u_A, u_B=command.u_B))


class Plant(Protocol):
    """Interface between the control loop and a plant.

    The loop reads and writes once per tick; ``plant/conformance.py`` checks the requirements.

    - ``paces_loop``: ``read`` blocks until the next sample is due (hardware clock); otherwise the loop keeps the time.
    - ``stepped``: time advances with the writes alone, so it can be stepped at any speed. A simulator advances by one
      period at each ``write``, so its motion never depends on the wall clock.
    - ``pushes``, ``loads_shafts``: whether ``push`` and ``load`` are supported.
    - ``unattended_max_s`` [s]: longest time without a write under control; a simulator waits, a rig keeps moving.
    - ``description``: text that names the hardware and its timing; complete once the plant is open.
    - ``raw``: raw values of the newest measurement.
    - ``unready``: reason why the plant may not be controlled yet, with the remedy; empty if it may.
    """

    paces_loop: bool
    stepped: bool
    pushes: bool
    loads_shafts: bool
    unattended_max_s: float
    description: str
    raw: RawReading

    @property
    def unready(self) -> str:
        """Why the plant may not be controlled yet; empty if it may."""
        ...

    def open(self) -> None:
        """Connect and set zero volts. Raises PlantError."""
        ...

    def read(self) -> Measurement:
        """Return the newest measurement. Raises PlantError."""
        ...

    def write(self, command: MotorCommand) -> None:
        """Set the output voltages until the next write. Raises PlantError."""
        ...

    def push(self, F_push: float) -> None:
        """Apply an external force [N], tangential at r_j, positive towards +q.

        Raises PlantError if the plant cannot be pushed.
        """
        ...

    def load(self, load: ShaftLoad) -> None:
        """Load the motor shafts. Raises PlantError if the plant cannot (a rig)."""
        ...

    def inject(self, injected_fault: InjectedFault | None) -> None:
        """Inject a fault, None clears all. Raises PlantError if the plant cannot (a rig)."""
        ...

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Set the current positions of joint and motors [rad]; at zero volts only.

        They apply from the next reading on. ``at_switch``: only while the joint holds its end switch. Raises
        PlantError, also if the positions are known already.
        """
        ...

    def acknowledge(self) -> None:
        """Re-arm safety module and watchdog. Raises PlantError while the cause persists."""
        ...

    def close(self) -> None:
        """Set zero volts, then release the hardware. Safe to call twice."""
        ...


@runtime_checkable
class SupportsDriveEnable(Protocol):
    """Plant whose drives can be disabled while people work at it."""

    def switch_drives(self, *, on: bool) -> None:
        """Set the drive-enable line. Raises PlantError.

        Switched off, it stays off until it is switched on, also across a reset. Switching off is possible at any time,
        also after a watchdog has disabled it; switching on at zero volts only.
        """
        ...


@runtime_checkable
class HasWiring(Protocol):
    """Plant behind a card; ``wired`` is the fingerprint of its wiring file as loaded."""

    wired: str


@runtime_checkable
class SupportsDirectionCheck(Protocol):
    """Plant whose motor directions must be proven before it may be controlled."""

    def prove_directions(self, *, proven: bool) -> None:
        """Set whether the motors are known to turn as stated in the wiring file."""
        ...


@runtime_checkable
class HasLimitSwitch(Protocol):
    """Plant with an end switch of the joint.

    ``zeroed``: the joint encoder counts from the middle of the range.
    """

    zeroed: bool

    @property
    def at_end(self) -> bool:
        """Whether the joint held the switch in the newest reading."""
        ...

    @property
    def unproven(self) -> str:
        """Why its motors may not be driven even slowly; empty if they may."""
        ...


# Plant selection -----------------------------------------------------------------------------------
# Selection of the plant, as given at the start and stored with every run.


DEFAULT_WIRING = "pcie-6323"

NAME_MAX = 100
"""Longest name of a plant [characters]: every run stores it whole."""

FILE_NAME_MAX = 200
"""Longest name of a parameter or wiring file [characters], without its suffix: runs store it whole."""


class PlantKind(StrEnum):
    """Kind of a plant."""

    SIMULATOR = "simulator"
    RIG = "rig"
    VIRTUAL_CARD = "virtual_card"
    REPLAY = "replay"
    PACKAGE = "package"


@dataclass(frozen=True)
class PlantChoice:
    """Selection of one plant.

    ``wiring`` and ``address`` (of a device server) apply to a card, ``recording``, a file, to a replay, and
    ``package``, the name of an entry point of the group ``sinew.plants``, to a package.
    """

    kind: PlantKind = PlantKind.SIMULATOR
    wiring: str = DEFAULT_WIRING
    address: str = ""
    recording: str = ""
    package: str = ""

    @property
    def name(self) -> str:
        """Name that runs store, and that badges, reports and exports show."""
        return self.package if self.kind is PlantKind.PACKAGE else str(self.kind).replace("_", " ")

    @property
    def simulated(self) -> bool:
        """Whether the motion is computed: pushes and faults can be injected."""
        return self.kind in (PlantKind.SIMULATOR, PlantKind.VIRTUAL_CARD)


SIMULATOR = PlantChoice()

SIMULATED = frozenset(choice.name for kind in PlantKind if (choice := PlantChoice(kind)).simulated)
"""Names of the plants whose runs have a seed."""
