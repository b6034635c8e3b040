"""Faults to order, by name: what a plant may be asked to break, so that every reaction of the loop can be tried."""

from dataclasses import dataclass
from enum import StrEnum


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
