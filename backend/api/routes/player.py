"""The player of a recording in place of a plant: what is played, and play, pause, speed and position."""

from fastapi import APIRouter

from backend.api.auth import SignedIn
from backend.api.service import HoldsControl, ServiceInUse
from backend.schemas.run import PlayedRecording, PlayerOrder

router = APIRouter(prefix="/api/player", tags=["operate"])


@router.get("")
async def get_recording(service: ServiceInUse, _person: SignedIn) -> PlayedRecording:
    """Return the recording that is played, with what happened in it; refused where a plant is driven."""
    return service.actuator.player.recording


@router.put("", status_code=204)
async def play(body: PlayerOrder, service: ServiceInUse, _person: HoldsControl) -> None:
    """Play, pause, set the speed or go to a time of the recording; at its end, playing begins anew."""
    await service.actuator.player.order(body)
