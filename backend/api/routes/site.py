"""The pages: sign-in by link, the dashboard's built files, the documentation of the interface."""

from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import FileResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles

from backend.api.auth import SignedIn
from backend.api.errors import STATUS
from backend.public_url import PublicUrl
from backend.refusal import RefusalError
from backend.web_server.cookies import authentication_of, grant, shown_by
from backend.web_server.message_page import message_page
from backend.web_server.proxied import COOKIE_PATH, PUBLIC

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
        app.mount("/", StaticFiles(directory=STATIC))


def _dashboard() -> Response:
    file = STATIC / "index.html"
    if not file.is_file():
        return message_page(
            503, "The dashboard's pages are not built yet: run make frontend, then load this page again."
        )
    return FileResponse(file, headers={"Cache-Control": "no-cache"})
