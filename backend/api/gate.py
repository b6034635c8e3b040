"""Opens with a token, then with the cookie that was given for it; knows whose session is over."""

import asyncio
import secrets
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

from fastapi import Response
from itsdangerous import BadData, URLSafeSerializer
from starlette.requests import HTTPConnection

from backend.api.attempts import Attempts
from backend.api.errors import ApiError
from backend.api.people import BEARER, OPEN, People, Person, printable
from backend.api.schemas.session import Role
from backend.api.sessions import Sessions
from backend.api.tokens import TokenFiles, Tokens
from backend.supervision import Part

PART = Part(
    "The watch over the token files", "Tokens that are changed by the command line come into force at the next start."
)

COOKIE = "sinew_session_"
"""What a cookie's name begins with; the port of the address follows: all ports of a host share one jar."""

KEPT_BY_BROWSER_S = 400 * 24 * 3600
"""As long as browsers keep a cookie at most: how long a session lasts is the service's to say, not a clock's."""

LONGEST_COOKIE, LONGEST_TOKEN = 2000, 200
LOOK_S = 0.5
SAVE_S = 3600.0
GRACE_S = 10.0
"""So long [s] the cookie that a browser sent before it rotated the tokens is still good for STOP."""

_SAME_COOKIES = 4
_KNOWN = "sinew.recognised"


@dataclass(frozen=True)
class _Replaced:
    """The tokens before the last rotation, good for STOP of the one session that asked for it, ``until`` [s]."""

    tokens: Tokens
    session: str
    until: float


