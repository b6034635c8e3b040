"""Sign-in, sign-out, health."""

from fastapi import APIRouter, Request, Response

from backend.api.auth import COOKIE, SignedIn, address_of, gate_of
from backend.api.schemas.history import Checklist
from backend.api.schemas.session import Health, SessionView, SignIn
from backend.api.service import ServiceInUse

router = APIRouter(prefix="/api", tags=["session"])


@router.get("/health")
async def get_health(service: ServiceInUse) -> Health:
    """Tell whether the loop is alive; open to all, without secrets."""
    return service.bench.picture.health()


@router.get("/session")
async def get_session(person: SignedIn) -> SessionView:
    """Tell who is signed in."""
    return SessionView(name=person.name, role=person.role)


@router.post("/session")
async def sign_in(body: SignIn, request: Request, response: Response) -> SessionView:
    """Exchange a token for a session cookie."""
    gate = gate_of(request)
    person = gate.sign_in(body.token, body.name, address_of(request))
    gate.grant(response, person)
    return SessionView(name=person.name, role=person.role)


@router.delete("/session", status_code=204)
async def sign_out(response: Response) -> None:
    """Forget the session cookie."""
    response.delete_cookie(COOKIE, httponly=True, samesite="strict", path="/")


@router.get("/checklist")
async def get_checklist(service: ServiceInUse, _person: SignedIn) -> Checklist:
    """Return how far the set-up is, from pretension to report, and what is out of date."""
    return await service.history.checklist()
