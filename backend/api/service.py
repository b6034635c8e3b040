"""The parts of a running service that routes call."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Header, Path
from starlette.requests import HTTPConnection

from backend.api.auth import Operator, Person
from backend.api.bench import Bench
from backend.api.control import HEADER, Control, read_stamp
from backend.api.desk import Desk
from backend.api.downloads import Downloads
from backend.api.history import History
from backend.api.library import Library
from backend.api.live import LiveStream
from backend.api.replay import Replay
from backend.api.shelf import Shelf
from backend.api.tasks import Tasks
from backend.api.upkeep import Upkeep

RowId = Annotated[int, Path(ge=1, le=2**53, description="identifier in the database")]


@dataclass(frozen=True)
class Service:
    """What the routes act on."""

    bench: Bench
    control: Control
    tasks: Tasks
    library: Library
    shelf: Shelf
    desk: Desk
    history: History
    replay: Replay
    downloads: Downloads
    live: LiveStream
    upkeep: Upkeep


def service_of(connection: HTTPConnection) -> Service:
    """Return the running service."""
    service: Service = connection.app.state.service
    return service


ServiceInUse = Annotated[Service, Depends(service_of)]


def _in_control(
    service: ServiceInUse,
    person: Operator,
    stamp: Annotated[
        str | None, Header(alias=HEADER, max_length=40, description="epoch.sequence of the page that holds control")
    ] = None,
) -> Person:
    service.control.require(person, read_stamp(stamp))
    return person


InControl = Annotated[Person, Depends(_in_control)]
"""An operator who holds control: only their commands move the actuator."""
