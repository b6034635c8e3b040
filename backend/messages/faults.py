"""What can go wrong, and how to make it happen where the plant is simulated."""

from enum import StrEnum

from pydantic import Field

from backend.faults import Fault
from backend.messages.base import Schema
from plant.interface import Breakage, Sensor


class Silence(StrEnum):
    """What falls silent in the safety chain, the plant being whole."""

    SERVICE_SILENT = "service_silent"
    PAGE_SILENT = "page_silent"


class Injection(Schema):
    """One thing to break."""

    kind: Breakage | Silence
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
