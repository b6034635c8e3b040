"""The websocket of live samples, state and marks."""

from fastapi import APIRouter, WebSocket

from backend.api.auth import signed_in
from backend.api.live import serve
from backend.api.service import service_of
from backend.server.security import LIVE

router = APIRouter()


@router.websocket(LIVE)
async def live(websocket: WebSocket) -> None:
    """Stream to a signed-in person until either side ends it."""
    person, service = signed_in(websocket), service_of(websocket)
    await websocket.accept()
    await serve(service.live, websocket, lambda ping: service.control.heard(person, ping.control))