class Gate:
    """Tells who asks. ``files`` None leaves the door open: everyone is an operator.

    Cookies are signed with the token of their role. Which of them are live is up to ``sessions``; one that is genuine
    and neither live nor signed out is good for STOP alone.
    """

    def __init__(
        self,
        files: TokenFiles | None,
        sessions: Sessions | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._files = files
        self._clock = clock
        self._attempts = Attempts(clock)
        self._replaced: _Replaced | None = None
        self._turn = asyncio.Lock()
        self.sessions = sessions or Sessions()
        self.people = People()

    def sign_in(self, connection: HTTPConnection, token: str, name: str = "") -> Person:
        """Return who ``token`` belongs to. Raises ApiError 401 for a wrong one, 429 after too many of them.

        A browser that is signed in already goes on with its session, or ends it where it is another person's now.
        """
        if self._files is None:
            return Person(printable(name) or Role.OPERATOR, Role.OPERATOR, OPEN)
        role = self._files.tokens.role_of(token[:LONGEST_TOKEN])
        if role is None:
            self._count_wrong(connection)
            raise ApiError(401, "wrong token; use the sign-in link that the service printed at its start")
        called, before = printable(name), self._person_of_cookie(connection)
        if before is not None and before.role is role and called in ("", before.called):
            return before
        if before is not None:
            self.sessions.end(before.session)
            self._dismiss()
        session = secrets.token_urlsafe(12)
        self.sessions.begin(session, role)
        return Person(self.people.shown(called, role, session), role, session, called or role)

    def grant(self, connection: HTTPConnection, response: Response, person: Person) -> None:
        """Put the session cookie on ``response``."""
        if self._files is None or person.session in (BEARER, OPEN):
            return
        content = {"name": person.name, "called": person.called, "role": person.role, "session": person.session}
        value = _signer(self._files.tokens, person.role).dumps(content)
        response.set_cookie(
            cookie_name(connection), value, max_age=KEPT_BY_BROWSER_S, httponly=True, samesite="strict", path="/"
        )

    def sign_out(self, connection: HTTPConnection, response: Response) -> None:
        """End the session of the cookie, wherever else that cookie may be by now."""
        person = self._genuine(connection)
        if person is not None:
            self.sessions.end(person.session)
            self._dismiss()
        response.delete_cookie(cookie_name(connection), httponly=True, samesite="strict", path="/")

    def recognise(self, connection: HTTPConnection) -> Person | None:
        """Return who sends this request or opens this websocket, None when not signed in. Raises ApiError 401, 429.

        May be asked as often as one likes: a wrong token counts once for each request.
        """
        if self._files is None:
            return Person(Role.OPERATOR, Role.OPERATOR, OPEN)
        scheme, _, token = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self._person_of_bearer(connection, token.strip())
        return self._person_of_cookie(connection)

    def recognise_for_stop(self, connection: HTTPConnection) -> Person | None:
        """Return who presses STOP: also somebody whose session fell asleep or was forgotten, not one signed out."""
        person = self.recognise(connection)
        if person is None:
            person = self._genuine(connection)
        return person

    async def rotate(self, roles: list[Role], person: Person) -> Tokens:
        """Put new tokens in force at once; all sessions of ``roles`` end but that of ``person``.

        Raises ApiError 409 where no token is asked for, 503 when they cannot be written: the old ones hold then.
        """
        if self._files is None:
            raise ApiError(409, "this service asks for no token: there is nothing to rotate")
        async with self._turn:
            self._replaced = _Replaced(self._files.tokens, person.session, self._clock() + GRACE_S)
            try:
                await asyncio.to_thread(self._files.rotate, roles)
            except OSError as error:
                raise ApiError(503, f"the new tokens cannot be written: {error.strerror or error}") from error
            await self._refresh(but=person.session)
        await self.sessions.save()
        return self._files.tokens

    async def run(self) -> None:
        """Notice token files that were changed, and keep the file of sessions fresh, until cancelled."""
        saved = self._clock()
        while True:
            await asyncio.sleep(LOOK_S)
            async with self._turn:
                changed = await self._refresh()
            if changed or self._clock() - saved > SAVE_S:
                saved = self._clock()
                for _, person in self.people.connected():
                    self.sessions.use(person.session)
                await self.sessions.save()

    async def _refresh(self, but: str | None = None) -> bool:
        if self._files is None:
            return False
        changed = await asyncio.to_thread(self._files.refresh)
        for role in changed:
            self.sessions.end_all(role, but)
        self._dismiss(changed)
        return bool(changed)

    def _dismiss(self, bearers: Collection[Role] = ()) -> None:
        """Close the websockets of sessions that are over, and of scripts whose token was replaced."""
        for over, person in self.people.connected():
            if person.session == BEARER:
                ended = person.role in bearers
            else:
                ended = person.session != OPEN and not self.sessions.is_live(person.session)
            if ended:
                over.set()

    def _person_of_bearer(self, connection: HTTPConnection, token: str) -> Person:
        # The right token passes whatever others have tried: a script that stops the rig must not be locked out.
        role = self._files.tokens.role_of(token[:LONGEST_TOKEN]) if self._files else Role.OPERATOR
        if role is None:
            self._count_wrong(connection)
            raise ApiError(401, "wrong token; use the one in the data folder")
        return Person(role, role, BEARER)

    def _person_of_cookie(self, connection: HTTPConnection) -> Person | None:
        person = self._genuine(connection, replaced=False)
        return person if person is not None and self.sessions.use(person.session) else None

    def _genuine(self, connection: HTTPConnection, replaced: bool = True) -> Person | None:
        """Return whose cookie this is, however old, unless it was signed out."""
        if self._files is None:
            return None
        for value in _values(connection, cookie_name(connection)):
            for tokens, only in self._accepted(replaced):
                person = _read(value, tokens)
                if person is None or only not in (None, person.session):
                    continue
                if not self.sessions.was_ended(person.session):
                    return person
        return None

    def _accepted(self, replaced: bool) -> Iterator[tuple[Tokens, str | None]]:
        if self._files is not None:
            yield self._files.tokens, None
        if replaced and self._replaced is not None and self._clock() < self._replaced.until:
            yield self._replaced.tokens, self._replaced.session

    def _count_wrong(self, connection: HTTPConnection) -> None:
        scope = connection.scope
        # What a page of somebody else makes a browser send says nothing about the person at that browser.
        foreign = connection.headers.get("sec-fetch-site", "none") not in ("none", "same-origin")
        if foreign or scope.get(_KNOWN):
            return
        scope[_KNOWN] = True
        self._attempts.failed(address_of(connection))


def address_of(connection: HTTPConnection) -> str:
    """Return the address of the other end."""
    return connection.client.host if connection.client else "unknown"


def cookie_name(connection: HTTPConnection) -> str:
    """Return the name of the session cookie at the address that the browser asked for."""
    port = connection.headers.get("host", "").rpartition(":")[2]
    return COOKIE + (port if port.isascii() and port.isdigit() and len(port) <= 5 else "80")


def _values(connection: HTTPConnection, name: str) -> list[str]:
    """Return the cookies of a name: there may be others beside ours, set by somebody else on this host."""
    pairs = (pair.strip().partition("=") for pair in connection.headers.get("cookie", "").split(";"))
    return [value for found, _, value in pairs if found == name and len(value) <= LONGEST_COOKIE][:_SAME_COOKIES]


def _read(value: str, tokens: Tokens) -> Person | None:
    for role in Role:
        try:
            content = _signer(tokens, role).loads(value)
        except BadData:
            continue
        return replace(Person(content["name"], role, content["session"]), called=content["called"])
    return None


def _signer(tokens: Tokens, role: Role) -> URLSafeSerializer:
    return URLSafeSerializer(tokens.of(role), salt=f"session of {role}")
