"""Flight records of trips."""

from fastapi import APIRouter, Response

from backend.api.auth import SignedIn
from backend.api.routes.runs import MEDIA_TYPES, DataFormat, download
from backend.api.service import RowId, ServiceInUse
from backend.messages.flight import FlightList

router = APIRouter(prefix="/api/flights", tags=["faults"])


@router.get("")
async def list_flights(service: ServiceInUse, _person: SignedIn) -> FlightList:
    """List the newest flight records: 10 s before to 5 s after each trip, at 1 kHz."""
    return await service.runs.flights()


@router.get(
    "/{id}/data.{format}",
    response_class=Response,
    responses={200: {"content": {kind.partition(";")[0]: {} for kind in MEDIA_TYPES.values()}}},
)
async def get_flight_data(id: RowId, format: DataFormat, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return a flight record as CSV, Parquet or MATLAB file; t counts from the trip."""
    return download(await service.downloads.flight(id, format), MEDIA_TYPES[format], f"sinew-trip-{id}.{format}")
