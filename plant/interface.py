"""What the loop may ask of a plant, be it the rig, the simulator or a recording played back."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol, runtime_checkable

from plant.errors import ErrorCode, SinewError

# Breakage ------------------------------------------------------------------------------------------
#
# Faults to order, by name: what a plant may be asked to break, so that every reaction of the loop
# can be tried.


class Sensor(StrEnum):
    """A reading of the plant, by its name in ``Measurement``."""

    Q = "q"
    THETA_A = "theta_A"
    THETA_B = "theta_B"
    F_A = "F_A"
    F_B = "F_B"


class Breakage(StrEnum):
    """What breaks. The first five are about one sensor; those from LATE to WATCHDOG_DEATH and LOST_SAMPLE happen once.

    All others last until they are mended. From DEVICE_GONE on only a card has them: they are tried on the virtual card.
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
class Broken:
    """One thing to break; ``sensor`` counts where ``kind`` is about a sensor."""

    kind: Breakage
    sensor: Sensor = Sensor.Q

    @property
    def words(self) -> str:
        """What is broken, as a person reads it: "drift up of θ_A"."""
        kind = str(self.kind).replace("_", " ")
        named = self.kind in (*ON_SENSORS, *_AT_TERMINALS)
        return f"{kind} of {str(self.sensor).replace('theta', 'θ')}" if named else kind


ONLY_OF_A_CARD = tuple(Breakage)[tuple(Breakage).index(Breakage.DEVICE_GONE) :]
"""What a simulator without a card does not have."""

ON_SENSORS = (Breakage.NO_NUMBER, Breakage.STUCK, Breakage.JUMP, Breakage.DRIFT_UP, Breakage.DRIFT_DOWN)
"""What is done to one reading on its way to the loop."""

_AT_TERMINALS = (Breakage.SATURATION, Breakage.LOST_COUNTS)


# Interface -----------------------------------------------------------------------------------------


T_s = 1e-3
"""Sampling period of everything [s] (method section 1)."""


class Measurement(NamedTuple):
    """One reading of the plant. SI units: rad, N, N·m/rad.

    ``S_true``, ``F_push`` and ``F_wall``, the force of an obstacle on the joint at r_j, are known to the simulator
    only; the rig reports nan, 0 and nan. ``safety_trip`` is 1.0 once the independent safety module has cut the motors,
    else 0.0.
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
    """What a card said: volts of the load cells, counts of the encoders; nan where there is no card."""

    V_A: float
    V_B: float
    n_q: float
    n_A: float
    n_B: float


NO_RAW = RawReading(*(5 * [math.nan]))


class ShaftLoad(NamedTuple):
    """Torques [N·m] that load the gearbox outlets besides the tendons, the way a tendon pulls; never below 0."""

    load_A: float
    load_B: float


NO_LOAD = ShaftLoad(0.0, 0.0)


class MotorCommand(NamedTuple):
    """Voltages at the two analog outputs [V], each within ±10 V."""

    u_A: float
    u_B: float


ZERO_VOLTS = MotorCommand(0.0, 0.0)


class PlantError(SinewError):
    """The plant cannot be opened, read or written; the message says what to do."""

    category = ErrorCode.UNAVAILABLE


def require_numbers(command: MotorCommand) -> None:
    """Raise PlantError for a voltage that is no number: no output has a place for it."""
    if not math.isfinite(command.u_A + command.u_B):
        raise PlantError(f"voltages of {command.u_A:g} and {command.u_B:g} V: both have to be numbers")


class Plant(Protocol):
    """The one road between the loop and what it controls.

    A tick reads once and writes once. A simulator advances its physics by one period at each ``write``, so its
    motion never depends on the wall clock; ``paces_loop`` is True for a plant whose ``read`` blocks until the next
    sample is due (a hardware clock), False where the loop keeps the time. ``stepped`` is True where time passes with
    the writes alone: it may be driven as fast as one likes. ``pushes`` and ``loads_shafts`` tell whether ``push``
    and ``load`` are there.
    ``unattended_max_s`` [s] is how long it may be left without a write while it is under control: the simulator
    waits, a rig moves on. ``description`` says what is driven and how it is timed, for people; it is complete once the
    plant is open. ``raw`` is what the newest measurement was made from. ``unready`` says why the plant may not be
    controlled yet and what to do; empty when it may. ``plant/conformance.py`` checks all of it.
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
        """Why it may not be controlled yet."""
        ...

    def open(self) -> None:
        """Connect, outputs at zero volts. Raises PlantError."""
        ...

    def read(self) -> Measurement:
        """Return the newest measurement. Raises PlantError."""
        ...

    def write(self, command: MotorCommand) -> None:
        """Put the voltages on the outputs until the next write. Raises PlantError."""
        ...

    def push(self, F_push: float) -> None:
        """Apply an external force [N], tangential at r_j, positive towards +q. PlantError where nothing can push."""
        ...

    def load(self, load: ShaftLoad) -> None:
        """Load the motors' shafts. PlantError where nothing can load them to order (a rig)."""
        ...

    def inject(self, broken: Broken | None) -> None:
        """Break something, None to mend it. PlantError where nothing can be broken to order (a rig)."""
        ...

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Say where joint and motors stand now [rad], from the next reading on; at zero volts only.

        ``at_switch``: only while the joint holds its end switch. Raises PlantError, also where positions are known.
        """
        ...

    def acknowledge(self) -> None:
        """Re-arm safety module and watchdog after the cause is gone. Raises PlantError while it is not."""
        ...

    def close(self) -> None:
        """Zero volts, then let go of the hardware. Safe to call twice."""
        ...


@runtime_checkable
class SupportsDriveEnable(Protocol):
    """A plant whose drives can be taken away while people have their hands in it."""

    def switch_drives(self, *, on: bool) -> None:
        """Set the drive-enable line; off, it stays off until it is switched on, also over a reset. PlantError.

        Off at any time, also where a watchdog has taken it away already; on at zero volts only.
        """
        ...


@runtime_checkable
class HasWiring(Protocol):
    """A plant behind a card; ``wired`` is the fingerprint of the wiring file as it was read for it."""

    wired: str


@runtime_checkable
class SupportsDirectionCheck(Protocol):
    """A plant whose motors' directions have to be proven before it may be controlled."""

    def prove_directions(self, *, proven: bool) -> None:
        """Take note whether the motors are known to turn as the wiring says."""
        ...


