"""The pages: sign-in by link, the dashboard's built files, the documentation of the interface."""

from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, HTTPException, Request
from fastapi.responses import FileResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.routing import Match, Route
from starlette.types import Receive, Scope, Send

from backend.api.auth import SignedIn
from backend.api.errors import STATUS
from backend.errors import RefusalError
from backend.public_url import PublicUrl
from backend.server.deployment import COOKIE_PATH, PUBLIC
from backend.server.security import authentication_of, grant, message_page, shown_by

STATIC = Path(__file__).parents[2] / "static"

router = APIRouter(include_in_schema=False)


@router.get("/")
async def index(request: Request, token: str | None = None, name: str = "") -> Response:
    """Sign in by the link's token, then show the dashboard under an address without it."""
    if token is None:
        return _dashboard()
    authentication = authentication_of(request)
    try:
        person = authentication.sign_in(shown_by(request), token, name)
    except RefusalError as error:
        return message_page(STATUS[error.because], str(error))
    answer = RedirectResponse("./", status_code=303)  # from here: a proxy may have a path before it
    grant(authentication, request, answer, person)
    await authentication.sessions.save()
    return answer


@router.get("/api/docs")
async def documentation() -> RedirectResponse:
    """Show the documentation of this interface, from files of this service alone."""
    return RedirectResponse("../docs.html")


@router.get("/api/openapi.json")
async def description(request: Request, _person: SignedIn) -> dict[str, Any]:
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
        return message_page(
            503, "The dashboard's pages are not built yet: run make frontend, then load this page again."
        )
    return FileResponse(file, headers={"Cache-Control": "no-cache"})
