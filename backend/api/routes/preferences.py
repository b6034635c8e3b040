"""What the page remembers for the person who is signed in."""

from fastapi import APIRouter

from backend.api.auth import SignedIn
from backend.api.service import ServiceInUse
from backend.schemas.preferences import Preferences

router = APIRouter(prefix="/api/preferences", tags=["session"])


@router.get("")
async def get_preferences(service: ServiceInUse, person: SignedIn) -> Preferences:
    """Return how the signed-in person likes the page; defaults for somebody new."""
    return await service.preferences.of(person)


@router.put("")
async def set_preferences(body: Preferences, service: ServiceInUse, person: SignedIn) -> Preferences:
    """Remember how the signed-in person likes the page. Open to viewers: it moves nothing."""
    return await service.preferences.put(person, body)
