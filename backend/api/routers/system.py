"""Routes of the system, commissioning, live stream and built pages."""

import logging
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, HTTPException, Request, WebSocket
from fastapi.responses import FileResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.routing import Match, Route
from starlette.types import Receive, Scope, Send

from backend.api import messages
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

# Commissioning -------------------------------------------------------------------------------------


bring_up_router = APIRouter(prefix="/api/bring-up", tags=["bring-up"], route_class=ThreadRoute)


@bring_up_router.get("")
async def get_bring_up(service: CurrentService, _person: SignedInUser) -> BringUpView:
    """Return all steps in order with their states, and the running step."""
    return await service.bring_up.view()


@bring_up_router.post("/confirm")
async def confirm_bring_up(service: CurrentService, _person: ActuatorOperator) -> BringUpView:
    """Confirm the action that the running step requests."""
    return await service.bring_up.confirm()


@bring_up_router.post("/cancel")
async def cancel_bring_up(service: CurrentService, _person: ActuatorOperator) -> BringUpView:
    """Cancel the running step without a result; a direction test that has started a motor is stored as failed."""
    return await service.bring_up.cancel()


@bring_up_router.post("/drives")
async def switch_drives(body: DrivesRequest, service: CurrentService, person: ActuatorOperator) -> BringUpView:
    """Disable the drives at any time, or enable them in mode off between two steps."""
    return await service.bring_up.switch_drives(body.on, person.name)


@bring_up_router.post("/{step}", status_code=202)
async def start_bring_up(
    step: StepId, body: StepValues, service: CurrentService, person: ActuatorOperator
) -> BringUpView:
    """Start a step; rejected while another one runs, and before the steps it requires."""
    return await service.bring_up.start(step, body.values, person.name)


# Pages ---------------------------------------------------------------------------------------------


STATIC = Path(__file__).parents[2] / "static"

site_router = APIRouter(include_in_schema=False)


@site_router.get("/")
async def index(request: Request, token: str | None = None, name: str = "") -> Response:
    """Sign in with the link's token, then redirect to the address without it."""
    if token is None:
        return _dashboard()
    authentication = find_authentication(request)
    try:
        person = authentication.sign_in(read_credentials(request), token, name)
    except RequestRejectedError as error:
        return render_message_page(STATUS_BY_CODE[error.category], str(error))
    answer = RedirectResponse("./", status_code=303)  # relative: a proxy may add a path prefix
    set_session_cookie(authentication, request, answer, person)
    await authentication.sessions.save()
    return answer


@site_router.get("/api/docs")
async def documentation() -> RedirectResponse:
    """Redirect to the documentation of this interface, which needs no other server."""
    return RedirectResponse("../docs.html")


@site_router.get("/api/openapi.json")
async def description(request: Request, _person: SignedInUser) -> dict[str, Any]:
    """Return the OpenAPI schema."""
    application: FastAPI = request.app
    public: PublicUrl | None = request.scope.get(PUBLIC)
    prefix = "" if public is None or request.scope[COOKIE_PATH] == "/" else public.prefix
    return {**application.openapi(), **({"servers": [{"url": prefix}]} if prefix else {})}


def mount_static(app: FastAPI) -> None:
    """Serve the dashboard's built files; all its pages have the path "/"."""
    if STATIC.is_dir():
        app.mount("/", _Files(app))


class _Files(StaticFiles):
    """The built files, mounted after all routes.

    Requests of an existing route with another method arrive here too and are rejected.
    """

    def __init__(self, app: FastAPI) -> None:
        super().__init__(directory=STATIC)
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send a file, or reject the method with the allowed ones."""
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
        return render_message_page(503, messages.dashboard_not_built())
    return FileResponse(file, headers={"Cache-Control": "no-cache"})


# Live stream ---------------------------------------------------------------------------------------


stream_router = APIRouter()


@stream_router.websocket(LIVE)
async def live(websocket: WebSocket) -> None:
    """Send the live stream to a signed-in user until either side ends it."""
    person, service = require_signed_in(websocket), get_service(websocket)
    await websocket.accept()
    _log.info("A live stream to %s opened.", person.name)
    try:
        await serve_live_stream(service.live, websocket, lambda ping: service.control.record_ping(person, ping.control))
    finally:
        _log.info("A live stream to %s closed.", person.name)


# System --------------------------------------------------------------------------------------------


system_router = APIRouter(prefix="/api/system", tags=["system"], route_class=ThreadRoute)


@system_router.get("")
def get_system(service: CurrentService, _person: SignedInUser) -> SystemView:
    """Return real-time status, lateness, versions, disk, database and backups."""
    return service.maintenance.describe_system()


@system_router.post("/check")
def check_database(service: CurrentService, _person: Operator) -> DatabaseCheck:
    """Check the whole database while it is in use."""
    return service.maintenance.check_database()


@system_router.post("/backups", status_code=201)
def make_backup(service: CurrentService, person: Operator) -> BackupView:
    """Copy the database to the data folder while it is in use; `sinew db restore` restores a copy."""
    return service.maintenance.back_up_database(person.name)


@system_router.get("/recordings")
def get_recordings(service: CurrentService, _person: SignedInUser) -> RecordingsView:
    """Return the size of the recordings, and the runs whose samples may be deleted."""
    return service.retention.summarize_recordings()


@system_router.post("/recordings/removal")
def remove_recordings(request: RemovalRequest, service: CurrentService, person: Operator) -> RecordingsView:
    """Delete the samples of these runs; rejected unless all of them may be deleted."""
    return service.retention.delete_samples(request.runs, person.name)
