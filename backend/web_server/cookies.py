"""What a request shows of who sends it, and the cookie that goes with an answer."""

from fastapi import Response
from starlette.requests import HTTPConnection

from backend.access.authentication import Authentication, Shown
from backend.access.people import Person
from backend.public_url import PublicUrl
from backend.web_server.proxied import COOKIE_PATH, PUBLIC

COOKIE = "sinew_session_"
"""What a cookie's name begins with; the port of the address follows: all ports of a host share one jar."""

KEPT_BY_BROWSER_S = 400 * 24 * 3600
"""As long as browsers keep a cookie at most: how long a session lasts is the service's to say, not a clock's."""

LONGEST_COOKIE = 2000

_SAME_COOKIES = 4
_SHOWN = "sinew.shown"


def authentication_of(connection: HTTPConnection) -> Authentication:
    """Return what tells who asks, of the running service."""
    authentication: Authentication = connection.app.state.authentication
    return authentication


def shown_by(connection: HTTPConnection) -> Shown:
    """Return what a request or websocket shows of who sends it; the same each time it is asked for."""
    shown: Shown | None = connection.scope.get(_SHOWN)
    if shown is None:
        scheme, _, token = connection.headers.get("authorization", "").partition(" ")
        shown = connection.scope[_SHOWN] = Shown(
            address=connection.client.host if connection.client else "unknown",
            token=token.strip() if scheme.lower() == "bearer" else None,
            cookies=_values(connection, cookie_name(connection)),
            is_foreign=connection.headers.get("sec-fetch-site", "none") not in ("none", "same-origin"),
        )
    return shown


def grant(authentication: Authentication, connection: HTTPConnection, response: Response, person: Person) -> None:
    """Put the session cookie of ``person`` on ``response``."""
    value = authentication.cookie(person)
    if value is not None:
        response.set_cookie(
            cookie_name(connection),
            value,
            max_age=KEPT_BY_BROWSER_S,
            httponly=True,
            samesite="strict",
            secure=_is_secure(connection),
            path=_path(connection),
        )


def forget(authentication: Authentication, connection: HTTPConnection, response: Response) -> None:
    """End the session of the cookie, and take the cookie from this browser."""
    authentication.sign_out(shown_by(connection))
    for path in sorted({"/", _path(connection)}):
        response.delete_cookie(
            cookie_name(connection), httponly=True, samesite="strict", secure=_is_secure(connection), path=path
        )


def cookie_name(connection: HTTPConnection) -> str:
    """Return the name of the session cookie at the address that the browser asked for."""
    port = connection.headers.get("host", "").rpartition(":")[2]
    return COOKIE + (port if port.isascii() and port.isdigit() and len(port) <= 5 else "80")


def _is_secure(connection: HTTPConnection) -> bool:
    """Return whether browsers are to send the cookie over https only.

    Behind a public https address always: a request does not show whether it came that way. Chrome and Firefox take
    http://localhost for secure too, so that somebody at this machine can sign in without the proxy.
    """
    public: PublicUrl | None = connection.scope.get(PUBLIC)
    return public is not None and public.is_secure


def _path(connection: HTTPConnection) -> str:
    path: str = connection.scope.get(COOKIE_PATH, "/")
    return path


def _values(connection: HTTPConnection, name: str) -> list[str]:
    """Return the cookies of a name: there may be others beside ours, set by somebody else on this host."""
    pairs = (pair.strip().partition("=") for pair in connection.headers.get("cookie", "").split(";"))
    return [value for found, _, value in pairs if found == name and len(value) <= LONGEST_COOKIE][:_SAME_COOKIES]
