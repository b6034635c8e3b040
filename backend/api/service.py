"""The parts of a running service that routes call."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Path
from starlette.requests import HTTPConnection

from backend.api.bench import Bench
from backend.api.desk import Desk
from backend.api.downloads import Downloads
from backend.api.history import History
from backend.api.library import Library
from backend.api.live import LiveStream
from backend.api.tasks import Tasks

RowId = Annotated[int, Path(ge=1, le=2**53, description="identifier in the database")]


@dataclass(frozen=True)
class Service:
    """What the routes act on."""

    bench: Bench
    tasks: Tasks
    library: Library
    desk: Desk
    history: History
    downloads: Downloads
    live: LiveStream


def service_of(connection: HTTPConnection) -> Service:
    """Return the running service."""
    service: Service = connection.app.state.service
    return service


ServiceInUse = Annotated[Service, Depends(service_of)]
