"""The websocket of live samples, state and marks."""

from fastapi import APIRouter, WebSocket

from backend.api.auth import signed_in
from backend.api.service import service_of

router = APIRouter()


@router.websocket("/api/live")
async def live(websocket: WebSocket) -> None:
    """Stream to a signed-in person until either side ends it."""
    signed_in(websocket)
    await websocket.accept()
    await service_of(websocket).live.serve(websocket)
