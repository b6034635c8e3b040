"""Routes of the system, commissioning, live stream and built pages."""

import logging
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, HTTPException, Request, WebSocket
from fastapi.responses import FileResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.routing import Match, Route
from starlette.types import Receive, Scope, Send

from backend.api.dependencies import (
    ActuatorOperator,
    CurrentService,
    Operator,
    SignedInUser,
    get_service,
    require_signed_in,
    serve_live_stream,
)
from backend.api.errors import STATUS_BY_CODE
from backend.commissioning import StepId
from backend.errors import RequestRejectedError
from backend.public_url import PublicUrl
from backend.schemas import (
    BackupView,
    BringUpView,
    DatabaseCheck,
    DrivesRequest,
    RecordingsView,
    RemovalRequest,
    StepValues,
    SystemView,
)
from backend.server import (
    COOKIE_PATH,
    LIVE,
    PUBLIC,
    ThreadRoute,
    find_authentication,
    read_credentials,
    render_message_page,
    set_session_cookie,
)

_log = logging.getLogger(__name__)

# Bring up ------------------------------------------------------------------------------------------
#
# Bring a rig up: its steps, one at a time.


bring_up_router = APIRouter(prefix="/api/bring-up", tags=["bring-up"], route_class=ThreadRoute)


@bring_up_router.get("")
async def get_bring_up(service: CurrentService, _person: SignedInUser) -> BringUpView:
    """Return all steps in order, how each stands, and the one that is under way."""
    return await service.bring_up.view()


@bring_up_router.post("/confirm")
async def confirm_bring_up(service: CurrentService, _person: ActuatorOperator) -> BringUpView:
    """Confirm what the step under way asks a person to do."""
    return await service.bring_up.confirm()


@bring_up_router.post("/cancel")
async def cancel_bring_up(service: CurrentService, _person: ActuatorOperator) -> BringUpView:
    """Give up the step under way; nothing of it is kept."""
    return await service.bring_up.cancel()


@bring_up_router.post("/drives")
async def switch_drives(body: DrivesRequest, service: CurrentService, person: ActuatorOperator) -> BringUpView:
    """Switch the drives off, at any time, or once no hand is at the rig on, in off and between two steps only."""
    return await service.bring_up.switch_drives(body.on, person.name)


@bring_up_router.post("/{step}", status_code=202)
async def start_bring_up(
    step: StepId, body: StepValues, service: CurrentService, person: ActuatorOperator
) -> BringUpView:
    """Start a step; refused while another one is under way, and where something has to come before it."""
    return await service.bring_up.start(step, body.values, person.name)


# Site ----------------------------------------------------------------------------------------------
#
# The pages: sign-in by link, the dashboard's built files, the documentation of the interface.


STATIC = Path(__file__).parents[2] / "static"

site_router = APIRouter(include_in_schema=False)


@site_router.get("/")
async def index(request: Request, token: str | None = None, name: str = "") -> Response:
    """Sign in by the link's token, then show the dashboard under an address without it."""
    if token is None:
        return _dashboard()
    authentication = find_authentication(request)
    try:
        person = authentication.sign_in(read_credentials(request), token, name)
    except RequestRejectedError as error:
        return render_message_page(STATUS_BY_CODE[error.category], str(error))
    answer = RedirectResponse("./", status_code=303)  # from here: a proxy may have a path before it
    set_session_cookie(authentication, request, answer, person)
    await authentication.sessions.save()
    return answer


@site_router.get("/api/docs")
async def documentation() -> RedirectResponse:
    """Show the documentation of this interface, from files of this service alone."""
    return RedirectResponse("../docs.html")


@site_router.get("/api/openapi.json")
async def description(request: Request, _person: SignedInUser) -> dict[str, Any]:
    """Return the description of this interface."""
    application: FastAPI = request.app
    public: PublicUrl | None = request.scope.get(PUBLIC)
    prefix = "" if public is None or request.scope[COOKIE_PATH] == "/" else public.prefix
    return {**application.openapi(), **({"servers": [{"url": prefix}]} if prefix else {})}


def mount_static(app: FastAPI) -> None:
    """Serve the dashboard's built files; its pages are told apart behind the #, so "/" is all of them."""
    if STATIC.is_dir():
        app.mount("/", _Files(app))


class _Files(StaticFiles):
    """The built files. Every address comes here that no route answers, so other methods of a route are refused here."""

    def __init__(self, app: FastAPI) -> None:
        super().__init__(directory=STATIC)
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer with a file, or refuse with the methods that the address takes."""
        if scope["type"] == "http" and scope["path"].startswith("/api/") and (allowed := self._allowed(scope)):
            raise HTTPException(405, headers={"Allow": ", ".join(allowed)})
        await super().__call__(scope, receive, send)

    def _allowed(self, scope: Scope) -> list[str]:
        asked = {**scope, "root_path": scope.get("app_root_path", ""), "path_params": {}}
        methods: set[str] = set()
        included = (getattr(one, "original_router", None) for one in self._app.routes)
        for route in (*self._app.routes, *(route for router in included if router for route in router.routes)):
            if isinstance(route, Route) and route.matches(asked)[0] is Match.PARTIAL:
                methods |= route.methods or set()
        return sorted(methods | {"HEAD"} if "GET" in methods else methods)


def _dashboard() -> Response:
    file = STATIC / "index.html"
    if not file.is_file():
        return render_message_page(
            503, "The dashboard's pages are not built yet: run make frontend, then load this page again."
        )
    return FileResponse(file, headers={"Cache-Control": "no-cache"})


# Stream --------------------------------------------------------------------------------------------
#
# The websocket of live samples, state and marks.


stream_router = APIRouter()


@stream_router.websocket(LIVE)
async def live(websocket: WebSocket) -> None:
    """Stream to a signed-in person until either side ends it."""
    person, service = require_signed_in(websocket), get_service(websocket)
    await websocket.accept()
    _log.info("A live stream to %s opened.", person.name)
    try:
        await serve_live_stream(service.live, websocket, lambda ping: service.control.record_ping(person, ping.control))
    finally:
        _log.info("A live stream to %s closed.", person.name)


# System --------------------------------------------------------------------------------------------
#
# Machine, timing, disk, database; backups; room for recordings.


system_router = APIRouter(prefix="/api/system", tags=["system"], route_class=ThreadRoute)


@system_router.get("")
def get_system(service: CurrentService, _person: SignedInUser) -> SystemView:
    """Return what was granted to the loop, how late its ticks are, versions, disk, database and its backups."""
    return service.maintenance.describe_system()


@system_router.post("/check")
def check_database(service: CurrentService, _person: Operator) -> DatabaseCheck:
    """Check the whole database while it is in use."""
    return service.maintenance.check_database()


@system_router.post("/backups", status_code=201)
def make_backup(service: CurrentService, person: Operator) -> BackupView:
    """Copy the database to the data folder while it is in use; `sinew db restore` brings a copy back."""
    return service.maintenance.back_up_database(person.name)


@system_router.get("/recordings")
def get_recordings(service: CurrentService, _person: SignedInUser) -> RecordingsView:
    """Return how much recordings take, and the runs whose samples may go."""
    return service.retention.summarize_recordings()


@system_router.post("/recordings/removal")
def remove_recordings(request: RemovalRequest, service: CurrentService, person: Operator) -> RecordingsView:
    """Delete the samples of exactly these runs; refused as a whole unless each of them may go now."""
    return service.retention.delete_samples(request.runs, person.name)
