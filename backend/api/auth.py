"""Who is asking: session cookie, bearer token, roles, and how often a wrong token may be tried."""

import secrets
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request, Response
from fastapi.security import APIKeyCookie, HTTPBearer
from itsdangerous import BadData, URLSafeTimedSerializer
from starlette.requests import HTTPConnection

from backend.api.errors import ApiError
from backend.api.schemas.session import Role
from backend.api.tokens import Tokens

COOKIE = "sinew_session"
SESSION_S = 30 * 24 * 3600
BEARER, OPEN = "bearer", "open"
"""The ``session`` of all who send a token with each request, and of all where no token is needed."""

ATTEMPTS = 10
ATTEMPTS_WINDOW_S = 60.0


@dataclass(frozen=True)
class Person:
    """Someone who is signed in. ``session`` tells two browsers of one name apart."""

    name: str
    role: Role
    session: str


class Gate:
    """Opens with a token, then with the cookie that was given for it.

    The cookie is signed with a key made of the tokens, so sessions outlive a restart of the service and end when the
    tokens are replaced. ``tokens`` None leaves the door open: everyone is an operator.
    """

    def __init__(self, tokens: Tokens | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._tokens = tokens
        self._cookies = URLSafeTimedSerializer(tokens.signing_key, salt="session") if tokens else None
        self._clock = clock
        self._failures: dict[str, deque[float]] = {}

    def sign_in(self, token: str, name: str, address: str) -> Person:
        """Return who ``token`` belongs to. Raises ApiError 401 for a wrong one, 429 after too many of them."""
        if self._tokens is None:
            return Person(name or Role.OPERATOR, Role.OPERATOR, secrets.token_urlsafe(12))
        failures = self._recent_failures(address)
        if len(failures) >= ATTEMPTS:
            wait_s = int(failures[0] + ATTEMPTS_WINDOW_S - self._clock()) + 1
            raise ApiError(429, f"too many wrong tokens; try again in {wait_s} s", headers={"Retry-After": str(wait_s)})
        role = self._tokens.role_of(token)
        if role is None:
            failures.append(self._clock())
            raise ApiError(401, "wrong token; use the sign-in link that the service printed at its start")
        return Person(name.strip() or role, role, secrets.token_urlsafe(12))

    def grant(self, response: Response, person: Person) -> None:
        """Put the session cookie on ``response``."""
        if self._cookies is not None:
            value = self._cookies.dumps({"name": person.name, "role": person.role, "session": person.session})
            response.set_cookie(COOKIE, value, max_age=SESSION_S, httponly=True, samesite="strict", path="/")

    def recognise(self, connection: HTTPConnection) -> Person | None:
        """Return who sends this request or opens this websocket, None when not signed in. Raises ApiError 401, 429."""
        if self._tokens is None:
            return Person(Role.OPERATOR, Role.OPERATOR, OPEN)
        scheme, _, token = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self._person_of_bearer(token.strip(), address_of(connection))
        return self._person_of_cookie(connection.cookies.get(COOKIE))

    def _person_of_bearer(self, token: str, address: str) -> Person:
        # The right token passes whatever others have tried: a script that stops the rig must not be locked out.
        role = self._tokens.role_of(token) if self._tokens else Role.OPERATOR
        if role is None:
            return self.sign_in(token, "", address)
        return Person(role, role, BEARER)

    def _person_of_cookie(self, cookie: str | None) -> Person | None:
        if cookie is None or self._cookies is None:
            return None
        try:
            content = self._cookies.loads(cookie, max_age=SESSION_S)
        except BadData:
            return None
        return Person(content["name"], Role(content["role"]), content["session"])

    def _recent_failures(self, address: str) -> deque[float]:
        oldest = self._clock() - ATTEMPTS_WINDOW_S
        for known in [key for key, times in self._failures.items() if not times or times[-1] < oldest]:
            del self._failures[known]
        failures = self._failures.setdefault(address, deque(maxlen=ATTEMPTS))
        while failures and failures[0] < oldest:
            failures.popleft()
        return failures


def address_of(connection: HTTPConnection) -> str:
    """Return the address of the other end."""
    return connection.client.host if connection.client else "unknown"


def gate_of(connection: HTTPConnection) -> Gate:
    """Return the gate of the running service."""
    gate: Gate = connection.app.state.gate
    return gate


def signed_in(connection: HTTPConnection) -> Person:
    """Return the signed-in person. Raises ApiError 401 for anybody else."""
    person = gate_of(connection).recognise(connection)
    if person is None:
        raise ApiError(401, "not signed in; open the sign-in link that the service printed at its start")
    return person


# Declared for the documentation only: the generated schema names both ways of proving who asks.
_bearer = HTTPBearer(auto_error=False, description="token from the data folder")
_cookie = APIKeyCookie(name=COOKIE, auto_error=False)


def _signed_in(
    request: Request, _token: Annotated[object, Depends(_bearer)], _session: Annotated[object, Depends(_cookie)]
) -> Person:
    return signed_in(request)


SignedIn = Annotated[Person, Depends(_signed_in)]


def _operator(person: SignedIn) -> Person:
    if person.role is not Role.OPERATOR:
        raise ApiError(403, f"{person.name} is signed in as {person.role}; this needs the operator's token")
    return person


Operator = Annotated[Person, Depends(_operator)]
