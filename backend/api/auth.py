"""Who is asking, as routes say what they need: anybody signed in, an operator, somebody who presses STOP."""

from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import APIKeyCookie, HTTPBearer
from starlette.requests import HTTPConnection

from backend.auth.authentication import BEARER, OPEN, Person
from backend.errors import Because, RefusalError
from backend.schemas.state import Role
from backend.server.security import COOKIE, authentication_of, shown_by

__all__ = ["BEARER", "OPEN", "MayStop", "Operator", "Person", "SignedIn", "may_stop", "signed_in"]

_SIGN_IN = "sign in again with the link that the service printed at its start, or with a token of the data folder"


def signed_in(connection: HTTPConnection) -> Person:
    """Return the signed-in person. Raises RefusalError for anybody else."""
    person = authentication_of(connection).recognise(shown_by(connection))
    if person is None:
        raise RefusalError(Because.NOT_SIGNED_IN, f"not signed in: {_SIGN_IN}")
    return person


def may_stop(connection: HTTPConnection) -> Person:
    """Return who presses STOP: also somebody whose session is not live any more. Raises RefusalError."""
    person = authentication_of(connection).recognise_for_stop(shown_by(connection))
    if person is None:
        raise RefusalError(Because.NOT_SIGNED_IN, f"not signed in, nothing was stopped: {_SIGN_IN}")
    return person


# Declared for the documentation only: the generated schema names both ways of proving who asks.
_bearer = HTTPBearer(auto_error=False, description="token from the data folder")
_cookie = APIKeyCookie(
    name=f"{COOKIE}8000", auto_error=False, description="from signing in; its name ends with the port of the address"
)

# All of these are coroutines: plain functions would run in threads, and commands would overtake one another there.


async def _signed_in(
    request: Request, _token: Annotated[object, Depends(_bearer)], _session: Annotated[object, Depends(_cookie)]
) -> Person:
    return signed_in(request)


SignedIn = Annotated[Person, Depends(_signed_in)]


async def _may_stop(
    request: Request, _token: Annotated[object, Depends(_bearer)], _session: Annotated[object, Depends(_cookie)]
) -> Person:
    return may_stop(request)


MayStop = Annotated[Person, Depends(_may_stop)]


async def _operator(request: Request, person: SignedIn) -> Person:
    if person.role is not Role.OPERATOR:
        if request.method not in ("GET", "HEAD"):
            request.state.commanding = person, b""  # the log tells who asked for what; a viewer's values are not read
        raise RefusalError(
            Because.NOT_ALLOWED, f"{person.name} is signed in as {person.role}; this needs the operator's token"
        )
    return person


Operator = Annotated[Person, Depends(_operator)]
