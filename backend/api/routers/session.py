"""Routes of sign-in, tokens, health and preferences."""

from fastapi import APIRouter, Request, Response

from backend.api.dependencies import CurrentService, Operator, SignedInUser
from backend.auth import User
from backend.schemas import (
    Checklist,
    Health,
    NameRequest,
    NewTokens,
    PageAddress,
    PageAddressFindings,
    Preferences,
    Role,
    Rotation,
    SessionView,
    SignIn,
)
from backend.server import (
    PEER,
    PUBLIC,
    ThreadRoute,
    end_session,
    find_authentication,
    find_deployment_problems,
    read_credentials,
    set_session_cookie,
)

# Preferences ---------------------------------------------------------------------------------------


preferences_router = APIRouter(prefix="/api/preferences", tags=["session"], route_class=ThreadRoute)


@preferences_router.get("")
def get_preferences(service: CurrentService, person: SignedInUser) -> Preferences:
    """Return the preferences of the signed-in user; defaults for a new one."""
    return service.preferences.load(person)


@preferences_router.put("")
def set_preferences(body: Preferences, service: CurrentService, person: SignedInUser) -> Preferences:
    """Store the preferences of the signed-in user. Open to viewers: nothing moves."""
    return service.preferences.save(person, body)


# Session -------------------------------------------------------------------------------------------


session_router = APIRouter(prefix="/api", tags=["session"], route_class=ThreadRoute)


@session_router.get("/health")
async def get_health(service: CurrentService) -> Health:
    """Return whether the control loop runs; requires no sign-in, and contains no secrets."""
    return service.actuator.live_state.health()


@session_router.post("/page-address")
async def check_page_address(body: PageAddress, request: Request) -> PageAddressFindings:
    """Return the problems of the path from a page's address to this service.

    Open to everyone; a page of another origin gets 403.
    """
    public, peer = request.scope[PUBLIC], request.scope[PEER]
    return PageAddressFindings(problems=find_deployment_problems(body.url, public, request.headers, peer))


@session_router.get("/session")
async def get_session(request: Request, response: Response, person: SignedInUser) -> SessionView:
    """Return the signed-in user, and renew the session cookie."""
    set_session_cookie(find_authentication(request), request, response, person)
    return _view(person)


@session_router.put("/session/name")
async def set_name(
    body: NameRequest, request: Request, response: Response, service: CurrentService, person: SignedInUser
) -> SessionView:
    """Set the name of this browser's user; session and control lease remain valid."""
    authentication = find_authentication(request)
    renamed = authentication.active_users.rename(person, body.name)
    set_session_cookie(authentication, request, response, renamed)
    service.control.rename(renamed)
    return _view(renamed)


@session_router.post("/session")
async def sign_in(body: SignIn, request: Request, response: Response) -> SessionView:
    """Exchange a token for a session cookie."""
    authentication = find_authentication(request)
    person = authentication.sign_in(read_credentials(request), body.token, body.name)
    set_session_cookie(authentication, request, response, person)
    await authentication.sessions.save()
    return _view(person)


@session_router.delete("/session", status_code=204)
async def sign_out(request: Request, response: Response) -> None:
    """End the session: invalidate its cookie and disconnect its pages."""
    authentication = find_authentication(request)
    end_session(authentication, request, response)
    await authentication.sessions.save()


@session_router.post("/session/tokens/rotate")
async def rotate_tokens(body: Rotation, request: Request, response: Response, person: Operator) -> NewTokens:
    """Replace tokens immediately. All sessions of the old tokens end, except the caller's."""
    roles = list(Role) if body.role is None else [body.role]
    authentication = find_authentication(request)
    tokens = await authentication.rotate(roles, person)
    set_session_cookie(authentication, request, response, person)
    return NewTokens(tokens={role: tokens.get(role) for role in roles})


@session_router.get("/checklist")
def get_checklist(service: CurrentService, _person: SignedInUser) -> Checklist:
    """Return the steps of the setup, from pretension to report, with their states."""
    return service.history.build_checklist()


def _view(person: User) -> SessionView:
    return SessionView(name=person.name, role=person.role, asks_name=person.has_no_name)
