"""What the loop may ask of a plant, be it the rig, the simulator or a recording played back."""

import math
from typing import NamedTuple, Protocol, runtime_checkable

from plant.breakage import Broken

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


class PlantError(Exception):
    """The plant cannot be opened, read or written; the message says what to do."""


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
    controlled yet and what to do; empty when it may. ``plant/contract.py`` checks all of it.
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
class Switched(Protocol):
    """A plant whose drives can be taken away while people have their hands in it."""

    def switch_drives(self, *, on: bool) -> None:
        """Set the drive-enable line; off, it stays off until it is switched on, also over a reset. PlantError.

        Off at any time, also where a watchdog has taken it away already; on at zero volts only.
        """
        ...


@runtime_checkable
class Wired(Protocol):
    """A plant behind a card; ``wired`` is the fingerprint of the wiring file as it was read for it."""

    wired: str


@runtime_checkable
class Proven(Protocol):
    """A plant whose motors' directions have to be proven before it may be controlled."""

    def prove_directions(self, *, proven: bool) -> None:
        """Take note whether the motors are known to turn as the wiring says."""
        ...


@runtime_checkable
class EndSwitched(Protocol):
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
