"""The pages: sign-in by link, the dashboard's built files, the documentation of the interface."""

import html
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles

from backend.api.auth import SignedIn
from backend.api.errors import STATUS
from backend.refusal import RefusalError
from backend.web_server.cookies import authentication_of, grant, shown_by
from backend.web_server.guard import DOCUMENT_POLICY

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
        return _message(STATUS[error.because], str(error))
    answer = RedirectResponse("/", status_code=303)
    grant(authentication, request, answer, person)
    await authentication.sessions.save()
    return answer


@router.get("/api/docs")
async def documentation() -> RedirectResponse:
    """Show the documentation of this interface, from files of this service alone."""
    return RedirectResponse("/docs.html")


@router.get("/api/openapi.json")
async def description(request: Request, _person: SignedIn) -> dict[str, Any]:
    """Return the description of this interface."""
    application: FastAPI = request.app
    return application.openapi()


def mount_static(app: FastAPI) -> None:
    """Serve the dashboard's built files; its pages are told apart behind the #, so "/" is all of them."""
    if STATIC.is_dir():
        app.mount("/", StaticFiles(directory=STATIC))


def _dashboard() -> Response:
    file = STATIC / "index.html"
    if not file.is_file():
        return _message(503, "The dashboard's pages are not built yet: run make frontend, then load this page again.")
    return FileResponse(file, headers={"Cache-Control": "no-cache"})


def _message(status: int, text: str) -> HTMLResponse:
    content = f"<!doctype html><title>Sinew</title><p>{html.escape(text)}</p>"
    return HTMLResponse(content, status_code=status, headers={"Content-Security-Policy": DOCUMENT_POLICY})
