"""What can go wrong, and how to make it happen where the plant is simulated."""

from enum import StrEnum

from pydantic import Field

from backend.faults import Fault
from backend.messages.base import Schema
from plant.breakage import Sensor


class InjectionKind(StrEnum):
    """What is broken: parts of the plant as in ``plant.breakage.Breakage``, then links of the safety chain."""

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
    SERVICE_SILENT = "service_silent"
    PAGE_SILENT = "page_silent"


class Injection(Schema):
    """One thing to break."""

    kind: InjectionKind
    sensor: Sensor = Field(default=Sensor.Q, description="which reading, where the kind is about one")


class FaultKind(Schema):
    """A fault with its words, and what brings it about while the joint moves."""

    code: Fault
    message: str
    remedy: str
    injection: Injection | None = Field(description="what to break; null where there is nothing to be broken")
    by_hand: str = Field(description="what a person does instead; empty where something can be broken")


class CardFault(Schema):
    """Something that can go wrong with a card and its wires."""

    injection: Injection
    says: str = Field(description="what is broken, as a person reads it")
    leads_to: list[Fault] = Field(description="the faults it may end in while the joint moves")


class FaultList(Schema):
    """All faults there are, in the order of their codes; and what can be broken of the card, where it is virtual."""

    faults: list[FaultKind]
    card: list[CardFault]
