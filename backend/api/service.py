"""The parts of a running service that routes call."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Header, Path, Request
from starlette.requests import HTTPConnection

from backend.api.auth import Operator
from backend.api.bench import Bench
from backend.api.bring_up import BringUp
from backend.api.control import HEADER, Control, read_stamp
from backend.api.desk import Desk
from backend.api.downloads import Downloads
from backend.api.evaluations import Evaluations
from backend.api.history import History
from backend.api.library import Library
from backend.api.live import LiveStream
from backend.api.people import Person
from backend.api.replay import Replay
from backend.api.retention import Retention
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
    evaluations: Evaluations
    shelf: Shelf
    desk: Desk
    history: History
    replay: Replay
    downloads: Downloads
    live: LiveStream
    upkeep: Upkeep
    retention: Retention
    bring_up: BringUp


def service_of(connection: HTTPConnection) -> Service:
    """Return the running service."""
    service: Service = connection.app.state.service
    return service


async def _service_in_use(request: Request) -> Service:
    return service_of(request)


ServiceInUse = Annotated[Service, Depends(_service_in_use)]


Stamped = Annotated[
    str | None, Header(alias=HEADER, max_length=40, description="page.sequence of the page that holds control")
]


async def _in_control(service: ServiceInUse, person: Operator, stamp: Stamped = None) -> AsyncIterator[Person]:
    async with service.control.turn(person, read_stamp(stamp)):
        yield person


InControl = Annotated[Person, Depends(_in_control, scope="function")]
"""An operator who holds control: only their commands move the actuator."""
