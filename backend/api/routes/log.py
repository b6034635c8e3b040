"""What happened: the log, what people say of it, and the flight records of trips and triggers."""

from typing import Annotated

from fastapi import APIRouter, Query, Response

from backend.api.angles import AnglesRead
from backend.api.auth import Operator, SignedIn
from backend.api.routes.runs import DATA, download
from backend.api.service import RowId, ServiceInUse
from backend.exports.formats import MEDIA_TYPES, DataFormat
from backend.schemas.run import FlightList, FlightMoment, Instant, Remark, Timeline
from backend.storage.events import EventKind
from backend.storage.timeline import Asked

router = APIRouter(prefix="/api", tags=["log"])


@router.get("/log")
async def get_log(
    service: ServiceInUse,
    _person: SignedIn,
    angles: AnglesRead,
    kind: Annotated[list[EventKind] | None, Query(max_length=50, description="of these kinds only")] = None,
    words: Annotated[
        str, Query(max_length=400, description="each of these words, in text as it is read, person, note or tag")
    ] = "",
    since: Annotated[Instant | None, Query(description="from this time on")] = None,
    before: Annotated[Instant | None, Query(description="before this time")] = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> Timeline:
    """Return what happened and who asked for it, newest first."""
    return await service.timeline.page(Asked(kind or (), words.split(), since, before, angles), limit)


@router.put("/log/{id}/remark", status_code=204)
async def set_remark(id: RowId, body: Remark, service: ServiceInUse, person: Operator) -> None:
    """Say something of an event: a note and tags, in the place of those before."""
    await service.timeline.remark(id, body, person.name)


@router.get("/flights", tags=["faults"])
async def list_flights(service: ServiceInUse, _person: SignedIn) -> FlightList:
    """List the newest flight records: of trips 10 s before to 5 s after, of triggers as asked for, at 1 kHz."""
    return await service.runs.flights()


@router.get("/flights/{id}/data.{format}", tags=["faults"], response_class=Response, responses=DATA)
async def get_flight_data(id: RowId, format: DataFormat, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return a flight record in a format; t counts from the trip or trigger."""
    return download(await service.downloads.flight(id, format), MEDIA_TYPES[format], f"sinew-flight-{id}.{format}")


@router.post("/flights/{id}/replay", tags=["faults"], status_code=204)
async def show_flight_moment(id: RowId, body: FlightMoment, service: ServiceInUse, _person: SignedIn) -> None:
    """Let the replay's 3D view at /replay/ show a moment of a flight record; nothing real moves."""
    await service.replay.show_flight(id, body.t)
