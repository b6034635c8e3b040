"""Flight records of trips."""

from fastapi import APIRouter, Response

from backend.api.auth import SignedIn
from backend.api.routes.runs import DATA, download
from backend.api.service import RowId, ServiceInUse
from backend.exports.formats import MEDIA_TYPES, DataFormat
from backend.messages.flight import FlightList

router = APIRouter(prefix="/api/flights", tags=["faults"])


@router.get("")
async def list_flights(service: ServiceInUse, _person: SignedIn) -> FlightList:
    """List the newest flight records: 10 s before to 5 s after each trip, at 1 kHz."""
    return await service.runs.flights()


@router.get("/{id}/data.{format}", response_class=Response, responses=DATA)
async def get_flight_data(id: RowId, format: DataFormat, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return a flight record in a format; t counts from the trip."""
    return download(await service.downloads.flight(id, format), MEDIA_TYPES[format], f"sinew-trip-{id}.{format}")