@runtime_checkable
class HasLimitSwitch(Protocol):
    """A plant whose joint can be driven to an end switch; ``zeroed`` tells that its encoder counts from its middle."""

    zeroed: bool

    @property
    def at_end(self) -> bool:
        """Whether the joint held the switch in the newest reading."""
        ...

    @property
    def unproven(self) -> str:
        """Why its motors may not be driven yet, even where no position is known; empty where they may."""
        ...


# Choice --------------------------------------------------------------------------------------------
#
# Which plant is to be driven, as one says it at the start and as every run remembers it.


DEFAULT_WIRING = "pcie-6323"

NAME_MAX = 100
"""Longest name of a plant [characters]: every run remembers it whole."""

FILE_NAME_MAX = 200
"""Longest name of a file with parameters or a wiring [characters], without its ending: runs remember it whole."""


class PlantKind(StrEnum):
    """What is behind the Plant interface."""

    SIMULATOR = "simulator"
    RIG = "rig"
    VIRTUAL_CARD = "virtual_card"
    REPLAY = "replay"
    PACKAGE = "package"


@dataclass(frozen=True)
class PlantChoice:
    """One plant: ``wiring`` and ``address`` (of a device server) count for a card, the others for their kind.

    ``recording`` is a file, ``package`` the name of an entry point of the group ``sinew.plants``.
    """

    kind: PlantKind = PlantKind.SIMULATOR
    wiring: str = DEFAULT_WIRING
    address: str = ""
    recording: str = ""
    package: str = ""

    @property
    def name(self) -> str:
        """What a run remembers, and what stands on badge, report and export."""
        return self.package if self.kind is PlantKind.PACKAGE else str(self.kind).replace("_", " ")

    @property
    def simulated(self) -> bool:
        """Whether what moves is computed: it can be pushed, and broken to order."""
        return self.kind in (PlantKind.SIMULATOR, PlantKind.VIRTUAL_CARD)


SIMULATOR = PlantChoice()

SIMULATED = frozenset(choice.name for kind in PlantKind if (choice := PlantChoice(kind)).simulated)
"""Names of the plants of which every run has a seed."""
